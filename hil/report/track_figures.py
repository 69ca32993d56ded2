"""The figures of a tracked recording: gaps, residuals, the arm's angles and a strip of stick figures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Patch

from highfive.hil.report.drawing import FAINT, INK, Drawing, draw, new_figure
from highfive.hil.report.track_summary import MM, knows_arm, runs
from highfive.mocap_bridge.tracking.joint_angles import ANGLES
from highfive.mocap_bridge.tracking.tracked_recording import TrackedRecording
from highfive.model.geometry.rotations import Array

BLUE, ORANGE, RED, PURPLE = "#0072B2", "#E69F00", "#D55E00", "#8C6BB1"
_SHOWN_BANDS = 90.0  # per cent of the bands have room in their panel
_POINTS = 1200
"""Points of a drawn line at most: more than the page has pixels."""
_INSTANTS = 6
_HEAD_RADIUS, _BETWEEN = 0.095, 0.18  # m, of a stick figure
_NAMES = {
    "plane_of_elevation": "plane of elevation",
    "elevation": "elevation",
    "axial_rotation": "axial rotation",
    "elbow_flexion": "elbow flexion",
    "carrying_angle": "carrying angle",
    "pronation": "pronation",
    "wrist_flexion": "wrist flexion",
    "wrist_deviation": "wrist deviation",
}


def draw_track(track: TrackedRecording) -> list[Drawing]:
    """All figures that can be drawn."""
    painters = (gaps, residuals, joint_angles, skeleton_strip)
    return draw(partial(painter, track) for painter in painters)


def gaps(track: TrackedRecording) -> Drawing | None:
    """When each marker was hidden, and what became of it; None where all were seen and believed all the time."""
    rows = np.flatnonzero((track.hidden | track.disbelieved).any(axis=0))
    if not len(rows):
        return None
    figure = new_figure(9.0, 1.1 + 0.22 * len(rows))
    axes = figure.subplots()
    frame = 1.0 / track.rate_hz
    thinnest = len(track) * frame / 900.0  # what is one frame long shall be seen too
    kinds = [
        (track.hidden & track.usable, BLUE, 0.62, "hidden, filled in", "the rest of the skeleton says where it was"),
        (track.hidden & ~track.usable, ORANGE, 0.62, "hidden, left open", "too uncertain to be filled in"),
        (track.disbelieved, RED, 0.9, "measured, not believed", "not where the skeleton can be"),
    ]
    kinds = [kind for kind in kinds if kind[0].any()]
    for row, marker in enumerate(rows):
        axes.plot([0.0, len(track) * frame], [row, row], color=FAINT, lw=1.0, alpha=0.45, zorder=1)
        for flags, colour, height, *_ in kinds:
            spans = [(start * frame, max((end - start) * frame, thinnest)) for start, end in runs(flags[:, marker])]
            if spans:
                axes.broken_barh(spans, (row - height / 2, height), facecolors=colour, lw=0, zorder=2)
    axes.set_yticks(range(len(rows)), [track.marker_set.names[m] for m in rows], fontsize=8.5)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(0.0, len(track) * frame)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("time, s")
    handles = [Patch(color=colour, label=name) for _, colour, _, name, _ in kinds]
    axes.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=9, borderaxespad=0.2)
    others = int(track.labelled.sum()) - len(rows)
    meanings = "; ".join(f"{name}: {meaning}" for *_, name, meaning in kinds)
    rest = f" The other {others} markers were seen, and believed, in every frame." if others else ""
    return Drawing("gaps", f"{meanings[0].upper()}{meanings[1:]}.{rest}", figure)


def residuals(track: TrackedRecording) -> Drawing | None:
    """How far each marker was measured from where the skeleton has it."""
    rows = np.flatnonzero(np.isfinite(track.residuals).any(axis=0))
    if not len(rows):
        return None
    halves = np.array_split(rows, 2 if len(rows) > 16 else 1)
    figure = new_figure(9.0, 0.9 + 0.2 * max(len(half) for half in halves))
    panels = np.atleast_1d(figure.subplots(1, len(halves), sharex=True))
    for axes, half in zip(panels, halves, strict=True):
        for row, marker in enumerate(half):
            known = MM * track.residuals[:, marker]
            low, first, middle, third, high = np.nanpercentile(known, [5.0, 25.0, 50.0, 75.0, 95.0])
            axes.plot([low, high], [row, row], color=FAINT, lw=1.0, zorder=1)
            axes.plot([first, third], [row, row], color=BLUE, lw=4.5, alpha=0.45, solid_capstyle="butt", zorder=2)
            axes.plot(middle, row, "o", ms=4.0, color=BLUE, zorder=3)
        axes.set_yticks(range(len(half)), [track.marker_set.names[m] for m in half], fontsize=8.5)
        axes.set_ylim(max(len(each) for each in halves) - 0.5, -0.7)
        axes.spines["left"].set_visible(False)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="x", color=FAINT, alpha=0.25, lw=0.6)
        axes.set_xlabel("measured to skeleton, mm")
    panels[0].set_xlim(0.0, 1.05 * float(np.nanmax(np.nanpercentile(MM * track.residuals[:, rows], 95.0, axis=0))))
    caption = (
        "Distance of each measured marker from where it sits on the skeleton: a dot is the median, a bar the middle "
        "half, a line 5 to 95 % of the frames. Skin, and segments that are not rigid, show here."
    )
    return Drawing("residuals", caption, figure)


def joint_angles(track: TrackedRecording) -> Drawing | None:
    """Angles of the right arm with bands of two standard deviations."""
    if not knows_arm(track):
        return None
    figure = new_figure(9.0, 8.4)
    panels = figure.subplots(4, 2, sharex=True).T.reshape(-1)
    kept = np.unique(np.linspace(0, len(track) - 1, min(len(track), _POINTS)).astype(int))
    used = track.marker_set.indices(track.marker_set.arm.markers)
    arm = [m for m in used if track.marker_set.joints[m].startswith("right_")]
    blind = runs(np.asarray((track.hidden | track.disbelieved)[:, arm].any(axis=1)))
    times = track.times[kept]
    for axes, angle, i in zip(panels, ANGLES, range(len(ANGLES)), strict=True):
        degrees, band = np.degrees(track.angles[kept, i]), 2.0 * np.degrees(track.deviations[kept, i])
        for start, end in blind:
            axes.axvspan(start / track.rate_hz, end / track.rate_hz, color=BLUE, alpha=0.09, lw=0)
        axes.fill_between(times, degrees - band, degrees + band, color=PURPLE, alpha=0.3, lw=0)
        axes.plot(times, degrees, color=PURPLE, lw=1.3)
        axes.set_ylabel(f"{_NAMES[angle]}, °", fontsize=9)
        axes.margins(x=0.0)
        if not np.isfinite(degrees).any():
            axes.set_yticks([])
            axes.text(0.5, 0.5, "these markers do not show it", transform=axes.transAxes, ha="center", color=FAINT)
        else:  # bands run off the panel in long gaps; a joint that hardly moves shall look so
            reach = float(np.nanpercentile(band, _SHOWN_BANDS))
            low, high = float(np.nanmin(degrees)) - reach, float(np.nanmax(degrees)) + reach
            middle, half = (low + high) / 2.0, max(0.52 * (high - low), 10.0)
            axes.set_ylim(middle - half, middle + half)
    panels[3].set_xlabel("time, s")
    panels[7].set_xlabel("time, s")
    figure.align_ylabels()
    shaded = " Where it is shaded, a marker that the arm rests on was hidden, or not believed." if blind else ""
    caption = (
        "Angles of the right arm after the recommendation of the International Society of Biomechanics "
        "(Wu et al. 2005), with bands of two standard deviations as the tracker gives them. Elevation 0° is hanging; "
        "plane of elevation 0° is sideways, 90° forward; pronation 90° is with the palm at the thigh. A line has gaps "
        "where the markers do not show the angle." + shaded
    )
    return Drawing("joint_angles", caption, figure)


def skeleton_strip(track: TrackedRecording) -> Drawing | None:
    """Stick figures at some instants, from the front and from the person's right."""
    known = np.flatnonzero(track.posed)
    if not len(known):
        return None
    instants = known[np.unique(np.linspace(0, len(known) - 1, _INSTANTS).astype(int))]
    # Seen by someone who stands before the person, and by someone at the person's right.
    views = [[_stick_figure(track, int(number), across) for number in instants] for across in ((0.0, 1.0), (1.0, 0.0))]
    widths = [sum(stick.width + _BETWEEN for stick in sticks) for sticks in views]
    heights = [max(stick.top for stick in sticks) - min(stick.bottom for stick in sticks) for sticks in views]
    widest = max(*widths, 0.8 * sum(heights))  # m; one person's instants need not fill the page
    figure = new_figure(9.0, 1.0 + 8.5 / widest * sum(heights))
    panels = figure.subplots(2, 1, height_ratios=heights)
    for axes, sticks, width, name in zip(panels, views, widths, ("from the front", "from the right"), strict=True):
        place = (widest - width) / 2
        for stick, number in zip(sticks, instants, strict=True):
            place += stick.width / 2 + _BETWEEN / 2
            _paint(axes, stick, place - stick.middle)
            if axes is panels[0]:
                above = (place, max(each.top for each in sticks))
                text = f"{track.times[number]:.2f} s"
                axes.annotate(text, above, (0, 5), textcoords="offset points", ha="center", fontsize=9.5)
            place += stick.width / 2 + _BETWEEN / 2
        axes.set_xlim(0.0, widest)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.annotate(name, (0.0, 0.5), xycoords="axes fraction", rotation=90, ha="right", va="center", fontsize=9.5)
    caption = (
        "Head, trunk and right arm (violet) at some instants, each turned to face the same way. Grey dots are measured "
        "markers, blue rings hidden ones where the tracker has them."
    )
    return Drawing("skeleton", caption, figure)


