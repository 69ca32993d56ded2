"""What ``--robot.…`` says about the arm."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("high_five")
@dataclass(kw_only=True)
class HighFiveConfig(RobotConfig):
    """Which arm, and who is near it; each is an option of ``highfive rig follow``.

    Attributes:
        port: path of a serial port, ``emulated``, or ``virtual``: emulated, and every call takes 1/30 s.
        arm: its name, or the folder of an own one.
        armed: yes, the real arm on that port may move.
        nobody_near: nobody can be reached by the real arm; the operator answers for that.
        slow: every point of the arm is at most as fast as near a face.
        calibration: file of ``highfive calibrate``; None for what the rig's file names.
        rig: file of the rig; None for the arm's own.
        limits: file of limits, safer than the arm's; None for these.
        lower: lower limits, such as ``contact.speed=0.5``.
        estop: a named pipe that stops the arm when anything is written to it.
        faults: what goes wrong on an emulated arm.
        highfive: the command, which may be of another environment; '' for the one beside this Python, or on the path.
        cameras: by name.
    """

    port: str = "emulated"
    arm: str = "vx300s"
    armed: bool = False
    nobody_near: bool = False
    slow: bool = False
    calibration: Path | None = None
    rig: Path | None = None
    limits: Path | None = None
    lower: list[str] = field(default_factory=list)
    estop: Path | None = None
    faults: list[str] = field(default_factory=list)
    highfive: str = ""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)

    @property
    def command(self) -> str:
        """``highfive``."""
        beside = Path(sys.executable).with_name("highfive")
        return self.highfive or (str(beside) if beside.is_file() else "highfive")

    @property
    def words(self) -> list[str]:
        """Of ``highfive rig follow``."""
        flags = {"--arm": self.armed, "--nobody-near": self.nobody_near, "--slow": self.slow}
        files = {
            "--calibration": self.calibration,
            "--rig": self.rig,
            "--limits": self.limits,
            "--estop": self.estop,
        }
        lists = {"--lower": self.lower, "--faults": self.faults}
        return [
            self.port,
            *(flag for flag, given in flags.items() if given),
            *(word for option, file in files.items() if file is not None for word in (option, str(file))),
            *(word for option, values in lists.items() for value in values for word in (option, value)),
            f"--arm={self.arm}",
        ]
