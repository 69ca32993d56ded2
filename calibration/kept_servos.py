"""What a calibration has of an arm's servos: a new one of its room, links and plate keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta

import numpy as np

from highfive.calibration.arm_file import ArmCalibration, CalibratedJoint
from highfive.calibration.arm_latency import SERVO_LAG
from highfive.calibration.arm_poses import ArmPoses
from highfive.calibration.registration import REGISTRATION, RegistrationSettings
from highfive.model.geometry.rotations import Array

SERVOS, LAGS, SEEN = "play, friction and shadows", "lags", "ages of frames"
"""What ``calibrate servos`` and ``calibrate latency`` measure, as it is called where it is not kept."""


@dataclass(frozen=True)
class KeptServos:
    """What is still valid of an arm's servos.

    Attributes:
        joints: by name; empty where nothing was measured, or nothing is valid.
        latency: s, by name; empty likewise.
        servos_date, latency_date: UTC, when; None where that is empty.
        dropped: what is not kept (:data:`SERVOS`, :data:`LAGS`, :data:`SEEN`), and why, of each.
    """

    joints: Mapping[str, CalibratedJoint] = field(default_factory=dict)
    latency: Mapping[str, float] = field(default_factory=dict)
    servos_date: datetime | None = None
    latency_date: datetime | None = None
    dropped: Mapping[str, str] = field(default_factory=dict)

    def play(self, names: tuple[str, ...]) -> Array:
        """(J,) rad, of the joints."""
        return np.array([self.joints[name].play if name in self.joints else 0.0 for name in names])


def kept_servos(
    before: ArmCalibration, arm: str, system: str, now: datetime, settings: RegistrationSettings = REGISTRATION
) -> KeptServos:
    """What is still valid of a calibration that is to be replaced.

    Args:
        before: the one that is there.
        arm: fingerprint of the arm that is calibrated anew; another one's servos are others.
        system: the motion capture by which it is: another one's latency is another, the servos' lags are not.
        now: UTC.
        settings: with the longest age of what is relied on.
    """
    own = before.registration
    lags = {name: value for name, value in before.latency.items() if name.endswith(SERVO_LAG)}
    seen = {name: value for name, value in before.latency.items() if name not in lags}
    measured = {
        SERVOS: any(joint.play or joint.friction is not None or joint.shadow is not None for joint in _all(before)),
        LAGS: bool(lags),
        SEEN: bool(seen),
    }
    latency = before.latency_date or own.date
    dates = {SERVOS: before.servos_date or own.date, LAGS: latency, SEEN: latency}
    dropped: dict[str, str] = {}
    for what in (what for what, there in measured.items() if there):
        age = now - dates[what]
        if own.arm != arm:
            dropped[what] = f"they are of another arm ({own.arm}; this one is {arm})"
        elif age > timedelta(days=settings.longest_age):
            dropped[what] = f"they are {age.days} days old, at most {settings.longest_age:g} are relied on"
        elif what == SEEN and own.system != system:
            dropped[what] = f"they are of a {own.system} system; this one is {system}"
    good = {what: there and what not in dropped for what, there in measured.items()}
    return KeptServos(
        joints=before.joints if good[SERVOS] else {},
        latency=(lags if good[LAGS] else {}) | (seen if good[SEEN] else {}),
        servos_date=dates[SERVOS] if good[SERVOS] else None,
        latency_date=dates[LAGS] if good[LAGS] or good[SEEN] else None,
        dropped=dropped,
    )


def _all(found: ArmCalibration) -> list[CalibratedJoint]:
    return list(found.joints.values())


def without_play(poses: ArmPoses, play: Array) -> ArmPoses:
    """Poses as an arm without play would have taken them: encoders with half of the known play (J,), rad, in them."""
    return replace(poses, encoders=poses.encoders + 0.5 * play * poses.sides)


def with_servos(new: ArmCalibration, kept: KeptServos) -> ArmCalibration:
    """A new calibration, of poses :func:`without_play`, with what was kept in it."""
    joints = {
        name: replace(joint, play=own.play, friction=own.friction, shadow=own.shadow)
        if (own := kept.joints.get(name))
        else joint
        for name, joint in new.joints.items()
    }
    dates = {"servos_date": kept.servos_date, "latency_date": kept.latency_date}
    return replace(new, joints=joints, latency=kept.latency, **dates)
