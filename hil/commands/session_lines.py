"""What a session came to, in lines for people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from highfive.hil.runtime.console import STDERR, counted, escape
from highfive.hil.trials.summary import kind
from highfive.hil.trials.targets import BEFORE_MM

_REASONS = 5
"""Of so many high fives without contact the terminal says why."""


def print_session(summary: dict[str, Any], folder: Path) -> None:
    """A session's ``summary`` for people, and where in ``folder`` there is more."""
    count, tick, styles = summary["trials"], summary["tick_ms"], summary["contact_error_mm"]["by_emotion"]
    answered = f"answered as {', '.join(styles)}" if styles else "none was finished"
    print(f"{counted(count, 'high five')} with a {kind(summary)} person, {answered}")
    for label, key, digits, unit, target in (
        ("true palm at first touch", "true_error_at_touch_mm", 1, "mm", ""),
        ("closing speed then", "closing_speed_at_touch_m_s", 2, "m/s", ""),
        ("before correction", "uncorrected_error_mm", 1, "mm", f" (target: median ≤ {BEFORE_MM:g} mm)"),
        ("after, to tracked palm", "contact_error_mm", 2, "mm", ""),
    ):
        if summary[key]["median"] is not None:
            print(f"  {label:<26}{_spread(summary[key], count, digits, unit)}{target}")
    if count:
        print(f"  one tick                  median {tick['p50']:.2f} ms, p99 {tick['p99']:.2f} ms")
    for label, key in (
        ("out of reach", "out_of_reach"),
        ("no contact", "missed"),
        ("unwanted contacts", "unwanted_contacts"),
    ):
        if summary[key]:
            print(f"  {label + ':':<26}{summary[key]}")
    _print_not_met([row for row in summary["rows"] if not row["met"]])
    if summary["arm"]:
        _print_arm(summary["arm"])
    if summary["streams"]:
        _print_streams(summary["streams"])
    if summary["replayed"] is not None:
        _print_replayed(summary["replayed"])
    if summary["interrupted"]:
        print("  interrupted; the report covers the trials until then")
    for warning in summary["warnings"]:
        if warning == summary["unrecorded"]:  # it was said when it happened
            continue
        STDERR.print(f"[bold yellow]warning:[/] {escape(warning)}", soft_wrap=True)
    print(f"Open {folder / 'report.html'}")


def _print_not_met(rows: list[dict[str, Any]]) -> None:
    """Why palms did not meet, of the first few, for people."""
    for row in rows[:_REASONS]:
        print(f"    high five {row['trial'] + 1}: {row['why_not_met']}")
    if len(rows) > _REASONS:
        print(f"    and {len(rows) - _REASONS} more, in report.html")


def _print_streams(streams: list[dict[str, Any]]) -> None:
    """How the session's streams stood, for people."""
    name_width = max(len("streams"), *(len(row["stream"]) for row in streams))
    print(f"  {'streams':<{name_width}}  {'rate':>9}  {'offset':>15}  {'drift':>10}  {'bound':>9}  {'age':>9}  resets")
    for row in streams:
        rate, bound = (
            "–" if value is None else f"{value:.{digits}f} {unit}"
            for value, digits, unit in ((row["rate_hz"], 1, "Hz"), (row["bound_ms"], 2, "ms"))
        )
        print(
            f"  {row['stream']:<{name_width}}  {rate:>9}  {row['offset_s']:>13.6f} s  {row['drift_ppm']:>6.1f} ppm  "
            f"{bound:>9}  {row['age_ms']:>6.1f} ms  {row['resets']:>6}{'' if row['valid'] else '  not valid'}"
        )
        if row["shown"]:
            late = row["shown"]["late_ms"]
            pictures = f"{counted(row['shown']['pictures'], 'picture')} of the last minute, {row['shown']['dropped']}"
            print(f"    {pictures} dropped, shown {late['p50']:.1f} ms after their pose's time (p95 {late['p95']:.1f})")


def _print_replayed(replayed: dict[str, Any]) -> None:
    """Whether a session that was played again came out the same, for people."""
    ticks, same, first = replayed["ticks"], replayed["same"], replayed["first_difference"]
    if first is None:
        print(f"  played again:             {ticks} ticks, each pose the same to the last bit")
    else:
        print(
            f"  played again:             {same} of {ticks} ticks the same; others, by up to "
            f"{replayed['largest_mm']:.2f} mm, from high five {first['trial'] + 1}, {first['time_s']:.3f} s, on"
        )
    for line in replayed["differs"]:
        print(f"    {line}")


def _spread(extent: dict[str, float], count: int, digits: int, unit: str) -> str:
    """Median and worst; of a single trial the one figure that there is."""
    if count == 1:
        return f"{extent['median']:.{digits}f} {unit}"
    return f"median {extent['median']:.{digits}f} {unit}, worst {extent['max']:.{digits}f} {unit}"


def _print_arm(arm: dict[str, Any]) -> None:
    """What the servo arm did, for people."""
    error, late = arm["error_mm"], arm["time_error_ms"]
    able = arm["trials"] - arm["broken_off"] - len(arm["unreachable"])
    if error["median"] is not None:
        print(f"  servo arm's plate to palm {_spread(error, able, 1, 'mm')}")
    if late["median"] is not None:
        print(f"    off in time             {_spread(late, able - arm['missed'], 0, 'ms')}")
    print(f"    cycles of the bus       {arm['cycles']}, {arm['missed_cycles']} missed")
    for label, what in (
        ("no contact", ", ".join(arm["missed_trials"])),
        ("broken off", arm["broken_off"]),
        ("hand lost", ", ".join(arm["hand_lost"])),
        ("not possible", ", ".join(name for name in arm["unreachable"] if name not in arm["hand_lost"])),
        ("stopped", arm["stopped"]),
    ):
        if what:
            print(f"    {label + ':':<24}{what}")
