"""Numbers of a recording as viewers plot them that decode no JSON: ROS 2 ``sensor_msgs/msg/JointState`` in CDR.

``/joint_states`` is the servo arm, as ROS has it. ``/plot/…`` are the numbers of a JSON topic by name, 30 a second
at the most: no other message of ROS holds named numbers, and Rerun makes lines of this one.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from highfive.hil.recording import schemas

JOINT_STATES, PLOT = "/joint_states", "/plot"
PLOTTED = ("/person", "/tick", "/forecast", "/contact", "/arm", "/safety", "/shown", "/streams")
"""Topics whose numbers are plotted. Of the others transforms, points and lines are drawn, or they are words."""

TOPICS = (JOINT_STATES, *(f"{PLOT}{topic}" for topic in PLOTTED))
SCHEMA_NAME = "sensor_msgs/msg/JointState"
SCHEMA = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

PERIOD_NS = 33_000_000
"""Between two messages of a topic: every fourth of 120 Hz."""
_NO_LINE = frozenset(
    {"trial", "number", "page", "frame", "time_ns", "at_ns", "due_ns", "begun_ns", "pose_ns", "display_ns"}
)
"""What counts, and times of some clock."""
_BY_JOINT = ("/arm", "/safety")
"""Topics whose lists are by joint."""
_SECOND_NS = 1_000_000_000
_LITTLE_ENDIAN = b"\0\1\0\0"  # what CDR begins with; alignment counts from behind it


class Plots:
    """Turns messages of JSON topics, as they come, into such as are plotted."""

    def __init__(self, joints: Callable[[], Sequence[str]]) -> None:
        """``joints`` are the names of the servo arm's, asked for once there is one."""
        self._joints, self._names = joints, tuple[str, ...]()
        self._due: dict[str, int] = {}

    def of(self, topic: str, time_ns: int, message: Mapping[str, Any]) -> list[tuple[str, bytes]]:
        """Topics and messages for one of a JSON topic, before it is laid flat."""
        if topic not in PLOTTED:
            return []
        made = []
        if topic in _BY_JOINT and not self._names:
            self._names = tuple(self._joints())
        if topic == "/arm":
            state = joint_state(time_ns, self._names, message["positions"], message["velocities"])
            made.append((JOINT_STATES, state))
        stream = message["stream"] if topic == "/streams" else ""
        key = f"{topic} {stream}"
        if time_ns >= self._due.get(key, time_ns):
            self._due[key] = time_ns + PERIOD_NS
            found = numbers(topic, message, self._names)
            names = [f"{stream}.{name}" for name in found] if stream else list(found)
            made.append((f"{PLOT}{topic}", joint_state(time_ns, names, list(found.values()))))
        return made


def numbers(topic: str, message: Mapping[str, Any], joints: Sequence[str]) -> dict[str, float]:
    """The numbers of a message of a topic: of points ``wrist.x``, by joint ``positions.elbow``; what is unknown is NaN.

    All messages of a topic have the same names in the same order, for viewers go by the place in it.
    """
    found: dict[str, float] = {}
    for name, field in schemas.TOPICS[topic][1].items():
        if field.kind not in ("number", "integer", "boolean") or field.row or name in _NO_LINE:
            continue
        value = message.get(name)
        if not field.listed:
            found[name] = math.nan if value is None else float(value)
            continue
        axes = joints if topic in _BY_JOINT else {3: "xyz", 4: "wxyz"}[len(message[name])]
        values = [math.nan] * len(axes) if value is None else value
        found |= {f"{name}.{axis}": float(one) for axis, one in zip(axes, values, strict=True)}
    return found


def joint_state(
    time_ns: int, names: Sequence[str], positions: Sequence[float], velocities: Sequence[float] = ()
) -> bytes:
    """A ``sensor_msgs/msg/JointState`` in CDR (OMG DDSI-RTPS, plain, little endian)."""
    data = bytearray(struct.pack("<iI", *divmod(time_ns, _SECOND_NS)))
    _add_text(data, "")
    _add_count(data, len(names))
    for name in names:
        _add_text(data, name)
    for values in (positions, velocities, ()):
        _add_count(data, len(values))
        if values:
            _align(data, 8)
            data += struct.pack(f"<{len(values)}d", *values)
    return _LITTLE_ENDIAN + bytes(data)


def _add_text(data: bytearray, text: str) -> None:
    encoded = text.encode() + b"\0"
    _add_count(data, len(encoded))
    data += encoded


def _add_count(data: bytearray, count: int) -> None:
    _align(data, 4)
    data += struct.pack("<I", count)


def _align(data: bytearray, size: int) -> None:
    data += bytes(-len(data) % size)
