"""The session's LSL streams over the real library on this machine, heard by inlets that know nothing of us."""

import json
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pylsl
import pytest
from recorded_trials import ticks_of
from trial_results import some_results

from highfive.hil.publish.background import BackgroundPublisher
from highfive.hil.publish.lsl import LslPublisher
from highfive.hil.publish.publisher import SessionEvent, ShownPicture
from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.session.session import Sighting
from highfive.hil.session.shown import Shown
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.sources.lsl import clock_minus_lsl, configure
from highfive.mocap_bridge.wire.lsl import markers_of, parse_description
from highfive.model.errors import HighFiveError

NAMES = ("HighFive-Person", "HighFive-Avatar", "HighFive-Events", "HighFive-Shown")
HIDDEN = 2  # the marker that is out of sight in the second half
LATE_NS = 20_000_000  # from when the cameras saw a frame until its pose is shown


def sighted(tick: RecordedTick, *, hidden: bool) -> RecordedTick:
    """The tick with what its frame showed, LATE_NS before."""
    seen = tick.markers.seen.copy()
    seen[HIDDEN] = not hidden
    markers = replace(tick.markers, seen=seen, time_ns=tick.time_ns - LATE_NS)
    return replace(tick, sighting=Sighting(markers, replace(tick.person, valid=not hidden)))


@pytest.fixture(scope="module")
def ticks() -> list[RecordedTick]:
    some = list(ticks_of(some_results()[1]))[:120]
    start = 3_000_000_000_000_000  # a computer that has been on for a month
    return [
        sighted(replace(t, at_ns=start + t.at_ns), hidden=i >= 60) if i % 10 else replace(t, at_ns=start + t.at_ns)
        for i, t in enumerate(some)
    ]


@pytest.fixture(scope="module")
def heard(ticks: list[RecordedTick]) -> Iterator[dict[str, tuple[pylsl.StreamInfo, list[object], list[float]]]]:
    """Description, samples and stamps of each stream, as a program heard them that was there before the first tick."""
    configure(local_only=True)
    publisher = LslPublisher(ticks[0].markers.names, (120.0, 0.0), 0.0045, pages=True)
    inlets = {}
    for name in NAMES:
        (info,) = pylsl.resolve_byprop("name", name, timeout=60.0)
        inlets[name] = pylsl.StreamInlet(info, recover=False)
        inlets[name].open_stream(60.0)
    behind = BackgroundPublisher(publisher)
    for i, tick in enumerate(ticks):
        behind.give(tick)
        if i % 30 == 0:
            behind.give(SessionEvent("contact", tick.at_ns, {"trial": i, "emotion": "happy", "style": "frölich"}))
            shown = Shown(i, tick.at_ns - 9_000_000, tick.at_ns + 16_500_000, 2)
            behind.give(ShownPicture(1, shown, 300_000))
    infos = {name: inlet.info(60.0) for name, inlet in inlets.items()}
    counts = {NAMES[0]: sum(t.sighting is not None for t in ticks), NAMES[1]: len(ticks), NAMES[2]: 4, NAMES[3]: 4}
    found = {}
    for name, inlet in inlets.items():
        pulled = [inlet.pull_sample(60.0) for _ in range(counts[name])]
        assert inlet.pull_sample(0.0) == (None, None)  # and no more
        found[name] = infos[name], [sample for sample, _ in pulled], [stamp for _, stamp in pulled]
    behind.close()
    yield found


def test_streams_say_what_they_are(heard: dict[str, tuple[pylsl.StreamInfo, list[object], list[float]]]) -> None:
    kinds = {
        name: (i.type(), i.channel_count(), i.nominal_srate(), i.channel_format()) for name, (i, _, _) in heard.items()
    }
    assert kinds == {
        "HighFive-Person": ("MoCap", 3 * (16 + 4), 120.0, pylsl.cf_float32),
        "HighFive-Avatar": ("MoCap", 3 + 53 * 4, 0.0, pylsl.cf_float32),
        "HighFive-Events": ("Markers", 1, 0.0, pylsl.cf_string),
        "HighFive-Shown": ("Display", 5, 0.0, pylsl.cf_float32),
    }
    assert len({info.source_id() for info, _, _ in heard.values()}) == 4
    person, avatar = heard["HighFive-Person"][0].desc(), heard["HighFive-Avatar"][0].desc()
    assert person.child("acquisition").child_value("compensated_lag") == "0.0045"
    channel, labels = avatar.child("channels").child("channel"), []
    while not channel.empty():
        labels.append([channel.child_value(key) for key in ("label", "marker", "object", "type", "unit")])
        channel = channel.next_sibling("channel")
    assert len(labels) == 215 and labels[2] == ["avatar:pelvis_Z", "pelvis", "avatar", "PositionZ", "meters"]
    place = 3 + 4 * avatar_skeleton().index("right_wrist")
    named = ["avatar:right_wrist_A", "right_wrist", "avatar", "OrientationA", "normalized"]
    assert labels[place] == named and [kind[3][-1] for kind in labels[place : place + 4]] == list("ABCD")


