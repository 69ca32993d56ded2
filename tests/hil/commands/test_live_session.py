"""The session from a live system: a person who raises her hand again and again, over the wire.

In virtual time what comes over the wire is handed over at its time; two sessions are real ones, over sockets.
"""

import json
import logging
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from itertools import islice, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import failing
from live_commands import ended, lab_recording, serving, start, stop
from virtual_system import VirtualSystem

from highfive.calibration.latency_file import KeptLatency, save_latencies
from highfive.calibration.placement import Placement
from highfive.hil.commands.live_session import live_person
from highfive.hil.commands.session_outputs import known_of
from highfive.hil.commands.simulate import SimulateOptions, simulate
from highfive.hil.recording.recording import read_recording
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.session.session_streams import SessionStreams
from highfive.hil.trials.live_partner import TICK_NS, LivePerson, live_source
from highfive.hil.trials.live_settings import LIVE
from highfive.hil.trials.partners import simulated_partners
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

ADDRESS = "vicon://lab"
BEFORE_THE_FIRST_S, IN_THE_FIRST_S, IN_THE_SECOND_S = 7.0, 9.5, 13.5
PATIENCE_S = 300.0
SET_NS = 10_000_000


@pytest.fixture(scope="module")
def greeting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A C3D file of one person's high five; it is served again and again."""
    path = tmp_path_factory.mktemp("greeting") / "greeting.c3d"
    write_c3d(path, simulated_partners(1, ("neutral",), ("B2",), 3)[0].recording)
    return path


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


def session(system: VirtualSystem, folder: Path, trials: int) -> dict[str, Any]:
    options = SimulateOptions(trials=trials, emotions=("neutral",), source=ADDRESS, pictures=False)
    return simulate(options, folder, lambda *_: lambda *_: None, system.wiring)


def dies(system: VirtualSystem, at_s: float) -> None:
    """Has the system switched off so long after now."""
    at = system.clock.now() + round(1e9 * at_s)
    system.clock.start("switch", lambda: (system.clock.wait_until(at), system.hang_up()))


@pytest.mark.slow
def test_a_hand_that_is_raised_before_a_live_system_is_met_and_is_again(greeting: Path, tmp_path: Path) -> None:
    """Every tick has its new frame, and who goes first where two tasks have one time decides nothing."""
    rows = []
    for seed, trials in ((0, 2), (1, 1)):
        with VirtualClock(seed) as clock:
            system = VirtualSystem(clock, read_c3d(greeting), begins_s=0.3 * seed)
            folder = tmp_path / f"session{seed}"
            rows.append(session(system, folder, trials)["rows"])
            assert (folder / "session.mcap").stat().st_size > 10_000
    assert all(row["met"] and row["contact_error_mm"] < 0.1 for row in rows[0])
    assert all(row["notes"][-1].count(" ticks, 0 late, 0 between frames, 0 of them stale") == 1 for row in rows[0])
    assert [len(found) for found in rows] == [2, 1]
    assert rows[0][0] == rows[1][0]


@pytest.mark.slow
def test_a_system_that_dies_costs_no_more_than_the_rest(
    greeting: Path, tmp_path: Path, clock: VirtualClock, caplog: pytest.LogCaptureFixture
) -> None:
    system, begun = VirtualSystem(clock, read_c3d(greeting)), clock.now()
    dies(system, IN_THE_SECOND_S)
    result = session(system, tmp_path / "session", 9)
    assert clock.now() - begun == pytest.approx(1e9 * (IN_THE_SECOND_S + LIVE.gone), abs=2 * TICK_NS)
    assert result["interrupted"] and len(result["rows"]) == 1 and result["rows"][0]["met"]
    (said,) = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert said.startswith("high five 2 was broken off") and "nothing has come for 5 s (nothing listens)" in said
    assert (tmp_path / "session" / "report.html").exists()


