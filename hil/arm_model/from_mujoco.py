"""An arm's model, compiled by MuJoCo, in the numbers that the compiled functions work on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from highfive.hil.arm_model.arm_folder import ArmFolder
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

LEAST, MOST = 4, 7
"""Joints that an arm may have."""

FURTHEST_TURN, LONGEST_LINK, HEAVIEST_LINK = 6.5, 2.0, 50.0
"""rad, m and kg, beyond which a model is in other units: servos have a turn, and such arms stand on tables."""


@dataclass(frozen=True)
class ArmBody:
    """An arm whose base is at the origin; every frame is parallel to the base where all joints are zero.

    Attributes:
        axes, offsets: (J, 3) unit vectors, and m from the joint before.
        low, high: (J,) rad.
        masses, centres, inertias: (J,) kg, (J, 3) m and (J, 3, 3) kg·m² about the centres, of all that a joint carries
            up to the next one.
        plate, normal, fingers: (3,) m from the last joint, and unit vectors.
    """

    axes: Array
    offsets: Array
    low: Array
    high: Array
    masses: Array
    centres: Array
    inertias: Array
    plate: Array
    normal: Array
    fingers: Array


def load_spec(folder: ArmFolder, plate: float | None = None) -> mujoco.MjSpec:
    """The arm's model with its servos' gears, motors and plate.

    Args:
        folder: what arm.
        plate: m, from the last joint to the plate along its normal, other than the model says.

    Raises:
        HighFiveError: it is no model that MuJoCo reads, or no arm of ours; one line says why.
    """
    path = folder.model
    if not path.is_file():
        raise HighFiveError(f"{path}: there is no such model; arm.toml names it")
    urdf = path.suffix == ".urdf"
    _check_numbers(path)
    if urdf:
        _check_urdf(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise HighFiveError(f"{path} is not an arm that MuJoCo reads: {_first_line(error)}") from None
    if urdf:
        spec.compiler.fusestatic = False
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 0
    _check_joints(folder, spec)
    for joint in folder.joints:
        driven, limit = spec.joint(joint.name), joint.servos * joint.servo.stall
        driven.armature = joint.servos * joint.servo.armature
        driven.frictionloss = joint.servos * joint.servo.friction
        driven.damping = [joint.servos * joint.servo.damping, 0.0, 0.0]  # linear, no powers
        driven.actfrcrange = [-limit, limit]
        if spec.actuator(joint.name) is None:
            spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_motor()
    if spec.body("plate") is None:
        _add_plate(folder, spec)
    if plate is not None:
        body = _packed(folder, _compiled(folder, spec))
        _move_plate(spec, (plate - body.plate @ body.normal) * np.array([0.0, 0.0, 1.0]))
    return spec


@lru_cache(maxsize=64)
def compiled_body(folder: ArmFolder, plate: float | None = None) -> ArmBody:
    """The arm in numbers.

    Raises:
        HighFiveError: as :func:`load_spec`.
    """
    return _packed(folder, _compiled(folder, load_spec(folder, plate)))


def _compiled(folder: ArmFolder, spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise HighFiveError(f"{folder.model} is not an arm that MuJoCo compiles: {_first_line(error)}") from None


def _packed(folder: ArmFolder, model: mujoco.MjModel) -> ArmBody:
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    joints = [model.joint(name).id for name in folder.names]
    bodies = [int(model.jnt_bodyid[joint]) for joint in joints]
    _check_chain(folder, model, bodies)
    anchors = data.xanchor[joints]
    count = len(joints)
    masses, moments = np.zeros(count), np.zeros((count, 3))
    carried = [(body, _carrier(model, body, bodies)) for body in range(1, model.nbody)]
    for body, link in carried:
        if link >= 0:
            masses[link] += model.body_mass[body]
            moments[link] += model.body_mass[body] * (data.xipos[body] - anchors[link])
    if not (masses > 0.0).all():
        weightless = folder.names[int(np.argmin(masses))]
        raise HighFiveError(f"{folder.model}: what {weightless} carries weighs nothing; give its links their inertias")
    centres, inertias = moments / masses[:, None], np.zeros((count, 3, 3))
    for body, link in carried:
        if link >= 0:
            axes, away = data.ximat[body].reshape(3, 3), data.xipos[body] - anchors[link] - centres[link]
            inertias[link] += axes @ np.diag(model.body_inertia[body]) @ axes.T
            inertias[link] += model.body_mass[body] * (away @ away * np.eye(3) - np.outer(away, away))
    _check_units(folder, model.jnt_range[joints], np.diff(anchors, axis=0), masses)
    site = model.site("plate").id
    turned = data.site_xmat[site].reshape(3, 3)
    low, high = model.jnt_range[joints].T
    return ArmBody(
        axes=data.xaxis[joints].copy(),
        offsets=np.diff(anchors, axis=0, prepend=np.zeros((1, 3))),
        low=np.ascontiguousarray(low),
        high=np.ascontiguousarray(high),
        masses=masses,
        centres=centres,
        inertias=inertias,
        plate=data.site_xpos[site] - anchors[-1],
        normal=turned[:, 2].copy(),
        fingers=turned[:, 0].copy(),
    )


def _carrier(model: mujoco.MjModel, body: int, jointed: list[int]) -> int:
    """The link that a body is a part of; -1 for the base."""
    while body not in jointed and body > 0:
        body = int(model.body_parentid[body])
    return jointed.index(body) if body > 0 else -1


def _check_joints(folder: ArmFolder, spec: mujoco.MjSpec) -> None:
    path, names = folder.model, [joint.name for joint in spec.joints]
    if not LEAST <= len(names) <= MOST:
        put_right = "; lock those that are too many" if len(names) > MOST else ""
        raise HighFiveError(f"{path} has {len(names)} joints, expected {LEAST} to {MOST}{put_right}")
    for joint in spec.joints:
        if joint.type != mujoco.mjtJoint.mjJNT_HINGE:
            raise HighFiveError(f"{path}: {joint.name} is no hinge; an arm has hinges only: lock it")
    if list(spec.equalities):
        raise HighFiveError(f"{path} has a loop or coupled joints; an arm is a chain: remove its equality constraints")
    if tuple(names) != folder.names:
        raise HighFiveError(
            f"{path} has the joints {', '.join(names)}, arm.toml {', '.join(folder.names)}; name the same, base first"
        )


def _check_chain(folder: ArmFolder, model: mujoco.MjModel, bodies: list[int]) -> None:
    for number in range(1, len(bodies)):
        parent = int(model.body_parentid[bodies[number]])
        while parent > 0 and parent not in bodies:
            parent = int(model.body_parentid[parent])
        if parent != bodies[number - 1]:
            raise HighFiveError(f"{folder.model}: {folder.names[number]} does not follow {folder.names[number - 1]}")
    for name in folder.names:
        joint = model.joint(name)
        if not model.jnt_limited[joint.id]:
            raise HighFiveError(f"{folder.model}: {name} has no limits (lower < upper); give it a range")


def _check_units(folder: ArmFolder, ranges: Array, links: Array, masses: Array) -> None:
    """Of ranges (J, 2), rad, links (J - 1, 3), m, and what each joint carries (J,), kg, before its next joint."""
    for name, stops in zip(folder.names, ranges, strict=True):
        if (furthest := float(np.abs(stops).max())) > FURTHEST_TURN:
            raise HighFiveError(f"{folder.model}: {name} turns to {furthest:g} rad; are its limits in degrees?")
    for name, link in zip(folder.names[1:], links, strict=True):
        if (length := float(np.linalg.norm(link))) > LONGEST_LINK:
            raise HighFiveError(f"{folder.model}: {name} is {length:g} m from the joint before; is that millimetres?")
    for name, mass in zip(folder.names, masses, strict=True):
        if mass > HEAVIEST_LINK:
            raise HighFiveError(f"{folder.model}: what {name} carries weighs {mass:g} kg; is that grams?")


def _check_numbers(path: Path) -> None:
    """Refuses a model with numbers that are none: MuJoCo computes with some of them."""
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError):
        return  # MuJoCo says what is wrong with it
    for element in root.iter():
        for attribute, value in element.attrib.items():
            if attribute != "name" and {"nan", "inf"} & {word.strip("+-") for word in value.lower().split()}:
                where = element.get("name") or element.tag
                raise HighFiveError(f"{path}: {attribute} of {where} is {value!r}; expected finite numbers")


def _check_urdf(path: Path) -> None:
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError) as error:
        raise HighFiveError(f"{path} is no URDF: {error}") from None
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if not any((path.parent / one).is_file() for one in (name, Path(name).name)):
            raise HighFiveError(f"{path}: there is no mesh {name}; put it beside the URDF, or take the shape out")
    heavy = {link.get("name") for link in root.iter("link") if link.find("inertial") is not None}
    children: set[str] = set()
    for joint in root.iter("joint"):
        child = joint.find("child")
        name = "" if child is None else child.get("link", "")
        if name in children:
            raise HighFiveError(f"{path} has a loop: link {name} hangs on two joints; an arm is a chain")
        children.add(name)
        if joint.get("type") != "fixed" and name not in heavy:
            raise HighFiveError(f"{path}: link {name} has no inertial; give it its mass and inertia")


def _add_plate(folder: ArmFolder, spec: mujoco.MjSpec) -> None:
    """A round plate on the last link, given in the arm's zero pose."""
    plate = folder.plate
    if plate is None:
        raise HighFiveError(f"{folder.model} has no body 'plate', and arm.toml no [plate] that says where it is")
    model = _compiled(folder, spec.copy())
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    joint = model.joint(folder.names[-1]).id
    last = int(model.jnt_bodyid[joint])
    back = data.xmat[last].reshape(3, 3).T
    normal, fingers = np.array(plate.normal), np.array(plate.fingers)
    axes = np.column_stack([fingers, np.cross(normal, fingers), normal])
    if not np.allclose(axes.T @ axes, np.eye(3), atol=1e-6):
        raise HighFiveError("plate: normal and fingers have to be unit vectors at right angles")
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(back @ axes).ravel())
    where = back @ (data.xanchor[joint] + plate.position - data.xpos[last])
    body = spec.body(model.body(last).name).add_body(name="plate", pos=where.tolist(), quat=quat.tolist())
    body.explicitinertial = True
    across = 0.25 * plate.mass * plate.radius**2
    body.mass, body.ipos, body.inertia = plate.mass, [0.0, 0.0, -0.006], [across, across, 2.0 * across]
    body.add_geom(
        name="plate", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[plate.radius, 0.006, 0.0], pos=[0.0, 0.0, -0.006],
        mass=0.0, contype=0, conaffinity=0, rgba=[0.93, 0.56, 0.36, 1.0],
    )  # fmt: skip
    body.add_site(name="plate", size=[0.01, 0.01, 0.01], group=4)


def _move_plate(spec: mujoco.MjSpec, along: Array) -> None:
    """Moves the plate's body by ``along`` (3,), m in the frame of its site."""
    body, site = spec.body("plate"), spec.site("plate")
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    parent = int(model.body_parentid[model.body("plate").id])
    turn = data.xmat[parent].reshape(3, 3).T @ data.site_xmat[model.site(site.name).id].reshape(3, 3)
    body.pos = np.array(body.pos) + turn @ along


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
