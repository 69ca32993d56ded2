"""The live page of a session: what it is told of who is tracked, and of the arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any

from highfive.hil.commands.headset_session import hand_of, wears_headset
from highfive.hil.commands.live_options import sees_webcam
from highfive.hil.commands.page import open_page
from highfive.hil.commands.simulate_options import SimulateOptions

if TYPE_CHECKING:
    from highfive.calibration.headset_file import KeptRegistration
    from highfive.hil.arm.arm_trial import ArmWatch
    from highfive.hil.trials.live_partner import LivePerson
    from highfive.hil.view.live_page import LivePage


def session_page(
    options: SimulateOptions, about: Mapping[str, Any], watch: ArmWatch | None, stack: ExitStack,
    beside: tuple[KeptRegistration, LivePerson | None] | None = None,
    opened: Callable[[LivePage], None] | None = None,
) -> LivePage:  # fmt: skip
    """The page that shows a session; it begins when somebody looks on.

    Args:
        options: of the session, with a view.
        about: what the page is told first, besides who is tracked and which arm there is.
        watch: the arm, whose emergency stop the page pulls.
        stack: closes it.
        beside: a registered headset that shows it, and whom.
        opened: opens it, instead of somebody; a webcam's video does so before that.

    Raises:
        HighFiveError: see :func:`highfive.hil.commands.page.open_page`.
    """
    assert options.view is not None
    worn, webcam = wears_headset(options), sees_webcam(options)
    told = dict(about)
    if worn or webcam:
        told |= {"tracks": worn, "hand": hand_of(options)}
    if beside is not None:
        from highfive.hil.commands.headset_beside import space_in_world  # noqa: PLC0415

        kept, person = beside
        assert person is not None
        told |= {"tracks": True, "space": space_in_world(kept, person.placement)}
    estop = None if watch is None else watch.loop.estop
    told |= {"arm": estop is not None, "rig": "" if options.arm is None else options.arm.arm, "webcam": webcam}
    if webcam and options.webcam.video is not None:
        from highfive.hil.commands.webcam_session import watch_video  # noqa: PLC0415

        opened = _both(partial(watch_video, options, stack=stack), opened)
    return stack.enter_context(
        open_page(options.view, told, estop, opened, tracks=worn or webcam or beside is not None)
    )


def _both(first: Callable[[LivePage], None], second: Callable[[LivePage], None] | None) -> Callable[[LivePage], None]:
    if second is None:
        return first

    def both(page: LivePage) -> None:
        first(page)
        second(page)

    return both
