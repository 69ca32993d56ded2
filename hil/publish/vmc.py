"""The avatar in the Virtual Motion Capture protocol: OSC by UDP, for Unity, Unreal, and players of VRM avatars.

A bone's rotation is relative to its parent bone, and none at all in the pose with both arms out to the side and palms
down (VRM's T-pose), in which all bones' frames are parallel to the world. Coordinates are Unity's: left-handed, x to
the avatar's right, y up, z forward (protocol.vmc.info). Our trunk has a joint more than VRM's: its two lowest turn as
one ``Spine``.
"""

from __future__ import annotations

import socket
from logging import WARNING

import numpy as np

from highfive.hil.publish import osc
from highfive.hil.publish.publisher import ArmPosture, SessionEvent, ShownPicture
from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.runtime.console import say_aside
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

LONGEST = 1400
"""Bytes of a datagram: whole in one Ethernet frame."""

_TRUNK = {
    "Hips": ("pelvis", ""), "Spine": ("lumbar_3", "Hips"), "Chest": ("thoracic_12", "Spine"),
    "UpperChest": ("thoracic_8", "Chest"), "Neck": ("neck", "UpperChest"), "Head": ("head", "Neck"),
}  # fmt: skip
_LIMBS = {
    "Shoulder": ("clavicle", "UpperChest"), "UpperArm": ("shoulder", "Shoulder"), "LowerArm": ("elbow", "UpperArm"),
    "Hand": ("wrist", "LowerArm"), "UpperLeg": ("hip", "Hips"), "LowerLeg": ("knee", "UpperLeg"),
    "Foot": ("ankle", "LowerLeg"), "Toes": ("toe", "Foot"),
}  # fmt: skip
_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
_PARTS = ("Proximal", "Intermediate", "Distal")
_ARM = ("shoulder", "elbow", "wrist", *(name.lower() for name in _FINGERS))


def _bones() -> dict[str, tuple[str, str]]:
    bones = dict(_TRUNK)
    for side in ("Left", "Right"):
        limbs = dict(_LIMBS)
        for finger in _FINGERS:
            for number, part in enumerate(_PARTS, 1):
                parent = "Hand" if number == 1 else f"{finger}{_PARTS[number - 2]}"
                limbs[f"{finger}{part}"] = f"{finger.lower()}_{number}", parent
        for name, (joint, parent) in limbs.items():
            bones[side + name] = f"{side.lower()}_{joint}", parent if parent in _TRUNK else side + parent
    return bones


BONES: dict[str, tuple[str, str]] = _bones()
"""Name of each bone (Unity's ``HumanBodyBones``) → our joint, and the bone above it ('' for none); that one first."""


def _to_t_pose() -> Array:
    """(J, 4), how each joint is turned in the T-pose; in ours with hanging arms none is."""
    turns = []
    for name in avatar_skeleton().names:
        side, _, part = name.partition("_")
        raised = {"left": 90.0, "right": -90.0}.get(side, 0.0) if part.startswith(_ARM) else 0.0
        turns.append(rotations.from_axis_angle("x", np.deg2rad(raised)))
    return np.array(turns)


_FROM_T_POSE = rotations.conjugate(_to_t_pose())
_JOINTS = np.array([avatar_skeleton().index(joint) for joint, _ in BONES.values()])
_ABOVE = np.array([list(BONES).index(parent) for _, parent in BONES.values() if parent])
_VALUES = 7 * 4  # bytes of a bone's position and rotation, at the end of its message
_HEADS = [osc.message("/VMC/Ext/Bone/Pos", name, *[0.0] * 7)[:-_VALUES] for name in BONES]
_ROOT = osc.message("/VMC/Ext/Root/Pos", "root", *[0.0] * 6, 1.0)
_OK = osc.message("/VMC/Ext/OK", 1)


def bone_places(pose: Pose) -> tuple[Array, Array]:
    """Of each bone in :data:`BONES`: where it is (52, 3), m, and how it is turned (52, 4), w x y z, in the frame of the
    bone above it, the hips in the world; in our coordinates.
    """
    centres, turns = avatar_skeleton().forward_kinematics(pose.root_in_world, pose.quaternions)
    centres, turns = centres[_JOINTS], rotations.multiply(turns, _FROM_T_POSE)[_JOINTS]
    places, rotated = centres.copy(), turns.copy()
    back = rotations.conjugate(turns[_ABOVE])
    places[1:] = rotations.rotate(back, centres[1:] - centres[_ABOVE])
    rotated[1:] = rotations.multiply(back, turns[1:])
    return places, rotated


def in_unity(places: Array, turns: Array) -> tuple[Array, Array]:
    """Positions (..., 3), m, and rotations (..., 4), ours and w x y z, as Unity has them: x right, y up, z forward,
    left-handed, and x y z w.
    """
    x, y, z = (places[..., axis] for axis in range(3))
    w, i, j, k = (turns[..., part] for part in range(4))
    return np.stack([-y, z, x], axis=-1), np.stack([j, -k, -i, w], axis=-1)


class VmcPublisher:
    """Sends every tick's pose: its bones, then ``/VMC/Ext/OK`` and ``/VMC/Ext/T``, the seconds since the first tick."""

    waiting = 1
    """Of poses only the newest counts."""

    def __init__(self, host: str, port: int) -> None:
        """To UDP ``port`` of ``host``, whether anybody listens there or not.

        Raises:
            HighFiveError: there is no such host.
        """
        self.name = f"vmc://{host}:{port}"
        try:
            family, _, _, _, self._to = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or "that is no name"
            raise HighFiveError(f"cannot publish to {self.name}: {reason}; give a host such as 127.0.0.1") from None
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._start_ns: int | None = None
        self._trouble = ""

    def tick(self, tick: RecordedTick) -> None:
        """Sends the pose that was shown; what the network does not take at once is lost, as by UDP on the way."""
        if self._start_ns is None:
            self._start_ns = tick.at_ns
        for datagram in osc.bundles(pose_messages(tick.played, 1e-9 * (tick.at_ns - self._start_ns)), LONGEST):
            try:
                self._socket.sendto(datagram, self._to)
            except (BlockingIOError, ConnectionRefusedError):
                continue
            except OSError as error:  # a cable, or a network that is gone for a while
                self._tell(error.strerror or str(error))
                return
        self._tell("")

    def _tell(self, trouble: str) -> None:
        """Once when nothing can be sent, and once when it can again."""
        if bool(trouble) != bool(self._trouble):
            self._trouble = trouble
            if trouble:
                say_aside(f"{self.name} cannot be reached ({trouble}); it is tried again with each pose", WARNING)
            else:
                say_aside(f"{self.name} can be reached again")

    def event(self, event: SessionEvent) -> None:
        """The protocol has none."""

    def shown(self, picture: ShownPicture) -> None:
        """Nobody asks for it."""

    def arm(self, posture: ArmPosture) -> None:
        """Nobody asks for it."""

    def close(self) -> None:
        """Sends no more."""
        self._socket.close()


def pose_messages(pose: Pose, seconds: float) -> list[bytes]:
    """The OSC messages of a pose at a time, s."""
    values = np.concatenate(in_unity(*bone_places(pose)), axis=-1).astype(">f4").tobytes()
    bones = [head + values[i * _VALUES : (i + 1) * _VALUES] for i, head in enumerate(_HEADS)]
    return [_ROOT, *bones, _OK, osc.message("/VMC/Ext/T", seconds)]
