"""Calibrates arms that are not as their files say, and measures where their plates really are at contact.

What calibrates sees encoders and markers, and no truth. Postures of contact are those of the grid, ± 5 cm and ± 25°.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from highfive.calibration.arm_fit import ARM_FIT, EXTRINSICS, ArmFit, check_fit, fit_arm
from highfive.calibration.arm_kinematics import as_drawn
from highfive.calibration.arm_plate import Plate, held_out, plate_of_fit
from highfive.calibration.arm_poses import ArmPoses
from highfive.calibration.arm_result import Source, calibration_of
from highfive.calibration.pose_check import BASE, POSE_CHECK, PoseCheck, check_poses
from highfive.calibration.pose_choice import choose_poses
from highfive.calibration.rigid_fit import rigid_fit
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.free_postures import free_postures
from highfive.hil.arm.hidden_arm import COUNT, TEMPLATE, HiddenArm, HiddenTruth, drawn_truth
from highfive.hil.arm.plate_errors import contact_postures, missed, true_plates
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import DEFAULT_MOUNT, default_arm
from highfive.hil.bench.calibrated_contact import bench_calibrated_contact
from highfive.hil.bench.lag_error import lag_errors
from highfive.hil.runtime.console import STDOUT, Bar
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

NOISE_M, LOST, STRAYS, STRAY_M = 0.0005, 0.03, 0.1, 0.03
"""Of a pose's markers: noise, share of those that are not seen, and of those astray, and how far."""
BUMP_M, BUMP_RAD, SLIP_RAD = 0.003, np.radians(0.3), np.radians(0.5)
UP = np.array([0.0, 0.0, 1.0])
CHECKS = 8
"""Five-pose checks of each arm as it was, and of each way in which it was changed."""
_PLAIN = replace(ARM_FIT, joint_noise=1e-6, cut=1e9, marker=1.0, base_turn=10.0, base_place=10.0)
"""Plain least squares, as who believes the drawing would use it."""


@dataclass(frozen=True)
class CalibrationBenchOptions:
    """What is measured: number of arms, the seed of the first, how many high fives it has with a served person, and of
    how many of the arms the lags are measured."""

    arms: int = 16
    first: int = 0
    high_fives: int = 36
    lags: int = 4


class _Bench:
    """One arm, what is seen of it, and where its plate is in contact."""

    def __init__(self, truth: HiddenTruth, contacts: Array) -> None:
        self.truth, self.contacts = truth, contacts
        self.shape = drawn_shape(default_arm(), TEMPLATE.markers)
        self._rng = np.random.default_rng((truth.seed, 3))
        self.plates = true_plates(truth, contacts)

    def seen(self, postures: Array, truth: HiddenTruth | None = None, strays: float = 0.0) -> ArmPoses:
        """Postures (N, J), rad, as encoders and cameras have them."""
        arm, rng = HiddenArm(truth or self.truth, int(self._rng.integers(1 << 30))), self._rng
        encoders = np.round(postures / COUNT) * COUNT
        sides = np.where(rng.random(encoders.shape) < 0.5, -1.0, 1.0)
        places = []
        for joints, side in zip(encoders, sides, strict=True):
            arm.stand(joints, side)
            places.append(arm.markers())
        markers = np.array(places) + rng.normal(0.0, NOISE_M, (len(encoders), len(TEMPLATE.names), 3))
        away = rng.normal(size=markers.shape)
        away *= STRAY_M / np.linalg.norm(away, axis=-1, keepdims=True)
        markers += np.where(rng.random((*markers.shape[:2], 1)) < strays, away, 0.0)
        return ArmPoses(encoders, sides, markers, rng.random(markers.shape[:2]) >= LOST)

    def missed(self, fit: ArmFit, plate: Plate) -> Array:
        """m, of the plate's middle at contact."""
        return missed(fit, plate, self.contacts, self.plates)

    def fitted(self, poses: ArmPoses) -> Array:
        """m, with everything fitted."""
        fit = fit_arm(self.shape, poses, UP)
        check_fit(fit)
        return self.missed(fit, plate_of_fit(fit, TEMPLATE))

    def base_only(self, poses: ArmPoses) -> Array:
        """m, with base and markers fitted, and the drawing believed."""
        fit = fit_arm(self.shape, poses, UP, EXTRINSICS, _PLAIN)
        laid = rigid_fit(TEMPLATE.places, fit.shape.markers + fit.errors.marker)
        return self.missed(fit, Plate(laid.translation, laid.rotation @ TEMPLATE.normal, laid.rms))

    def by_tape(self) -> Array:
        """m, with the mount believed."""
        turn = rotations.to_matrix(self.truth.mocap)
        drawn = as_drawn(
            self.shape,
            turn @ rotations.to_matrix(DEFAULT_MOUNT.quaternion),
            self.truth.in_mocap(np.array(DEFAULT_MOUNT.position)),
        )
        none = np.zeros(drawn.packed().size)
        fit = ArmFit(self.shape, drawn, UP, (), none, none, 0.0, np.zeros(0), np.zeros(0))
        return self.missed(fit, Plate(TEMPLATE.centre, TEMPLATE.normal, 0.0))

    def checks(self, poses: ArmPoses, five: Array) -> tuple[list[PoseCheck], dict[str, list[PoseCheck]]]:
        """Five-pose checks of the arm as it was, and bumped or slipped."""
        fit = fit_arm(self.shape, poses, UP)
        source = Source("bench", "bench", datetime(2026, 1, 1, tzinfo=UTC), "", "")
        mount = (np.array(DEFAULT_MOUNT.position), DEFAULT_MOUNT.quaternion)
        off = held_out(self.shape, poses, UP, TEMPLATE)
        kept = calibration_of(Path("bench"), fit, poses, plate_of_fit(fit, TEMPLATE), TEMPLATE, off, mount, source)

        def look(truth: HiddenTruth) -> PoseCheck:
            return check_poses(self.shape, kept, self.seen(five, truth))

        def moved() -> HiddenTruth:
            way = self._rng.normal(size=3) * [1.0, 1.0, 0.0]
            return replace(self.truth, base=self.truth.base + BUMP_M * way / np.linalg.norm(way))

        def turned() -> HiddenTruth:
            turn = np.array([0.0, 0.0, self._rng.choice([-BUMP_RAD, BUMP_RAD])])
            return replace(self.truth, base_turn=self.truth.base_turn + turn)

        def slipped() -> HiddenTruth:
            zero = self.truth.zero.copy()
            zero[self._rng.integers(1, 3)] += self._rng.choice([-SLIP_RAD, SLIP_RAD])
            return replace(self.truth, zero=zero)

        changes = {"moved_3mm": moved, "turned_0_3deg": turned, "slipped_0_5deg": slipped}
        return (
            [look(self.truth) for _ in range(CHECKS)],
            {name: [look(change()) for _ in range(CHECKS)] for name, change in changes.items()},
        )


