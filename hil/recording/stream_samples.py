"""Samples of another program's stream, as they are recorded beside a session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class StreamSamples:
    """T samples of C channels that came together.

    Attributes:
        name: of the stream.
        labels: C names of the channels; those of a stream are written once, when it begins.
        text: the values are texts; otherwise numbers.
        values: T rows of C.
        stamps: T, s, as the sender stamped them, on its own clock.
        times_ns: T, the same on the session's clock, ns.
        came_ns: when they came, by the session's clock, ns.
        begins: these are the first ones since the stream was found.
    """

    name: str
    labels: tuple[str, ...]
    text: bool
    values: Sequence[Sequence[float | str]]
    stamps: Sequence[float]
    times_ns: Sequence[int]
    came_ns: int
    begins: bool


def check_stream_names(names: Sequence[str]) -> None:
    """Names of streams that are to be recorded.

    Raises:
        HighFiveError: one is empty, there twice, or has a quotation mark in it, which cannot be searched for.
    """
    for name in names:
        if not name or "'" in name or '"' in name:
            raise HighFiveError(f"--record-lsl {name!r}: a stream has a name, without quotation marks")
        if names.count(name) > 1:
            raise HighFiveError(f"--record-lsl {name} is there twice; give each stream once")
