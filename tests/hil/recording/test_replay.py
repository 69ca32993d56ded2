"""A recorded session once more: the same to the last bit, or what differs."""

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_trials import record_trial
from shipped import written
from trial_results import some_results

from highfive.hil.bench.live_people import BEFORE_S, System, frames_of, here, parts, people
from highfive.hil.commands.replay_session import replay_of
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.recording.recorded_tick import recorded_tick
from highfive.hil.recording.recorder import SessionRecorder, TrialHead
from highfive.hil.recording.recording import SessionRecording, read_recording
from highfive.hil.recording.replay import Replay, open_replay
from highfive.hil.recording.session_reader import read_session
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.session.session import UNSEEN_AT_REST, Session, Tick, TickInput
from highfive.hil.sim.playout import KinematicPlayOut, PlayState
from highfive.hil.trials.frame_link import FrameLink, SentFrames
from highfive.hil.trials.live_partner import LiveTrial
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import SessionSettings, versions
from highfive.hil.trials.trial import run_trial
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.model.errors import HighFiveError

MODEL = "default"


@pytest.fixture(scope="module")
def person() -> Partner:
    return people(("happy",), ("B2",), 1, lambda *_: lambda *_, **__: None)[0]


def session_of(person: Partner, recording: Replay | None = None) -> Session:
    pose, tracking = (UNSEEN_AT_REST, None) if recording is None else (recording.pose, recording.tracking)
    model, scene = parts()
    return Session(model, {"happy": 1.0}, person.marker_set, scene, settings=pose, tracking=tracking)


