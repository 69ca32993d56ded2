"""What is pressed on the experimenter's page while the avatar moves: by a page that gives what was pressed once."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from helpers.virtual_stage import VirtualStage

from highfive.hil.experiments.stage import RunStoppedError, TrialBrokenOffError
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.view.commands import Command
from highfive.hil.view.wire import PoseMessage

AT = 40
"""Pictures after which something is pressed: the hand rises."""


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


def pressing(run: VirtualStage, *commands: Command) -> None:
    """Presses in the middle of the motion."""
    show = run.page.show

    def shown(message: PoseMessage) -> None:
        show(message)
        if run.page.poses == AT:
            run.page.pressed += commands

    run.page.show = shown


@pytest.mark.parametrize(("name", "error"), [("break_off", TrialBrokenOffError), ("stop", RunStoppedError)])
def test_breaking_off_and_stopping_end_the_trial_at_once(
    name: str, error: type[Exception], clock: VirtualClock, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        run = VirtualStage(clock, stack, tmp_path)
        pressing(run, Command(name, None))
        with pytest.raises(error, match=" by the experimenter"):
            run.play("I1", "interactive", 1)
        assert AT <= run.page.poses < AT + 5


def test_a_note_is_kept_and_a_pause_comes_after_the_trial(clock: VirtualClock, tmp_path: Path) -> None:
    with ExitStack() as stack:
        run = VirtualStage(clock, stack, tmp_path)
        pressing(run, Command("note", "she laughed"), Command("pause", True))
        run.play("I1", "interactive", 1)
        assert run.desk.notes() == "she laughed" and run.desk.paused and run.page.poses > 2 * AT
