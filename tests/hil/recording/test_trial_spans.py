"""Where high fives begin and end: one rule, for whatever reads a recording."""

from dataclasses import replace

from shipped import shipped_recording

from highfive.hil.recording.exports.export_file import trial_names
from highfive.hil.recording.session_reader import read_session
from highfive.hil.recording.trial_spans import StoredMessage, TrialSpan, high_fives, span_of
from highfive.hil.view import SHIPPED_RECORDING


def spans(*rows: tuple[str, int, int | None]) -> list[TrialSpan]:
    """Of messages as they stand in a file: topic, time, the number of the high five that it names."""
    stored = [
        StoredMessage(topic, time_ns, {} if number is None else {"trial": number}, (0, place))
        for place, (topic, time_ns, number) in enumerate(rows)
    ]
    return [span for found in high_fives(stored) if (span := span_of(found)) is not None]


def test_high_fives_cover_the_ticks_without_overlap():
    found, ticks = read_session(SHIPPED_RECORDING).spans, shipped_recording().channels["/tick"]
    inside = [[s.number for s in found if s.start_ns <= tick.time_ns <= s.end_ns] for tick in ticks]
    assert inside == [[tick.data["trial"]] for tick in ticks]
    assert [span.text("emotion") for span in found] == ["neutral", "happy", "angry", "sad"]
    assert all(span.contact["trial"] == span.number for span in found)


def test_trial_and_contact_may_be_missing():
    found = spans(("/trial", 4, 3), ("/tick", 5, 3), ("/tick", 6, 3), ("/tick", 9, 4), ("/contact", 20, 4))
    assert [(s.number, s.start_ns, s.end_ns) for s in found] == [(3, 5, 6), (4, 9, 9)]
    assert [bool(s.about) for s in found] == [True, False]
    assert [bool(s.contact) for s in found] == [False, True]
    assert found[1].text("emotion") == ""


def test_what_was_recorded_at_the_time_of_a_tick_is_of_its_high_five():
    found = spans(
        ("/avatar", 5, None), ("/tick", 5, 3), ("/contact", 5, 3), ("/avatar", 8, None), ("/tick", 8, 4)
    )  # fmt: skip
    assert [(s.first, s.last) for s in found] == [((0, 0), (0, 2)), ((0, 3), (0, 4))]


def test_one_that_was_broken_off_has_the_number_of_the_next_and_no_contact():
    found = spans(
        ("/trial", 0, 3), ("/tick", 0, 3), ("/tick", 8, 3), ("/trial", 9, 3), ("/tick", 9, 3), ("/tick", 16, 3),
        ("/contact", 16, 3), ("/trial", 20, 4), ("/tick", 20, 4),
    )  # fmt: skip
    assert [(s.number, s.start_ns, s.end_ns) for s in found] == [(3, 0, 8), (3, 9, 16), (4, 20, 20)]
    assert [bool(s.contact) for s in found] == [False, True, False]
    assert trial_names("s", found, ".bvh") == ["s_trial04.bvh", "s_trial04-2.bvh", "s_trial05.bvh"]


def test_names_of_files_end_in_the_style():
    (span,) = spans(("/trial", 0, 3), ("/tick", 0, 3))
    for about, name in (
        ({"style": "happy", "emotion": "sad"}, "s_trial04_happy.glb"),
        ({"style": "", "emotion": "sad"}, "s_trial04_sad.glb"),
        ({"style": "angry 0.5 + neutral 0.5"}, "s_trial04_angry-0.5-neutral-0.5.glb"),
        ({"style": "../../x"}, "s_trial04_..-..-x.glb"),
    ):
        assert trial_names("s", [replace(span, about=about)], ".glb") == [name]
    changed = replace(span, about={"style": "happy"}, contact={"style": "sad", "met": True})  # on the page, meanwhile
    assert trial_names("s", [changed], ".glb") == ["s_trial04_sad.glb"]


def test_a_trial_that_cannot_be_read_begins_all_the_same():
    found = spans(("/trial", 0, 3), ("/tick", 0, 3), ("/trial", 5, None), ("/tick", 5, 4), ("/contact", 5, 4))
    assert [(s.number, s.start_ns) for s in found] == [(3, 0), (4, 5)]
    assert found[1].about == {} and not found[0].contact and found[1].contact


def test_nothing_of_any_high_five_is_none():
    assert spans(("/session", 0, None), ("/event", 0, None)) == []
    assert spans(("/tick", 0, None), ("/tick", 1, None)) == []


def test_breaking_off_before_the_first_tick_is_not_of_the_one_before():
    def messages(number):
        yield StoredMessage("/trial", 0, {"trial": 3}, (0, 0))
        yield StoredMessage("/tick", 0, {"trial": 3}, (0, 1))
        yield StoredMessage("/event", 0, {"event": "trial_broken_off", "trial": number}, (0, 2))

    found = [span_of(list(messages(number))) for number in (3, 4)]
    assert [span is not None and span.broken_off for span in found] == [True, False]