@pytest.mark.slow
def test_a_system_that_dies_in_the_first_high_five_leaves_what_there_was_of_it(
    greeting: Path, tmp_path: Path, clock: VirtualClock
) -> None:
    system, begun, folder = VirtualSystem(clock, read_c3d(greeting)), clock.now(), tmp_path / "session"
    dies(system, IN_THE_FIRST_S)
    with pytest.raises(
        HighFiveError, match=r"no high five could be played: nothing has come.*; what there was of it is recorded$"
    ):
        session(system, folder, 2)
    assert clock.now() - begun == pytest.approx(1e9 * (IN_THE_FIRST_S + LIVE.gone), abs=2 * TICK_NS)
    assert [entry.name for entry in folder.iterdir()] == ["session.mcap"]
    recording = read_recording(folder / "session.mcap")
    assert recording.complete and len(recording.channels["/tick"]) > 60
    assert "trial_broken_off" in [message.data["event"] for message in recording.channels["/event"]]


@pytest.mark.slow
def test_a_system_that_dies_before_the_first_tick_leaves_nothing_behind(
    greeting: Path, tmp_path: Path, clock: VirtualClock
) -> None:
    system, folder = VirtualSystem(clock, read_c3d(greeting)), tmp_path / "session"
    dies(system, BEFORE_THE_FIRST_S)
    with pytest.raises(
        HighFiveError, match=r"no high five could be played: nothing has come for 5 s \(nothing listens\)$"
    ):
        session(system, folder, 2)
    assert not folder.exists()


def test_a_system_that_dies_while_the_person_is_watched_is_given_up(greeting: Path, clock: VirtualClock) -> None:
    system, begun = VirtualSystem(clock, read_c3d(greeting)), clock.now()
    dies(system, 2.0)
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        with pytest.raises(HighFiveError, match=r"nothing comes any more \(nothing listens\)"):
            LivePerson(source, ADDRESS, clock=clock)
        assert clock.now() - begun == pytest.approx(1e9 * (2.0 + LIVE.silent), abs=0.1e9)


@pytest.mark.slow
def test_at_every_phase_of_the_frames_a_trial_has_a_new_one_a_tick(greeting: Path, clock: VirtualClock) -> None:
    system = VirtualSystem(clock, read_c3d(greeting))
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        person = LivePerson(source, ADDRESS, clock=clock)
        for phase in np.arange(0.5, 8.0) / 8.0:
            trial = person.trial()
            clock.wait_until(clock.now() + round(phase * TICK_NS))
            begun = [(begins.time_ns, clock.now()) for begins in islice(trial, 60)]
            assert (trial.count, trial.late, trial.predicted, trial.stale, trial.trouble) == (60, 0, 0, 0, "")
            steps = np.diff(
                begun[10:], axis=0
            )  # the first frame was there before: ticks catch up by a millisecond each
            assert np.abs(steps - TICK_NS).max() <= 20_000


class ClockSet(VirtualSystem):
    """A system whose clock is set forward by 10 ms."""

    set_s = 0.0

    def send(self, frame: MarkerFrame) -> None:
        moved = SET_NS if frame.source_time_ns > 1e9 * self.set_s else 0
        super().send(replace(frame, source_time_ns=frame.source_time_ns + moved))


