"""An arm led by another program, line by line, in virtual time: driver, wire and servos are the real ones."""

import io
import json
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from command_line import running

from highfive.hil.arm.arm_files import limits_of
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.driven_arm import virtual_driven_arm
from highfive.hil.arm.goal_course import GoalCourse
from highfive.hil.arm.lifecycle import emulator_options
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.commands.rig.follow import Leader, follow
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.interrupts import ended_as_interrupted
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.model.errors import HighFiveError

VIRTUAL = ArmOptions("virtual")
run = running("rig", "follow")


def led(requests: Iterable[Any], options: ArmOptions = VIRTUAL) -> tuple[str, list[dict[str, Any]]]:
    """Why it was stopped, and the answers."""
    lines = "".join(f"{line if isinstance(line, str) else json.dumps(line)}\n" for line in requests)
    answers: list[dict[str, Any]] = []
    end = follow(options, io.StringIO(lines), lambda line: answers.append(json.loads(line)))
    assert end.heard
    return end.stopped, answers


def test_the_first_line_says_what_there_is() -> None:
    stopped, (first, last) = led([{"end": True}])
    assert stopped == "" and first["arm"] == "vx300s" and first["joints"][0] == "waist"
    assert len(first["low"]) == len(first["high"]) == len(first["joints"]) == len(first["positions"]) == 6
    assert first["goal"] == pytest.approx(first["positions"], abs=0.05) and 0.0 <= first["age"] < 0.02
    held = zip(first["low"], first["goal"].values(), first["high"], strict=True)  # it rests a little beyond a limit
    assert all(low <= goal <= high for low, goal, high in held)
    assert last["goal"] == first["goal"]


@pytest.mark.parametrize(
    "arm", ["vx300s", *(pytest.param(name, marks=pytest.mark.slow) for name in ("koch_v1_1", "openmanipulator_x"))]
)
def test_the_arm_goes_where_it_is_led(arm: str) -> None:
    """A wave of one joint, thirty goals a second: it follows with its lag, and gets there."""
    options = replace(VIRTUAL, arm=arm)
    joint = led([{"end": True}], options)[1][0]["joints"][-1]
    start = led([{"end": True}], options)[1][0]["positions"][joint]
    wave = [start + 0.2 * float(np.sin(n / 12)) for n in range(76)]
    stopped, answers = led([*({"goal": {joint: angle}} for angle in wave), *[{}] * 20, {"end": True}], options)
    assert stopped == ""
    measured = np.array([answer["positions"][joint] for answer in answers[1:]])
    assert np.abs(measured[3:76] - np.array(wave)[:73]).max() < 0.025  # a tenth of a second late
    assert measured[-1] == pytest.approx(wave[-1], abs=0.01)


@pytest.mark.slow
def test_a_goal_that_is_far_is_reached_at_the_envelopes_pace() -> None:
    stopped, answers = led([{"goal": {"waist": 1.0}}, *[{}] * 60, {"end": True}])
    waist = np.array([answer["positions"]["waist"] for answer in answers])
    assert stopped == "" and waist[-1] == pytest.approx(1.0, abs=0.01)
    assert np.diff(waist).max() * 30 < 3.2  # rad/s


@pytest.mark.slow
def test_a_line_that_is_not_understood_is_answered_and_moves_nothing() -> None:
    wrong = [
        "waist 0.1", "[]", "3", "null", '{"goal": 3}', '{"gaol": {"waist": 1}}', '{"goal": {"waist": NaN}}',
        '{"goal": {"waist": 1e999}}', '{"goal": {"waist": 57.3}}', "x" * 65_536 + '{"goal": {"waist": 0.5}}',
        " " * 200_000 + '{"goal": {"waist": 0.5}}', '{"goal": {"hip": 0.1}}', "", "[" * 60_000,
        '{"goal": {"waist": "0.1"}}',
    ]  # fmt: skip
    stopped, answers = led([*wrong, {}, {"end": True}])
    assert stopped == ""
    assert all(list(answer) == ["error"] and "\n" not in answer["error"] for answer in answers[1:-2])
    assert len(answers) == len(wrong) + 3
    assert answers[-1]["goal"] == answers[0]["goal"]
    assert answers[-1]["positions"] == pytest.approx(answers[0]["goal"], abs=0.005)


