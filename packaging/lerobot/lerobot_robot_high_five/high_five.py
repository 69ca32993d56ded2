"""The arm, as lerobot has it: degrees by joint, ``shoulder.pos``."""

from __future__ import annotations

import logging
import math
import re
from functools import cached_property
from typing import Any

from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.processor import RobotAction, RobotObservation
from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from .arm_line import ArmLine, ArmStopped, joints_of
from .config_high_five import HighFiveConfig

logger = logging.getLogger(__name__)

OLD_S = 0.1
"""Positions that are older, s, are no observation."""
POSITION = ".pos"
_OPTIONS = {
    "arm": "--robot.armed=true",
    "nobody-near": "--robot.nobody_near=true",
    "slow": "--robot.slow=true",
}
OPTION = re.compile(rf"--({'|'.join(_OPTIONS)})\b")
"""How ``highfive rig follow`` names what lerobot's command line names otherwise."""


class HighFive(Robot):
    """A Dynamixel arm behind High Five's safety envelope.

    What it is told it does at the envelope's pace, within its limits, and only as far as the straight way there is
    clear of floor, mount and the arm itself: :meth:`send_action` says how far that is. Where it is told nothing it
    stands.
    """

    config_class = HighFiveConfig
    name = "high_five"

    def __init__(self, config: HighFiveConfig) -> None:
        """Nothing is opened yet.

        Raises:
            ArmStopped: no such arm, or the command ``highfive`` is not there.
        """
        super().__init__(config)
        self.config = config
        self.joints = joints_of([config.command, "rig", "joints", "--arm", config.arm, "--json"])
        self.cameras = make_cameras_from_configs(config.cameras)
        self._line: ArmLine | None = None

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        """An angle by joint, in degrees; a picture by camera."""
        cameras = self.config.cameras
        return {
            **self.action_features,
            **{name: (cameras[name].height, cameras[name].width, 3) for name in self.cameras},
        }

    @cached_property
    def action_features(self) -> dict[str, Any]:
        """An angle by joint, in degrees."""
        return {f"{joint}{POSITION}": float for joint in self.joints}

    @property
    def is_connected(self) -> bool:
        """The arm follows, and all cameras are there."""
        follows = self._line is not None and self._line.open
        return follows and all(camera.is_connected for camera in self.cameras.values())

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Checks the arm and switches it on, where it stands. Calibrations are High Five's (``highfive calibrate``).

        Raises:
            ArmStopped: something is not as it has to be; nothing has moved.
        """
        try:
            self._line = ArmLine([self.config.command, "rig", "follow", *self.config.words])
        except ArmStopped as error:
            raise ArmStopped(OPTION.sub(lambda found: _OPTIONS[found[1]], str(error))) from None
        for camera in self.cameras.values():
            camera.connect()
        self.configure()
        logger.info("%s connected.", self)

    @property
    def is_calibrated(self) -> bool:
        """What has to be calibrated is checked by the arm itself as it is connected."""
        return True

    def calibrate(self) -> None:
        """Nothing: ``highfive calibrate servos`` and ``highfive calibrate extrinsics`` do."""

    def configure(self) -> None:
        """Nothing: ``highfive rig configure`` does, and asks before."""

    @check_if_not_connected
    def get_observation(self) -> RobotObservation:
        """What servos said last, degrees, and what cameras saw.

        Raises:
            ArmStopped: the arm was stopped.
            TimeoutError: its servos have been silent for a tenth of a second.
        """
        assert self._line is not None
        said = self._line.ask()
        if said["age"] > OLD_S:
            raise TimeoutError(f"the servos have said nothing for {said['age']:.2f} s")
        observation: dict[str, Any] = _degrees(said["positions"])
        return observation | {name: camera.read_latest() for name, camera in self.cameras.items()}

    @check_if_not_connected
    def send_action(self, action: RobotAction) -> RobotAction:
        """Leads the arm to the angles, degrees; a joint that is not named keeps its goal.

        Returns:
            where it is led: the last posture on the straight way that is within limits, and free.

        Raises:
            ArmStopped: the arm was stopped.
            ValueError: no such joint, or what is no number; nothing has changed.
        """
        assert self._line is not None
        goal = {name.removesuffix(POSITION): math.radians(float(angle)) for name, angle in action.items()}
        return _degrees(self._line.ask(goal=goal)["goal"])

    def disconnect(self) -> None:
        """Has the arm go back to where it rests; it holds there, with torque on."""
        line, self._line = self._line, None
        if line is not None:
            line.close()
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()
        logger.info("%s disconnected.", self)


def _degrees(angles: dict[str, float]) -> dict[str, float]:
    return {f"{joint}{POSITION}": math.degrees(angle) for joint, angle in angles.items()}


__all__ = ["ArmStopped", "HighFive"]
