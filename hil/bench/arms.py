"""High fives with arms that are not as their model says, in virtual time: how near they come, and whether laws hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from highfive.hil.arm.arm_trial import ArmTrial, played_until_stopped
from highfive.hil.arm.contact_outcome import ContactOutcome, ReferenceTrajectory, judged, notice
from highfive.hil.arm.lifecycle import virtual_arm
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_laws import judge_body, judge_commands
from highfive.hil.bench.laws import Laws, largest
from highfive.hil.bench.motion_laws import judge_body_motion
from highfive.hil.bench.perturbed_arm import drawn_perturbation, perturbed_bus
from highfive.hil.bench.retarget import reference_trajectories
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.speeds import closing_speed, face_speed
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trained import HGPDM

CELLS = ("A2", "B1", "B2", "C3", "C1", "C2")
"""At one of which each arm meets a hand, an emotion after the other; C1 and C2 are beside the head."""

_LOOKED_ON_NS = 500_000_000


@dataclass(frozen=True)
class ArmsOptions:
    """What is played.

    Attributes:
        arms: number of arms.
        first: seed of the first one.
        seed: of the people.
    """

    arms: int = 50
    first: int = 0
    seed: int = 0


@dataclass(frozen=True)
class ArmJob:
    """One arm and the high fives that it plays, one after the other."""

    arm: int
    references: tuple[ReferenceTrajectory, ...]


@dataclass(frozen=True)
class ArmPlayed:
    """What one arm did.

    Attributes:
        outcomes: of each high five, by where its plate really was.
        laws: as they were kept.
        speeds: m/s, the body's largest ones near hand and head, really.
        motion: the worst of :func:`highfive.hil.bench.motion_laws.judge_body_motion`, which is no law here: an arm that
            is weaker than its model swings.
        trouble: why it was stopped, or not started; '' if it was not.
    """

    outcomes: tuple[ContactOutcome, ...]
    laws: Laws
    speeds: tuple[float, float]
    motion: dict[str, float]
    trouble: str


def play_with(job: ArmJob) -> ArmPlayed:
    """Has one arm play its high fives."""
    rig, limits, planner, laws = load_rig(), load_limits(), default_planner(), Laws()
    outcomes: list[ContactOutcome] = []
    motion = Laws()
    speeds = [(0.0, 0.0)]
    trouble = ""
    with VirtualClock(job.arm) as clock:
        bus = perturbed_bus(drawn_perturbation(job.arm), rig)
        box = BlackBox(bus, rig)
        try:
            with virtual_arm(VirtualRig(clock, bus, box.look), retarget=planner) as loop:
                for reference in job.references:
                    trial = played_until_stopped(reference, loop)
                    if trial is not None:
                        judge_commands(laws, trial, limits, planner.arm)
                        judge_body_motion(motion, trial, box, limits, planner.arm, box.times[-1])
                    if trial is None or loop.trouble:
                        trouble = loop.trouble
                        break
                    outcomes.append(_really(trial, reference, box))
                    speeds.append(_real_speeds(trial, reference, box))
        except HighFiveError as error:
            trouble = str(error)
        clock.wait_until(clock.now() + _LOOKED_ON_NS)
    judge_body(laws, box, limits)
    return ArmPlayed(
        tuple(outcomes), laws, (max(it for it, _ in speeds), max(it for _, it in speeds)), motion.worst, trouble
    )


def _joints_at(box: BlackBox, times: Sequence[int]) -> list[np.ndarray]:
    at, rows = np.array(box.times), np.array(box.positions)
    return list(np.array([np.interp(np.array(times), at, joint) for joint in rows.T]).T)


def _really(trial: ArmTrial, reference: ReferenceTrajectory, box: BlackBox) -> ContactOutcome:
    """How plate and palm met by where the plate was, not by what the servos said."""
    planner = default_planner()
    plates = [planner.arm.plate_at(pose) for pose in _joints_at(box, [tick.frame_ns for tick in trial.ticks])]
    places, normals = np.array([it.position for it in plates]), np.array([it.normal for it in plates])
    return judged(reference, places, normals, notice(reference, planner), trial.met.relaxation)


def _real_speeds(trial: ArmTrial, reference: ReferenceTrajectory, box: BlackBox) -> tuple[float, float]:
    limits, arm = load_limits(), default_planner().arm
    frames = [tick.frame_ns for tick in trial.ticks]
    points = np.array([arm.points(pose)[0] for pose in _joints_at(box, frames)])
    times, none = 1e-9 * np.array(frames), np.full(3, np.nan)
    heads = np.array([none if tick.goal.head is None else tick.goal.head for tick in trial.ticks])
    hands = reference.person[: len(times)]
    return closing_speed(times, points[:, 0], hands, limits.contact), face_speed(times, points, heads, limits.face)


def bench_arms(options: ArmsOptions, model: HGPDM, bar: Bar) -> dict[str, Any]:
    """Plays on all arms.

    Returns:
        what :func:`arms_figures` gives.

    Raises:
        HighFiveError: no arm is asked for.
    """
    if options.arms < 1:
        raise HighFiveError(f"{options.arms} arms; ask for at least one")
    references = reference_trajectories(model, tuple(EMOTIONS), CELLS, options.seed, bar)
    of_cell = [tuple(it for it in references if it.cell == cell) for cell in CELLS]
    jobs = [ArmJob(options.first + number, of_cell[number % len(of_cell)]) for number in range(options.arms)]
    return arms_figures(jobs, list(parallel_map(play_with, jobs, lambda total: bar("arms", total))))


def arms_figures(jobs: Sequence[ArmJob], played: Sequence[ArmPlayed]) -> dict[str, Any]:
    """The figures of all arms.

    Args:
        jobs: the arms.
        played: what each did.

    Returns:
        ``arms``, ``high_fives``; ``error_mm``: ``median``, ``p90``, ``max`` of plate to palm where that was possible;
        ``by_arm_mm``: of the arms' medians the ``median`` and the ``max``; ``missed``; ``body_closing_speed`` and
        ``body_face_speed``, m/s; ``motion``: figure → worst value, which is held to nothing; ``worst``: law → value;
        ``broken``: ``law``, ``arm``, ``value``; ``stopped``: ``arm`` and why.
    """
    able = [[it for it in one.outcomes if it.possible] for one in played]
    errors = 1e3 * np.array([it.error for one in able for it in one])
    medians = 1e3 * np.array([np.median([it.error for it in one]) for one in able if one])
    return {
        "arms": len(jobs),
        "high_fives": len(errors),
        "error_mm": _rounded(errors, median=0.5, p90=0.9, max=1.0),
        "by_arm_mm": _rounded(medians, median=0.5, max=1.0),
        "missed": sum(not it.touched for one in able for it in one),
        "body_closing_speed": round(max(one.speeds[0] for one in played), 3),
        "body_face_speed": round(max(one.speeds[1] for one in played), 3),
        "motion": {name: round(value, 4) for name, value in sorted(largest([it.motion for it in played]).items())},
        "worst": {law: round(value, 4) for law, value in sorted(largest([it.laws.worst for it in played]).items())},
        "broken": [
            {"law": law, "arm": job.arm, "value": value}
            for job, one in zip(jobs, played, strict=True)
            for law, value in one.laws.broken
        ],
        "stopped": [{"arm": job.arm, "why": one.trouble} for job, one in zip(jobs, played, strict=True) if one.trouble],
    }


def _rounded(values: np.ndarray, **quantiles: float) -> dict[str, float | None]:
    """Quantiles by name; None where no high five was possible."""
    return {name: round(float(np.quantile(values, at)), 2) if len(values) else None for name, at in quantiles.items()}


def print_arms(result: dict[str, Any]) -> None:
    """The figures, for people."""
    error, arms = result["error_mm"], result["by_arm_mm"]
    print(f"{result['arms']} arms that are not as their model says, {result['high_fives']} high fives")
    print(f"  plate to palm, mm   median {error['median']}, 90 % {error['p90']}, worst {error['max']}")
    print(f"  by arm, mm          median {arms['median']}, worst {arms['max']}; {result['missed']} not touched")
    print(
        f"  the body, m/s       {result['body_closing_speed']} near the hand, {result['body_face_speed']} near the head"
    )
    for name, value in result["motion"].items():
        print(f"  {name:<52}{value:>10.4g}   no law here")
    for law, value in result["worst"].items():
        print(f"  {law:<52}{value:>10.4g}")
    for one in result["stopped"]:
        print(f"  arm {one['arm']} was stopped: {one['why']}")
    for one in result["broken"]:
        print(f"  BROKEN by arm {one['arm']}: {one['law']}: {one['value']:.4g}")
