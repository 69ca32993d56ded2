"""The JSON topics of a recording: their fields, JSON schemas, and how rows are laid flat.

Viewers draw a JSON message by its schema, and know neither lists in lists nor a field of two types: a list of rows is
one list of numbers, row after row, and what is unknown is left out. Who reads a recording gets rows, and None.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

FORMAT = 2
"""Of recordings; those before say none."""


@dataclass(frozen=True)
class Field:
    """A field of a JSON message.

    Attributes:
        kind: its JSON type, of a list that of its items.
        listed: it is a list.
        row: numbers a row of a list of rows; 0 where it is no such list.
        optional: it may be left out, and is None then.
        properties: of objects: their own fields.
    """

    kind: str
    listed: bool = False
    row: int = 0
    optional: bool = False
    properties: Mapping[str, Field] | None = None

    @property
    def schema(self) -> dict[str, Any]:
        """As JSON schema."""
        one: dict[str, Any] = {"type": self.kind}
        if self.kind == "object":
            one["properties"] = {name: field.schema for name, field in (self.properties or {}).items()}
        return {"type": "array", "items": one} if self.listed else one


_NUMBER, _TEXT, _YES, _WHOLE = Field("number"), Field("string"), Field("boolean"), Field("integer")
_UNKNOWN, _MAYBE_WHOLE, _MAYBE_TEXT = (Field(kind, optional=True) for kind in ("number", "integer", "string"))
_LIST, _NAMES, _ANSWERS = (Field(kind, listed=True) for kind in ("number", "string", "boolean"))
_MAYBE = Field("number", listed=True, optional=True)


def _rows(count: int, *, optional: bool = False) -> Field:
    return Field("number", listed=True, row=count, optional=optional)


_POSE = {"root": _LIST, "quaternions": _rows(4)}
_UNWANTED = Field("object", listed=True, properties={"first": _TEXT, "second": _TEXT, "deepest": _UNKNOWN})

TOPICS: dict[str, tuple[str, dict[str, Field]]] = {
    "/session": (
        "high_five.Session",
        {"format": _WHOLE, "settings": Field("object"), "chain": Field("object", optional=True), "joints": _NAMES,
         "units": _TEXT},
    ),
    "/trial": (
        "high_five.Trial",
        {"trial": _WHOLE, "title": _TEXT, "emotion": _TEXT, "style": _TEXT, "weights": Field("object"), "cell": _TEXT,
         "corrects": _YES, "simulated": _YES,
         "notes": _NAMES, "marker_set": _TEXT, "markers": _NAMES, "paced": _YES, "host_ns": _WHOLE, "utc": _TEXT},
    ),
    "/frame": (
        "high_five.MarkerFrame",
        {"names": _NAMES, "positions": _rows(3), "valid": _ANSWERS, "number": _WHOLE, "source_time_ns": _WHOLE,
         "arrival_time_ns": _WHOLE, "latency_ns": _WHOLE, "unlabelled": _rows(3), "covariance": _rows(9, optional=True),
         "counted": _YES, "own_clock": _YES, "impossible": _WHOLE},
    ),
    "/person": (
        "high_five.Person",
        {"head": _LIST, "head_orientation": _LIST, "shoulder": _LIST, "elbow": _LIST, "wrist": _LIST, "knuckles": _LIST,
         "palm": _LIST, "palm_normal": _LIST, "valid": _YES, "age_ns": _WHOLE},
    ),
    "/generated": ("high_five.Pose", _POSE),
    "/avatar": ("high_five.Pose", _POSE),
    "/tick": (
        "high_five.Tick",
        {"trial": _WHOLE, "phase": _TEXT, "weight": _NUMBER, "time_to_contact": _UNKNOWN, "latency_ms": _UNKNOWN,
         "time_ns": _WHOLE, "at_ns": _WHOLE, "framed": _YES, "digest": _TEXT, "sure": Field("boolean", optional=True)},
    ),
    "/forecast": (
        "high_five.Forecast",
        {"time": _NUMBER, "time_deviation": _NUMBER, "point": _LIST, "covariance": _rows(3)},
    ),
    "/contact": (
        "high_five.Contact",
        {"trial": _WHOLE, "style": _TEXT, "met": _YES, "met_time": _UNKNOWN, "distance": _UNKNOWN,
         "gap": _UNKNOWN, "lateral": _UNKNOWN,
         "palm_angle": _UNKNOWN, "approach_speed": _UNKNOWN, "peak_force": _UNKNOWN, "where": _LIST,
         "out_of_reach": _YES, "uncorrected_error": _UNKNOWN, "true_error": _UNKNOWN, "touch_error": _UNKNOWN,
         "unwanted": _UNWANTED},
    ),
    "/arm": (
        "high_five.ArmCycle",
        {"number": _WHOLE, "mode": _TEXT, "due_ns": _WHOLE, "begun_ns": _WHOLE, "took_ns": _WHOLE, "sent": _MAYBE,
         "sent_currents": _MAYBE, "positions": _LIST, "velocities": _LIST, "currents": _LIST, "errors": _LIST,
         "answered": _ANSWERS, "tripped": _ANSWERS, "apart": _LIST, "temperatures": _LIST, "voltages": _LIST},
    ),
    "/safety": (
        "high_five.Safety",
        {"time_ns": _WHOLE, "state": _TEXT, "event": _MAYBE_TEXT, "reason": _TEXT, "wanted": _LIST, "asked": _MAYBE,
         "reference": _MAYBE, "positions": _MAYBE, "currents": _MAYBE, "acted": _NAMES, "share": _NUMBER,
         "closing_speed": _UNKNOWN,
         "gap": _UNKNOWN, "step_ms": _UNKNOWN},
    ),
    "/shown": (
        "high_five.Shown",
        {"page": _WHOLE, "frame": _WHOLE, "pose_ns": _WHOLE, "display_ns": _WHOLE, "dropped": _WHOLE,
         "bound_ns": _WHOLE},
    ),
    "/streams": (
        "high_five.StreamState",
        {"stream": _TEXT, "rate_hz": _UNKNOWN, "offset_s": _NUMBER, "drift_ppm": _NUMBER, "bound_ms": _UNKNOWN,
         "age_ms": _NUMBER, "valid": _YES, "resets": _WHOLE},
    ),
    "/event": (
        "high_five.Event",
        {"event": _TEXT, "trial": _MAYBE_WHOLE, "emotion": _MAYBE_TEXT, "style": _MAYBE_TEXT, "cell": _MAYBE_TEXT,
         "detail": _MAYBE_TEXT, "stream": _MAYBE_TEXT, "moved_ms": _UNKNOWN,
         "weights": Field("object", optional=True), "corrects": Field("boolean", optional=True)},
    ),
}  # fmt: skip
"""Schema name and fields of each topic."""


STREAMS = "/lsl/"
"""Before the name of another program's stream, which is a topic of its own."""
_SAMPLE = {"stamp": _NUMBER, "time_ns": _WHOLE, "labels": Field("string", listed=True, optional=True)}
_STREAM_OF_NUMBERS = "high_five.StreamNumbers", {"values": _LIST, **_SAMPLE}
_STREAM_OF_TEXTS = "high_five.StreamTexts", {"values": _NAMES, **_SAMPLE}


