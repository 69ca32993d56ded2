"""The figures of a session's report."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import FuncFormatter, LogLocator

from highfive.hil.report.colours import PARTNER, PERSON, colour_of, mark_of
from highfive.hil.report.drawing import FAINT, HINGES, INK, Drawing, new_figure
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.sim.people.grid import CELLS, GRID_Z
from highfive.hil.sim.people.role import RATE_HZ
from highfive.hil.trials.key_frames import contact_tick, key_frames_of
from highfive.hil.trials.summary import MM, style_of, styles_of
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.geometry.rotations import Array

_TRACES = 12
"""Trials an emotion that are drawn as lines: more hide each other."""
_MARGIN_S, _AFTER_S = 0.2, 1.0
"""Shown before the person starts, and after the palms part."""
_STEP = 3
"""Ticks between points of a drawn line, 25 ms: all that 300 pixels show."""
_FLOOR_MM = 0.02


def contact_error(results: Sequence[TrialResult]) -> Drawing:
    """Palm-to-palm error by style, before and after correction: a dot per trial, a bar the median of several."""
    emotions = styles_of(results)
    figure = new_figure(9.0, 3.4)
    axes = figure.subplots()
    for place, emotion in enumerate(emotions):
        group = [r for r in results if style_of(r) == emotion]
        pairs = np.array([[MM * r.uncorrected_error, MM * r.error] for r in group])
        spread = np.linspace(-0.13, 0.13, len(group)) if len(group) > 1 else np.zeros(1)
        x = place + np.array([-0.2, 0.2]) + spread[:, None]
        axes.plot(x.T, pairs.T.clip(_FLOOR_MM), color=FAINT, lw=0.4, alpha=0.5, zorder=1)
        for side, face in ((0, "none"), (1, colour_of(emotion))):
            axes.plot(
                x[:, side], pairs[:, side].clip(_FLOOR_MM), mark_of(emotion), ms=5.5, mfc=face, mec=colour_of(emotion),
                mew=1.1, alpha=0.9, zorder=2,
            )  # fmt: skip
            middle = place + (-0.2, 0.2)[side]
            if len(group) > 1:
                axes.plot([middle - 0.17, middle + 0.17], [np.median(pairs[:, side])] * 2, color=INK, lw=1.8, zorder=3)
    axes.set_xticks(range(len(emotions)), emotions)
    axes.set_xlim(-0.6, len(emotions) - 0.4)
    axes.axhline(1.0, color=FAINT, lw=0.8, ls=(0, (4, 3)))
    axes.axhline(5.0, color=FAINT, lw=0.8, ls=(0, (1, 2)))
    axes.annotate(
        "1 mm", (1.0, 1.0), xycoords=("axes fraction", "data"), ha="left", va="center", color=FAINT, fontsize=9
    )
    axes.annotate(
        "5 mm", (1.0, 5.0), xycoords=("axes fraction", "data"), ha="left", va="center", color=FAINT, fontsize=9
    )
    _log_mm(axes)
    axes.set_ylabel("to the palm as tracked, mm")
    caption = (
        "Distance of the avatar's palm from the person's as tracked, at the nearest. In each pair: left, open, as the "
        "model generated it; right, filled, as it was played after the contact correction."
        + " A mark is a trial, a bar the median of several."
        * (len(results) > 1)
    )
    return Drawing("contact_error", caption, figure, "Contact error")


def error_by_cell(results: Sequence[TrialResult]) -> Drawing | None:
    """Median error in each of the 3 × 3 cells, a style per column, before, after correction a row; none of one cell."""
    if len({r.cell for r in results if r.cell in CELLS}) < 2:
        return None
    emotions = styles_of(results)
    figure = new_figure(9.0, 4.1)
    grid = figure.subplots(2, max(len(emotions), 2), squeeze=False)
    norm = LogNorm(0.1, 100.0)
    image = None
    for column, panels in enumerate(grid.T):
        if column >= len(emotions):
            for axes in panels:
                axes.set_axis_off()
            continue
        for axes, value in zip(panels, (lambda r: r.uncorrected_error, lambda r: r.error), strict=True):
            image = _cells(axes, [r for r in results if style_of(r) == emotions[column]], value, norm)
        panels[0].set_title(emotions[column], color=colour_of(emotions[column]))
    for axes, name in zip(grid[:, 0], ("as generated", "after correction"), strict=True):
        axes.set_ylabel(f"{name}\nheight, m")
    assert image is not None
    bar = figure.colorbar(image, ax=grid, shrink=0.7, pad=0.02, extend="both", label="median error, mm")
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    caption = (
        "Median error, mm, in the cells of the grid as the avatar sees it: rows A to C are heights, columns 1 to 3 go "
        "from the avatar's right to its left, which is left in the picture. The colour scale is logarithmic and the "
        "same everywhere."
    )
    return Drawing("error_by_cell", caption, figure, "Contact error")


def _cells(axes: Axes, results: Sequence[TrialResult], value: Callable[[TrialResult], float], norm: LogNorm):
    table = np.full((3, 3), np.nan)
    for number, cell in enumerate(CELLS):
        known = [MM * value(r) for r in results if r.cell == cell]
        if known:
            table[divmod(number, 3)] = np.median(known)
    # Columns of the grid count from the avatar's right; seen with its eyes that is on the right.
    table = table[:, ::-1]
    image = axes.imshow(np.ma.masked_invalid(table).clip(0.1), cmap="cividis", norm=norm, origin="lower")
    for (row, column), error in np.ndenumerate(table):
        if np.isfinite(error):
            colour = "#ffffff" if norm(error) < 0.55 else "#101010"
            axes.text(column, row, f"{error:.{1 if error < 9.95 else 0}f}", ha="center", va="center", color=colour)
    axes.set_xticks(range(3), ["3\nleft", "2", "1\nright"], fontsize=9)
    axes.set_yticks(range(3), [f"{row}  {z:g}" for row, z in zip("ABC", GRID_Z, strict=True)], fontsize=9)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return image


def palm_distance(results: Sequence[TrialResult]) -> Drawing:
    """Distance of the palms and speed of the avatar's hand over time."""
    emotions = styles_of(results)
    figure = new_figure(9.0, 4.6)
    rows = figure.subplots(2, len(emotions), squeeze=False, sharex="col", sharey="row")
    for (upper, lower), emotion in zip(rows.T, emotions, strict=True):
        for result in _shown(results, emotion):
            time, part = _around_contact(result)
            apart = [
                np.linalg.norm(p - result.person_palm, axis=-1)[part] for p in (result.generated_palm, result.palm)
            ]
            upper.plot(time, MM * apart[0].clip(1e-4), color=FAINT, lw=0.7, alpha=0.7)
            upper.plot(time, MM * apart[1].clip(1e-4), color=colour_of(emotion), alpha=0.8)
            lower.plot(time, _speed(result.person_palm)[part], color=PERSON, lw=0.7, alpha=0.7)
            lower.plot(time, _speed(result.palm)[part], color=colour_of(emotion), alpha=0.8)
        upper.set_title(emotion, color=colour_of(emotion))
        upper.axvline(0.0, color=FAINT, lw=0.8)
        lower.axvline(0.0, color=FAINT, lw=0.8)
        lower.set_xlabel("s from contact")
    _log_mm(rows[0, 0])
    rows[0, 0].set_ylabel("palm to palm, mm")
    rows[1, 0].set_ylabel("hand speed, m/s")
    caption = (
        "Above: distance between the palms, in colour as played, in grey as generated. Below: speed of the avatar's "
        "palm, in colour, and of the person's, in violet. Time 0 is contact, or the nearest approach."
    )
    return Drawing("palm_distance", caption, figure)


