"""A session before two motion capture systems that see one person, each a part of her, in virtual time.

Each has a clock, a rate and a frame of its own; the second one's clock is set during the session.
"""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_system import VirtualSystem

import highfive
from highfive.hil.commands.simulate import SimulateOptions, simulate
from highfive.hil.recording.recording import read_recording
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.live_wiring import LiveWiring
from highfive.hil.trials.partners import simulated_partners
from highfive.mocap_bridge.files.recording import Recording, make_recording, resample
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.merged_address import merged_part
from highfive.model.geometry import rotations

FIRST, SECOND = "vicon://front:801", "qtm://side:22223"
SECOND_AT = f"{SECOND}?at=1.2,-0.4,0,90"
MS, S = 1_000_000, 1_000_000_000
SET_NS = 10 * MS
SET_S, STARTED_S = 9.0, 1000.0
"""When the second system's clock is set forward, and what it shows when the session begins."""


class Second(VirtualSystem):
    """Whose clock is another, and is set forward."""

    def send(self, frame: MarkerFrame) -> None:
        moved = SET_NS if frame.source_time_ns > SET_S * S else 0
        super().send(replace(frame, source_time_ns=frame.source_time_ns + round(STARTED_S * S) + moved))


def part_of(recording: Recording, unseen: tuple[str, ...]) -> Recording:
    """As long at 120 as at 100 Hz, for it is sent again and again."""
    kept = [m for m, name in enumerate(recording.names) if name not in unseen]
    frames = slice(round(recording.rate_hz * (int(20 * (len(recording) - 1) / recording.rate_hz) / 20)))
    names = [recording.names[m] for m in kept]
    return make_recording(recording.rate_hz, names, recording.points[frames, kept], recording.valid[frames, kept])


def moved(recording: Recording) -> Recording:
    """In the second system's own frame."""
    placed = merged_part(SECOND_AT).placed
    points = rotations.rotate(rotations.conjugate(placed.rotation), recording.points - placed.translation)
    return make_recording(recording.rate_hz, recording.names, points, recording.valid)


@pytest.mark.slow(15)
def test_two_systems_are_one_body_and_two_streams_each_with_its_own_clock(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    person = simulated_partners(1, ("neutral",), ("B2",), 3)[0]
    arm = person.marker_set.arm
    with VirtualClock(4) as clock:
        begun = clock.now()
        front = VirtualSystem(clock, part_of(person.recording, arm.hand))
        side = Second(clock, moved(part_of(resample(person.recording, 100.0), arm.head)))
        by = {"vicon": front, "qtm": side}
        wiring = LiveWiring(clock, front.wiring.scheduler, lambda address: by[address.scheme].wiring.connects(address))
        options = SimulateOptions(trials=2, emotions=("neutral",), source=f"{FIRST}+{SECOND_AT}", pictures=False)
        summary = simulate(options, tmp_path / "out", lambda *_: lambda *_: None, wiring)
    assert not [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    # One body: neither system alone has the markers to meet a hand with.
    assert all(row["met"] and row["contact_error_mm"] < 2.0 for row in summary["rows"])
    path = tmp_path / "out" / "session.mcap"
    recording = read_recording(path)
    assert {name for m in recording.channels["/frame"] for name in m.data["names"]} == set(person.recording.names)

    # Two streams: asked for one time each second, each with its own clock, age and bound.
    states = [m for m in recording.channels["/streams"]]
    asked = {m.time_ns for m in states}
    assert len(states) == 2 * len(asked) >= 8
    for at_ns in asked:
        assert {m.data["stream"] for m in states if m.time_ns == at_ns} == {FIRST, SECOND}
    (set_at,) = [m for m in recording.channels["/event"] if m.data["event"] == "resynchronised"]
    assert set_at.data["stream"] == SECOND and set_at.data["moved_ms"] == pytest.approx(-10.0, abs=0.5)
    for m in states:
        one, own = m.data, m.data["stream"] == SECOND
        assert one["rate_hz"] == pytest.approx(100.0 if own else 120.0, rel=0.01)
        assert one["valid"] and 0.0 <= one["age_ms"] < 25.0 and 0.0 <= one["bound_ms"] < 2.0
        was_set = own and m.time_ns > set_at.time_ns
        assert one["resets"] == was_set
        offset_s = 1e-9 * begun - own * STARTED_S - was_set * 1e-9 * SET_NS
        assert abs(one["offset_s"] - offset_s) <= 1e-3 * one["bound_ms"] + 1e-3, one
    assert [row["stream"] for row in summary["streams"]] == [FIRST, SECOND]
    both = list(highfive.read_session(path))
    assert len(both) == 2 and all(np.isfinite(one.arrays("/person")["wrist"]).all() for one in both)