def stream_definition(*, text: bool) -> tuple[str, dict[str, Field]]:
    """Schema name and fields of a stream's topic. ``labels`` are those of the first message until others come."""
    return _STREAM_OF_TEXTS if text else _STREAM_OF_NUMBERS


def schema_of(topic: str) -> dict[str, Any]:
    """The JSON schema of a topic's messages."""
    return schema(*TOPICS[topic])


def schema(name: str, fields: Mapping[str, Field]) -> dict[str, Any]:
    """The JSON schema of messages with these fields."""
    return {
        "title": name,
        "type": "object",
        "properties": {name: field.schema for name, field in fields.items()},
        "required": [name for name, field in fields.items() if not field.optional],
    }


def flattened(topic: str, message: Mapping[str, Any]) -> dict[str, Any]:
    """A message as it is written: rows one after the other, without what is None."""
    fields = TOPICS[topic][1]
    written = {}
    for name, value in message.items():
        if value is None:
            continue
        field = fields.get(name)
        is_rows = field is not None and field.row > 0 and len(value) > 0 and isinstance(value[0], list)
        written[name] = [number for row in value for number in row] if is_rows else value
    return written


def restored(topic: str, message: Mapping[str, Any]) -> dict[str, Any]:
    """A message as it was before :func:`flattened`; one of an older version, which has rows, stays as it is."""
    found = dict(message)
    for name, field in TOPICS[topic][1].items():
        if field.optional:
            found.setdefault(name, None)
        value = found.get(name)
        if field.row and isinstance(value, list) and value and not isinstance(value[0], list):
            found[name] = [value[i : i + field.row] for i in range(0, len(value), field.row)]
    return found
