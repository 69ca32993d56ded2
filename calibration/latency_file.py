"""How late streams are, kept in a file: ``calibrate event`` writes it, a session takes it off their times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole
from highfive.model.toml_file import as_float, read_toml, table, typed

FORMAT = 1
"""Version of the file's format."""
LONGEST_MS = 2000.0
"""A stream that is later is of another event."""


@dataclass(frozen=True)
class KeptLatency:
    """Of one stream.

    Attributes:
        latency_ms: by which its samples are late.
        bound_ms: how far that may be off, two standard errors.
        events: that it rests on.
        reference: the stream that is taken to be in time.
        source: the recording.
        date: when it was measured: ISO 8601.
    """

    latency_ms: float
    bound_ms: float
    events: int
    reference: str
    source: str
    date: str


def save_latencies(path: Path, latencies: Mapping[str, KeptLatency], *, replace: bool) -> None:
    """Writes all, by the names of the streams, in one piece.

    Raises:
        HighFiveError: it cannot be written, or is there already and not to be replaced.
    """
    rows = "".join(
        f"\n[stream.{_quoted(name)}]\nlatency_ms = {one.latency_ms:.3f}\nbound_ms = {one.bound_ms:.3f}  # two standard "
        f"errors\nevents = {one.events}\nreference = {_quoted(one.reference)}\nsource = {_quoted(one.source)}\n"
        f"date = {_quoted(one.date)}\n"
        for name, one in sorted(latencies.items())
    )
    text = f"# By how much streams are late: for simulate --latencies.\n[meta]\nformat = {FORMAT}\n{rows}"
    try:
        write_whole(path, text.encode(), replace=replace)
    except OSError as error:
        raise HighFiveError(f"cannot write the latencies {path}: {error.strerror or error}") from None


def load_latencies(path: Path) -> dict[str, KeptLatency]:
    """By the names of the streams.

    Raises:
        HighFiveError: it cannot be read, or holds something else; one line says what.
    """
    data = read_toml(path, "the latencies")
    try:
        found = typed(table(data, "meta"), "meta.", "format", int)
        if found != FORMAT:
            raise HighFiveError(f"format {found}, expected {FORMAT}")
        streams = table(data, "stream")
        return {name: _latency(name, table(streams, name)) for name in streams}
    except HighFiveError as error:
        raise HighFiveError(f"{path} holds no latencies: {error}; measure them with highfive calibrate event") from None


def _latency(name: str, row: Mapping[str, Any]) -> KeptLatency:
    where = f"{name}: "
    latency, bound = (as_float(typed(row, where, key, float)) for key in ("latency_ms", "bound_ms"))
    if not (0.0 <= latency <= LONGEST_MS and bound >= 0.0 and math.isfinite(bound)):
        raise HighFiveError(f"{name}: {latency:g} ± {bound:g} ms, expected 0 to {LONGEST_MS:g} and a bound")
    events = typed(row, where, "events", int)
    reference, source, date = (typed(row, where, key, str) for key in ("reference", "source", "date"))
    try:
        datetime.fromisoformat(date)
    except ValueError:
        raise HighFiveError(f"{name}: date {date!r} is none") from None
    return KeptLatency(latency, bound, events, reference, source, date)


def _quoted(text: str) -> str:
    """As a basic string of TOML."""
    escaped = "".join(
        f"\\{c}"
        if c in '\\"'
        else c
        if c.isprintable()
        else f"\\u{ord(c):04x}"
        if ord(c) < 0x10000
        else f"\\U{ord(c):08x}"
        for c in text
    )
    return f'"{escaped}"'
