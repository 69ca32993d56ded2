"""What goes with ``--source webcam``, and what does not: one line each, before anything is opened."""

from dataclasses import replace
from pathlib import Path

import pytest

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.commands.headset_session import hand_of
from highfive.hil.commands.live_options import camera_settings, check_live_options, sees_webcam
from highfive.hil.commands.simulate_options import SimulateOptions, WebcamOptions
from highfive.mocap_bridge.sources.address import connector, is_live, parse_address
from highfive.model.errors import HighFiveError

WEBCAM = SimulateOptions(source="webcam")


def refused(options: SimulateOptions) -> str:
    with pytest.raises(HighFiveError) as error:
        check_live_options(options, options.source is not None)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("port", ["emulated", "virtual", "/dev/ttyUSB0"])
def test_no_arm_answers_a_webcam(port: str) -> None:
    assert "no arm answers a webcam" in refused(replace(WEBCAM, arm=ArmOptions(port=port)))


def test_what_does_not_go_with_a_webcam_is_said(tmp_path: Path) -> None:
    assert "--marker-set" in refused(replace(WEBCAM, marker_set="paper"))
    assert "--latency" in refused(replace(WEBCAM, latency_ms=5.0))
    assert "--camera" in refused(replace(WEBCAM, webcam=WebcamOptions(video=tmp_path / "none.mjpeg")))
    (tmp_path / "film.mp4").touch()
    assert ".y4m" in refused(replace(WEBCAM, webcam=WebcamOptions(video=tmp_path / "film.mp4")))
    assert refused(replace(WEBCAM, webcam=WebcamOptions(height=17.5))).startswith("--height is 17.5 m")
    assert refused(replace(WEBCAM, webcam=WebcamOptions(field_of_view=3.0))).startswith("--fov is 3.0 °")
    for more in (WebcamOptions(height=1.7), WebcamOptions(field_of_view=65.0), WebcamOptions(video=tmp_path)):
        assert "add --source webcam" in refused(SimulateOptions(webcam=more))


def test_a_left_hand_is_asked_for_in_the_address() -> None:
    left = replace(WEBCAM, source="webcam?hand=left", view=None)
    check_live_options(left, True)
    assert sees_webcam(left) and hand_of(left) == "left" and hand_of(WEBCAM) == "right"
    assert "no arm answers a webcam" in refused(replace(left, arm=ArmOptions(port="emulated")))
    for wrong in ("webcam?hand=both", "webcam?fov=70", "webcam?hand"):
        with pytest.raises(HighFiveError, match="hand=left or hand=right"):
            parse_address(wrong)


def test_what_is_said_of_the_person_reaches_the_filter() -> None:
    check_live_options(WEBCAM, True)
    settings = camera_settings(replace(WEBCAM, webcam=WebcamOptions(height=1.62, field_of_view=66.0)))
    assert (settings.height, settings.field_of_view) == (1.62, 66.0)
    assert camera_settings(WEBCAM).height == 1.75


def test_a_webcam_is_live_and_has_no_address() -> None:
    assert is_live("webcam") and is_live("Webcam")
    with pytest.raises(HighFiveError, match="simulate --source webcam"):
        connector(parse_address("webcam"))
