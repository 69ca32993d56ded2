"""``highfive rig play``: the high fives of a recorded session once more, on the servo arm."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hil.arm_report import arm_section, draw_arm
from hil.arm_session import ArmOptions, ready_arm
from hil.arm_trial import arm_summary, played
from hil.avatar import avatar_skeleton, right_palm
from hil.bench_retarget import Asked
from hil.console import counted
from hil.drawing import to_png
from hil.page import render, section, write_file
from hil.recording import SessionRecording, read_recording
from hil.retarget import ExpectedContact, PalmGoal
from hil.session import RATE_HZ
from hil.summary import versions
from mocap_bridge.frames import PalmPose
from model.errors import HighFiveError
from model.rotations import Array

if TYPE_CHECKING:
    from hil.console import Bar

FORESEEN = 0.9
"""s before contact from which on the arm is told of it: a recording knows, but nobody lifts a hand earlier."""
TOGETHER = 0.06
"""s for which palms stay together."""
SURE = 0.002
"""m, deviation of a place that is known."""


@dataclass(frozen=True)
class PlayOptions:
    """What to play.

    Attributes:
        session: folder of a session, or its recording.
        arm: which arm.
        trials: numbers of the trials; empty for all.
    """

    session: Path
    arm: ArmOptions
    trials: tuple[int, ...] = ()


def play(options: PlayOptions, folder: Path, bar: Bar) -> dict[str, Any]:
    """Plays a recording's high fives and writes a report into ``folder``.

    Returns:
        the summary of :func:`hil.arm_trial.arm_summary`, with ``session`` and ``port``.

    Raises:
        HighFiveError: the recording is of another avatar, or without a high five; the arm cannot be used, or stopped.
    """
    path = options.session / "session.mcap" if options.session.is_dir() else options.session
    asked = recorded_high_fives(read_recording(path), path)
    wanted = options.trials or tuple(asked)
    if absent := [number for number in wanted if number not in asked]:
        known = ", ".join(map(str, asked))
        raise HighFiveError(f"{path} has no high five {absent[0]} in which the palms met; there are {known}")
    trials = []
    with ready_arm(options.arm) as loop:
        lag = loop.retarget.settings.lag
        advance = bar("high fives", len(wanted))
        for number in wanted:
            trials.append(played(asked[number], loop))
            advance()
    summary = {"session": str(path), "port": options.arm.port, **arm_summary(trials, lag), "versions": versions()}
    drawings = draw_arm(trials, lag)
    page = render(
        "High Five: a session played by the servo arm",
        f"{counted(len(trials), 'high five')} of {escape(path.name)}, {escape(options.arm.port)} arm.",
        f'<span class="badge{"" if options.arm.emulated else " loud"}">'
        f"{'emulated arm' if options.arm.emulated else 'real arm'}</span>",
        [
            section("Servo arm", arm_section(summary, {drawing.name: drawing for drawing in drawings})),
            section("Do it again", f"<pre>{escape(shlex.join(['highfive', *sys.argv[1:]]))}</pre>"),
        ],
    )
    for drawing in drawings:
        write_file(folder / "figures" / f"{drawing.name}.png", to_png(drawing.figure))
    write_file(folder / "report.json", json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False).encode())
    write_file(folder / "report.html", page.encode())
    return summary


def print_played(summary: dict[str, Any], folder: Path) -> None:
    """The figures, for people."""
    error, late = summary["error_mm"], summary["time_error_ms"]
    print(f"{counted(summary['trials'], 'high five')} played on {summary['port']}")
    if error["median"] is not None:
        print(f"  plate to palm      median {error['median']:.1f} mm, worst {error['max']:.1f} mm")
    if late["median"] is not None:
        print(f"  off in time        median {late['median']:.0f} ms, worst {late['max']:.0f} ms")
    if summary["missed"]:
        print(f"  no contact         {summary['missed']}")
    if summary["unreachable"]:
        print(f"  out of reach       {', '.join(summary['unreachable'])}")
    print(f"  cycles of the bus  {summary['cycles']}, {summary['missed_cycles']} missed")
    print(f"Open {folder / 'report.html'}")


def recorded_high_fives(recording: SessionRecording, path: Path) -> dict[int, Asked]:
    """What each high five of a recording asks of the arm, by the trial's number; those without contact are left out.

    The recording knows when and where palms met, so that the arm is told :data:`FORESEEN` s before.

    Raises:
        HighFiveError: it is of another avatar, or no palms met in it.
    """
    if recording.joints != tuple(avatar_skeleton().names):
        raise HighFiveError(
            f"{path} is the recording of another avatar: {len(recording.joints)} joints, this one has "
            f"{len(avatar_skeleton().names)}"
        )
    people, (_, poses) = recording.channels["/person"], recording.poses()
    times = np.array([message.time_ns for message in people])
    starts = [message for message in recording.channels["/trial"]]
    ends = [message.time_ns for message in starts[1:]] + [np.inf]
    judged = {message.data["trial"]: message.data for message in recording.channels["/contact"]}
    found = {}
    for start, end in zip(starts, ends, strict=True):
        data, judgement = start.data, judged.get(start.data["trial"])
        rows = np.flatnonzero((times >= start.time_ns) & (times < end))
        if judgement is None or not judgement["met"] or judgement.get("met_time") is None or len(rows) < 2:
            continue
        skeleton, chosen = avatar_skeleton(), [poses[row] for row in rows]
        placed = skeleton.forward_kinematics(
            np.array([pose.root_in_world for pose in chosen]), np.array([pose.quaternions for pose in chosen])
        )
        positions, normals, _ = right_palm(skeleton, *placed)
        persons = [people[row].data for row in rows]
        found[data["trial"]] = _asked(
            data, round(judgement["met_time"] * RATE_HZ), _moving(positions, normals), persons
        )
    if not found:
        raise HighFiveError(f"{path} holds no high five in which the palms met")
    return found


def _asked(data: dict[str, Any], due: int, ours: list[PalmPose], persons: list[dict[str, Any]]) -> Asked:
    theirs = _moving(
        np.array([person["palm"] for person in persons]), np.array([person["palm_normal"] for person in persons])
    )
    due = min(due, len(ours) - 1)
    goals = []
    for tick, (our, their, person) in enumerate(zip(ours, theirs, persons, strict=True)):
        left = (due - tick) / RATE_HZ
        contact = None
        if person["valid"] and -TOGETHER <= left <= FORESEEN:
            at = theirs[due] if left > 0.0 else their
            contact = ExpectedContact(at.position, SURE**2 * np.eye(3), -at.normal, max(left, 0.0))
        seen = their if person["valid"] else None
        goals.append(PalmGoal(our, seen, np.array(person["head"]) if person["valid"] else None, contact))
    return Asked(
        data["emotion"], data["cell"], tuple(goals), np.array([palm.position for palm in theirs]),
        np.array([palm.position for palm in ours]), np.array([palm.normal for palm in ours]), due, due,
    )  # fmt: skip


def _moving(positions: Array, normals: Array) -> list[PalmPose]:
    """Palms (T, 3), m, with their velocities; fingers upwards, which the round plate does not care for."""
    velocities = np.array(np.gradient(positions, 1.0 / RATE_HZ, axis=0))
    up = np.array([0.0, 0.0, 1.0])
    return [PalmPose(p, n, up, v) for p, n, v in zip(positions, normals, velocities, strict=True)]