@pytest.mark.slow
@pytest.mark.parametrize("set_s", [7.0, 10.0], ids=["while a resting hand is waited for", "in a high five"])
def test_a_systems_clock_that_is_set_in_a_session_is_one_event_that_says_how_far(
    set_s: float, greeting: Path, tmp_path: Path, clock: VirtualClock
) -> None:
    begun, system = clock.now(), ClockSet(clock, read_c3d(greeting))
    system.set_s = set_s
    result = session(system, tmp_path / "session", 1)
    recording = read_recording(tmp_path / "session" / "session.mcap")
    (event,) = [m for m in recording.channels["/event"] if m.data["event"] == "resynchronised"]
    assert event.data["stream"].startswith(ADDRESS)
    assert event.data["moved_ms"] == pytest.approx(-1e-6 * SET_NS, abs=0.5)
    began_s = 1e-9 * (recording.channels["/trial"][0].data["host_ns"] - begun)
    within = began_s < set_s
    assert within == (set_s > 8.0) and event.data["trial"] == (0 if within else None)
    if within:  # a stamp so far ahead is seen to be wrong at once, and not after seconds
        assert 0.0 <= began_s + 1e-9 * event.time_ns - set_s < 0.1
    assert sum("synchronised anew" in note for row in result["rows"] for note in row["notes"]) == within
    (row,) = result["streams"]
    assert row["stream"] == event.data["stream"] and row["resets"] == 1 and row["valid"]
    assert row["rate_hz"] == pytest.approx(120.0, rel=0.01) and 0.0 <= row["bound_ms"] < 2.0
    states = [m.data for m in recording.channels["/streams"]]
    assert states[-1] == {name: value for name, value in row.items() if name != "shown"}
    # The system's clock began with its first frame; its offset is that time, until it is set forward.
    wanted_s = 1e-9 * begun - (1e-9 * SET_NS if states[-1]["resets"] else 0.0)
    assert states[-1]["offset_s"] == pytest.approx(wanted_s, abs=2e-3)


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("where", [("vicon", "--port", 0), ("lsl",)], ids=["vicon", "lsl"])
def test_over_the_wire_a_session_goes_on_until_its_system_is_killed(
    where: tuple, greeting: Path, tmp_path: Path
) -> None:
    """Server and session are commands; the server is killed in the second high five."""
    server, address, _ = serving(where[0], greeting, "--loop", *where[1:])
    try:
        words = ("--source", address, "--emotion", "neutral", "--trials", 9, "--no-pictures", "--json")
        running = start("simulate", *words, "--out", tmp_path / "session")
        assert running.stderr is not None
        before = list(takewhile(lambda line: "high five 2, neutral" not in line, running.stderr))
        assert any("high five 1, neutral" in line for line in before), before
        server.kill()
        code, out, err = ended(running, within=PATIENCE_S)
    finally:
        stop(server)
    result = json.loads(out)
    assert code == 1 and result["interrupted"] and 1 <= len(result["rows"]) < 9
    assert all("between frames" in row["notes"][-1] for row in result["rows"])
    assert "nothing has come" in err
    assert (tmp_path / "session" / "session.mcap").stat().st_size > 10_000
    assert (tmp_path / "session" / "report.html").exists()


