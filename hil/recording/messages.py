"""How the session's values become the JSON messages of a recording (:mod:`highfive.hil.recording.schemas`).

Units: m, rad, s, ns where a name says so. Quaternions are w, x, y, z, each joint relative to its parent.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.sim.avatar import Pose
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.frames import HumanArm, MarkerFrame
from highfive.model.geometry.rotations import Array
from highfive.model.online.contact_forecast import ContactForecast

if TYPE_CHECKING:
    from highfive.hil.arm.loop import ArmTick
    from highfive.hil.drivers.bus.cycle_ring import Cycle


def rounded(values: Array, digits: int = 5) -> list[Any]:
    """As nested lists, to 10 µm or 10 µrad: a fifth of the size of full floats."""
    return np.round(values, digits).tolist()


def known(value: float) -> float | None:
    """A number that JSON can hold; None for NaN and infinity."""
    return round(value, 5) if np.isfinite(value) else None


def number(value: Any) -> float | None:
    """All of a number of somebody else's, as JSON can hold it; None for NaN and infinity."""
    return value if math.isfinite(value) else None


def pose(pose: Pose) -> dict[str, Any]:
    """For ``/avatar`` and ``/generated``."""
    return {"root": rounded(pose.root_in_world), "quaternions": rounded(pose.quaternions)}


def forecast(contact: ContactForecast) -> dict[str, Any]:
    """For ``/forecast``: s from the message's time on; the covariance of the point is in m²."""
    return {
        "time": round(contact.time, 5),
        "time_deviation": round(contact.deviation, 5),
        "point": rounded(contact.point),
        "covariance": rounded(contact.covariance[:3, :3], 9),
    }


def person(arm: HumanArm) -> dict[str, Any]:
    """For ``/person``."""
    return {
        "head": rounded(arm.head_position),
        "head_orientation": rounded(arm.head_orientation),
        "shoulder": rounded(arm.shoulder),
        "elbow": rounded(arm.elbow),
        "wrist": rounded(arm.wrist),
        "knuckles": rounded(arm.knuckles),
        "palm": rounded(arm.palm.position),
        "palm_normal": rounded(arm.palm.normal),
        "valid": bool(arm.valid),
        "age_ns": int(arm.age_ns),
    }


def frame(frame: MarkerFrame) -> dict[str, Any]:
    """For ``/frame``: all of it, as it came into the tick; numbers are not rounded, so that it can be played again."""
    covariance = frame.covariance
    return {
        "names": list(frame.names),
        "positions": frame.positions.tolist(),
        "valid": frame.valid.tolist(),
        "number": int(frame.number),
        "source_time_ns": int(frame.source_time_ns),
        "arrival_time_ns": int(frame.arrival_time_ns),
        "latency_ns": int(frame.latency_ns),
        "unlabelled": frame.unlabelled.tolist(),
        "covariance": None if covariance is None else covariance.reshape(len(covariance), 9).tolist(),
        "counted": bool(frame.counted),
        "own_clock": bool(frame.own_clock),
        "impossible": int(frame.impossible),
    }


def contact(result: TrialResult, met_s: float) -> dict[str, Any]:
    """For ``/contact``; ``met_s``: when palms met, s from the first tick by the recording's clock."""
    found = result.contact
    return {
        "trial": result.number,
        "style": result.style,
        "met": found.met,
        "met_time": known(met_s),
        "distance": known(found.distance),
        "gap": known(found.gap),
        "lateral": known(found.lateral),
        "palm_angle": known(found.palm_angle),
        "approach_speed": known(found.approach_speed),
        "peak_force": known(found.peak_force),
        "where": rounded(found.where),
        "out_of_reach": bool(result.out_of_reach),
        "uncorrected_error": known(result.uncorrected_error),
        "true_error": known(result.true_error),
        "touch_error": known(result.touch_error),
        "unwanted": [{"first": u.first, "second": u.second, "deepest": known(u.deepest)} for u in found.unwanted],
    }


def arm_cycle(cycle: Cycle) -> dict[str, Any]:
    """For ``/arm``; times are of the host's monotonic clock."""
    state, health, sent = cycle.state, cycle.health, cycle.sent
    return {
        "number": cycle.number,
        "mode": cycle.mode.name.lower(),
        "due_ns": cycle.due_ns,
        "begun_ns": cycle.begun_ns,
        "took_ns": cycle.took_ns,
        "sent": None if sent is None else rounded(sent.positions),
        "sent_currents": None if sent is None else rounded(sent.currents, 3),
        "positions": rounded(state.positions),
        "velocities": rounded(state.velocities),
        "currents": rounded(state.currents, 3),
        "errors": state.errors.tolist(),
        "answered": state.answered.tolist(),
        "tripped": state.tripped.tolist(),
        "apart": rounded(state.apart),
        "temperatures": rounded(health.temperatures, 1),
        "voltages": rounded(health.voltages, 2),
    }


def safety(tick: ArmTick) -> dict[str, Any]:
    """For ``/safety``."""
    return {**tick.report.record(), "wanted": rounded(tick.planned), "step_ms": known(tick.step_ms)}
