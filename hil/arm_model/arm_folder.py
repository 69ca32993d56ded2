"""An arm's folder: a MuJoCo or URDF model, and ``arm.toml``, which says what such a model cannot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from highfive import scenes
from highfive.hil.arm_model.mount import Mount
from highfive.model.errors import HighFiveError
from highfive.model.toml_file import check_keys, is_list, number, read_toml, typed

ARMS = Path(scenes.__file__).parent / "arms"
"""Folders of the arms that come with the project."""
DEFAULT_ARM = "vx300s"
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Servo:
    """A servo at its usual voltage.

    Attributes:
        voltage: V, that is.
        stall, no_load: N·m and rad/s.
        stall_current: A.
        mass: kg.
        armature, friction, damping: kg·m², N·m and N·m·s of rotor and gears, seen from the joint.
    """

    voltage: float
    stall: float
    no_load: float
    stall_current: float
    mass: float
    armature: float
    friction: float
    damping: float


@dataclass(frozen=True)
class DrivenJoint:
    """A joint by its name in the model, what drives it, how many of that, and rad/s² that are requested at most."""

    name: str
    model: str
    servo: Servo
    servos: int
    acceleration: float


@dataclass(frozen=True)
class Ball:
    """A sphere for distances: on the link behind a joint (its name, or ``"plate"``), m; whether it could meet the upper
    arm."""

    on: str
    centre: Vector
    radius: float
    upper: bool


@dataclass(frozen=True)
class Plate:
    """A plate for a model that has none: on the last link, m and unit vectors in the model's zero pose, and kg."""

    position: Vector
    normal: Vector
    fingers: Vector
    radius: float
    mass: float


@dataclass(frozen=True)
class ArmFolder:
    """What is known of an arm beside its model.

    Attributes:
        key: name of the folder.
        folder: path of it; ``rig.toml`` and ``limits.toml`` lie there, too.
        name: for people.
        model: path of the MuJoCo or URDF file.
        speed_limit: rad/s, that no joint is to exceed.
        mount: where it stands.
        ready: (J,) rad, where it waits.
        near: names of shapes that may meet a head.
        facing: m that a turn of the plate's normal by a radian counts as much as; little for an arm that cannot turn it
            everywhere.
        gives_up: what it cannot do beside a six-jointed arm; '' for nothing.
        joints: from the base on.
        posts: m, radii of turret, upper arm and column.
        between: names of the joints between which the upper arm lies.
        balls: for distances.
        meeting: names of joints whose centres may meet a person, beside the plate.
        plate: where the model has no body of that name.
    """

    key: str
    folder: Path
    name: str
    model: Path
    speed_limit: float
    mount: Mount
    ready: tuple[float, ...]
    near: tuple[str, ...]
    facing: float
    gives_up: str
    joints: tuple[DrivenJoint, ...]
    posts: Vector
    between: tuple[str, str]
    balls: tuple[Ball, ...]
    meeting: tuple[str, ...]
    plate: Plate | None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the joints."""
        return tuple(joint.name for joint in self.joints)

    @property
    def each(self) -> tuple[np.ndarray, np.ndarray]:
        """(J,) N·m and rad/s: stall torque of all servos of a joint, and its no-load speed."""
        stall = np.array([joint.servos * joint.servo.stall for joint in self.joints])
        return stall, np.array([joint.servo.no_load for joint in self.joints])

    @property
    def stall_currents(self) -> np.ndarray:
        """(J,) A, of each servo of a joint."""
        return np.array([joint.servo.stall_current for joint in self.joints])

    @property
    def voltages(self) -> np.ndarray:
        """(J,) V, usual for the joints' servos."""
        return np.array([joint.servo.voltage for joint in self.joints])


def shipped() -> tuple[str, ...]:
    """Names of the arms that come with the project."""
    return tuple(sorted(path.parent.name for path in ARMS.glob("*/arm.toml")))


@lru_cache(maxsize=16)
def find_arm(arm: str = DEFAULT_ARM) -> ArmFolder:
    """An arm by its name, or by the path of its folder.

    Raises:
        HighFiveError: there is none, or its ``arm.toml`` makes no sense; one line says what.
    """
    folder = ARMS / arm if arm in shipped() else Path(arm)
    path = folder / "arm.toml"
    if not path.is_file():
        known = f"known are {', '.join(shipped())}, or a folder with a model and an arm.toml of your own"
        raise HighFiveError(f"there is no arm {arm!r}: {known}")
    try:
        return _described(folder, read_toml(path, "the arm"))
    except HighFiveError as error:
        raise HighFiveError(f"{path}: {error}") from None


@lru_cache(maxsize=1)
def servo_table() -> dict[str, Servo]:
    """The servos that are known, by model."""
    path = Path(scenes.__file__).parent / "servos.toml"
    return {model: Servo(**entry) for model, entry in read_toml(path, "the servos").items()}