fails = failing("simulate")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        pytest.param(("--source", "vicon://127.0.0.1:9"), "nothing listens", marks=pytest.mark.slow),  # it waits 5 s
        (("--source", "vicom://127.0.0.1"), "unknown address"),
        (("--source", "vicon://127.0.0.1:9", "--place", "no/such/place.toml"), "there is no folder no/such"),
    ],
)
def test_what_is_not_there_is_one_line(fails, words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    assert message in fails(*words, "--out", tmp_path / "none")


@pytest.mark.slow
def test_somebody_with_other_markers_is_told_what_was_wanted(tmp_path: Path) -> None:
    path = lab_recording(tmp_path / "lab.c3d")
    server, address, _ = serving("vicon", path, "--loop", "--port", 0)
    try:
        words = ("--source", address, "--human", "avatar", "--out", tmp_path / "none")
        code, _, err = ended(start("simulate", *words), within=PATIENCE_S)
        assert code == 2 and "RFIN" in err
    finally:
        stop(server)


def test_in_a_registered_room_the_world_is_where_the_file_says_and_nobody_is_watched(
    greeting: Path, clock: VirtualClock
) -> None:
    """Every marker lies where rotation and translation take it, from the first frame on, wherever the person stands."""
    turn, shift = rotations.from_axis_angle("z", 0.7), np.array([2.0, -1.0, 0.1])
    registered = Placement(turn, shift, ("the room is registered",))
    recording = read_c3d(greeting)
    system = VirtualSystem(clock, recording)
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        began = clock.now()
        person = LivePerson(source, ADDRESS, None, registered, clock)
        assert clock.now() - began < TICK_NS  # she need not raise the hand to be found
        frames = [begins.frame for begins in islice(person.trial(), 20) if begins.frame is not None]
    where = rotations.rotate(turn, recording.points) + shift
    for frame in frames:
        columns = [recording.names.index(name) for name in frame.names]
        row = (frame.number % len(recording), columns)
        np.testing.assert_array_equal(frame.valid, recording.valid[row])
        np.testing.assert_allclose(frame.positions[frame.valid], where[row][frame.valid], atol=1e-9)
    assert any(frame.valid.all() for frame in frames)


def test_a_guess_is_asked_about_and_the_person_watched_again(greeting: Path, clock: VirtualClock) -> None:
    """She does not raise the hand the first time; where nobody can be asked, the session goes on and warns."""
    recording = read_c3d(greeting)
    still = replace(recording, points=recording.points[:60], valid=recording.valid[:60])
    still = replace(still, unlabelled=recording.unlabelled[:60], unlabelled_valid=recording.unlabelled_valid[:60])
    asked: list[str] = []
    answers = iter([False, True])

    def confirm(question: str) -> bool:
        asked.append(question)
        return next(answers)

    system = VirtualSystem(clock, still)
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        begun = clock.now()
        LivePerson(source, ADDRESS, clock=clock, confirm=confirm)
        assert clock.now() - begun == pytest.approx(2e9 * LIVE.practice, abs=0.5e9)
        assert len(asked) == 2 and all("no hand was raised" in question for question in asked)
        LivePerson(source, ADDRESS, clock=clock)


def test_a_raised_hand_is_no_guess(greeting: Path, clock: VirtualClock) -> None:
    system = VirtualSystem(clock, read_c3d(greeting))
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        person = LivePerson(source, ADDRESS, clock=clock, confirm=pytest.fail)
        assert not person.placement.guesses and len(person.placement.notes) == 3


@pytest.mark.slow
def test_a_placement_is_kept_for_the_next_session(greeting: Path, tmp_path: Path) -> None:
    """The second session watches nobody; one of another system's placement is refused, and so is a recording's."""
    path = tmp_path / "room.toml"
    took = []
    for number in range(2):
        with VirtualClock() as clock:
            system = VirtualSystem(clock, read_c3d(greeting))
            options = SimulateOptions(trials=1, emotions=("neutral",), source=ADDRESS, pictures=False, place=path)
            begun = clock.now()
            found = simulate(options, tmp_path / str(number), lambda *_: lambda *_: None, system.wiring)
            took.append(clock.now() - begun)
            assert found["rows"][0]["met"]
    assert 'system = "vicon"' in path.read_text(encoding="utf-8")
    assert took[0] - took[1] > 1e9 * 0.5
    with VirtualClock() as clock:
        system = VirtualSystem(clock, read_c3d(greeting))
        other = replace(options, source="qtm://lab")
        with pytest.raises(HighFiveError, match="is of a vicon system, the person comes from qtm"):
            simulate(other, tmp_path / "other", lambda *_: lambda *_: None, system.wiring)
    for wrong in (replace(options, source=str(greeting)), replace(options, source=None)):
        with pytest.raises(HighFiveError, match="--place keeps where a live person stands"):
            simulate(wrong, tmp_path / "wrong", lambda *_: lambda *_: None)
    with pytest.raises(HighFiveError, match="--latency 500 ms; expected 0 to 200"):
        simulate(replace(options, latency_ms=500.0), tmp_path / "wrong", lambda *_: lambda *_: None)


@pytest.mark.parametrize("late_ms", [0.0, 12.0, 60.0])
@pytest.mark.slow
def test_a_person_who_is_measured_to_be_late_is_seen_by_that_much_earlier(
    late_ms: float, greeting: Path, tmp_path: Path
) -> None:
    """By each tick, which predicts her over it, and by her stream; without that, a frame is of when it came."""
    kept = tmp_path / "latencies.toml"
    save_latencies(kept, {"person": KeptLatency(late_ms, 1.5, 8, "arm", "a.mcap", "2026-11-25")}, replace=True)
    options, late_ns = SimulateOptions(source=ADDRESS, latencies=kept, latency_ms=7.0), round(1e6 * late_ms)
    with VirtualClock(2) as clock, ExitStack() as stack:
        system = VirtualSystem(clock, read_c3d(greeting))
        person = live_person(options, stack, system.wiring, None)
        streams = SessionStreams(known=known_of(options))
        streams.follow(person.source)
        ticks, frame = list(islice(person.trial(), 240)), None
        sent, begun = dict(system.sent), None
        for begins in ticks[10:]:
            assert begins.frame is not None
            frame = begins.frame
            captured_ns = begins.at_ns - begins.ahead_ns
            assert abs(captured_ns - (sent[frame.number] - late_ns)) < 50_000
            # Shown 7 ms after the tick, whatever was measured of the system; and by so much beyond the frame.
            assert 0 <= begins.at_ns - 7_000_000 - sent[frame.number] < TICK_NS
            begun = begins.at_ns - 7_000_000
        assert frame is not None and begun is not None
        (state,) = streams.states(sent[frame.number] - late_ns)
        assert state.age_ms < 0.1 and 1.5 <= (state.bound_ms or 0.0) < 4.0
        assert person.latency_ns == late_ns
