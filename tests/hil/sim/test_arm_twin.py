"""The compiled arm is the one that the constants describe."""

import mujoco
import numpy as np
import pytest
import vx300s_measures as measures

from highfive.hil.arm_model import kinematics
from highfive.hil.arm_model.mount import Mount
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.values import Plant
from highfive.hil.sim.arm_body import PREFIX, ArmTwin, arm_alone, arm_in_scene
from highfive.hil.sim.arm_plant import ArmPlant
from highfive.model.errors import HighFiveError

MOUNT = Mount((0.1, -0.2, 1.1), 0.4, 0.2)
JOINTS = 6


@pytest.fixture(scope="module")
def twin() -> ArmTwin:
    return arm_alone(MOUNT)


@pytest.fixture(scope="module")
def arm() -> ServoArm:
    return ServoArm(MOUNT)


def draws(arm: ServoArm, count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(arm.packed.low, arm.packed.high, (count, JOINTS))


def test_limits_torques_and_gears_are_those_of_the_constants(twin: ArmTwin) -> None:
    for name, (low, high), (servo, count) in zip(
        measures.JOINTS, measures.LIMITS_DEGREES, measures.SERVOS, strict=True
    ):
        joint = twin.model.joint(PREFIX + name)
        assert joint.range == pytest.approx(np.radians([low, high]))
        dof = joint.dofadr[0]
        assert twin.model.jnt_actfrcrange[joint.id] == pytest.approx(np.array([-1, 1]) * count * servo.stall)
        assert twin.model.dof_armature[dof] == pytest.approx(count * servo.armature)
        assert twin.model.dof_frictionloss[dof] == pytest.approx(count * servo.friction)
        assert twin.model.dof_damping[dof] == pytest.approx(count * servo.damping)


def test_links_weigh_what_the_maker_says(twin: ArmTwin) -> None:
    assert float(twin.model.body_mass.sum()) == pytest.approx(measures.MOVING_MASS + measures.PLATE_MASS)
    assert sum(link.mass for link in measures.LINKS) == pytest.approx(measures.MOVING_MASS)


def test_link_lengths_by_forward_kinematics() -> None:
    height = np.array([0.0, 0.0, 1.0])
    twin = arm_alone(Mount((0.0, 0.0, 1.0)))
    data = mujoco.MjData(twin.model)
    mujoco.mj_kinematics(twin.model, data)
    centres = np.array([data.xanchor[twin.model.joint(PREFIX + name).id] for name in measures.JOINTS])
    assert centres - height == pytest.approx(np.cumsum(measures.OFFSETS, axis=0))
    assert data.site_xpos[twin.plate_site] == pytest.approx(centres[-1] + [measures.PLATE_DISTANCE, 0, 0])
    assert data.site_xmat[twin.plate_site].reshape(3, 3)[:, 2] == pytest.approx([1, 0, 0])
    assert data.geom_xpos[twin.plate_geom] == pytest.approx(
        data.site_xpos[twin.plate_site] - [0.5 * measures.PLATE_THICKNESS, 0, 0]
    )


@pytest.mark.slow
def test_the_stretched_arm_reaches_what_the_maker_says() -> None:
    arm = ServoArm(Mount((0.0, 0.0, 0.0)), measures.GRIPPER)
    # stretched: the forearm in line with the bent upper arm
    along = np.arctan2(measures.OFFSETS[2][2], measures.OFFSETS[2][0])
    stretched = np.array([0.0, 0.3, -along, 0.0, 0.0, 0.0])
    shoulder = kinematics.joint_centres(arm.packed, stretched)[1]
    reach = float(np.linalg.norm(arm.plate_at(stretched).position - shoulder))
    assert reach == pytest.approx(measures.REACH, abs=1e-3)
    others = [np.linalg.norm(arm.plate_at(joints).position - shoulder) for joints in draws(arm, 300)]
    assert max(others) <= reach + 1e-9


def test_the_plant_holds_still_under_gravity_torques_and_falls_without(arm: ServoArm) -> None:
    joints = np.array([0.2, -0.3, 0.5, 0.3, -0.4, 0.1])
    plant: Plant = ArmPlant(MOUNT, joints)
    held, speeds = plant.step(arm.gravity(joints), 0.2)
    assert held == pytest.approx(joints, abs=1e-6) and speeds == pytest.approx(np.zeros(JOINTS), abs=1e-6)
    fallen, _ = plant.step(np.zeros(JOINTS), 0.2)
    assert np.abs(fallen - joints).max() > 0.05


def test_the_plant_stops_at_its_stops_and_gives_way_to_a_push(arm: ServoArm) -> None:
    joints = np.array([0.0, -0.3, 0.5, 0.0, -0.2, 0.0])
    plant = ArmPlant(MOUNT, joints)
    for _ in range(60):
        there, _ = plant.step(np.array([0.0, 21.2, 0.0, 0.0, 0.0, 0.0]), 0.05)
    assert there[1] < np.radians(72) + 0.05
    plant.reset(joints)
    plant.force = -30.0 * arm.plate_at(joints).normal
    before = plant.plate().position
    plant.step(arm.gravity(joints), 0.1)
    assert (plant.plate().position - before) @ arm.plate_at(joints).normal < -0.005


def test_the_plant_keeps_time_whatever_the_steps() -> None:
    joints = np.array([0.0, -0.3, 0.5, 0.0, -0.2, 0.0])
    one, many = ArmPlant(MOUNT, joints), ArmPlant(MOUNT, joints)
    torques = np.array([1.0, 3.0, 2.0, 0.3, 0.3, 0.1])
    for _ in range(30):
        fine, _ = many.step(torques, 0.1 / 30)
    assert fine == pytest.approx(one.step(torques, 0.1)[0], abs=1e-9)


def test_torques_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(HighFiveError, match="a finite number a joint"):
        ArmPlant(MOUNT, np.zeros(JOINTS)).step(np.full(JOINTS, np.nan), 0.01)


@pytest.mark.parametrize("avatar", [True, False])
def test_the_arm_stands_in_the_scene(avatar: bool, arm: ServoArm) -> None:
    twin = arm_in_scene(MOUNT, avatar=avatar)
    data = mujoco.MjData(twin.model)
    joints = np.array([0.2, -0.3, 0.5, 0.3, -0.4, 0.1])
    data.qpos[twin.qpos] = joints
    mujoco.mj_forward(twin.model, data)
    assert twin.plate(data).position == pytest.approx(arm.plate_at(joints).position, abs=1e-12)
    names = {twin.model.geom(i).name for i in range(twin.model.ngeom)}
    assert ("right_palm" in names) is avatar and "person_palm" in names
