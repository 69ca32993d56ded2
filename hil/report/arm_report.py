"""The servo arm's section of a session's report: what was planned, sent and done, what it cost, and what went wrong."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from html import escape
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from highfive.hil.arm.arm_figures import ArmFigures
from highfive.hil.arm.arm_trial import MS, ArmTrial
from highfive.hil.report.colours import PERSON, colour_of
from highfive.hil.report.drawing import FAINT, INK, Drawing, draw, new_figure
from highfive.hil.report.page import figures, table
from highfive.hil.session.session import RATE_HZ

SENT, ACTUAL = "#E69F00", "#0072B2"
_HALF_S = 1.0
"""Shown before and after contact."""


def draw_arm(
    trials: Sequence[ArmTrial], lag: float, figures_of: Sequence[ArmFigures], names: Sequence[str]
) -> list[Drawing]:
    """All figures of the arm.

    Args:
        trials: of which every tick is known.
        lag: s, of the joints after where they were planned.
        figures_of: every high five.
        names: of the joints.
    """
    if not trials:
        return []
    return draw([
        partial(joints, trials[0], lag, names), partial(meeting, trials), partial(effort, figures_of, names),
        partial(bus, figures_of),
    ])  # fmt: skip


def joints(trial: ArmTrial, lag: float, names: Sequence[str]) -> Drawing:
    """Joint angles of one high five: planned, sent, and what the servos said."""
    figure = new_figure(9.0, 5.2)
    grid = figure.subplots(2, (len(names) + 1) // 2, sharex=True)
    contact = _contact(trial)
    for axes in grid.flat[len(names) :]:
        axes.set_axis_off()
    for joint, (name, axes) in enumerate(zip(names, grid.flat, strict=False)):
        axes.plot(trial.times + lag - contact, np.degrees(trial.planned[:, joint]), color=FAINT, lw=2.2)
        axes.plot(trial.cycle_times - contact, np.degrees(trial.sent[:, joint]), color=SENT, lw=1.0)
        axes.plot(trial.cycle_times - contact, np.degrees(trial.actual[:, joint]), color=ACTUAL, lw=1.2)
        axes.set_title(name.replace("_", " "))
        _about_contact(axes)
    for axes in grid[-1]:
        axes.set_xlabel("s from contact")
    for axes in grid[:, 0]:
        axes.set_ylabel("joint angle, °")
    for colour, name, height in ((FAINT, "planned", 0.9), (SENT, "sent", 0.8), (ACTUAL, "actual", 0.7)):
        grid[0, 0].text(0.03, height, name, color=colour, transform=grid[0, 0].transAxes, fontsize=9)
    caption = (
        f"First trial ({trial.met.emotion}{', ' + trial.met.cell if trial.met.cell else ''}): joint angles that "
        "retargeting planned (grey, at the time for which it planned them), as sent to the servos (orange: ahead of "
        "that, and beyond by what a joint gives way), and as the servos reported them (blue). Time 0 is the session's "
        "contact."
    )
    return Drawing("arm_joints", caption, figure, "Servo arm")


def _about_contact(axes: Axes) -> None:
    """The time about contact, and a line at it."""
    axes.axvline(0.0, color=FAINT, lw=0.8)
    axes.set_xlim(-_HALF_S, _HALF_S)


def meeting(trials: Sequence[ArmTrial]) -> Drawing:
    """Plate to palm, and speed of plate and hand, about contact."""
    figure = new_figure(9.0, 3.4)
    left, right = figure.subplots(1, 2)
    for trial in trials[:40]:
        contact, goals = _contact(trial), [tick.goal for tick in trial.ticks]
        time = trial.times - contact
        palm = np.array([np.full(3, np.nan) if goal.person is None else goal.person.position for goal in goals])
        speed = np.array([np.nan if goal.person is None else np.linalg.norm(goal.person.velocity) for goal in goals])
        plate = np.array([pose.position for pose in trial.plates])
        colour = colour_of(trial.met.emotion)
        left.plot(time, MS * np.linalg.norm(plate - palm, axis=1).clip(1e-4), color=colour, lw=0.9, alpha=0.8)
        right.plot(time, speed, color=PERSON, lw=0.6, alpha=0.5)
        right.plot(time, [np.linalg.norm(p.velocity) for p in trial.plates], color=colour, lw=0.9, alpha=0.8)
    left.set_yscale("log")
    left.set_ylim(1.0, 1500.0)
    left.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    left.set_ylabel("plate to palm, mm")
    right.set_ylabel("speed, m/s")
    for axes in (left, right):
        _about_contact(axes)
        axes.set_xlabel("s from contact")
    caption = (
        "Left: distance from the middle of the plate to the person's palm. Right: speed of the plate, in the emotion's "
        "colour, and of the hand, violet. Time 0 is the session's own contact."
    )
    return Drawing("arm_meeting", caption, figure, "Servo arm")


def effort(trials: Sequence[ArmFigures], joint_names: Sequence[str]) -> Drawing:
    """Following error and current of each joint, over all trials."""
    figure = new_figure(9.0, 3.2)
    left, right = figure.subplots(1, 2)
    errors = np.degrees(np.abs(np.concatenate([trial.following for trial in trials])))
    currents = np.abs(np.concatenate([trial.currents for trial in trials]))
    names = [name.replace("_", "\n") for name in joint_names]
    for axes, values, label in ((left, errors, "following error, °"), (right, currents, "current per servo, A")):
        for joint in range(values.shape[1]):
            p50, p95, p100 = np.percentile(values[:, joint], [50, 95, 100])
            axes.plot([joint, joint], [p50, p95], color=ACTUAL, lw=6.0, alpha=0.4, solid_capstyle="butt")
            axes.plot(joint, p50, "o", color=ACTUAL, ms=6)
            axes.plot(joint, p100, "_", color=INK, ms=12, mew=1.4)
        axes.set_xticks(range(len(names)), names, fontsize=8)
        axes.set_ylim(0.0)
        axes.set_ylabel(label)
    caption = (
        "For each joint: median (dot), up to the 95th percentile (bar) and the largest value (line), over all trials. "
        "The following error is to where retargeting planned the joint at that time."
    )
    return Drawing("arm_effort", caption, figure, "Servo arm")


def bus(trials: Sequence[ArmFigures]) -> Drawing:
    """When cycles of the bus began, and what they took."""
    figure = new_figure(9.0, 2.8)
    left, right = figure.subplots(1, 2)
    periods = np.concatenate([trial.periods_ms for trial in trials])
    took = np.concatenate([trial.took_ms for trial in trials])
    for axes, values, label in ((left, periods, "from cycle to cycle, ms"), (right, took, "one cycle, ms")):
        top = float(np.percentile(values, 99.9))
        axes.hist(values.clip(None, top), bins=60, color=ACTUAL, log=True)
        axes.set_xlabel(label)
        axes.set_ylabel("cycles")
    left.axvline(MS / RATE_HZ, color=FAINT, lw=0.8)
    caption = (
        "Cycles of the bus: one packet with all goals, one with all answers. The slowest thousandth stands at the "
        "right edge. The line is 120 Hz."
    )
    return Drawing("arm_bus", caption, figure, "Servo arm")


def arm_section(summary: dict[str, Any], drawn: dict[str, Drawing]) -> str:
    """The section's HTML."""
    error, late, jitter = summary["error_mm"], summary["time_error_ms"], summary["period_jitter_ms"]
    impossible = len(summary["unreachable"])
    broken_off = summary["broken_off"]
    met = summary["trials"] - impossible - summary["missed"] - broken_off
    lines = [
        f"The plate met the palm in {met} of {met + summary['missed']} trials in which it could."
        + f" Not met: {', '.join(summary['missed_trials'])}." * (summary["missed"] > 0)
        + (
            f" {impossible} were out of reach, lost from view, or known of too late: the table has them, these figures "
            "have not, whether the plate touched the palm or not."
        )
        * (impossible > 0)
        + (f" {broken_off} broken off before the palms met, and not in the figures of how they met." * (broken_off > 0))
    ]
    if error["median"] is not None:
        lines.append(
            "Plate to palm as tracked, where they touched, or at the nearest, in trials that were possible: "
            + _spread(error, met + summary["missed"], ".1f", "mm")
        )
    if late["median"] is not None:
        lines.append(
            f"Off the session's own contact in time: {_spread(late, met, '.0f', 'ms')} They touched no "
            f"faster than {_known(summary['max_relative_speed'], 'm/s')} relative to each other."
        )
    lines.append(
        f"{summary['cycles']} cycles of the bus, {summary['missed_cycles']} missed, period off by "
        f"{_known(jitter['p99'], 'ms')} at most in 99 of 100; one cycle took "
        f"{_known(summary['cycle_ms']['p50'], 'ms')}, planning and safety "
        f"{_known(summary['step_ms']['p50'], 'ms')} (medians). It planned ahead by the servos' lag, "
        f"{summary['lag_ms']:.1f} ms ({summary['lag_from']}). "
        f"Cycles in which a servo did not answer: {summary['unanswered']}."
    )
    if summary["hand_lost"]:
        lines.append(
            "The person was not seen any more, and the arm held where it was and went back, in "
            f"{', '.join(summary['hand_lost'])}."
        )
    closing, face = summary["closing_speed"], summary["face_speed"]
    lines.append(
        "Largest speed towards the hand near it, and near the head: "
        f"{_near(closing['wire'])} and {_near(face['wire'])} of what was commanded, {_near(closing['body'])} and "
        f"{_near(face['body'])} of the arm itself."
    )
    if summary["stricter"]:
        lines.append(f"Limits of the safety envelope made stricter for this: {', '.join(summary['stricter'])}.")
    if summary["stopped"]:
        lines.append(f"The arm was stopped: {summary['stopped']}.")
    rules = [[name.replace("_", " "), str(ticks)] for name, ticks in sorted(summary["rules"].items())]
    shown = figures(drawn, "arm_joints", "arm_meeting", "arm_effort", "arm_bus")
    return (
        "".join(f"<p>{escape(line)}</p>" for line in lines)
        + shown
        + _trials(summary["rows"])
        + (table(["rule of the safety envelope", "ticks in which it acted"], rules, words={0}) if rules else "")
    )


