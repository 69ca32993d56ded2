"""What exports are made from: checked, and what a recording lacks or has wrong is one line."""

from dataclasses import replace

import numpy as np
import pytest
from shipped import shipped, shipped_recording

from highfive.hil.recording.exports.session_arrays import session_arrays
from highfive.hil.recording.recording import RecordedMessage
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


def test_trials_are_the_parts_of_the_whole():
    whole, parts = shipped(), [shipped().trial(place) for place in range(4)]
    for name in ("times", "root", "quaternions", "seen", "age"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))
    assert [part.spans[0].number for part in parts] == [0, 1, 2, 3]
    assert all((part.trials == part.spans[0].number).all() for part in parts)


def test_joints_are_the_skeletons():
    recording = shipped_recording()
    np.testing.assert_allclose(shipped().positions[:, 0], recording.arrays("/avatar")["root"])
    assert np.allclose(np.linalg.norm(shipped().orientations, axis=-1), 1.0)


def test_an_older_recording_has_no_markers():
    arrays = session_arrays(without(shipped_recording(), "/markers"), "old.mcap")
    assert arrays.names == () and arrays.markers.shape == (918, 0, 3)


def test_a_marker_that_was_never_seen_has_no_age():
    arrays = session_arrays(changed("/person", lambda d: d | {"age_ns": 2**63 - 1}), "s.mcap")
    assert np.isnan(arrays.age).all()


@pytest.mark.parametrize(
    ("recording", "says"),
    [
        (replace(shipped_recording(), joints=("a", "b")), "another avatar: 2 joints, this one has 53"),
        (without(shipped_recording(), "/tick"), "holds no high five"),
        (without(shipped_recording(), "/person"), "holds no high five"),
        (replace(without(shipped_recording(), "/avatar"), complete=False), "holds no high five.*cut short"),
        (changed("/tick", lambda d: d | {"trial": None}), "another version"),
        (changed("/tick", lambda d: {"phase": ""}), "another version"),
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
def test_what_cannot_be_exported_is_one_line(recording, says):
    with pytest.raises(HighFiveError, match=says) as error:
        session_arrays(recording, "s.mcap")
    assert "\n" not in str(error.value)


def test_a_number_that_is_not_there_is_named_with_those_that_are():
    with pytest.raises(HighFiveError, match=r"no high five 7.*0, 1, 2, 3"):
        shipped().place_of(7)