def palm_paths(results: Sequence[TrialResult]) -> Drawing:
    """Paths of the palms from the side and from above, until contact and a little beyond."""
    emotions = styles_of(results)
    figure = new_figure(9.0, 4.2)
    rows = figure.subplots(2, len(emotions), squeeze=False, sharex=True, sharey="row")
    partner = not all(r.simulated for r in results)
    for column, emotion in zip(rows.T, emotions, strict=True):
        for result in _shown(results, emotion):
            _, part = _around_contact(result)
            tracks = [(result.person_palm, PERSON, 1.0), (result.generated_palm, FAINT, 0.8)]
            tracks.append((result.palm, colour_of(emotion), 1.3))
            if partner and result.other_palm is not None:
                tracks.append((result.other_palm, PARTNER, 1.3))
            for axes, (across, up) in zip(column, ((0, 2), (0, 1)), strict=True):
                for track, colour, width in tracks:
                    line = track[part.start : min(part.stop, len(track)) : _STEP]
                    axes.plot(line[:, across], line[:, up], color=colour, lw=width, alpha=0.8)
                where = result.palm[contact_tick(result)]
                axes.plot(where[across], where[up], mark_of(emotion), ms=4.5, mfc=colour_of(emotion), mec=INK, mew=0.6)
        column[0].set_title(emotion, color=colour_of(emotion))
        column[1].set_xlabel("x towards person, m")
        for axes in column:
            axes.set_aspect("equal", adjustable="box")
    rows[0, 0].set_ylabel("side view\nheight z, m")
    rows[1, 0].set_ylabel("from above\ny to the left, m")
    more = ", and pink who really met that hand" if partner else ""
    caption = (
        "Paths of the palms: violet the person, grey the avatar as generated, in colour as played"
        + more
        + ". The mark is contact."
    )
    return Drawing("palm_paths", caption, figure)


