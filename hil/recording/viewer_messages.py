"""What viewers draw: protobuf messages in Foxglove's schemas, which Foxglove, Lichtblick and Rerun know.

``/tf`` holds the places of all bodies, ``/markers`` the tracked markers, ``/skeleton`` bones as lines, ``/log`` what
was said and happened. Quaternions are x, y, z, w there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.sim.arm_body import PREFIX, arm_alone
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.mocap_bridge.frames import HumanArm, TrackedMarkers
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

TOPICS: dict[str, Any] = {
    "/tf": FrameTransforms,
    "/markers": PointCloud,
    "/skeleton": SceneUpdate,
    "/log": Log,
}
"""The message class of each protobuf topic."""

WORLD = "world"
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("seen", "u1")])
_COLOURS = {"avatar": (0.84, 0.37, 0.0, 1.0), "person": (0.0, 0.45, 0.70, 1.0)}
_STRAIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_SECOND_NS = 1_000_000_000


class Transforms:
    """``/tf``: the avatar's joints (``avatar/…``, each in its parent), the person's parts (``person/…``) and, where a
    servo arm takes part, its bodies (``arm/…``), in the world.
    """

    def __init__(self, arm: str = DEFAULT_ARM) -> None:
        """Of the avatar, a person and an arm (its name or folder) on its column."""
        self._arm, self._twin, self._arm_data = arm, None, None
        skeleton = avatar_skeleton()
        names = [f"avatar/{name}" for name in skeleton.names]
        self._offsets = np.array(skeleton.offsets)
        self._joints = [(WORLD if p < 0 else names[p], name) for p, name in zip(skeleton.parents, names, strict=True)]

    def body(self, time_ns: int, played: Pose, person: HumanArm) -> FrameTransforms:
        """Of avatar and person."""
        message = FrameTransforms()
        places = self._offsets.copy()
        places[0] = played.root_in_world
        for (parent, child), place, turn in zip(self._joints, places, played.quaternions, strict=True):
            _add(message, time_ns, parent, child, place, turn)
        for name, (place, turn) in _parts(person).items():
            _add(message, time_ns, WORLD, f"person/{name}", place, turn)
        return message

    def arm(self, time_ns: int, joints: Array) -> FrameTransforms:
        """Of the servo arm, as measured: ``joints`` (J,), rad."""
        if self._twin is None or self._arm_data is None:
            folder = find_arm(self._arm)
            self._twin = arm_alone(folder.mount, folder)
            self._arm_data = mujoco.MjData(self._twin.model)
        model, data, message = self._twin.model, self._arm_data, FrameTransforms()
        data.qpos[self._twin.qpos] = joints
        mujoco.mj_kinematics(model, data)
        for body in range(1, model.nbody):
            if (name := model.body(body).name).startswith(PREFIX):
                _add(message, time_ns, WORLD, f"arm/{name.removeprefix(PREFIX)}", data.xpos[body], data.xquat[body])
        return message


def point_cloud(time_ns: int, markers: TrackedMarkers) -> PointCloud:
    """``/markers``: a point each, in the order of the trial's names; ``seen`` is 1 where it was measured."""
    points = np.zeros(len(markers.positions), dtype=_POINT)
    for axis, name in enumerate("xyz"):
        points[name] = markers.positions[:, axis]
    points["seen"] = markers.seen
    message = PointCloud(frame_id=WORLD, point_stride=_POINT.itemsize, data=points.tobytes())
    _stamp(message.timestamp, time_ns)
    message.pose.orientation.w = 1.0
    for name in ("x", "y", "z", "seen"):
        kind = PackedElementField.UINT8 if name == "seen" else PackedElementField.FLOAT32
        message.fields.add(name=name, offset=_POINT.fields[name][1], type=kind)  # type: ignore[index]
    return message


def cloud_points(data: bytes) -> dict[str, Any]:
    """``positions`` and ``seen`` of a ``/markers`` message.

    Raises:
        ValueError: it is no such message.
    """
    points = np.frombuffer(PointCloud.FromString(data).data, dtype=_POINT)
    single = np.stack([points[axis] for axis in "xyz"], axis=1)
    if not np.isfinite(single).all():
        raise ValueError("a point that is nowhere")
    places = single.astype(float)
    return {"positions": np.round(places, 6).tolist(), "seen": points["seen"].astype(bool).tolist()}


def log(time_ns: int, level: str, text: str) -> Log:
    """``/log``; ``level`` is INFO, WARNING or ERROR."""
    message = Log(level=Log.Level.Value(level), message=text, name="highfive")
    _stamp(message.timestamp, time_ns)
    return message


def event_text(event: str, about: Mapping[str, Any]) -> str:
    """An event in words: ``contact (trial 0, emotion sad)``."""
    told = ", ".join(f"{name} {value}" for name, value in about.items() if value not in (None, ""))
    return f"{event.replace('_', ' ')}{told and f' ({told})'}"


def skeleton(time_ns: int, played: Pose, person: HumanArm) -> SceneUpdate:
    """``/skeleton``: bones between the avatar's joints, and the person's head, arm and hand, as lines."""
    parents, joints = avatar_skeleton().parents, joints_of([played])[0]
    bones = joints[[end for joint in range(1, len(parents)) for end in (parents[joint], joint)]]
    arm = np.array([person.head_position, person.shoulder, person.elbow, person.wrist, person.knuckles])
    message = SceneUpdate()
    for name, points in {"avatar": bones, "person": np.repeat(arm, 2, axis=0)[1:-1]}.items():
        entity = message.entities.add(id=name, frame_id=WORLD)
        _stamp(entity.timestamp, time_ns)
        line = entity.lines.add(type=LinePrimitive.LINE_LIST, thickness=0.012)
        line.pose.orientation.w = 1.0
        line.color.r, line.color.g, line.color.b, line.color.a = _COLOURS[name]
        for x, y, z in _short(points):
            line.points.add(x=x, y=y, z=z)
    return message


def joints_of(poses: Sequence[Pose]) -> Array:
    """Joint centres (T, J, 3), m, of poses, all at once."""
    quaternions = np.array([pose.quaternions for pose in poses])
    return avatar_skeleton().forward_kinematics(np.array([pose.root_in_world for pose in poses]), quaternions)[0]


def _parts(person: HumanArm) -> dict[str, tuple[Array, Array]]:
    palm = person.palm
    axes = np.stack([palm.fingers, np.cross(palm.normal, palm.fingers), palm.normal], axis=1)
    return {
        "head": (person.head_position, person.head_orientation),
        "shoulder": (person.shoulder, _STRAIGHT),
        "elbow": (person.elbow, _STRAIGHT),
        "wrist": (person.wrist, _STRAIGHT),
        "knuckles": (person.knuckles, _STRAIGHT),
        "palm": (palm.position, rotations.from_matrix(axes)),
    }


def _add(message: FrameTransforms, time_ns: int, parent: str, child: str, place: Array, turn: Array) -> None:
    one = message.transforms.add(parent_frame_id=parent, child_frame_id=child)
    _stamp(one.timestamp, time_ns)
    (w, x, y, z), (px, py, pz) = _short(turn), _short(place)
    to, by = one.translation, one.rotation
    to.x, to.y, to.z = px, py, pz
    by.w, by.x, by.y, by.z = w, x, y, z


def _short(values: Array) -> list[Any]:
    """In single precision, half of whose bits compress to nothing."""
    return values.astype(np.float32).tolist()


def _stamp(stamp: Any, time_ns: int) -> None:
    stamp.seconds, stamp.nanos = divmod(time_ns, _SECOND_NS)
