"""A hidden arm's cameras as a live system, in virtual time."""

from __future__ import annotations

from highfive.hil.arm.hidden_rig import RATE_HZ, PlateCamera
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.trials.frame_link import FrameLink
from highfive.hil.trials.live_wiring import LiveWiring


def camera_wiring(clock: VirtualClock, camera: PlateCamera) -> LiveWiring:
    """Clock, tasks and wire of a live system that is this camera."""
    return LiveWiring(clock, VirtualScheduler(clock), lambda _: lambda: FrameLink(clock, RATE_HZ, camera))
