"""The person before the webcam of the live page: the page opened, the person found, told what to do, and placed."""

from __future__ import annotations

from contextlib import ExitStack, closing

from highfive.calibration.placement import Placement, place_before_camera
from highfive.hil.commands.headset_session import hand_of
from highfive.hil.commands.live_options import camera_settings
from highfive.hil.commands.page import said_on
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.trials.live_partner import LivePerson
from highfive.hil.view.browser import Browser
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.webcam_source import WebcamSource
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.sources.address import WEBCAM
from highfive.mocap_bridge.sources.camera_person import CameraPerson
from highfive.mocap_bridge.tracking.filter_settings import WEBCAM as TRACKING
from highfive.model.errors import HighFiveError

PATIENCE_S = 120.0
"""So long nobody need be seen: the camera is allowed, the nets are loaded, a place is found."""
STEADY = 5
"""Pictures in a row that show all of the person that is needed."""
LONGEST_GAP_S = 20.0
"""Without a picture for so long, once there were some, the page is given up."""


def watch_video(options: SimulateOptions, page: LivePage, stack: ExitStack) -> None:
    """Lets a browser without a window open the page, with the video as its camera, until ``stack`` ends."""
    assert options.webcam.video is not None
    stack.enter_context(Browser((800, 450), camera=options.webcam.video)).go(page.address)


def webcam_person(options: SimulateOptions, page: LivePage, stack: ExitStack) -> LivePerson:
    """Who stands before the page's camera: found, and placed in the world. Followed until ``stack`` ends.

    Raises:
        HighFiveError: no picture comes, or nobody stands as she should for so long as :data:`PATIENCE_S`.
    """
    source = WebcamSource(page, CameraPerson(camera_settings(options), left=hand_of(options) == "left"))
    stack.enter_context(closing(source))

    page.tell("say", message="Stand two metres before the camera, from head to hips in its picture.")
    _wait(source)

    def place(watched: Recording, marker_set: MarkerSet) -> Placement:
        return place_before_camera(watched, marker_set, source.person.camera_in_room)

    person = LivePerson(source, WEBCAM, say=said_on(page), tracking=TRACKING, place=place, hand=hand_of(options))
    person.camera = person.placement.apply(source.person.camera_in_room)
    return person


def _wait(source: WebcamSource) -> None:
    """Until the person stands as she should."""
    begun, last, steady, frame = MACHINE.now(), MACHINE.now(), 0, None
    while steady < STEADY:
        new, now = source.wait(frame, 0.5), MACHINE.now()
        if new is not None:
            look = source.person.look
            whole = bool(new.valid.all()) and look is not None and look.distance == look.distance
            frame, last, steady = new, now, steady + 1 if whole else 0
        if now - begun > 1e9 * PATIENCE_S:
            seen = "nobody stood before the camera, head to hips in the picture" if frame else "no picture came"
            raise HighFiveError(f"{seen}, within {PATIENCE_S:g} s; what the page says of the camera tells why")
        if frame is not None and now - last > 1e9 * LONGEST_GAP_S:
            raise HighFiveError(f"no picture has come from the page for {LONGEST_GAP_S:g} s; is it still open?")