@dataclass(frozen=True)
class _Stick:
    """One instant, flat: bones (n, 2, 2) of the body and of the arm, head (2,), markers (m, 2), all in m."""

    body: Array
    arm: Array
    head: Array
    measured: Array
    filled: Array

    @property
    def _all(self) -> Array:
        around = self.head + _HEAD_RADIUS * np.array([[1.0, 1.0], [-1.0, -1.0]])
        return np.concatenate([self.body.reshape(-1, 2), self.arm.reshape(-1, 2), self.measured, self.filled, around])

    @property
    def width(self) -> float:
        return float(np.ptp(self._all[:, 0]))

    @property
    def middle(self) -> float:
        return float(self._all[:, 0].min() + self.width / 2)

    @property
    def bottom(self) -> float:
        return float(self._all[:, 1].min())

    @property
    def top(self) -> float:
        return float(self._all[:, 1].max())


def _stick_figure(track: TrackedRecording, number: int, across: tuple[float, float]) -> _Stick:
    """One instant seen along the floor: ``across`` weighs forward and left in what goes to the right."""
    heading = track.headings[number]
    forward, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    to_right = across[0] * forward + across[1] * left

    def flat(points: Array) -> Array:
        return np.stack([points[..., :2] @ to_right, points[..., 2]], axis=-1)

    centres, arm_joints = track.centres[number], ("right_elbow", "right_wrist")
    head, shoulder, elbow, wrist, knuckles = track.arm[number]
    bones = [
        (centres[parent], centres[joint])
        for joint, parent in enumerate(track.parents)
        if parent >= 0 and track.segments[joint] not in arm_joints
    ]
    if "head" not in track.segments:
        bones += [(centres[j], head) for j in _at(track, "thoracic_8")]
    # From the segments, not from the markers' mean: this is where the tracker has the joints.
    chain = [centres[j] for name in ("right_shoulder", *arm_joints) for j in _at(track, name)]
    chain = [*chain, knuckles] if len(chain) == 3 else [shoulder, elbow, wrist, knuckles]
    return _Stick(
        body=flat(np.array(bones)).reshape(-1, 2, 2),
        arm=flat(np.array(list(pairwise(chain)))),
        head=flat(head),
        measured=flat(track.measured[number, track.there[number]]),
        filled=flat(track.filled[number, (track.hidden & track.usable)[number]]),
    )


def _paint(axes: Axes, stick: _Stick, shift: float) -> None:
    """Draws a stick figure, moved to the right by ``shift``, m."""
    moved = np.array([shift, 0.0])
    for bone in stick.body + moved:
        axes.plot(bone[:, 0], bone[:, 1], color=FAINT, lw=2.4, solid_capstyle="round", zorder=2)
    for bone in stick.arm + moved:
        axes.plot(bone[:, 0], bone[:, 1], color=PURPLE, lw=3.0, solid_capstyle="round", zorder=4)
        axes.plot(*bone[0], "o", ms=4.6, color=PURPLE, zorder=5)
    axes.add_patch(Circle(tuple(stick.head + moved), _HEAD_RADIUS, fill=False, ec=FAINT, lw=2.0, zorder=3))
    dots, rings = stick.measured + moved, stick.filled + moved
    axes.plot(dots[:, 0], dots[:, 1], ".", ms=3.2, color=INK, alpha=0.5, mec="none", zorder=3)
    axes.plot(rings[:, 0], rings[:, 1], "o", ms=5.0, mfc="none", mec=BLUE, mew=1.2, zorder=6)


def _at(track: TrackedRecording, name: str) -> list[int]:
    return [track.segments.index(name)] if name in track.segments else []
