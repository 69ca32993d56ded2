"""High fives of a recording, by the numbers that its ticks bear."""

from dataclasses import replace

import pytest
from shipped import shipped_recording

from highfive.hil.recording.exports.export_file import trial_names
from highfive.hil.recording.recording import RecordedMessage, SessionRecording
from highfive.hil.recording.trial_spans import trial_spans
from highfive.model.errors import HighFiveError


def recording(ticks, trials=(), contacts=()) -> SessionRecording:
    channels = {"/tick": ticks, "/trial": trials, "/contact": contacts}
    made = {topic: tuple(RecordedMessage(t, {"trial": n}) for t, n in rows) for topic, rows in channels.items()}
    return SessionRecording({}, (), made, True)


def test_spans_cover_the_ticks_without_overlap():
    spans, ticks = trial_spans(shipped_recording()), shipped_recording().channels["/tick"]
    inside = [[s.number for s in spans if s.start_ns <= tick.time_ns <= s.end_ns] for tick in ticks]
    assert inside == [[tick.data["trial"]] for tick in ticks]
    assert [span.text("emotion") for span in spans] == ["neutral", "happy", "angry", "sad"]
    assert all(span.contact["trial"] == span.number for span in spans)


def test_trial_and_contact_may_come_at_any_time_or_not_at_all():
    spans = trial_spans(recording([(5, 3), (6, 3), (9, 4)], trials=[(4, 3)], contacts=[(20, 4)]))
    assert [(s.number, s.start_ns, s.end_ns) for s in spans] == [(3, 5, 6), (4, 9, 9)]
    assert [bool(s.about) for s in spans] == [True, False]
    assert [bool(s.contact) for s in spans] == [False, True]
    assert spans[1].text("emotion") == ""


def test_one_that_was_broken_off_has_the_number_of_the_next_and_no_contact():
    second = 1_000_000_000
    ticks = [(0, 3), (8, 3), (second + 8, 3), (second + 16, 3), (2 * second, 4)]
    spans = trial_spans(recording(ticks, trials=[(second + 8, 3)], contacts=[(second + 16, 3)]))
    assert [(s.number, s.start_ns, s.end_ns) for s in spans] == [
        (3, 0, 8), (3, second + 8, second + 16), (4, 2 * second, 2 * second),
    ]  # fmt: skip
    assert [bool(s.contact) for s in spans] == [False, True, False]
    assert trial_names("s", spans, ".bvh") == ["s_trial03.bvh", "s_trial03-2.bvh", "s_trial04.bvh"]


def test_no_ticks_are_no_high_fives():
    assert trial_spans(replace(shipped_recording(), channels={**shipped_recording().channels, "/tick": ()})) == ()


def test_ticks_without_a_number_are_of_another_version():
    with pytest.raises(HighFiveError, match="another version"):
        trial_spans(recording([(1, None)]))


def test_one_that_begins_again_at_once_is_another_one() -> None:
    spans = trial_spans(recording([(5, 3), (6, 3), (7, 3), (8, 3)], trials=[(5, 3), (7, 3)], contacts=[(8, 3)]))
    assert [(s.number, s.start_ns, s.end_ns, bool(s.contact)) for s in spans] == [(3, 5, 6, False), (3, 7, 8, True)]