def _described(folder: Path, data: Mapping[str, Any]) -> ArmFolder:
    plain = {"name", "model", "speed_limit", "ready", "near", "facing", "gives_up"}
    check_keys(data, "the arm", plain | {"mount", "joints", "posts", "person"}, {"balls", "plate"})
    joints = tuple(_joint(entry, f"joint {row + 1}: ") for row, entry in enumerate(typed(data, "", "joints", list)))
    names = tuple(joint.name for joint in joints)
    posts, person, mount = data["posts"], data["person"], data["mount"]
    check_keys(posts, "[posts]", {"turret", "upper_arm", "column", "between"})
    check_keys(person, "[person]", {"joints"})
    check_keys(mount, "[mount]", {"position"}, {"yaw_deg", "tilt_deg", "roll_deg"})
    between = _names(posts["between"], "posts.between", names)
    if len(between) != 2:
        raise HighFiveError(f"posts.between: got {len(between)} joints, expected two")
    ready = _numbers(data["ready"], "ready", len(joints))
    angles = {key: float(np.radians(mount.get(f"{key}_deg", 0.0))) for key in ("yaw", "tilt", "roll")}
    plate = None
    if "plate" in data:
        entry = data["plate"]
        check_keys(entry, "[plate]", {"position", "normal", "fingers", "radius", "mass"})
        plate = Plate(
            position=_vector(entry["position"], "plate.position"),
            normal=_vector(entry["normal"], "plate.normal"),
            fingers=_vector(entry["fingers"], "plate.fingers"),
            radius=number(entry, "plate: ", "radius", float, 0.01, 0.2),
            mass=number(entry, "plate: ", "mass", float, 0.001, 1.0),
        )
    return ArmFolder(
        key=folder.name,
        folder=folder,
        name=typed(data, "", "name", str),
        model=folder / typed(data, "", "model", str),
        speed_limit=number(data, "", "speed_limit", float, 0.01, 20.0),
        mount=Mount(_vector(mount["position"], "mount.position"), **angles),
        ready=ready,
        near=tuple(typed(data, "", "near", list)),
        facing=number(data, "", "facing", float, 1e-4, 1.0),
        gives_up=typed(data, "", "gives_up", str),
        joints=joints,
        posts=(
            number(posts, "posts.", "turret", float, 0.001, 0.5),
            number(posts, "posts.", "upper_arm", float, 0.001, 0.5),
            number(posts, "posts.", "column", float, 0.001, 0.5),
        ),
        between=(between[0], between[1]),
        balls=tuple(_ball(entry, f"ball {row + 1}: ", names) for row, entry in enumerate(data.get("balls", []))),
        meeting=_names(person["joints"], "person.joints", names),
        plate=plate,
    )


def _joint(entry: Any, where: str) -> DrivenJoint:
    check_keys(entry, where.removesuffix(": "), {"name", "servo", "servos", "acceleration"})
    servos, model = servo_table(), typed(entry, where, "servo", str)
    if model not in servos:
        raise HighFiveError(f"{where}there is no servo {model!r}; known are {', '.join(servos)}")
    count = typed(entry, where, "servos", int)
    if count not in (1, 2):
        raise HighFiveError(f"{where}servos is {count}, expected 1, or 2 that share the load")
    acceleration = number(entry, where, "acceleration", float, 0.1, 200.0)
    return DrivenJoint(typed(entry, where, "name", str), model, servos[model], count, acceleration)


def _ball(entry: Any, where: str, names: tuple[str, ...]) -> Ball:
    check_keys(entry, where.removesuffix(": "), {"on", "centre", "radius"}, {"upper"})
    on = typed(entry, where, "on", str)
    if on != "plate":
        _names([on], f"{where}on", names)
    radius = number(entry, where, "radius", float, 0.001, 0.5)
    return Ball(on, _vector(entry["centre"], f"{where}centre"), radius, bool(entry.get("upper", False)))


def _names(entry: Any, where: str, names: tuple[str, ...]) -> tuple[str, ...]:
    if not is_list(entry) or any(name not in names for name in entry):
        raise HighFiveError(f"{where}: got {entry!r}, expected names out of {', '.join(names)}")
    return tuple(entry)


def _vector(entry: Any, where: str) -> Vector:
    x, y, z = _numbers(entry, where, 3)
    return x, y, z


def _numbers(entry: Any, where: str, count: int) -> tuple[float, ...]:
    good = is_list(entry) and len(entry) == count
    if not good or not all(isinstance(one, int | float) and np.isfinite(one) for one in entry):
        raise HighFiveError(f"{where}: got {entry!r}, expected {count} numbers")
    return tuple(float(one) for one in entry)
