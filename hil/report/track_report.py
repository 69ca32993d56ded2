"""The page of a tracked recording, with its figures."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from highfive.hil.report.drawing import Drawing, to_png
from highfive.hil.report.page import figures, render, section, table
from highfive.hil.report.track_figures import draw_track
from highfive.hil.runtime.console import counted
from highfive.hil.runtime.folders import write_file
from highfive.mocap_bridge.tracking.tracked_recording import TrackedRecording
from highfive.mocap_bridge.tracking.unobservable import RULE, unseen_lines

PAGE, DATA, FIGURES = "report.html", "report.json", "figures"


def write_track_report(folder: Path, summary: dict[str, Any], track: TrackedRecording, command: Sequence[str]) -> Path:
    """Writes page, numbers and figures into ``folder``; returns the page.

    Args:
        folder: made if it is not there; an older report in it is replaced.
        summary: from :func:`highfive.hil.report.track_summary.summarise_track`.
        track: what is drawn.
        command: the words that make the report again.

    Raises:
        HighFiveError: a file cannot be written.
    """
    drawings = draw_track(track)
    write_file(folder / DATA, json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False).encode())
    for drawing in drawings:
        write_file(folder / FIGURES / f"{drawing.name}.png", to_png(drawing.figure))
    write_file(folder / PAGE, _page(summary, drawings, command).encode())
    return folder / PAGE


def _page(summary: dict[str, Any], drawings: Sequence[Drawing], command: Sequence[str]) -> str:
    drawn = {drawing.name: drawing for drawing in drawings}
    whose = f", {summary['person']}" if summary["person"] else ""
    subtitle = (
        f"{Path(summary['file']).name}{whose}: {summary['frames']} frames, {summary['seconds']:.1f} s at "
        f"{summary['rate_hz']:g} Hz."
    )
    badges = f'<span class="badge">marker set {escape(summary["marker_set"])}</span>'
    sections = [
        _headline(summary),
        _unseen(summary),
        _remarks(summary),
        section(
            "Gaps",
            figures(drawn, "gaps")
            or "<p>Every marker that the recording has was seen, and believed, in every frame.</p>",
        ),
        section("Skeleton", figures(drawn, "skeleton")),
        section("Right arm", figures(drawn, "joint_angles") + _angles(summary)),
        section("Residuals", figures(drawn, "residuals")),
        section("Markers", _markers(summary)),
        section("Do it again", _reproduce(summary, command)),
    ]
    return render("High Five: a tracked recording", escape(subtitle), badges, sections)


def _headline(summary: dict[str, Any]) -> str:
    residual = summary["residual_mm"]
    cards = [
        (
            "hidden points",
            f"{summary['hidden_points']}",
            f"in {summary['gaps']} gap{'s' * (summary['gaps'] != 1)}; {summary['filled_points']} filled",
        ),
        (
            "measured to skeleton, median",
            "–" if residual is None else f"{residual['median']:.1f} mm",
            "" if residual is None else f"95 % within {residual['p95']:.1f} mm",
        ),
        ("measured, not believed", f"{summary['disbelieved_points']}", "label swapped, or marker off its segment"),
    ]
    return (
        '<div class="headline">'
        + "".join(
            f'<div class="figure"><div class="what">{escape(what)}</div><div class="value">{escape(value)}</div>'
            f'<div class="target">{escape(more)}</div></div>'
            for what, value, more in cards
        )
        + "</div>"
    )


def _unseen(summary: dict[str, Any]) -> str:
    """What the markers do not show, before anything that they do."""
    lines = unseen_lines(summary)
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<p><b>Angles that these markers do not show are left blank.</b></p><ul>{items}</ul><p>{escape(RULE)}</p>"


def _remarks(summary: dict[str, Any]) -> str:
    found = []
    if summary["refused_frames"]:
        frames = counted(summary["refused_frames"], "frame")
        found.append(f"Not used: {frames} whose markers span what no person does, as if the unit had changed.")
    if summary["fitted"]:
        found.append(
            "The marker set was first fitted to this person, from the same recording: segment lengths, and where the "
            "markers sit."
        )
    if summary["missing"]:
        found.append(f"Markers of the set that the recording never shows: {', '.join(summary['missing'])}.")
    if summary["unused"]:
        shown = ", ".join(summary["unused"][:20])
        more = f" and {len(summary['unused']) - 20} more" if len(summary["unused"]) > 20 else ""
        found.append(f"Labels that the set does not know, left as they are, gaps and all: {shown}{more}.")
    lost = summary["frames"] - summary["tracked_frames"]
    if lost:
        found.append(f"In {lost} of {summary['frames']} frames too few markers are seen to say anything.")
    return "".join(f"<p>{escape(line)}</p>" for line in found)


def _angles(summary: dict[str, Any]) -> str:
    if summary["angles_deg"] is None:
        return "<p>There are no angles: the marker set or the recording has no trunk, upper arm, forearm and hand.</p>"
    base = summary["angles_relative_to"]
    remark = ""
    if base["markers"] < 3:
        markers = counted(base["markers"], "marker")
        remark = (
            f"<p>The first three angles are relative to the {escape(base['segment'].replace('_', ' '))}, which bears "
            f"{markers}: how it is turned is known from the rest of the body alone. A set with three or more markers "
            "on the trunk gives them better.</p>"
        )
    rows = [
        [name.replace("_", " "), *[""] * 5]
        if of is None
        else [
            name.replace("_", " "),
            f"{100.0 * of['seen']:.0f} %",
            f"{of['min']:.1f}",
            f"{of['max']:.1f}",
            f"{of['max'] - of['min']:.1f}",
            f"{of['sd']:.2f}",
        ]
        for name, of in summary["angles_deg"].items()
    ]
    return (
        table(["angle", "seen", "least, °", "most, °", "range, °", "standard deviation, median, °"], rows, words={0})
        + remark
    )


def _markers(summary: dict[str, Any]) -> str:
    heads = [
        "marker", "seen", "gaps", "longest, ms", "hidden", "filled", "standard deviation of filled, median, mm",
        "the same, largest, mm", "not believed", "residual, median, mm", "residual, 95 %, mm", "residual, largest, mm",
    ]  # fmt: skip
    rows = []
    for name, of in summary["markers"].items():
        residual = of["residual_mm"]
        values = ["", "", ""] if residual is None else [f"{residual[key]:.1f}" for key in ("median", "p95", "max")]
        filled = of["filled_sd_mm"]
        doubts = ["", ""] if filled is None else [f"{filled[key]:.1f}" for key in ("median", "max")]
        counts = [f"{of[key]:g}" if of[key] else "" for key in ("gaps", "longest_gap_ms", "hidden", "filled")]
        disbelieved = f"{of['disbelieved']}" if of["disbelieved"] else ""
        rows.append([name, f"{100.0 * of['seen']:.1f} %", *counts, *doubts, disbelieved, *values])
    return table(heads, rows, words={0})


def _reproduce(summary: dict[str, Any], command: Sequence[str]) -> str:
    files = summary["files"]
    said = (
        "its gaps filled; a point that was put in has residual 0, a measured one of this person more."
        if any(of["filled"] for of in summary["markers"].values())
        else "nothing put in: there was no gap that could be filled, and each point keeps the residual that it had."
    )
    return (
        f"<pre>{escape(shlex.join(command))}</pre><p><code>{escape(files['filled'])}</code> is the recording with "
        f"{said} "
        f"<code>{escape(files['angles'])}</code> has the angles of every frame, <code>{DATA}</code> the numbers of "
        f"this page; its pictures are in <code>{FIGURES}/</code>. What is hidden is estimated from before and after; "
        "angles and residuals are the tracker's, which knows what came before, as in a live session.</p>"
    )
