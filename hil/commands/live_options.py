"""What of a session's options concerns a live person."""

from __future__ import annotations

from typing import Any

from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.mocap_bridge.sources.address import WEBCAM, parse_address
from highfive.mocap_bridge.sources.camera_settings import CameraSettings
from highfive.model.errors import HighFiveError

VIDEOS = (".mjpeg", ".y4m")
"""What Chromium takes for a camera."""

LONGEST_LATENCY_MS = 200.0
"""Over more than this nobody can predict a hand."""


def check_live_options(options: SimulateOptions, live: bool) -> None:
    """What goes with a live person only, or not with what else was requested.

    Raises:
        HighFiveError: something does not.
    """
    check_webcam_options(options)
    if options.place is not None and not live:
        raise HighFiveError("--place keeps where a live person stands; add --source ADDRESS")
    if options.place is not None and not options.place.parent.is_dir():
        raise HighFiveError(f"--place {options.place}: there is no folder {options.place.parent}; make it first")
    if options.latency_ms and not live:
        raise HighFiveError("--latency is of a live person's system; add --source ADDRESS")
    if not 0.0 <= options.latency_ms <= LONGEST_LATENCY_MS:
        raise HighFiveError(f"--latency {options.latency_ms:g} ms; expected 0 to {LONGEST_LATENCY_MS:g}")
    if options.headset is not None and options.arm is not None and not options.arm.emulated:
        raise HighFiveError(
            f"--rig {options.arm.port} may be a real arm, which who wears a headset may not see, nor can she stop it: "
            "leave out --headset, or use --rig emulated"
        )
    if options.place is not None and options.arm is not None and options.arm.calibration is not None:
        raise HighFiveError("--place and --calibration both say where the person stands; give one")


def sees_webcam(options: SimulateOptions) -> bool:
    """The person comes from a webcam."""
    return options.source is not None and parse_address(options.source).scheme == WEBCAM


def check_webcam_options(options: SimulateOptions) -> None:
    """What a webcam is good for, and what goes with one only.

    Raises:
        HighFiveError: something is not, or does not.
    """
    webcam = options.webcam
    if not sees_webcam(options):
        given = (("--camera", webcam.video), ("--height", webcam.height), ("--fov", webcam.field_of_view))
        for name, value in given:
            if value is not None:
                raise HighFiveError(f"{name} is of the person before a webcam; add --source webcam")
        return
    if options.arm is not None:
        raise HighFiveError(
            "no arm answers a webcam, which sees depth to 10 cm only: leave out --rig, or use a motion capture system"
        )
    if options.marker_set is not None or options.human is not None:
        raise HighFiveError("a webcam sees one person, without markers: leave out --marker-set and --human")
    if options.place is not None or options.latency_ms:
        raise HighFiveError("a webcam says itself when and where: leave out --place and --latency")
    camera_settings(options)
    if webcam.video is not None and (webcam.video.suffix.lower() not in VIDEOS or not webcam.video.is_file()):
        raise HighFiveError(f"--camera {webcam.video}: no such film; expected one of {', '.join(VIDEOS)}")


def camera_settings(options: SimulateOptions) -> CameraSettings:
    """Of the filter, with what was said of the person and the camera.

    Raises:
        HighFiveError: nobody is so tall, or no camera sees so much.
    """
    said = {"height": options.webcam.height, "field_of_view": options.webcam.field_of_view}
    given: dict[str, Any] = {name: float(value) for name, value in said.items() if value is not None}
    try:
        return CameraSettings(**given)
    except HighFiveError as error:
        line = str(error)
        for name, option in (("height", "--height"), ("field_of_view", "--fov")):
            line = line.replace(f"{CameraSettings.__name__}.{name}", option)
        raise HighFiveError(line) from None
