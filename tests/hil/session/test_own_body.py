"""The own body: MuJoCo's distances are the oracle, finite differences the gradients'; and nothing of it is touched."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from highfive.hil.session.contact_correction import ContactCorrection
from highfive.hil.session.own_body import OWN_BODY, OwnBody
from highfive.hil.session.session import RATE_HZ, Session, Tick
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.scene import Scene, build_scene, own_pairs, rest_pose
from highfive.hil.trials.partners import Partner, simulated_partners, simulated_person
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trained import HGPDM

FLAT_PALM = (-0.006, 0.004)
"""m by which the three rods of the palm may be nearer and further than the ellipsoid that they cover."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene()


@pytest.fixture(scope="module")
def model() -> HGPDM:
    return load_model(DEFAULT_MODEL)


def poses(scene: Scene, count: int, seed: int) -> Iterable[mujoco.MjData]:
    """States with trunk and right arm about one with the forearm before the trunk, inside the limits."""
    rng, data, skeleton = np.random.default_rng(seed), scene.make_data(), scene.skeleton
    limits = skeleton.hinge_limits[scene.arm_joints].reshape(-1, 2)
    hinges = across(scene, 30.0)
    for _ in range(count):
        arm = hinges[scene.arm_joints].ravel() + rng.normal(0.0, 0.5, 18)
        scene.set_pose(data, Pose(rest_pose(skeleton).root_in_world, hinges))
        data.qpos[scene.hinge_qpos[scene.arm_joints].ravel()] = np.clip(arm, limits[:, 0], limits[:, 1])
        mujoco.mj_kinematics(scene.model, data)
        yield data


def across(scene: Scene, degrees: float) -> np.ndarray:
    """Hinges of the avatar with its right forearm turned inwards, in front of the belly."""
    skeleton, hinges = scene.skeleton, rest_pose(scene.skeleton).hinges.copy()
    shoulder = skeleton.index("right_shoulder")
    order = skeleton.hinge_orders[shoulder]
    hinges[shoulder, order.index("y")], hinges[shoulder, order.index("z")] = np.radians([15.0, degrees])
    hinges[skeleton.index("right_elbow"), 0] = np.radians(-95.0)
    return skeleton.clamp(hinges)


def deepest(scene: Scene, data: mujoco.MjData, pose: Pose) -> float:
    """m of the deepest contact of the own body that MuJoCo finds; 0 where there is none."""
    scene.set_pose(data, pose)
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_collision(scene.model, data)
    own = own_names(scene.skeleton.names)
    names = [frozenset(scene.model.geom(g).name for g in pair) for pair in data.contact.geom]
    return max((-c for c, pair in zip(data.contact.dist, names, strict=True) if pair in own), default=0.0)


@cache
def own_names(joints: tuple[str, ...]) -> frozenset[frozenset[str]]:
    """The pairs of shapes that shall not touch, in either order."""
    assert joints == avatar_skeleton().names
    return frozenset(map(frozenset, own_pairs(avatar_skeleton())))


def test_every_pair_that_the_scene_calls_unwanted_is_kept_apart(scene: Scene) -> None:
    body = OwnBody(scene, scene.make_data())
    assert {(rod, shape) for rod in body.rods for shape in body.shapes} == set(own_pairs(scene.skeleton))


@pytest.mark.slow
def test_distances_are_mujocos(scene: Scene) -> None:
    overlapping = 0
    for data in poses(scene, 25, 1):
        body = OwnBody(scene, data)
        distances, _ = body.distances()
        for column, shape in enumerate(body.shapes):
            oracle = {
                name: mujoco.mj_geomDistance(
                    scene.model, data, scene.model.geom(name).id, scene.model.geom(shape).id, 10.0, None
                )
                for name in dict.fromkeys(body.rods)
            }
            palm = min(d for d, name in zip(distances[:, column], body.rods, strict=True) if name == "right_palm")
            for name, distance in zip(body.rods, distances[:, column], strict=True):
                if name == "right_palm":
                    continue
                overlapping += oracle[name] < 0.0
                # Where bodies overlap, MuJoCo looks for the way out in steps, and for the shortest of all directions.
                tolerance = 1e-6 if oracle[name] > 0.0 else 1e-3
                assert distance == pytest.approx(oracle[name], abs=tolerance), (name, shape)
            if oracle["right_palm"] > 0.0:
                assert FLAT_PALM[0] < palm - oracle["right_palm"] < FLAT_PALM[1]
    assert overlapping > 20


@pytest.mark.slow
def test_gradients_are_the_distances_differences(scene: Scene) -> None:
    addresses = scene.hinge_qpos[scene.arm_joints].ravel()
    for data in poses(scene, 5, 2):
        body = OwnBody(scene, data)
        _, gradients = body.distances()
        start, step = data.qpos.copy(), 1e-6
        for k, address in enumerate(addresses):
            ends = []
            for way in (step, -step):
                data.qpos[:] = start
                data.qpos[address] += way
                mujoco.mj_kinematics(scene.model, data)
                ends.append(body.distances()[0])
            differences = (ends[0] - ends[1]) / (2.0 * step)
            off = np.abs(differences - gradients[:, :, k])
            # Inside, a distance has a crease where two ways out are as long.
            outside = np.minimum(*ends) > 0.0
            assert off[outside].max() < 1e-3
            assert np.median(off) < 1e-6
        data.qpos[:] = start


