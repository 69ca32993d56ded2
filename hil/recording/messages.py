"""The messages of a recording: their schemas, and how the session's values become JSON.

Units: m, rad, s, ns where a name says so. Quaternions are w, x, y, z, each joint relative to its parent.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.frames import HumanArm
from highfive.model.geometry.rotations import Array
from highfive.model.online.contact_forecast import ContactForecast

if TYPE_CHECKING:
    from highfive.hil.arm.loop import ArmTick
    from highfive.hil.drivers.bus.cycle_ring import Cycle

_NUMBER: dict[str, Any] = {"type": "number"}
_TEXT: dict[str, Any] = {"type": "string"}
_YES: dict[str, Any] = {"type": "boolean"}
_LIST: dict[str, Any] = {"type": "array", "items": _NUMBER}
_ROWS: dict[str, Any] = {"type": "array", "items": _LIST}
_NAMES: dict[str, Any] = {"type": "array", "items": _TEXT}
_UNKNOWN: dict[str, Any] = {"type": ["number", "null"]}
_MAYBE: dict[str, Any] = {"type": ["array", "null"], "items": _NUMBER}
_ANSWERS: dict[str, Any] = {"type": "array", "items": _YES}
_POSE = {"root": _LIST, "quaternions": _ROWS}
CHANNELS: dict[str, tuple[str, dict[str, Any]]] = {
    "/session": ("high_five.Session", {"settings": {"type": "object"}, "joints": _NAMES, "units": _TEXT}),
    "/trial": (
        "high_five.Trial",
        {"trial": _NUMBER, "title": _TEXT, "emotion": _TEXT, "style": _TEXT, "cell": _TEXT, "simulated": _YES,
         "notes": _NAMES},
    ),
    "/markers": ("high_five.Markers", {"names": _NAMES, "positions": _ROWS, "seen": {"type": "array", "items": _YES}}),
    "/person": (
        "high_five.Person",
        {"head": _LIST, "head_orientation": _LIST, "shoulder": _LIST, "elbow": _LIST, "wrist": _LIST, "knuckles": _LIST,
         "palm": _LIST, "palm_normal": _LIST, "valid": _YES, "age_ns": _NUMBER},
    ),
    "/generated": ("high_five.Pose", _POSE),
    "/avatar": ("high_five.Pose", _POSE),
    "/tick": (
        "high_five.Tick",
        {"trial": _NUMBER, "phase": _TEXT, "weight": _NUMBER, "time_to_contact": _UNKNOWN, "latency_ms": _UNKNOWN},
    ),
    "/forecast": (
        "high_five.Forecast",
        {"time": _NUMBER, "time_deviation": _NUMBER, "point": _LIST, "covariance": _ROWS},
    ),
    "/contact": (
        "high_five.Contact",
        {"trial": _NUMBER, "met": _YES, "distance": _NUMBER, "gap": _NUMBER, "lateral": _NUMBER, "palm_angle": _NUMBER,
         "approach_speed": _NUMBER, "peak_force": _NUMBER, "where": _LIST, "out_of_reach": _YES},
    ),
    "/arm": (
        "high_five.ArmCycle",
        {"number": _NUMBER, "mode": _TEXT, "due_ns": _NUMBER, "begun_ns": _NUMBER, "took_ns": _NUMBER, "sent": _MAYBE,
         "sent_currents": _MAYBE, "positions": _LIST, "velocities": _LIST, "currents": _LIST, "errors": _LIST,
         "answered": _ANSWERS, "tripped": _ANSWERS, "apart": _LIST, "temperatures": _LIST, "voltages": _LIST},
    ),
    "/safety": (
        "high_five.Safety",
        {"state": _TEXT, "event": {"type": ["string", "null"]}, "reason": _TEXT, "wanted": _LIST, "asked": _MAYBE,
         "reference": _MAYBE, "positions": _MAYBE, "currents": _MAYBE, "acted": _NAMES, "share": _NUMBER,
         "closing_speed": _UNKNOWN, "gap": _UNKNOWN, "step_ms": _NUMBER},
    ),
    "/skeleton": ("foxglove.SceneUpdate", {"deletions": {"type": "array"}, "entities": {"type": "array"}}),
}  # fmt: skip
"""Schema name and properties of each topic."""
_RGBA = {"avatar": (0.84, 0.37, 0.0, 1.0), "person": (0.0, 0.45, 0.70, 1.0)}


def rounded(values: Array, digits: int = 5) -> list[Any]:
    """As nested lists, to 10 µm or 10 µrad: a fifth of the size of full floats."""
    return np.round(values, digits).tolist()


def known(value: float) -> float | None:
    """A number that JSON can hold; None for NaN and infinity."""
    return round(value, 5) if np.isfinite(value) else None


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


def trial(result: TrialResult) -> dict[str, Any]:
    """For ``/trial``."""
    names = {"emotion": result.emotion, "style": result.style, "cell": result.cell, "notes": list(result.notes)}
    return {"trial": result.number, "title": result.title, "simulated": result.simulated, **names}


def contact(result: TrialResult) -> dict[str, Any]:
    """For ``/contact``."""
    found = result.contact
    return {
        "trial": result.number,
        "met": found.met,
        "met_time": known(result.contact_time),
        "distance": known(found.distance),
        "gap": known(found.gap),
        "lateral": known(found.lateral),
        "palm_angle": known(found.palm_angle),
        "approach_speed": known(found.approach_speed),
        "peak_force": known(found.peak_force),
        "where": rounded(found.where),
        "out_of_reach": bool(result.out_of_reach),
        "uncorrected_error": known(result.uncorrected_error),
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


def joints_of(poses: Sequence[Pose]) -> Array:
    """Joint centres (T, J, 3), m, of poses, all at once."""
    quaternions = np.array([pose.quaternions for pose in poses])
    return avatar_skeleton().forward_kinematics(np.array([pose.root_in_world for pose in poses]), quaternions)[0]


def skeleton_update(now: int, person: HumanArm, joints: Array) -> dict[str, Any]:
    """A ``foxglove.SceneUpdate``: bones between the avatar's joints (J, 3), and the person's head, arm and hand."""
    parents = avatar_skeleton().parents
    bones = joints[[end for joint in range(1, len(parents)) for end in (parents[joint], joint)]]
    arm = np.array([person.head_position, person.shoulder, person.elbow, person.wrist, person.knuckles])
    lines = {"avatar": bones, "person": np.repeat(arm, 2, axis=0)[1:-1]}
    return {"deletions": [], "entities": [_entity(now, name, points) for name, points in lines.items()]}


def _entity(now: int, name: str, points: Array) -> dict[str, Any]:
    origin = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    line = {
        "type": 2,  # a list of segments
        "pose": origin,
        "thickness": 0.012,
        "scale_invariant": False,
        "points": [dict(zip("xyz", point, strict=True)) for point in rounded(points, 3)],
        "color": dict(zip("rgba", _RGBA[name], strict=True)),
        "colors": [],
        "indices": [],
    }
    others = {
        kind: [] for kind in ("metadata", "arrows", "cubes", "spheres", "cylinders", "triangles", "texts", "models")
    }
    stamp = {"sec": now // 1_000_000_000, "nsec": now % 1_000_000_000}
    return {"timestamp": stamp, "frame_id": "world", "id": name, "lifetime": {"sec": 0, "nsec": 0},
            "frame_locked": False, "lines": [line], **others}  # fmt: skip