def test_no_pose_is_lost_and_each_has_its_time(
    heard: dict[str, tuple[pylsl.StreamInfo, list[object], list[float]]], ticks: list[RecordedTick]
) -> None:
    _, values, stamps = heard["HighFive-Avatar"]
    expected = [np.concatenate([t.played.root_in_world, t.played.quaternions.ravel()]) for t in ticks]
    np.testing.assert_allclose(np.array(values), expected, atol=1e-6)
    np.testing.assert_allclose(1e9 * (np.array(stamps) - ticks[0].at_ns * 1e-9 + clock_minus_lsl(time.monotonic)),
                               [t.at_ns - ticks[0].at_ns for t in ticks], atol=50_000)  # fmt: skip


def test_the_person_is_as_a_reader_of_markers_finds_her(
    heard: dict[str, tuple[pylsl.StreamInfo, list[object], list[float]]], ticks: list[RecordedTick]
) -> None:
    info, values, stamps = heard["HighFive-Person"]
    framed = [t for t in ticks if t.sighting is not None]
    assert len(values) == len(framed) == 108  # a tick without a frame shows nobody
    layout = parse_description(info.as_xml(), info.channel_count())
    names = ticks[0].markers.names
    assert layout.names == tuple(f"person:{name}" for name in (*names, "wrist", "knuckles", "palm", "head"))
    points, valid, _ = markers_of(layout, np.array(values, dtype=float))
    for tick, at, there in zip(framed, points, valid, strict=True):
        assert tick.sighting is not None
        markers, person = tick.sighting.markers, tick.sighting.person
        assert there[:16].tolist() == markers.seen.tolist() and set(there[16:].tolist()) == {person.valid}
        np.testing.assert_allclose(at[:16][markers.seen], markers.positions[markers.seen], atol=1e-6)
        if person.valid:
            np.testing.assert_allclose(at[18], person.palm.position, atol=1e-6)
    assert not valid[-1, HIDDEN] and valid[0, HIDDEN]
    poses = dict(zip((t.at_ns for t in ticks), heard["HighFive-Avatar"][2], strict=True))
    ahead = [poses[t.at_ns] - stamp for t, stamp in zip(framed, stamps, strict=True)]
    np.testing.assert_allclose(ahead, 1e-9 * LATE_NS, atol=2e-6)  # doubles of 3e6 s


def test_events_have_the_time_of_their_pose(
    heard: dict[str, tuple[pylsl.StreamInfo, list[object], list[float]]],
) -> None:
    _, values, stamps = heard["HighFive-Events"]
    said = [json.loads(value[0]) for value in values]  # type: ignore[index]
    assert said == [{"event": "contact", "trial": i, "emotion": "happy", "style": "frölich"} for i in (0, 30, 60, 90)]
    assert stamps == [heard["HighFive-Avatar"][2][i] for i in (0, 30, 60, 90)]


def test_other_markers_than_announced_are_no_sample(ticks: list[RecordedTick]) -> None:
    publisher = LslPublisher(("A", "B"), (120.0, 120.0))
    with pytest.raises(HighFiveError, match="the person's markers are"):
        publisher.tick(ticks[1])
    publisher.close()


def test_who_takes_nothing_holds_nobody_up(ticks: list[RecordedTick]) -> None:
    publisher = LslPublisher(ticks[0].markers.names, (120.0, 120.0))
    (info,) = pylsl.resolve_byprop("name", "HighFive-Avatar", timeout=60.0)
    asleep = pylsl.StreamInlet(info, max_buflen=1, recover=False)
    asleep.open_stream(60.0)
    for _ in range(10):  # ten seconds of a session, far more than this inlet keeps
        for tick in ticks:
            publisher.tick(tick)
    values, stamps = asleep.pull_chunk(0.0, 5000, as_numpy=False)
    assert len(values) == len(stamps) < 1200
    publisher.close()


def test_what_was_shown_is_stamped_with_when_it_was_seen(
    heard: dict[str, tuple[pylsl.StreamInfo, list[object], list[float]]], ticks: list[RecordedTick]
) -> None:
    _, values, stamps = heard["HighFive-Shown"]
    np.testing.assert_allclose(np.array(values), [[1, i, 25.5, 2, 0.3] for i in (0, 30, 60, 90)], rtol=1e-6)
    seen = [1e-9 * (ticks[i].at_ns + 16_500_000) for i in (0, 30, 60, 90)]
    np.testing.assert_allclose(np.diff(stamps), np.diff(seen), atol=1e-6)