def test_the_force_is_the_slope_of_the_cost(scene: Scene) -> None:
    addresses, seen = scene.hinge_qpos[scene.arm_joints].ravel(), 0
    for data in poses(scene, 30, 3):
        body = OwnBody(scene, data)
        gradient, hessian = np.zeros(18), np.zeros((18, 18))
        mujoco.mj_kinematics(scene.model, data)
        if body.keep_off(1.0, gradient, hessian) < 1e-8 or body.distances()[0].min() < -0.03:
            continue
        seen += 1
        start, step, slopes = data.qpos.copy(), 1e-6, []
        for address in addresses:
            costs = []
            for way in (step, -step):
                data.qpos[:] = start
                data.qpos[address] += way
                mujoco.mj_kinematics(scene.model, data)
                costs.append(body.keep_off(1.0, np.zeros(18), np.zeros((18, 18))))
            slopes.append((costs[0] - costs[1]) / (2.0 * step))
        data.qpos[:] = start
        assert 0.5 * np.array(slopes) == pytest.approx(gradient, rel=1e-3, abs=1e-6)
        assert np.linalg.eigvalsh(hessian).min() > -1e-9 * np.abs(hessian).max()
    assert seen > 5


def test_the_cost_of_one_pair_is_what_is_written(scene: Scene) -> None:
    for pose in poses(scene, 300, 4):
        body = OwnBody(scene, pose)
        distances = body.distances()[0]
        near = np.sort(distances.ravel())
        if near[1] > 0.07 and 0.0 < near[0] < 0.05:
            cost = body.keep_off(0.5, np.zeros(18), np.zeros((18, 18)))
            assert cost == pytest.approx(
                0.5 * OWN_BODY.stiffness * OWN_BODY.softness * np.exp(-near[0] / OWN_BODY.softness),
                rel=1e-9,
            )
            return
    raise AssertionError("no pose with one near pair")


@pytest.mark.parametrize(("share", "smooth"), [(0.0, 1.0), (0.1, 1.0), (1.0, None)])
def test_a_forearm_that_is_led_through_the_trunk_stays_outside(
    scene: Scene, share: float, smooth: float | None
) -> None:
    """It swings across the belly, 7 cm deep, and back: with a palm target of no weight, hardly any, or much."""
    correction, data, limits = ContactCorrection(scene), scene.make_data(), avatar_skeleton().hinge_limits
    generated, played = [], []
    for swing in np.sin(np.linspace(0.0, np.pi, 180)) ** 2:
        pose = Pose(rest_pose(scene.skeleton).root_in_world, across(scene, 55.0 * swing))
        generated.append(deepest(scene, data, pose))
        palm = correction.palm_of(pose)
        solved = correction.solve(pose, palm.position, palm.normal, share).pose
        assert deepest(scene, data, solved) == 0.0
        assert np.all(solved.hinges >= limits[..., 0] - 1e-9)
        assert np.all(solved.hinges <= limits[..., 1] + 1e-9)
        played.append(solved.hinges)
    assert max(generated) > 0.06
    if smooth is not None:
        change = np.abs(np.diff(np.array(played), n=2, axis=0)) * RATE_HZ
        assert change.max() < smooth  # rad/s per tick


def test_far_from_the_own_body_nothing_changes(scene: Scene) -> None:
    correction, pose = ContactCorrection(scene), rest_pose(scene.skeleton)
    hinges = pose.hinges.copy()
    hinges[scene.skeleton.index("right_shoulder"), 0] = np.radians(-90.0)
    reaching = Pose(pose.root_in_world, hinges)
    palm = correction.palm_of(reaching)
    np.testing.assert_array_equal(correction.solve(reaching, palm.position, palm.normal, 0.0).pose.hinges, hinges)


def ticks_of(session: Session, partner: Partner) -> list[Tick]:
    """A high five in the partner's emotion; nothing of the one before is left."""
    session.set_style({partner.emotion: 1.0})
    session.reset()
    return [session.step(frame) for frame in C3DSource(partner.recording, RATE_HZ)]


@pytest.fixture(scope="module")
def session(scene: Scene, model: HGPDM) -> Session:
    return Session(model, {model.emotions[0]: 1.0}, load_marker_set(PERSON_SET), scene)


@pytest.fixture(scope="module")
def hierarchy_session(scene: Scene, model: HGPDM) -> Session:
    alone = replace(model, ensemble=None, task_space=None)
    return Session(alone, {model.emotions[0]: 1.0}, load_marker_set(PERSON_SET), scene)


@pytest.mark.parametrize(
    ("seed", "emotion", "cell"),
    [
        (0, "happy", "A3"),  # forearm and trunk, after the high five
        (7, "angry", "C3"),  # fingers and head
        (101, "angry", "C3"),  # hand and head
    ],
)
@pytest.mark.slow
def test_high_fives_whose_arm_the_model_leads_into_its_body(
    seed: int, emotion: str, cell: str, scene: Scene, hierarchy_session: Session
) -> None:
    """By the hierarchy alone; pooled and led, its arm goes less deep."""
    session = hierarchy_session
    partner, data = simulated_partners(1, [emotion], [cell], seed)[0], scene.make_data()
    ticks = ticks_of(session, partner)
    assert max(deepest(scene, data, tick.generated) for tick in ticks) > 0.005
    assert max(deepest(scene, data, tick.pose) for tick in ticks) == 0.0


@pytest.mark.slow(20)
@pytest.mark.contact
@pytest.mark.parametrize("every", [3, 1])
def test_no_high_five_touches_the_own_body(scene: Scene, model: HGPDM, session: Session, every: int) -> None:
    """Each emotion at each cell, of two seeds in turn; of those a third at first."""
    data = scene.make_data()
    partners = [
        simulated_person(emotion, cell, (0, 101)[(row + column) % 2])
        for row, cell in enumerate(CELLS)
        for column, emotion in enumerate(model.emotions)
    ]
    found = {
        partner.title: max(deepest(scene, data, tick.pose) for tick in ticks_of(session, partner))
        for partner in partners[::every]
    }
    assert not {title: depth for title, depth in found.items() if depth > 0.0}