def test_who_just_goes_away_leaves_the_arm_where_it_is() -> None:
    stopped, answers = led([{"goal": {"waist": 0.8}}, *[{}] * 5])
    assert "end of input" in stopped and answers[-1] == {"stopped": stopped}


def test_a_dead_servo_stops_it() -> None:
    options = replace(VIRTUAL, faults=("dead=4@4",))
    stopped, answers = led([*({"goal": {"waist": 0.01 * n}} for n in range(200)), {"end": True}], options)
    assert "forearm_roll" in stopped or "4" in stopped
    assert answers[-1] == {"stopped": stopped} and len(answers) < 150


@pytest.mark.slow
def test_a_stopped_arm_says_nothing_more() -> None:
    """Answers come from a thread of their own: none follows the last line."""
    for _ in range(20):
        said: list[dict[str, Any]] = []
        with VirtualClock() as clock, ExitStack() as stack:
            leader = stack.enter_context(_leader(clock, said))
            asks = threading.Thread(target=leader.listen, args=(io.StringIO("{}\n" * 400),))
            asks.start()
            assert leader.end("it was stopped")
            asks.join()
        assert [list(one) for one in said].count(["stopped"]) == 1 and said[-1] == {"stopped": "it was stopped"}


@pytest.mark.slow
def test_whoever_reads_nothing_any_more_stops_the_arm() -> None:
    """An answer that is not taken holds the thread that answers, and neither the arm nor the end."""
    with VirtualClock() as clock, ExitStack() as stack:
        taken = threading.Event()
        leader = stack.enter_context(_leader(clock, answer=lambda line: taken.wait()))
        threading.Thread(target=leader.listen, args=(io.StringIO("{}\n"),), daemon=True).start()
        leader.lead()
        assert "reads no answers" in leader.gone
        assert not leader.end(leader.gone)
        taken.set()


@contextmanager
def _leader(clock: VirtualClock, said: list[dict[str, Any]] | None = None, answer: Any = None) -> Iterator[Leader]:
    body = default_arm()
    virtual = VirtualRig(clock, make_bus(emulator_options(VIRTUAL)))
    with virtual_driven_arm(virtual, VIRTUAL, body, lambda: "") as drive:
        course = GoalCourse(body, limits_of(body.folder), drive.positions)
        took = answer or (lambda line: (said if said is not None else []).append(json.loads(line)))
        yield Leader(drive, course, body.folder.names, took)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_in_virtual_time_a_signal_interrupts(number: signal.Signals) -> None:
    """Nothing real is to be stopped, so it is not taken for an emergency stop that nobody hears."""
    before, answers = signal.getsignal(number), []

    def answer(line: str) -> None:
        answers.append(line)
        if len(answers) == 3:
            signal.raise_signal(number)

    with ended_as_interrupted(), pytest.raises(KeyboardInterrupt):
        follow(VIRTUAL, io.StringIO("{}\n" * 10), answer)
    assert len(answers) == 3 and signal.getsignal(number) is before


def test_refused_before_anything_moves() -> None:
    with pytest.raises(HighFiveError, match="only with --arm"):
        follow(ArmOptions("/dev/ttyUSB9"), io.StringIO(), print)
    with pytest.raises(HighFiveError, match="nobody-near"):
        follow(ArmOptions("/dev/ttyUSB9", armed=True), io.StringIO(), print)


@pytest.mark.slow
def test_on_the_command_line(run: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO('{"goal": {"waist": 0.1}}\n{"end": true}\n'))
    code, out, _ = run("virtual")
    answers = [json.loads(line) for line in out.splitlines()]
    assert code == 0 and len(answers) == 3 and answers[1]["goal"]["waist"] == pytest.approx(0.1)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    code, out, err = run("virtual")
    assert code == 1 and "end of input" in err and len(out.splitlines()) == 2