def bench_calibration(options: CalibrationBenchOptions, bar: Bar) -> dict[str, Any]:
    """The figures: mm at contact over all arms, and shares of the five-pose checks."""
    shape, contacts = drawn_shape(default_arm(), TEMPLATE.markers), contact_postures()
    free = free_postures(default_arm(), 0)
    order = choose_poses(shape, free, 30)
    five = free[choose_poses(shape, free, POSE_CHECK.poses, BASE)]
    found: dict[str, list[Array]] = {}
    quiet: list[PoseCheck] = []
    bumped: dict[str, list[PoseCheck]] = {}
    advance = bar("arms", options.arms)
    for seed in range(options.first, options.first + options.arms):
        one = _Bench(drawn_truth(seed), contacts)
        poses = one.seen(free[order])
        with_play = _Bench(drawn_truth(seed, play=float(np.radians(0.3))), contacts)
        for name, off in {
            "plate_mm": one.fitted(poses),
            "plate_15_mm": one.fitted(one.seen(free[order[:15]])),
            "strays_mm": one.fitted(one.seen(free[order], strays=STRAYS)),
            "play_mm": with_play.fitted(with_play.seen(free[order])),
            "extrinsics_only_mm": one.base_only(poses),
            "tape_mm": one.by_tape(),
        }.items():
            found.setdefault(name, []).append(1e3 * off)
        still, changed = one.checks(poses, five)
        quiet += still
        for name, checks in changed.items():
            bumped.setdefault(name, []).extend(checks)
        advance()
    caught = {name: _alarms(checks) for name, checks in bumped.items()}
    return {
        "arms": options.arms,
        **{name: _spread(np.concatenate(off)) for name, off in found.items()},
        "check_mm": {
            name: _spread(np.array([1e3 * one.rms for one in checks]))
            for name, checks in {"as_it_was": quiet, **bumped}.items()
        },
        "bump_caught": round(float(np.mean(list(caught.values()))), 4),
        "bump_caught_by_kind": {name: round(share, 4) for name, share in caught.items()},
        "false_alarms": round(_alarms(quiet), 4),
        "latency_error_ms": _latency_error(range(options.first, options.first + min(options.lags, options.arms)), bar),
        "contact_mm": bench_calibrated_contact(options.first, options.high_fives, bar),
    }


def _latency_error(seeds: range, bar: Bar) -> dict[str, Any]:
    """ms, of all joints; the worst joint by name."""
    off = 1e3 * np.abs(lag_errors(seeds, bar))
    by_joint = {name: round(float(most), 2) for name, most in zip(find_arm().names, off.max(axis=0), strict=True)}
    return {**_spread(off.ravel()), "arms": len(seeds), "largest_by_joint": by_joint}


def _alarms(checks: list[PoseCheck]) -> float:
    return sum(bool(one.trouble) for one in checks) / len(checks)


def _spread(values: Array) -> dict[str, float]:
    return {"median": round(float(np.median(values)), 2), "p95": round(float(np.percentile(values, 95)), 2)}


def print_calibration(figures: dict[str, Any]) -> None:
    """The figures for people."""
    names = {
        "tape_mm": "the tape measure alone",
        "extrinsics_only_mm": "base and markers alone",
        "plate_15_mm": "everything, 15 poses",
        "plate_mm": "everything, 30 poses",
        "strays_mm": "everything, one marker in ten 30 mm astray",
        "play_mm": "everything, up to 0.3° of play, not fitted",
    }
    shown = Table("plate at contact", "median, mm", "95 %, mm", box=SIMPLE_HEAD)
    for name, words in names.items():
        shown.add_row(words, f"{figures[name]['median']:.2f}", f"{figures[name]['p95']:.2f}")
    STDOUT.print(shown)
    kinds = ", ".join(f"{name} {share:.0%}" for name, share in figures["bump_caught_by_kind"].items())
    print(f"Five-pose check: {figures['bump_caught']:.1%} of what changed was caught ({kinds}),")
    print(f"{figures['false_alarms']:.1%} false alarms; {figures['arms']} arms.")
    late = figures["latency_error_ms"]
    print(f"Lags of {late['arms']} arms' joints: {late['median']:.2f} ms off (median), {late['p95']:.2f} (95 %).")
    met = figures["contact_mm"]
    print(
        f"{met['high_fives']} high fives with a served person: {met['median']:.1f} mm (median) calibrated at the wire, "
        f"{met['known_median']:.1f} mm with the same arm known exactly."
    )
