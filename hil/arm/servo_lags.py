"""How late each joint of an arm is: each in turn is led along a chirp, slowly, and its encoder is listened to.

What a joint gives way to its load looks like lag as well, friction most of all. Retargeting makes up for that by its
torques, and plans ahead of time by the rest: so the same torques are taken off here.

Where a motion capture system sees the plate, its markers are listened to as well: how late that is comes with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.arm_kinematics import ArmShape
from highfive.calibration.chirp import ChirpSettings, chirp
from highfive.calibration.servo_lag import ServoLag, servo_lag
from highfive.hil.arm.free_postures import check_way
from highfive.hil.arm.mocap_lags import MocapDelay, SeenFrames, mocap_delay, ways
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm_model.dynamics import dynamics, friction_torque
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.safety.limits import Limits
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

NS, MS = 1e-9, 1e-3

LONGEST_S, UNSURE_S = 0.15, 0.005
"""A servo's lag, and how sure it has to be."""

_STEP_S = 2e-3  # of the differences by which speed and acceleration of a chirp are taken


@dataclass
class PlateSeen:
    """Who sees the plate while joints are led along, and what that told.

    Attributes:
        frames: of the motion capture, with the plate's markers first.
        shape: the arm as drawn, with its markers.
        found: its calibration.
        strengths: (J,) N·m/A, of a joint's servos together.
        reply: s, that the servos' answer takes on the line: they measure as it begins.
        delays: of the motion capture, by the joints that tell of it.
    """

    frames: SeenFrames
    shape: ArmShape
    found: ArmCalibration
    strengths: Array
    reply: float
    delays: dict[str, MocapDelay] = field(default_factory=dict)

    def ways(self, angles: Array) -> Array:
        """(M, 3, J) m/rad, along which joints move the markers, about angles (J,), rad, zeros in them."""
        zeros = np.array([self.found.joints[name].zero for name in self.shape.names])
        return ways(self.shape, self.found, angles - zeros)

    def tell(self, joint: int, led: Led, ready: Array) -> None:
        """Takes in what was seen of a joint that was led along, about ``ready`` (J,), rad."""
        assert led.frames is not None
        states = [cycle.state for cycle in led.cycles if cycle.state.answered.all()]
        read = np.array([state.time_ns for state in states], np.int64) - round(1e9 * self.reply)
        angles, speeds, currents = (
            np.array([getattr(state, name) for state in states]) for name in ("positions", "velocities", "currents")
        )
        own = [self.found.joints[name] for name in self.shape.names]
        play, soft = np.array([one.play for one in own]), np.array([one.compliance for one in own])
        # Where links are: behind play and compliance, neither of which an encoder sees. Others give way, too.
        links = angles + 0.5 * play * np.sign(speeds) - soft * self.strengths * currents
        all_ways = self.ways(ready)
        way = all_ways[..., joint]
        shares = np.einsum("maj,ma->j", all_ways, way) / np.sum(way**2)
        if (found := mocap_delay(read, links @ shares, led.frames, way)) is not None:
            self.delays[self.shape.names[joint]] = found


def slow_enough(drive: PostureDrive, arm: ServoArm, limits: Limits, joint: int) -> float:
    """rad/s, that a joint may have about where the arm waits: by its limit, and that of any point of the arm."""
    ways = np.linalg.norm(arm.points(arm.ready)[1][..., joint], axis=1)  # (P,) m/rad
    return min(limits.joints[joint].speed, drive.settings.point_speed / max(float(ways.max()), 1e-6))


@dataclass(frozen=True)
class Led:
    """A joint that was led along a chirp.

    Attributes:
        name: of the joint.
        angle: (N,) rad beside where the arm waits, at (N,) s from the beginning.
        cycles: of the bus, that sent goals.
        frames: of the motion capture meanwhile; None where none looks.
    """

    name: str
    angle: Callable[[Array], Array]
    cycles: list[Cycle]
    frames: SeenFrames | None = None


