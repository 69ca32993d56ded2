"""What is pressed on the experimenter's page while the avatar moves: by a page that gives what was pressed once."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from helpers.experiments import protocol
from helpers.virtual_stage import VirtualStage

from highfive.hil.commands.clips import SIMULATED, load_clips
from highfive.hil.experiments.stage import RunStoppedError, TrialBrokenOffError
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.view.commands import Command
from highfive.hil.view.wire import PoseMessage
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set

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


@pytest.mark.slow
def test_a_note_is_kept_and_a_pause_comes_after_the_trial(clock: VirtualClock, tmp_path: Path) -> None:
    with ExitStack() as stack:
        run = VirtualStage(clock, stack, tmp_path)
        pressing(run, Command("note", "she laughed"), Command("pause", True))
        run.play("I1", "interactive", 1)
        assert run.desk.notes() == "she laughed" and run.desk.paused and run.page.poses > 2 * AT


@pytest.mark.parametrize("template", ["high_five", "tipping"])
@pytest.mark.slow
def test_the_room_is_not_empty_before_the_first_trial(template: str, clock: VirtualClock, tmp_path: Path) -> None:
    with ExitStack() as stack:
        clips = load_clips(SIMULATED, protocol(template)) if template == "tipping" else None
        run = VirtualStage(clock, stack, tmp_path, template=template, clips=clips)
        shown: list[PoseMessage] = []
        run.page.show = shown.append
        names = load_marker_set(PERSON_SET).names
        run.stage.stand(names)
        (first,) = shown
        assert not first.seen.any() and np.isfinite(first.bodies).all()
        heads = first.bodies[:, 2].max()
        assert 1.5 < heads < 2.2  # they stand
        run.play("I1", "interactive", 1, style="neutral", clip=1, cell="" if clips else "B2")
        assert len(shown) > 100
