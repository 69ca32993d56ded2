"""What exports are made from: checked, and what a recording lacks or has wrong is one line."""

from dataclasses import replace

import numpy as np
import pytest
from shipped import shipped_recording, shipped_trials, written

from highfive.hil.recording.exports.trial_arrays import TrialArrays, export_trials
from highfive.hil.recording.recording import RecordedMessage, SessionRecording
from highfive.hil.recording.session_reader import read_session
from highfive.model.errors import HighFiveError


def changed(topic, change, every=True):
    """The shipped recording with messages of a topic changed: all, or the tenth alone."""
    recording = shipped_recording()
    messages = tuple(
        RecordedMessage(m.time_ns, change(dict(m.data))) if every or i == 10 else m
        for i, m in enumerate(recording.channels[topic])
    )
    return replace(recording, channels={**recording.channels, topic: messages})


def without(recording, topic):
    return replace(recording, channels={**recording.channels, topic: ()})


def arrays_of(recording: SessionRecording) -> list[TrialArrays]:
    return [trial.load() for trial in export_trials(read_session(written(recording)))]


def test_high_fives_are_the_parts_of_the_whole():
    whole, parts = shipped_recording(), shipped_trials()
    np.testing.assert_allclose(np.concatenate([part.times for part in parts]), whole.arrays("/tick")["time"])
    np.testing.assert_array_equal(np.concatenate([part.root for part in parts]), whole.arrays("/avatar")["root"])
    np.testing.assert_array_equal(np.concatenate([part.seen for part in parts]), whole.arrays("/markers")["seen"])
    numbers = whole.arrays("/tick")["trial"]
    assert [part.span.number for part in parts] == [0, 1, 2, 3]
    assert [len(part) for part in parts] == [(numbers == part.span.number).sum() for part in parts]


def test_joints_are_the_skeletons():
    root = np.concatenate([part.positions[:, 0] for part in shipped_trials()])
    np.testing.assert_allclose(root, shipped_recording().arrays("/avatar")["root"])
    for part in shipped_trials():
        assert np.allclose(np.linalg.norm(part.orientations, axis=-1), 1.0)


@pytest.mark.slow
def test_an_older_recording_has_no_markers():
    for arrays in arrays_of(without(shipped_recording(), "/markers")):
        assert arrays.names == () and arrays.markers.shape == (len(arrays), 0, 3)


def test_a_marker_that_was_never_seen_has_no_age():
    for arrays in arrays_of(changed("/person", lambda d: d | {"age_ns": 2**63 - 1})):
        assert np.isnan(arrays.age).all()


@pytest.mark.parametrize(
    ("recording", "says"),
    [
        (replace(shipped_recording(), joints=("a", "b")), "another avatar: 2 joints, this one has 53"),
        (without(shipped_recording(), "/tick"), "holds no high five that can be exported: /tick not recorded"),
        (without(shipped_recording(), "/person"), "holds no high five that can be exported: /person not recorded"),
        (replace(without(shipped_recording(), "/avatar"), complete=False), "/avatar not recorded; it is cut short"),
        (changed("/tick", lambda d: {}), "another version.*phase is missing"),
        (changed("/avatar", lambda d: d | {"root": [0.0, 1.0]}, False), "/avatar: root is not made of numbers"),
        (
            changed("/avatar", lambda d: d | {"quaternions": d["quaternions"][1:]}),
            r"quaternions has the shape \(52, 4\)",
        ),
        (changed("/avatar", lambda d: d | {"quaternions": [[2.0, 0, 0, 0]] * 53}, False), "no rotation"),
        (changed("/person", lambda d: d | {"wrist": [0.0, float("nan"), 0.0]}, False), "wrist.*not finite"),
        (changed("/person", lambda d: {k: v for k, v in d.items() if k != "palm"}, False), "palm is missing"),
        (changed("/markers", lambda d: d | {"names": ["A"]}, False), "the names change"),
        (changed("/markers", lambda d: d | {"positions": [[0.0, 0.0, 0.0]] * 3}, False), "do not fit the names"),
        (changed("/markers", lambda d: d | {"names": 7}), "no list of texts"),
    ],
)
@pytest.mark.slow
def test_what_cannot_be_exported_is_one_line(recording, says):
    with pytest.raises(HighFiveError, match=says) as error:
        arrays_of(recording)
    assert "\n" not in str(error.value)
