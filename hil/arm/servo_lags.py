"""How late each joint of an arm is: each in turn is led along a chirp, slowly, and its encoder is listened to."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from highfive.calibration.chirp import ChirpSettings, chirp
from highfive.calibration.servo_lag import ServoLag, servo_lag
from highfive.hil.arm.free_postures import check_way
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.safety.limits import Limits
from highfive.model.errors import HighFiveError

NS, MS = 1e-9, 1e-3

LONGEST_S, UNSURE_S = 0.15, 0.005
"""A servo's lag, and how sure it has to be."""


def servo_lags(
    drive: PostureDrive,
    arm: ServoArm,
    limits: Limits,
    joints: Sequence[str],
    advance: Callable[[], object] = lambda: None,
    settings: ChirpSettings | None = None,
) -> dict[str, ServoLag]:
    """From command to encoder, by the driver's clock: of joints by their names, about where the arm waits.

    No chirp is faster than the limits of its joint, nor than a point of the arm may be.

    Raises:
        HighFiveError: the arm was stopped, or a joint does not follow; which.
    """
    s, found = settings or ChirpSettings(), {}
    check_way(arm, drive.positions, arm.ready, drive.command("release"))
    drive.go(arm.ready)
    ways = np.linalg.norm(arm.points(arm.ready)[1], axis=1)  # (P, J) m/rad
    for name in joints:
        joint = limits.names.index(name)
        own, along = limits.joints[joint], np.eye(len(limits.joints))[joint]
        speed = min(own.speed, drive.settings.point_speed / max(float(ways[:, joint].max()), 1e-6))
        course = lambda t, along=along, speed=speed, most=own.braking: (  # noqa: E731
            arm.ready + along * chirp(np.array([t]), speed, most, s)[0]
        )
        cycles = [cycle for cycle in drive.follow(course, s.seconds + 0.1) if cycle.sent is not None]
        told = np.array([cycle.sent.positions[joint] for cycle in cycles if cycle.sent is not None])
        heard = np.array([cycle.state.answered[joint] for cycle in cycles])
        at, begun = NS * np.array([[cycle.state.time_ns, cycle.begun_ns] for cycle in cycles]).T
        angles = np.array([cycle.state.positions[joint] for cycle in cycles])
        try:
            found[name] = lag = servo_lag(begun - begun[0], told, (at - begun[0])[heard], angles[heard])
        except HighFiveError as error:
            raise HighFiveError(f"{name}: {error}") from None
        if not (0.0 <= lag.lag <= LONGEST_S and lag.lag_error <= UNSURE_S):
            raise HighFiveError(
                f"{name}: a lag of {lag.lag / MS:.1f} ± {lag.lag_error / MS:.1f} ms is none that can be trusted; "
                f"expected 0 to {LONGEST_S / MS:.0f}, to {UNSURE_S / MS:.0f} ms: is it blocked, or does it slip?"
            )
        drive.go(arm.ready)
        advance()
    return found
