"""The tables of a session's report: its trials, and its styles."""

from __future__ import annotations

from html import escape
from typing import Any

from highfive.hil.report.colours import colour_of
from highfive.hil.report.page import table

_TRUE = (
    "True at touch: from the avatar's palm as played to the simulated person's true palm, in the tick of first touch; "
    "closing: of these two, along their normal, in that tick. True at contact: the same distance where the played palm "
    "is nearest to the palm as tracked. "
)
_COLUMNS = (
    "Before, after: palm to palm as tracked, at the nearest, before and after "
    "correction. Later: than the palms met originally. Speed step: largest change of a joint's speed from tick to tick "
    "while the correction fades in, as a share of the largest in the motion as generated."
)

_BY_STYLE = (
    ("true_error_at_touch_mm", "true palm at first touch, mm", 1),
    ("closing_speed_at_touch_m_s", "closing speed then, m/s", 2),
    ("uncorrected_error_mm", "before correction, mm", 1),
    ("contact_error_mm", "after, to the tracked palm, mm", 2),
    ("palm_angle_deg", "palm angle, °", 2),
    ("time_error_ms", "contact later by, ms", 0),
)
"""Figure, heading and digits of the table of styles."""


def style_table(summary: dict[str, Any]) -> str:
    """A row per style. Where no style has more than one trial there is no spread to show."""
    styles = summary["contact_error_mm"]["by_emotion"]
    counts = {style: sum((row["style"] or "unknown") == style for row in summary["rows"]) for style in styles}
    shown = [f for f in _BY_STYLE if any(summary[f[0]]["by_emotion"][style]["median"] is not None for style in styles)]
    several = any(count > 1 for count in counts.values())
    heads = ["style", "trials"]
    for _, head, _ in shown:
        heads.append(f"{head}: median (largest)" if several else head)
    rows = []
    for style, count in counts.items():
        row = [f"{dot(style)}{escape(style)}", str(count)]
        for name, _, digits in shown:
            extent = summary[name]["by_emotion"][style]
            largest = f" ({show(extent['max'], digits)})" if count > 1 and extent["max"] is not None else ""
            row.append(f"{show(extent['median'], digits)}{largest}")  # one cell: a page has no room for two
        rows.append(row)
    return table(heads, rows, words={0}, escaped=True) if rows else ""


def trial_table(summary: dict[str, Any]) -> str:
    """A row per trial; columns of which nothing is known are left out."""
    rows = summary["rows"]
    if not rows:
        return ""
    own = any(row["person_emotion"] and row["person_emotion"] != row["style"] for row in rows)
    columns = [
        ("", [str(row["trial"] + 1) for row in rows]),
        ("style", [f"{dot(row['style'])}{escape(row['style'] or '–')}" for row in rows]),
        ("person", [escape(row["person_emotion"] or "–") if own else "" for row in rows]),
        ("cell", [escape(row["cell"] or "") for row in rows]),
        ("met", [_met(row) for row in rows]),
        ("true at touch, mm", _column(rows, "true_error_at_touch_mm", 1)),
        ("closing, m/s", _column(rows, "closing_speed_at_touch_m_s")),
        ("true at contact, mm", _column(rows, "true_error_mm", 1)),
        ("before, mm", _column(rows, "uncorrected_error_mm")),
        ("after, mm", _column(rows, "contact_error_mm")),
        ("angle, °", _column(rows, "palm_angle_deg", 1)),
        ("contact, s", _column(rows, "contact_time_s")),
        ("later, ms", _column(rows, "time_error_ms", 0)),
        ("force, N", _column(rows, "peak_force_n", 0) if summary["physics"] else []),
        ("speed step, ×", _column(rows, "speed_change_ratio")),
        ("markers seen, %", [show(_percent(row["markers_seen"]), 1) for row in rows]),
        ("unwanted", [str(row["unwanted_contacts"]) for row in rows]),
        ("notes", [escape("; ".join([*([] if row["simulated"] else [row["title"]]), *row["notes"]])) for row in rows]),
    ]  # fmt: skip
    columns = [(head, cells) for head, cells in columns if any(cell not in ("", "–") for cell in cells)]
    heads = [head for head, _ in columns]
    known = any(row["true_error_mm"] is not None for row in rows)
    words = {i for i, head in enumerate(heads) if head in ("style", "person", "cell", "met", "notes")}
    listed = [list(row) for row in zip(*(cells for _, cells in columns), strict=True)]
    return table(heads, listed, words=words, escaped=True) + f'<p class="soft">{_TRUE * known}{_COLUMNS}</p>'


def show(value: float | None, digits: int = 2) -> str:
    """A number as the page shows it; a dash for none."""
    if value is None:
        return "–"
    shown = f"{value:.{digits if abs(value) < 100 else min(digits, 1)}f}"
    return shown.lstrip("-") if float(shown) == 0.0 else shown.replace("-", "−")


def dot(style: str | None) -> str:
    """A dot in the colour of a style."""
    return f'<span class="dot" style="background:{colour_of(style or "")}"></span>'


def _column(rows: list[dict[str, Any]], key: str, digits: int = 2) -> list[str]:
    return [show(row[key], digits) for row in rows]


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def _met(row: dict[str, Any]) -> str:
    if row["met"] and not row["out_of_reach"]:
        return "yes"
    return f'<span class="unmet">{"out of reach" if row["out_of_reach"] else "no"}</span>'
