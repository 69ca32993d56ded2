"""The servo arm of a session: looked at before anything takes long, then made ready."""

from __future__ import annotations

import signal
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING

from highfive.hil.commands.session_partners import worn_set
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.runtime.console import Bar

if TYPE_CHECKING:
    from highfive.hil.arm.arm_trial import ArmWatch
    from highfive.hil.trials.live_wiring import LiveWiring
    from highfive.mocap_bridge.markers.marker_set import MarkerSet

# What only an arm needs is imported where it is needed: it takes seconds.


def with_arm(options: SimulateOptions, live: bool, stack: ExitStack, wiring: LiveWiring | None) -> SimulateOptions:
    """The options once the arm may be used; from then on the first Ctrl-C alone interrupts.

    Raises:
        HighFiveError: it may not.
    """
    if options.arm is None:
        return options
    from highfive.hil.arm.emergency_stop import uninterrupted  # noqa: PLC0415
    from highfive.hil.arm.preconditions import check_arm  # noqa: PLC0415

    arm = replace(options.arm, person=str(options.source) if live else "")
    check_arm(arm)
    stack.enter_context(uninterrupted((signal.SIGINT,), once=True))
    if live and not arm.emulated:
        from highfive.hil.commands.session_check import check_before_session  # noqa: PLC0415

        _compile_before(options)
        check_before_session(arm, worn_set(options), wiring, options.human)
    return replace(options, arm=arm)


def arm_watch(options: SimulateOptions, bar: Bar, worn: MarkerSet, stack: ExitStack) -> ArmWatch | None:
    """The arm, ready until ``stack`` ends; None where none takes part.

    Raises:
        HighFiveError: see :func:`highfive.hil.arm.lifecycle.ready_arm`.
    """
    if options.arm is None:
        return None
    from highfive.hil.arm.arm_trial import ArmWatch  # noqa: PLC0415
    from highfive.hil.arm.lifecycle import ready_arm  # noqa: PLC0415

    return ArmWatch(stack.enter_context(ready_arm(options.arm, bar, worn)))


def _compile_before(options: SimulateOptions) -> None:
    """What a session compiles, once after installing, is compiled before the arm is looked at: it takes minutes, in
    which somebody may bump it."""
    from highfive.hil.evaluation.reaction_models import open_model  # noqa: PLC0415
    from highfive.hil.session.session import Session  # noqa: PLC0415
    from highfive.hil.sim.people.capture import PERSON_SET  # noqa: PLC0415
    from highfive.hil.sim.scene import build_scene  # noqa: PLC0415
    from highfive.mocap_bridge.markers.marker_set_file import load_marker_set  # noqa: PLC0415

    model = open_model(options.model)
    Session(model, {model.emotions[0]: 1.0}, load_marker_set(PERSON_SET), build_scene())