def lead_along(
    drive: PostureDrive,
    arm: ServoArm,
    limits: Limits,
    joints: Sequence[str],
    advance: Callable[[], object] = lambda: None,
    settings: ChirpSettings | None = None,
    frames: SeenFrames | None = None,
) -> list[Led]:
    """Leads joints along chirps, one after the other, about where the arm waits; what they tell, :func:`servo_lags`
    finds once the arm has been let go, for that takes seconds.

    No chirp is faster than the limits of its joint, nor than a point of the arm may be.

    Raises:
        HighFiveError: the arm was stopped.
    """
    s, led = settings or ChirpSettings(), list[Led]()
    check_way(arm, drive.positions, arm.ready, drive.command("release"))
    drive.go(arm.ready)
    for name in joints:
        joint = limits.names.index(name)
        own, along = limits.joints[joint], np.eye(len(limits.joints))[joint]
        angle = partial(chirp, speed=slow_enough(drive, arm, limits, joint), acceleration=own.braking, settings=s)
        course = lambda t, along=along, angle=angle: arm.ready + along * angle(np.array([t]))[0]  # noqa: E731
        if frames is not None:
            frames.begin()
        look = (lambda: None) if frames is None else frames.look
        cycles = [cycle for cycle in drive.follow(course, s.seconds + 0.1, look) if cycle.sent is not None]
        led.append(Led(name, angle, cycles, None if frames is None else frames.taken()))
        drive.go(arm.ready)
        advance()
    return led


def servo_lags(
    led: Sequence[Led],
    arm: ServoArm,
    limits: Limits,
    plate: PlateSeen | None = None,
    reply: float = 0.0,
    sag: Array | None = None,
) -> dict[str, ServoLag]:
    """From command to encoder, by the driver's clock: of joints by their names, about where the arm waits.

    Where the plate was seen, what joints tell of the motion capture goes into ``plate.delays``. ``reply``: s, that an
    answer takes on the line. ``sag``: (J,) rad/(N·m), by which joints give way to the torques of arm and gears that the
    model knows; None takes nothing off.

    Raises:
        HighFiveError: a joint did not follow; which.
    """
    found: dict[str, ServoLag] = {}
    for one in led:
        name, joint = one.name, limits.names.index(one.name)
        try:
            lag = lag_of(one.cycles, joint, reply)
            if sag is not None:
                period = limits.timing.period_s
                load = partial(_load, arm, joint, lambda t, one=one, late=lag.lag - period: one.angle(t - late))
                lag = lag_of(one.cycles, joint, reply, lambda t, load=load, soft=sag[joint]: soft * load(t))
            found[name] = lag
            if plate is not None and one.frames is not None:
                plate.tell(joint, one, arm.ready)
        except HighFiveError as error:
            raise HighFiveError(f"{name}: {error}") from None
        if not (0.0 <= lag.lag <= LONGEST_S and lag.lag_error <= UNSURE_S):
            raise HighFiveError(
                f"{name}: a lag of {lag.lag / MS:.1f} ± {lag.lag_error / MS:.1f} ms is none that can be trusted; "
                f"expected 0 to {LONGEST_S / MS:.0f}, to {UNSURE_S / MS:.0f} ms: is it blocked, or does it slip?"
            )
    return found


def lag_of(
    cycles: Sequence[Cycle], joint: int, reply: float, gives_way: Callable[[Array], Array] | None = None
) -> ServoLag:
    """Of one joint, in cycles that sent goals.

    Args:
        cycles: of the bus.
        joint: which.
        reply: s, that an answer takes on the line.
        gives_way: (N,) rad, by which the joint stands off its goal by its load, at (N,) s from the first cycle on.
    """
    told = np.array([cycle.sent.positions[joint] for cycle in cycles if cycle.sent is not None])
    heard = np.array([cycle.state.answered[joint] for cycle in cycles])
    at, begun = NS * np.array([[cycle.state.time_ns, cycle.begun_ns] for cycle in cycles]).T
    angles = np.array([cycle.state.positions[joint] for cycle in cycles])
    at = at - reply - begun[0]
    off = 0.0 if gives_way is None else gives_way(at)
    return servo_lag(begun - begun[0], told, at[heard], (angles + off)[heard])


def _load(arm: ServoArm, joint: int, angle: Callable[[Array], Array], times: Array) -> Array:
    """(N,) N·m of inertia and friction as one joint moves along ``angle``; gravity's the goals lead by already."""
    before, now, after = (angle(times + step) for step in (-_STEP_S, 0.0, _STEP_S))
    speeds, pulls = (after - before) / (2.0 * _STEP_S), (after - 2.0 * now + before) / _STEP_S**2
    mass = dynamics(arm.packed, arm.ready, np.zeros(arm.joints))[0][joint, joint]  # the same at all its own angles
    return mass * pulls + np.array([friction_torque(arm.packed, joint, speed) for speed in speeds])
