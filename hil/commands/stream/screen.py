"""The screen of ``highfive stream``, and the one line per second where there is no terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from highfive.hil.commands.stream.arm import ArmView
from highfive.hil.commands.stream.statistics import Snapshot
from highfive.mocap_bridge.sources.source import Connection, SourceHealth

COLUMN_WIDTH = 30
"""Columns that one marker takes."""

_COLOURS = {
    Connection.LIVE: "green",
    Connection.CONNECTING: "yellow",
    Connection.STALLED: "yellow",
    Connection.ENDED: "dim",
}


@dataclass(frozen=True)
class StreamView:
    """Everything that is shown at one moment.

    Attributes:
        title: the address.
        health: of the source.
        nominal_hz: frames per second, as the system says.
        seen: what came.
        marker_set: name of the set, '' where none fits.
        arm: the right arm, or None.
        notes: lines about the recording and the like.
    """

    title: str
    health: SourceHealth
    nominal_hz: float
    seen: Snapshot
    marker_set: str
    arm: ArmView | None
    notes: tuple[str, ...] = ()


def screen(view: StreamView, width: int, height: int) -> RenderableType:
    """The screen, at most ``height`` lines of ``width`` columns."""
    health, seen = view.health, view.seen
    head = Text.assemble(
        (view.title, "bold"), "   ", (health.connection.value, f"bold {_COLOURS[health.connection]}"), _since(health)
    )
    age, jitter = seen.age_ms, seen.jitter_ms
    lines: list[RenderableType] = [
        head,
        Text.from_markup(
            f"[dim]rate[/] {seen.rate_hz:.0f} Hz [dim]of {view.nominal_hz:g}[/]   [dim]frames[/] {health.received}   "
            f"[dim]lost[/] {_warned(health.lost)}   [dim]refused[/] {_warned(health.refused)}   "
            f"[dim]without a label[/] {seen.unlabelled}"
            + (f"   [dim]impossible[/] {_warned(health.impossible)}" if health.impossible else "")
        ),
        Text.from_markup(
            f"[dim]age[/] {age[0]:.2f} ms [dim]p99[/] {age[1]:.2f} [dim]max[/] {age[2]:.1f}   "
            f"[dim]jitter[/] {jitter[0]:.2f} ms [dim]period p99[/] {jitter[1]:.2f}"
        ),
    ]
    if health.trouble:
        lines.append(Text(health.trouble, style="yellow"))
    lines += [_arm_line(view), *(Text(note, style="dim") for note in view.notes)]
    for line in lines:
        if isinstance(line, Text):
            line.no_wrap, line.overflow = True, "ellipsis"
    if seen.names:
        lines.append(_markers(seen, width, max(3, height - len(lines) - 4)))
    return Group(*lines)


def plain_line(view: StreamView) -> str:
    """The same in one line."""
    health, seen = view.health, view.seen
    missing = [name for name, share in zip(seen.names, seen.recent, strict=True) if share == 0.0]
    hidden = f", hidden: {_few(missing)}" if missing and health.connection is Connection.LIVE else ""
    arm = f", {arm_text(view.arm)}" if view.arm is not None and view.arm.valid else ""
    arm += _doubted(view.arm)
    loose = f", {seen.unlabelled} without a label" if seen.unlabelled else ""
    trouble = f" ({health.trouble})" if health.trouble else ""
    return (
        f"{health.connection.value}{_since(health)}{trouble}: {seen.rate_hz:.0f} Hz, {health.received} frames, "
        f"{health.lost} lost, {_refused(health)}"
        f"age {seen.age_ms[0]:.2f} ms, jitter {seen.jitter_ms[0]:.2f} ms{hidden}{loose}{arm}"
    )


def arm_text(arm: ArmView) -> str:
    """Angles and hand in words."""
    x, y, z = arm.hand
    return (
        f"elbow {math.degrees(arm.elbow_flexion):.0f}°, upper arm {math.degrees(arm.shoulder_elevation):.0f}° up, "
        f"hand at {x:.2f}, {y:.2f}, {z:.2f} m"
    )


def _refused(health: SourceHealth) -> str:
    impossible = f"{health.impossible} impossible markers, " if health.impossible else ""
    return (f"{health.refused} refused, " if health.refused else "") + impossible


def _since(health: SourceHealth) -> str:
    return f"   newest frame {health.age_ns * 1e-9:.1f} s ago" if health.age_ns > 0.25e9 else ""


def _warned(number: int) -> str:
    return f"[yellow]{number}[/]" if number else "0"


def _arm_line(view: StreamView) -> Text:
    if not view.marker_set:
        return Text(
            "right arm: no marker set fits the labels (docs/markers.md)" if view.seen.names else "", style="dim"
        )
    if view.arm is None or not view.arm.valid:
        return Text(f"right arm ({view.marker_set}): not enough markers seen yet", style="dim")
    return Text(f"right arm ({view.marker_set}): {arm_text(view.arm)}{_doubted(view.arm)}")


def _doubted(arm: ArmView | None) -> str:
    """The labels that were not believed in the newest frame."""
    return f", not believed: {_few(arm.rejected)}" if arm is not None and arm.rejected else ""


def _few(names: Sequence[str]) -> str:
    return " ".join(names[:8]) + (" …" if len(names) > 8 else "")


def _markers(seen: Snapshot, width: int, height: int) -> Table:
    """Markers side by side; where there is no room for all, those that are seen least."""
    across = max(1, width // COLUMN_WIDTH)
    room = across * height
    shown = list(range(len(seen.names)))
    if len(shown) > room:
        shown = sorted(sorted(shown, key=lambda m: seen.recent[m])[: room - 1])
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False, pad_edge=False)
    for _ in range(min(across, len(shown))):
        table.add_column("marker", width=12, no_wrap=True, header_style="dim")
        table.add_column("seen", width=6, justify="right", header_style="dim")
        table.add_column("last", width=7, header_style="dim")
    rows = -(-len(shown) // across)
    for row in range(rows):
        cells: list[str | Text] = []
        for m in shown[row::rows]:
            style = "" if seen.recent[m] > 0.99 else "yellow" if seen.recent[m] > 0.0 else "red"
            ago = seen.last_seen_s[m]
            last = "never" if math.isinf(ago) else "now" if ago < 0.25 else f"{ago:.1f} s" if ago < 1e3 else "long"
            cells += [Text(seen.names[m], style), Text(f"{100 * seen.recent[m]:.0f} %", style), Text(last, style)]
        table.add_row(*cells)
    if len(shown) < len(seen.names):
        table.caption = f"and {len(seen.names) - len(shown)} more, which are seen better"
    return table
