"""Skins, faces and materials: what is seen of avatar and person. Nothing here collides."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from highfive.hil.sim.body_geometry import is_finger, split_side
from highfive.hil.sim.sculpt import BindPose, Surface, sculpt
from highfive.model.geometry.skeleton import Skeleton
from highfive.scenes import appearance, body_shapes

GLOSS = {"skin": 0.18, "lips": 0.35, "hair": 0.25, "shoes": 0.25, "eye": 0.9}
"""Specular reflection of materials; all others are matt cloth."""

# Joint angles in degrees, left side, in which parts are sculpted: limbs apart, so that they do not melt together.
_APART = {"shoulder_x": 50.0, "hip_x": 7.0, "index_1_y": -7.0, "middle_1_y": -2.0, "ring_1_y": 3.0, "little_1_y": 8.0}
# The person's left arm is not measured: it hangs, a little bent, as part of the trunk.
_PERSON_BIND = {"left_shoulder_x": 13.0, "left_shoulder_y": 4.0, "left_elbow_y": -22.0, "left_wrist_z": 0.0}


def bind_pose(skeleton: Skeleton, degrees: dict[str, float]) -> BindPose:
    """The pose in which parts are sculpted: hinge angles by name, the pelvis at its height."""
    angles = np.zeros((len(skeleton), 3))
    for i, (joint, order) in enumerate(zip(skeleton.names, skeleton.hinge_orders, strict=True)):
        angles[i] = [np.radians(degrees.get(f"{joint}_{axis}", 0.0)) for axis in order]
    positions, orientations = skeleton.forward_kinematics(skeleton.offsets[0], skeleton.from_hinges(angles))
    return BindPose(skeleton, positions, orientations)


def avatar_bind(skeleton: Skeleton) -> BindPose:
    """Arms and legs apart, fingers spread."""
    degrees = {f"left_{name}": angle for name, angle in _APART.items()}
    degrees |= {f"right_{n}": a if n.endswith("_y") else -a for n, a in _APART.items()}
    return bind_pose(skeleton, degrees)


def person_bind(skeleton: Skeleton) -> BindPose:
    """As the avatar's, but the left arm hangs and the right hand is open, the way the person's rigid hand is."""
    degrees = {f"right_{n}": -a for n, a in _APART.items() if n[-1] == "x"}
    degrees |= {"left_hip_x": _APART["hip_x"], **_PERSON_BIND}
    bend = body_shapes.PERSON_FINGER_BEND_DEGREES
    for finger in ("index", "middle", "ring", "little"):
        for number in (1, 2, 3):
            degrees[f"right_{finger}_{number}_x"] = bend
            degrees[f"left_{finger}_{number}_x"] = -2.5 * bend
    return bind_pose(skeleton, degrees)


# What share of a joint's motion is the trunk's, the rest being the pelvis's: the person's spine bends as one curve.
_TRUNK_SHARE = {"lumbar_5": 0.2, "lumbar_3": 0.45, "thoracic_12": 0.75}
_PERSON_BODY = {"head": "person_head", "right_shoulder": "person_upper_arm", "right_elbow": "person_forearm"}


def person_bodies(joint: str) -> dict[str, float]:
    """The person's bodies that stand for a joint of the skeleton, with their shares."""
    if joint in _TRUNK_SHARE:
        return {"person_trunk": _TRUNK_SHARE[joint], "person_pelvis": 1.0 - _TRUNK_SHARE[joint]}
    if joint in _PERSON_BODY:
        return {_PERSON_BODY[joint]: 1.0}
    name = split_side(joint)[1]
    if joint.startswith("right_") and (name == "wrist" or is_finger(joint)):
        return {"person_palm": 1.0}
    return {"person_pelvis" if name in ("pelvis", "hip", "knee", "ankle", "toe") else "person_trunk": 1.0}


# The joint whose frame a body of the person has.
_BODY_FRAME = {
    "person_head": "head", "person_upper_arm": "right_shoulder", "person_forearm": "right_elbow",
    "person_trunk": "thoracic_8", "person_pelvis": "pelvis", "person_palm": "right_wrist",
}  # fmt: skip


def _all_parts(look: appearance.Look) -> list[appearance.Part]:
    both = []
    for part in appearance.parts(look):
        both += [part, appearance.mirror_image(part)] if part.name.startswith("left_") else [part]
    return both


def _add_materials(spec: mujoco.MjSpec, owner: str, look: appearance.Look) -> None:
    for name, colour in {
        **look.colours,
        "eye": (0.95, 0.94, 0.92),
        "iris": look.iris,
        "pupil": (0.02, 0.02, 0.02),
    }.items():
        gloss = GLOSS.get(name, 0.03)
        spec.add_material(
            name=f"{owner}_{name}", rgba=[*colour, 1.0], specular=gloss, shininess=0.5 if gloss > 0.5 else 0.3
        )


def _add_skin(
    spec: mujoco.MjSpec,
    owner: str,
    part: appearance.Part,
    surface: Surface,
    pose: BindPose,
    bodies_of: Callable[[str], dict[str, float]],
) -> None:
    """One surface as a MuJoCo skin: every vertex moves with the weighted frames of its bodies."""
    skeleton = pose.skeleton
    by_body: dict[str, np.ndarray] = {}
    for joint in np.flatnonzero(surface.weights.any(axis=0)):
        for body, share in bodies_of(skeleton.names[joint]).items():
            by_body[body] = by_body.get(body, 0.0) + share * surface.weights[:, joint]
    skin = spec.add_skin(name=f"{owner}_{part.name}", material=f"{owner}_{part.material}")
    skin.vert = surface.vertices.ravel()
    skin.face = surface.faces.ravel()
    skin.bodyname = list(by_body)
    frames = [skeleton.index(_BODY_FRAME.get(body, body)) for body in by_body]
    skin.bindpos = pose.positions[frames].ravel()
    skin.bindquat = pose.orientations[frames].ravel()
    used = [np.flatnonzero(weight) for weight in by_body.values()]
    skin.vertid = [u.tolist() for u in used]
    skin.vertweight = [w[u].tolist() for w, u in zip(by_body.values(), used, strict=True)]


def _add_eyes(head: mujoco.MjsBody, owner: str) -> None:
    x, y, z = appearance.EYE_CENTRE
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for name, forward, radius in (("eye", 0.0, 1.0), ("iris", 0.0062, 0.60), ("pupil", 0.0098, 0.36)):
            size = appearance.EYE_RADIUS * radius
            head.add_geom(
                name=f"{owner}_{side}_{name}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[size, 0, 0], mass=0.0,
                pos=[x + forward, sign * y, z], material=f"{owner}_{name}", contype=0, conaffinity=0, group=1,
            )  # fmt: skip


def dress(spec: mujoco.MjSpec, skeleton: Skeleton) -> None:
    """Gives avatar and person their looks."""
    figures = (
        ("avatar", appearance.AVATAR, avatar_bind, lambda joint: {joint: 1.0}, "head"),
        ("person", appearance.PERSON, person_bind, person_bodies, "person_head"),
    )
    for owner, look, make_bind, bodies_of, head in figures:
        _add_materials(spec, owner, look)
        pose = make_bind(skeleton)
        for part in _all_parts(look):
            _add_skin(spec, owner, part, sculpt(part, pose), pose, bodies_of)
        _add_eyes(spec.body(head), owner)