@pytest.fixture(scope="module")
def recorded(person: Partner, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A live person at 60 Hz, with lost frames; in the middle somebody turns the style, and the correction off."""
    path = tmp_path_factory.mktemp("replay") / "session.mcap"
    session = session_of(person)
    head = TrialHead(0, person, "happy", session.weights, session.corrects, paced=True)
    settings = SessionSettings(seed=1, model=MODEL, trials=1)
    with VirtualClock(3) as clock, SessionRecorder(path, settings, session.chain) as recorder:
        begins = clock.now() + 100_000_000
        system = System(60.0, latency_ms=8.0, reported_ms=8.0, delay_ms=1.0, drop=0.05, drift_ppm=80.0)
        link = FrameLink(clock, 60.0, SentFrames(frames_of(person, system, begins, np.random.default_rng(3))))
        recorder.begin_trial(head)
        count = 0

        def keep(begins: TickInput, tick: Tick, state: PlayState, tick_ms: float) -> None:
            nonlocal count
            recorder.record_tick(recorded_tick(begins, tick, state.pose, tick_ms))
            count += 1
            if count in (80, 200):
                session.set_style({"happy": 0.3, "sad": 0.7})
                session.set_correct(count == 80)
                about = {"weights": dict(session.weights), "corrects": session.corrects}
                recorder.record_event("answer_changed", begins.at_ns, trial=0, **about)

        with closing(LiveSource("simulated", lambda: link, None, 60.0, VirtualScheduler(clock))) as source:
            clock.wait_until(begins + round(1e9 * BEFORE_S))
            trial = LiveTrial(source, here(), clock)
            recorder.end_trial(run_trial(0, person, session, KinematicPlayOut(parts()[1]), trial, trial.watch, keep))
    return path


def played_again(path: Path, person: Partner) -> Replay:
    replay = open_replay(read_session(path), MODEL, True, None)
    session = session_of(person, replay)
    session.set_style(replay.styles[0])
    run_trial(
        0, replay.partners(None)[0], session, KinematicPlayOut(parts()[1]), replay.inputs(0, session),
        keep=lambda begins, tick, state, tick_ms: replay.check(0, tick),
    )  # fmt: skip
    return replay


def test_a_live_session_is_played_again_to_the_last_bit(recorded: Path, person: Partner) -> None:
    recording = read_recording(recorded)
    replay = played_again(recorded, person)
    ticks = recording.channels["/tick"]
    assert replay.ticks == replay.same == len(ticks) > 250
    assert replay.first is None and replay.differs == [] and replay.largest == 0.0
    framed = [tick.data["framed"] for tick in ticks]
    assert 0.3 < np.mean(framed) < 0.6  # between the frames the person was predicted
    assert replay.pose == UNSEEN_AT_REST
    assert len({tick.time_ns for tick in ticks}) == len(ticks)


def test_one_that_names_no_least_closing_speed_is_played_without(recorded: Path) -> None:
    session = read_session(recorded)
    now = session.chain
    assert now is not None and now["reach"]["closing"] > 0.0
    reach = {name: value for name, value in now["reach"].items() if name != "closing"}
    for chain in ({**now, "reach": reach}, None):
        session.chain = chain
        assert open_replay(session, MODEL, True, None).reach.closing == 0.0


def recorded_twice(path: Path, person: Partner, corrects: bool, off_in: int | None = None) -> Path:
    """Two high fives; in tick 100 of that one the correction is turned off, and on again before the next."""
    session = session_of(person)
    settings = SessionSettings(seed=1, model=MODEL, trials=2, corrected=corrects)
    with SessionRecorder(path, settings, session.chain) as recorder:
        for number in range(2):
            session.set_correct(corrects)
            recorder.begin_trial(TrialHead(number, person, "happy", session.weights, session.corrects))
            count = 0

            def keep(begins: TickInput, tick: Tick, state: PlayState, tick_ms: float, number: int = number) -> None:
                nonlocal count
                recorder.record_tick(recorded_tick(begins, tick, state.pose, tick_ms))
                count += 1
                if count == 100 and number == off_in:
                    session.set_correct(False)
                    recorder.record_event(
                        "answer_changed", begins.at_ns, trial=number, weights=dict(session.weights), corrects=False
                    )

            recorder.end_trial(run_trial(number, person, session, KinematicPlayOut(parts()[1]), keep=keep))
    return path


def both_again(path: Path, person: Partner, corrected: bool) -> Replay:
    """Played again by a session that does not correct of itself where that is asked for."""
    replay = open_replay(read_session(path), MODEL, corrected, None)
    session = session_of(person, replay)
    session.set_correct(corrected)
    for number, partner in enumerate(replay.partners(None)):
        run_trial(
            number, partner, session, KinematicPlayOut(parts()[1]), replay.inputs(number, session),
            keep=lambda begins, tick, state, tick_ms, number=number: replay.check(number, tick),
        )  # fmt: skip
    return replay


@pytest.mark.slow(20)
def test_a_session_without_correction_is_played_again_to_the_last_bit(person: Partner, tmp_path: Path) -> None:
    without = both_again(recorded_twice(tmp_path / "without.mcap", person, False), person, True)
    assert without.same == without.ticks > 400 and without.differs == []
    with_it = recorded_twice(tmp_path / "with.mcap", person, True)
    assert (again := both_again(with_it, person, True)).same == again.ticks
    never = both_again(with_it, person, False)
    assert never.same < never.ticks and never.differs == ["correction on then, off now"]


@pytest.mark.slow
def test_a_correction_that_was_turned_off_in_one_high_five_is_not_off_in_the_next(
    person: Partner, tmp_path: Path
) -> None:
    path = recorded_twice(tmp_path / "off.mcap", person, True, off_in=0)
    replay = both_again(path, person, True)
    assert replay.same == replay.ticks > 400
    never = both_again(path, person, False)
    assert never.first is not None and never.first[0] == 0


@pytest.mark.slow
def test_a_micrometre_in_one_frame_is_found(recorded: Path, person: Partner) -> None:
    recording = read_recording(recorded)
    frames = list(recording.channels["/frame"])
    place = len(frames) // 2
    moved = (np.array(frames[place].data["positions"]) + np.array([1e-6, 0.0, 0.0])).tolist()
    frames[place] = replace(frames[place], data=frames[place].data | {"positions": moved})
    replay = played_again(written(replace(recording, channels={**recording.channels, "/frame": tuple(frames)})), person)
    assert replay.same < replay.ticks and replay.first is not None
    assert replay.first[1] == pytest.approx(1e-9 * (frames[place].time_ns - frames[0].time_ns), abs=0.02)
    assert replay.largest < 1e-4  # rounding of what is recorded, mostly


def test_what_is_not_as_it_was_is_said(recorded: Path) -> None:
    recording = read_recording(recorded)
    old = {**versions(), "numpy": "1.0"}
    recording = replace(recording, settings={**recording.settings, "versions": old})
    differs = open_replay(read_session(written(recording)), "another", False, None).differs
    assert differs[:2] == [f"model {MODEL} then, another now", "correction on then, off now"]
    assert [line for line in differs if line.startswith("numpy 1.0 then")]


def test_a_recording_without_an_end_is_said_to_be_one(
    recorded: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: int(0.7 * recorded.stat().st_size)])
    for path in (recorded, cut):
        replay = replay_of(SimulateOptions(source=str(path)), MODEL)
        assert len(replay.trials) == 1
    assert [record.getMessage() for record in caplog.records] == [
        f"{cut} has no end: its last high five is played as far as it was recorded"
    ]


def changed(recording: SessionRecording, topic: str, change: Callable[[dict], dict]) -> SessionRecording:
    messages = tuple(replace(message, data=change(dict(message.data))) for message in recording.channels[topic])
    return replace(recording, channels={**recording.channels, topic: messages})


def refused() -> Iterator[tuple[Callable[[SessionRecording], SessionRecording], str]]:
    yield lambda it: replace(it, channels={**it.channels, "/frame": ()}), "holds no marker frames"
    yield lambda it: replace(it, joints=("hip",)), "of another avatar: 1 joints"
    yield lambda it: changed(it, "/trial", lambda data: data | {"marker_set": "mine"}), r"'mine'.*--marker-set FILE"
    yield lambda it: changed(it, "/trial", lambda data: data | {"weights": [1.0]}), "does not say how it was answered"
    yield lambda it: changed(it, "/tick", lambda data: {}), "/tick at 0.000 s is of another version.*time_ns"
    yield lambda it: changed(it, "/frame", lambda data: data | {"names": ["A"]}), "/frame.*valid is missing, or not"
    yield lambda it: changed(it, "/avatar", lambda data: data | {"root": None}), "/avatar.*root is missing, or not"
    yield lambda it: without_one(it, "/frame", 4), "the frame of its tick at .* is missing"
    yield lambda it: without_one(it, "/avatar", 4), "poses that do not belong together"
    yield lambda it: replace(it, chain={"pose": {"speed": 3.0}}), "of another version: this one has other settings"
    yield lambda it: changed(it, "/event", lambda data: data | {"event": "trial_broken_off"}), "no high five"


def without_one(recording: SessionRecording, topic: str, place: int) -> SessionRecording:
    messages = list(recording.channels[topic])
    del messages[place]
    return replace(recording, channels={**recording.channels, topic: tuple(messages)})


@pytest.mark.slow
@pytest.mark.parametrize(("change", "message"), list(refused()))
def test_what_cannot_be_played_again_is_one_line(
    recorded: Path, change: Callable[[SessionRecording], SessionRecording], message: str
) -> None:
    recording = change(read_recording(recorded))
    if "no high five" in message:  # what was judged was not broken off
        recording = replace(recording, channels={**recording.channels, "/contact": ()})
    with pytest.raises(HighFiveError, match=message) as error:
        open_replay(read_session(written(recording)), MODEL, True, None)
    said = str(error.value)
    assert "\n" not in said and not any(word in said for word in ("KeyError", "TypeError", "argument", "Error:"))


def test_frames_that_were_recorded_are_the_frames_that_came(tmp_path: Path) -> None:
    path = tmp_path / "frames.mcap"
    with SessionRecorder(path, SessionSettings(seed=3, model="m", trials=1)) as recorder:
        record_trial(recorder, some_results()[0])
    replay = open_replay(read_session(path), "m", True, None)
    frames = replay.read(replay.trials[0].span).inputs
    for begins, markers in zip(frames, some_results()[0].markers, strict=True):
        assert begins.frame is not None
        np.testing.assert_array_equal(begins.frame.positions, markers.positions)
        assert begins.frame.valid.tolist() == markers.seen.tolist()
