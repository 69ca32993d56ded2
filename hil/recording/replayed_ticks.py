"""The ticks of a recorded high five as a session takes them again. A recording is a file: every value is checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeGuard

import numpy as np

from highfive.hil.recording.recording import RecordedMessage
from highfive.hil.recording.session_reader import RecordedHighFive
from highfive.hil.session.session import TickInput
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

TOPICS = ("/trial", "/frame", "/avatar", "/tick", "/event")


@dataclass(frozen=True)
class ReplayedTicks:
    """Of a high five.

    Attributes:
        inputs: of its ticks.
        digests: of the poses that were requested in them.
        poses: of the avatar in them, as they were played, rounded.
        changes: how it was answered from after a tick on, by the tick's place.
    """

    inputs: tuple[TickInput, ...]
    digests: tuple[str, ...]
    poses: tuple[Pose, ...]
    changes: Mapping[int, tuple[Mapping[str, float], bool]]


def replayed_ticks(high_five: RecordedHighFive) -> ReplayedTicks:
    """Of a high five with its :data:`TOPICS`.

    Raises:
        HighFiveError: a message is missing, or says what cannot be: which one.
    """
    ticks, poses = high_five.of("/tick"), high_five.of("/avatar")
    frames = {message.time_ns: message for message in high_five.of("/frame")}
    if not ticks or [tick.time_ns for tick in ticks] != [pose.time_ns for pose in poses]:
        raise HighFiveError(f"it has {len(ticks)} ticks and {len(poses)} poses that do not belong together")
    inputs = tuple(_input(tick, frames) for tick in ticks)
    for before, after in pairwise(inputs):
        if after.at_ns <= before.at_ns or after.time_ns <= before.time_ns:
            raise HighFiveError("the times of its ticks do not follow each other")
    places = {tick.time_ns: number for number, tick in enumerate(ticks)}
    changes = {}
    for event in high_five.of("/event"):
        if event.data.get("event") == "answer_changed":
            weights = _checked(event, "/event", "weights", is_style(event.data.get("weights")))
            corrects = _checked(event, "/event", "corrects", isinstance(event.data.get("corrects"), bool))
            changes[places.get(event.time_ns, -1)] = weights, corrects
    if -1 in changes:
        raise HighFiveError("its answer was changed at a time that has no tick")
    digests = tuple(_checked(it, "/tick", "digest", isinstance(it.data.get("digest"), str)) for it in ticks)
    return ReplayedTicks(inputs, digests, tuple(_pose(message) for message in poses), changes)


def is_style(value: object) -> TypeGuard[Mapping[str, float]]:
    """Weights by emotion."""
    return isinstance(value, dict) and bool(value) and all(_is_number(weight) for weight in value.values())


def _input(tick: RecordedMessage, frames: Mapping[int, RecordedMessage]) -> TickInput:
    times = [_checked(tick, "/tick", name, _is_whole(tick.data.get(name))) for name in ("time_ns", "at_ns")]
    framed = _checked(tick, "/tick", "framed", isinstance(tick.data.get("framed"), bool))
    if framed and tick.time_ns not in frames:
        raise HighFiveError(f"the frame of its tick at {1e-9 * tick.time_ns:.3f} s is missing")
    return TickInput(_frame(frames[tick.time_ns]) if framed else None, *times)


def _frame(message: RecordedMessage) -> MarkerFrame:
    said = message.data
    for name in ("number", "source_time_ns", "arrival_time_ns", "impossible", "latency_ns"):
        _checked(message, "/frame", name, _is_whole(said.get(name)))
    for name in ("counted", "own_clock"):
        _checked(message, "/frame", name, isinstance(said.get(name), bool))
    names = _checked(message, "/frame", "names", _all(said.get("names"), str))
    valid = _checked(message, "/frame", "valid", _all(said.get("valid"), bool) and len(said["valid"]) == len(names))
    covariance = None
    if said.get("covariance") is not None:
        covariance = _numbers(message, "/frame", "covariance", len(names), 9).reshape(-1, 3, 3)
    return MarkerFrame(
        tuple(names),
        _numbers(message, "/frame", "positions", len(names), 3),
        np.array(valid, dtype=bool),
        said["number"],
        said["source_time_ns"],
        said["arrival_time_ns"],
        _numbers(message, "/frame", "unlabelled", None, 3),
        said["counted"],
        said["impossible"],
        said["latency_ns"],
        covariance,
        said["own_clock"],
    )


def _pose(message: RecordedMessage) -> Pose:
    quaternions = _numbers(message, "/avatar", "quaternions", len(avatar_skeleton().names), 4)
    root = _numbers(message, "/avatar", "root", None, None)
    _checked(message, "/avatar", "root", root.shape == (3,))
    _checked(message, "/avatar", "quaternions", bool((np.linalg.norm(quaternions, axis=1) > 0.5).all()))
    return Pose.from_quaternions(root, quaternions)


def _numbers(message: RecordedMessage, topic: str, name: str, rows: int | None, columns: int | None) -> Array:
    """Finite numbers, in so many rows (any number for None) of so many columns (no rows for None)."""
    try:
        values = np.array(message.data.get(name), dtype=float)
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if columns is not None and values.size == 0:
        values = values.reshape(-1, columns)
    fits = columns is None or (values.ndim == 2 and values.shape[1] == columns and rows in (None, len(values)))
    _checked(message, topic, name, fits and bool(np.isfinite(values).all()))
    return values


def _checked(message: RecordedMessage, topic: str, name: str, right: bool) -> Any:
    """The field, which is as it has to be, or that it is not."""
    if not right:
        raise HighFiveError(
            f"its {topic} at {1e-9 * message.time_ns:.3f} s is of another version, or damaged: {name} is missing, or "
            "not as it has to be"
        )
    return message.data[name]


def _is_whole(value: object) -> bool:
    return type(value) is int and abs(value) < 2**62


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _all(value: object, kind: type) -> bool:
    return isinstance(value, list) and all(type(one) is kind for one in value)
