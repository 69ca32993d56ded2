"""``highfive rig play``: the high fives of a recorded session once more, on the servo arm."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from highfive.hil.arm.arm_figures import ArmResults, arm_summary
from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.arm_trial import kept_back, played_until_stopped
from highfive.hil.arm.busy import too_busy
from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.arm.emergency_stop import uninterrupted
from highfive.hil.arm.lifecycle import ready_arm
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.drivers.priority import going_first
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.one_recording import unended
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.replay_goals import RecordedHighFives
from highfive.hil.recording.session_reader import SessionReader, read_session
from highfive.hil.report.arm_report import arm_section, draw_arm
from highfive.hil.report.drawing import to_png
from highfive.hil.report.page import render, section
from highfive.hil.runtime.console import counted, given_command, say_aside
from highfive.hil.runtime.folders import results_folder, write_file
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.session.session import RATE_HZ
from highfive.hil.trials.summary import SessionSettings, versions
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.arm.loop import ArmLoop, ArmTick
    from highfive.hil.arm.planner import Retarget
    from highfive.hil.commands.rig.play_view import PlayView
    from highfive.hil.commands.simulate_options import PageOptions
    from highfive.hil.drivers.bus.cycle_ring import Cycle
    from highfive.hil.runtime.console import Bar
    from highfive.hil.view.recorded import RecordedTrials

# What only the live page needs is imported where it is needed: it takes seconds.

ENDED = "ended on the page"
BACK_S = 2.5
"""About so long the arm takes back to rest after a high five, s: an estimate."""


@dataclass(frozen=True)
class PlayOptions:
    """What to play.

    Attributes:
        session: folder of a session, or its recording.
        arm: which arm.
        trials: numbers of the trials; empty for all.
        begin: number of the first trial; None for the recording's.
        most: so many trials at most; None for all.
        overwrite: write into a folder that holds something.
        view: the live page that shows it; None for none.
    """

    session: Path
    arm: ArmOptions
    trials: tuple[int, ...] = ()
    begin: int | None = None
    most: int | None = None
    overwrite: bool = False
    view: PageOptions | None = None


def play(options: PlayOptions, folder: Path, bar: Bar) -> dict[str, Any]:
    """Plays a recording's high fives; writes a report and a recording of the arm, ``arm.mcap``, into ``folder``.

    A stop, or Ctrl-C, ends it early.

    Returns:
        the summary of :func:`highfive.hil.arm.arm_figures.arm_summary`, with ``session`` and ``port``, and, if it ended
        early, why in ``stopped``, what helps in ``remedy``, and the trial to go on ``from``.

    Raises:
        HighFiveError: the folder holds something; the recording is of another avatar, or without a high five; the arm
            cannot be used.
    """
    with results_folder(folder, options.overwrite):
        return _play(options, folder, bar)


def _play(options: PlayOptions, folder: Path, bar: Bar) -> dict[str, Any]:
    check_options(options.arm)  # before the session is read, which takes seconds
    if options.view is not None and options.arm.port == VIRTUAL:
        raise HighFiveError("--view shows what goes at the pace of the clock; --port virtual does not: --port emulated")
    opened = datetime.now(UTC)
    session = read_session(options.session)
    path = session.path
    if not session.complete:
        say_aside(f"{path.name} {unended(path, opened)}: played is what there is of it")
    recorded = RecordedHighFives(session)
    chosen = _chosen(options, recorded, path)
    if absent := [number for number in chosen if number not in recorded]:
        known = ", ".join(str(number + 1) for number in recorded)
        raise HighFiveError(f"{path} has no high five {absent[0] + 1} in which the palms met; there are {known}")
    about = _settings(session, len(chosen), options.arm)
    say_aside(f"{counted(len(chosen), 'high five')}, {_duration([recorded.ticks[number] for number in chosen])}")
    with uninterrupted() as from_now_on:
        shown = None
        if options.view is not None:
            from highfive.hil.commands.rig.play_view import shown_trials  # noqa: PLC0415

            shown = shown_trials(session, options.view)
        results, retarget, end = _played(recorded, shown, chosen, about, options, folder, bar, from_now_on)
        said = {"session": str(path), "port": options.arm.port}
        ended = {
            "stopped": end.why,
            "remedy": end.remedy,
            "from": chosen[end.whole] if end.whole < len(chosen) else None,
        }
        summary = {**said, **arm_summary(results.figures, retarget, options.arm.lower), **ended, "versions": versions()}
        _write_report(summary, results, retarget.settings.lag, options.arm, path, folder)
    return summary


@dataclass(frozen=True)
class _End:
    """How it ended: why early, '' if it did not; what helps; how many high fives were played to their end."""

    why: str
    remedy: str
    whole: int


def _chosen(options: PlayOptions, recorded: Mapping[int, ReferenceTrajectory], path: Path) -> tuple[int, ...]:
    """Numbers of the trials that are to be played."""
    begin = options.begin
    chosen = tuple(number for number in options.trials or recorded if begin is None or number >= begin)[: options.most]
    if not chosen and recorded:
        raise HighFiveError(f"{path} has no high five from {(begin or 0) + 1} on; its last one is {max(recorded) + 1}")
    return chosen


def _duration(ticks: Sequence[int]) -> str:
    """How long that takes, for people."""
    seconds = sum(count / RATE_HZ + BACK_S for count in ticks)
    return (
        f"about {seconds / 60.0:.0f} minutes" if seconds > 90.0 else f"about {10.0 * math.ceil(seconds / 10.0):.0f} s"
    )


def _played(
    recorded: Mapping[int, ReferenceTrajectory],
    shown: RecordedTrials | None,
    chosen: Sequence[int],
    about: SessionSettings,
    options: PlayOptions,
    folder: Path,
    bar: Bar,
    ready: Callable[[], object],
) -> tuple[ArmResults, Retarget, _End]:
    """What the arm did, how it was planned, and how it ended; ``ready`` is called once it is switched on.

    ``shown`` is on the live page meanwhile, where there is one. What is played is recorded as it comes.
    """
    results = ArmResults()
    with ExitStack() as stack:
        stack.enter_context(quick_switching())
        loop = stack.enter_context(ready_arm(options.arm, bar))
        view = None if shown is None else stack.enter_context(_view(options, shown, loop, len(chosen)))
        recorder = BackgroundRecorder(  # before anything moves
            SessionRecorder(folder / "arm.mcap", about), paced=options.arm.port != VIRTUAL
        )
        stack.enter_context(recorder)
        ready()
        stopped, remedy, whole = "", "", 0
        advance = bar("high fives", len(chosen))
        for number in chosen:
            try:
                reference = recorded[number]
                if view is not None:
                    view.begin(number)
                    if view.ends:
                        stopped = loop.trouble or ENDED
                        break
                with going_first():
                    trial = played_until_stopped(reference, loop, Kept(recorder, view))
            except HighFiveError as error:
                if not results.figures and not loop.trouble:  # the arm is not as it has to be: nothing has moved
                    recorder.discard()
                    raise
                trial, stopped = None, str(error)
            if trial is not None and (why := kept_back(trial.ticks)):  # its servos say why; nothing has moved
                trial, stopped = None, f"the arm does not take part: {why}"
            if trial is not None:
                results.add(number, trial, loop.retarget, loop.limits)
                if view is not None:
                    view.judged(trial)
            if recorder.trouble:  # a full disk; there is still a report to try
                stopped = recorder.trouble
            if stopped := loop.trouble or stopped:
                idle = options.arm.never_silent
                remedy = too_busy(trial, loop.cycles(), loop.stopped_by, gone=loop.gone, never_silent=idle)
                recorder.record_event("fault", detail=stopped)
                whole += trial is not None and not (trial.broken_off or recorder.trouble)
                break
            whole += 1
            advance()
        recorder.close()
        stopped = stopped or recorder.trouble
        if view is not None:
            view.end(stopped, folder)
    return results, loop.retarget, _End(stopped, remedy, whole)


class Kept:
    """A high five on its way into the recording and onto the page, tick by tick."""

    def __init__(self, recorder: BackgroundRecorder, view: PlayView | None) -> None:
        """Begins with the first tick."""
        self._recorder, self._view, self._begun = recorder, view, False

    def __call__(self, tick: ArmTick, cycles: Sequence[Cycle]) -> None:
        """A tick, and the cycles of the bus since the one before."""
        if not self._begun:
            self._begun = True
            self._recorder.begin_played(tick.frame_ns)
        self._recorder.record_arm([tick], cycles)
        if self._view is not None:
            self._view.watch(tick)


def _view(options: PlayOptions, shown: RecordedTrials, loop: ArmLoop, count: int) -> AbstractContextManager[PlayView]:
    from highfive.hil.commands.rig.play_view import play_view  # noqa: PLC0415

    assert options.view is not None
    return play_view(options.view, shown, loop, options.arm.arm, count, options.session.name)


def _settings(session: SessionReader, trials: int, arm: ArmOptions) -> SessionSettings:
    seed, model = session.settings.get("seed"), session.settings.get("model")
    command = given_command()
    return SessionSettings(
        seed if isinstance(seed, int) else 0,
        str(model or ""),
        trials,
        source=str(session.path),
        arm=arm.port,
        arm_name=arm.arm,
        command=command,
    )


def _write_report(
    summary: dict[str, Any], results: ArmResults, lag: float, arm: ArmOptions, path: Path, folder: Path
) -> None:
    drawings = draw_arm(list(results.whole.values()), lag, results.figures, find_arm(arm.arm).names)
    page = render(
        "High Five: a session played by the servo arm",
        f"{counted(len(results.figures), 'high five')} of {escape(path.name)}, {escape(summary['port'])} arm.",
        f'<span class="badge{"" if arm.emulated else " loud"}">{"emulated arm" if arm.emulated else "real arm"}</span>',
        [
            section("Servo arm", arm_section(summary, {drawing.name: drawing for drawing in drawings})),
            section("Do it again", f"<pre>{escape(given_command())}</pre>"),
        ],
    )
    # What matters most first: the disk may be full.
    write_file(folder / "report.json", json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False).encode())
    write_file(folder / "report.html", page.encode())
    for drawing in drawings:
        write_file(folder / "figures" / f"{drawing.name}.png", to_png(drawing.figure))


def print_played(summary: dict[str, Any], folder: Path) -> None:
    """The figures, for people."""
    error, late = summary["error_mm"], summary["time_error_ms"]
    until = " until the arm was stopped" if summary["stopped"] else ""
    print(f"{counted(summary['trials'], 'high five')} played on {summary['port']}{until}")
    if error["median"] is not None:
        print(f"  plate to palm      median {error['median']:.1f} mm, worst {error['max']:.1f} mm")
    if late["median"] is not None:
        print(f"  off in time        median {late['median']:.0f} ms, worst {late['max']:.0f} ms")
    if summary["missed"]:
        print(f"  no contact         {', '.join(summary['missed_trials'])}")
    if summary["broken_off"]:
        print(f"  broken off         {summary['broken_off']}")
    if summary["unreachable"]:
        print(f"  not possible       {', '.join(summary['unreachable'])}")
    print(f"  cycles of the bus  {summary['cycles']}, {summary['missed_cycles']} missed")
    print(f"Open {folder / 'report.html'}")