def _trials(rows: Sequence[dict[str, Any]]) -> str:
    heads = ["", "style", "cell", "met", "error, mm", "later, ms", "relative speed, m/s", "path's scale", "delay, ms",
             "miss when due, mm", "limits that acted"]  # fmt: skip
    shown = [
        [
            str(row["trial"] + 1), row["emotion"], row["cell"], _how(row),
            f"{row['error_mm']:.1f}", _known(row["time_error_ms"]), _known(row["relative_speed"]),
            f"{row['scale']:.2f}", f"{row['delay_ms']:.0f}", f"{row['miss_mm']:.1f}", ", ".join(row["limits"]),
        ]
        for row in rows
    ]  # fmt: skip
    return table(heads, shown, words={1, 2, 3, 10})


def _how(row: dict[str, Any]) -> str:
    if row["broken_off"]:
        return "broken off"
    return "yes" if row["touched"] else "no" if row["possible"] else "not possible"


def _spread(extent: dict[str, float], values: int, form: str, unit: str) -> str:
    if values == 1:
        return f"{extent['median']:{form}} {unit}."
    return f"median {extent['median']:{form}} {unit}, largest {extent['max']:{form}} {unit}."


def _near(speed: float | None) -> str:
    """Of a speed that is only measured where something is near."""
    return _known(speed or None, "m/s")


def _known(value: float | None, unit: str = "") -> str:
    if value is None:
        return "–"
    return f"{value:.{2 if abs(value) < 10 else 0}f} {unit}".rstrip()


def _contact(trial: ArmTrial) -> float:
    return float(trial.times[min(trial.due, len(trial.times) - 1)])
