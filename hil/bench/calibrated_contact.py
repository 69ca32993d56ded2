"""High fives of a served person with an arm that is not as drawn: calibrated at the wire, and beside it known exactly.

All in virtual time: servos, driver and cameras calibrate the arm (``highfive calibrate extrinsics``), then a live
system's frames lead it to a person's hand. How plate and palm met is judged by where both really were.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from highfive.calibration.arm_file import ArmCalibration, CalibratedJoint, load_arm, save_arm
from highfive.calibration.placement import Placement
from highfive.calibration.plate_template import template_text
from highfive.calibration.registration import Registration
from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.arm_trial import ArmTrial, ArmWatch
from highfive.hil.arm.contact_outcome import ContactOutcome, judged, notice, reference_in
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenTruth, drawn_truth
from highfive.hil.arm.hidden_rig import hidden_bus
from highfive.hil.arm.lifecycle import session_planner, virtual_arm
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.bench.live_people import System, frames_of, parts, people
from highfive.hil.commands.calibrate_extrinsics import ExtrinsicsOptions, checked_extrinsics, fitted, measured
from highfive.hil.commands.calibration_room import hidden_room
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.session.session import RATE_HZ, Session, Tick, tick_times
from highfive.hil.sim.arm_plant import ArmPlant
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.trials.frame_link import FrameLink, SentFrames
from highfive.hil.trials.live_partner import LiveTrial
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.trial import run_trial
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SYSTEM = System(latency_ms=8.0, reported_ms=8.0)
PLAY = np.radians(0.3)
STILL_S, READY_S = 3.0, 2.0
"""So long the person stands still before she raises her hand, and so long before that the arm is made ready, s: checks
and servos take 1.4, as before a session."""
ADDRESS = "vicon://cameras"


@dataclass(frozen=True)
class ContactJob:
    """One high five: with whom, by which arm, and by which file it is known; '' for the drawing and the tape."""

    person: Partner
    truth: HiddenTruth
    file: str
    seed: int


@dataclass
class PlateBox:
    """Where a hidden arm's plate really is, every millisecond; :meth:`look` is a virtual rig's watch."""

    plant: ArmPlant
    times: list[int] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)
    normals: list[Array] = field(default_factory=list)

    def look(self, now_ns: int) -> None:
        """Adds a row."""
        plate = self.plant.plate()
        self.times.append(now_ns)
        self.places.append(plate.position)
        self.normals.append(plate.normal)

    def at(self, times: Array) -> tuple[Array, Array]:
        """Places (T, 3), m, and normals (T, 3) at times (T,), ns."""
        known = np.array(self.times, float)
        places, normals = (
            np.array([np.interp(times, known, axis) for axis in np.array(rows).T]).T
            for rows in (self.places, self.normals)
        )
        return places, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def calibrated_at_the_wire(truth: HiddenTruth, folder: Path, bar: Bar, poses: int = 30) -> Path:
    """The file that ``highfive calibrate extrinsics`` writes of a hidden arm, with noise, gaps and swapped labels."""
    plate, arm = folder / "plate.toml", ArmOptions(VIRTUAL, slow=True)
    plate.write_text(template_text(TEMPLATE))
    run = checked_extrinsics(ExtrinsicsOptions(arm, ADDRESS, plate, poses, out=folder / "calibrated.toml"))
    with hidden_room(truth, arm, TEMPLATE) as room, room.driven(default_arm()) as drive:
        taken = measured(run, drive, room.watch, bar)
    fitted(run, taken, drive.moving_s)
    return run.options.out


def known_exactly(truth: HiddenTruth, file: Path) -> Path:
    """The file of somebody who was told everything but play and ripple, which no file of a session knows."""
    mount, drawn = truth.mount, default_arm().packed
    back = rotations.conjugate(truth.mocap)
    joints = {
        name: CalibratedJoint(float(zero), float(soft), 0.0, length, tilt)
        for name, zero, soft, length, tilt in zip(
            find_arm().names, truth.zero, truth.compliance, truth.length, truth.tilt, strict=True
        )
    }
    room = Registration(
        file, datetime.now(UTC), fingerprint(load_rig()), "vicon", back, -rotations.rotate(back, truth.mocap_place),
        100, 1e-6,
    )  # fmt: skip
    turn = rotations.from_rotation_vector(truth.base_turn)
    save_arm(
        file,
        ArmCalibration(
            registration=room,
            tool="",
            command="told",
            note="",
            mount=np.array(mount.position) + truth.base,
            mount_rotation=rotations.multiply(turn, mount.quaternion),
            plate=drawn.plate + truth.plate,
            plate_normal=rotations.rotate(rotations.from_rotation_vector(truth.plate_turn), drawn.normal),
            marker_names=TEMPLATE.names,
            markers=TEMPLATE.markers,
            joints=joints,
            held_out_median=1e-6,
            held_out_max=1e-6,
            rms=0.0,
            temperatures=None,
            latency={},
        ),
    )
    return file


def play(job: ContactJob) -> ContactOutcome | None:
    """One high five, judged by where plate and palm really were; None where the arm was stopped."""
    person, truth = job.person, job.truth
    model, scene = parts()
    session = Session(model, {person.emotion: 1.0}, person.marker_set, scene)
    placement = _placement(job)
    with VirtualClock(job.seed) as clock:
        bus, plant = hidden_bus(truth, load_rig())
        box = PlateBox(plant)
        with virtual_arm(VirtualRig(clock, bus, box.look), _options(job.file), _planner(job.file)) as loop:
            begins = clock.now() + 100_000_000
            frames = [_in_mocap(truth, frame) for frame in frames_of(person, SYSTEM, begins, _rng(job), STILL_S)]
            link = FrameLink(clock, SYSTEM.rate_hz, SentFrames(frames))
            scheduler = VirtualScheduler(clock)
            with closing(LiveSource("simulated", lambda: link, None, SYSTEM.rate_hz, scheduler)) as source:
                zero = begins + round(1e9 * STILL_S)
                clock.wait_until(zero - round(1e9 * READY_S))  # the arm is checked, and follows, before she moves
                arm, ticks = ArmWatch(loop), list[Tick]()
                trial, seen = LiveTrial(source, placement, clock, 0), _seen(arm, ticks)
                arm.begin()
                run_trial(0, person, session, KinematicPlayOut(scene), arm.inputs(trial), _each(trial.watch, seen))
                done = arm.end(person.emotion, person.cell, -1)
                stopped = loop.trouble
        if done is None or stopped:
            return None
    return _really(job, done, ticks, box, placement, zero)


def _really(
    job: ContactJob, done: ArmTrial, ticks: Sequence[Tick], box: PlateBox, placement: Placement, zero: int
) -> ContactOutcome:
    """Plate and palm in the session's world, from where they were in the arm's own."""
    person, truth = job.person, job.truth
    assert person.palm is not None
    reference, times = reference_in(ticks, person.emotion, person.cell, -1), tick_times(ticks)
    frames = np.array([tick.frame_ns for tick in done.ticks], float)
    rows = np.arange(len(reference.goals)) / RATE_HZ
    rows = rows[rows <= times[len(frames) - 1] + 0.5 / RATE_HZ]
    moments = np.interp(rows, times[: len(frames)], frames)
    palm = CubicSpline(np.arange(len(person.palm)) / RATE_HZ, person.palm)
    hand = palm(np.clip(1e-9 * (moments - zero), 0.0, (len(person.palm) - 1) / RATE_HZ))
    places, normals = box.at(moments)
    facing = rotations.multiply(placement.rotation, truth.mocap)
    reference = replace(reference, person=placement.apply(truth.in_mocap(hand)))
    planner = _planner(job.file)
    return judged(
        reference, placement.apply(truth.in_mocap(places)), rotations.rotate(facing, normals),
        notice(reference, planner), done.met.relaxation,
    )  # fmt: skip


def _options(file: str) -> ArmOptions:
    return ArmOptions(VIRTUAL, calibration=Path(file) if file else None)


@cache
def _planner(file: str) -> Retarget:
    options = _options(file)
    limits, rig = check_options(options)
    return session_planner(options, rig, limits)


def _placement(job: ContactJob) -> Placement:
    """The room as the file has it; by tape the arm is believed to stand on its mount in the true world."""
    if job.file:
        return load_arm(Path(job.file)).registration.placement
    back = rotations.conjugate(job.truth.mocap)
    return Placement(back, -rotations.rotate(back, job.truth.mocap_place), ("by tape",))


def _in_mocap(truth: HiddenTruth, frame: MarkerFrame) -> MarkerFrame:
    return replace(frame, positions=truth.in_mocap(frame.positions))


def _rng(job: ContactJob) -> np.random.Generator:
    return np.random.default_rng((job.seed, 17))


def _seen(arm: ArmWatch, ticks: list[Tick]) -> Callable[[Tick], None]:
    def watch(tick: Tick) -> None:
        ticks.append(tick)
        arm.watch(tick)

    return watch


def _each(*watchers: Callable[[Tick], None]) -> Callable[[Tick], None]:
    def watch(tick: Tick) -> None:
        for one in watchers:
            one(tick)

    return watch


def bench_calibrated_contact(seed: int, high_fives: int, bar: Bar) -> dict[str, Any]:
    """Plate to palm, mm, over the high fives that were possible: of the calibrated arm, and of the same known exactly.

    Args:
        seed: of the arm and of the people.
        high_fives: at most, of the 36 of four emotions and nine cells.
        bar: shows how far it is.

    Raises:
        HighFiveError: the arm could not be calibrated.
    """
    persons = people(tuple(EMOTIONS), CELLS, seed, bar)[:high_fives]
    truth = drawn_truth(seed, play=float(PLAY))
    with TemporaryDirectory() as folder:
        files = {
            "calibrated": calibrated_at_the_wire(truth, Path(folder), bar),
            "known": known_exactly(truth, Path(folder) / "known.toml"),
        }
        jobs = [
            ContactJob(person, truth, str(file), number)
            for file in files.values()
            for number, person in enumerate(persons)
        ]
        met = list(parallel_map(play, jobs, lambda total: bar("high fives", total)))
    if not any(met):
        raise HighFiveError("the arm was stopped in every high five")
    halves = dict(zip(files, (met[: len(persons)], met[len(persons) :]), strict=True))
    errors = {
        name: 1e3 * np.array([one.error for one in half if one is not None and one.possible])
        for name, half in halves.items()
    }
    return {
        "median": _median(errors["calibrated"]),
        "p95": round(float(np.percentile(errors["calibrated"], 95)), 2),
        "known_median": _median(errors["known"]),
        "known_p95": round(float(np.percentile(errors["known"], 95)), 2),
        "high_fives": len(errors["calibrated"]),
        "stopped": sum(one is None for one in met),
        "missed": sum(one is not None and one.possible and not one.touched for one in halves["calibrated"]),
    }


def _median(values: Array) -> float:
    return round(float(np.median(values)), 2)