def joint_angles(results: Sequence[TrialResult]) -> Drawing:
    """Angles of the right shoulder, elbow and wrist, generated and played."""
    emotions = styles_of(results)
    figure = new_figure(9.0, 8.0)
    rows = figure.subplots(len(HINGES), len(emotions), squeeze=False, sharex="col", sharey="row")
    index = avatar_skeleton().index
    for column, emotion in zip(rows.T, emotions, strict=True):
        for result in _shown(results, emotion):
            time, part = _around_contact(result)
            generated, played = _degrees(result.generated[part]), _degrees(result.poses[part])
            for axes, (joint, hinge, _, sign) in zip(column, HINGES, strict=True):
                axes.plot(time, sign * generated[:, index(joint), hinge], color=FAINT, lw=0.7, alpha=0.7)
                axes.plot(time, sign * played[:, index(joint), hinge], color=colour_of(emotion), alpha=0.8)
        column[0].set_title(emotion, color=colour_of(emotion))
        column[-1].set_xlabel("s from contact")
        for axes in column:
            axes.axvline(0.0, color=FAINT, lw=0.8)
    for axes, (_, _, name, _) in zip(rows[:, 0], HINGES, strict=True):
        axes.set_ylabel(f"{name}, °")
    caption = "Joint angles of the avatar's right arm: grey as generated, in colour as played. Time 0 is contact."
    return Drawing("joint_angles", caption, figure)


def latency(results: Sequence[TrialResult]) -> Drawing:
    """Share of ticks that took no longer than a time."""
    ticks = np.sort(np.concatenate([r.tick_ms for r in results]))
    share = np.arange(1, len(ticks) + 1) / len(ticks)
    # The slow ones one by one, the many quick ones thinned out.
    kept = np.unique(
        np.concatenate([np.linspace(0, len(ticks) - 1, 300), np.arange(max(len(ticks) - 60, 0), len(ticks))])
    )
    kept = kept.astype(int)
    figure = new_figure(9.0, 2.8)
    axes = figure.subplots()
    axes.step(ticks[kept], 100.0 * share[kept], where="post", color=colour_of("sad"), lw=1.6)
    for percent in (50.0, 99.0):
        value = float(np.percentile(ticks, percent))
        axes.plot(value, percent, "o", ms=6, color=colour_of("sad"))
        name = f"half within {value:.2f} ms" if percent == 50.0 else f"99 of 100 within {value:.2f} ms"
        axes.annotate(name, (value, percent), (8, -4 if percent == 50.0 else -14), textcoords="offset points")
    axes.axvline(1e3 / RATE_HZ, color=FAINT, ls=(0, (4, 3)), lw=1.0)
    axes.annotate(
        "a frame at 120 Hz", (1e3 / RATE_HZ, 8.0), (-6, 0), textcoords="offset points", ha="right", color=FAINT
    )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(10, (1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.xaxis.set_minor_formatter(FuncFormatter(lambda *_: ""))
    axes.set_xlabel("one tick, ms")
    axes.set_ylabel("share of ticks, %")
    axes.set_ylim(0, 103)
    caption = "Time of one tick, from markers to the corrected pose, on the machine that made this report."
    return Drawing("latency", caption, figure, "Latency")


def _shown(results: Sequence[TrialResult], emotion: str) -> list[TrialResult]:
    return [r for r in results if r.whole and style_of(r) == emotion][:_TRACES]


def _around_contact(result: TrialResult) -> tuple[Array, slice]:
    """Times (n,) s from contact, and the ticks that they are of."""
    at = key_frames_of(result)
    before = at.contact - max(at.start - round(_MARGIN_S * RATE_HZ), 0)
    part = slice(at.contact - before // _STEP * _STEP, min(at.release + round(_AFTER_S * RATE_HZ), at.end) + 1, _STEP)
    return result.times[part] - result.times[at.contact], part


def _degrees(poses: Sequence[Pose]) -> Array:
    return np.degrees([pose.hinges for pose in poses])


def _speed(track: Array) -> Array:
    if len(track) < 2:
        return np.zeros(len(track))
    return np.linalg.norm(np.gradient(track, 1.0 / RATE_HZ, axis=0), axis=-1)


def _log_mm(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(FuncFormatter(lambda *_: ""))
