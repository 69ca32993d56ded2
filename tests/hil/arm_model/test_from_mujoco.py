"""Arms out of their folders are the arms that MuJoCo simulates; what is no arm is refused in one line."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from highfive.hil.arm_model import dynamics
from highfive.hil.arm_model.arm_folder import ARMS, ArmFolder, find_arm, shipped
from highfive.hil.arm_model.from_mujoco import compiled_body, load_spec
from highfive.hil.arm_model.mount import Mount
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.sim.arm_body import ArmTwin, arm_alone
from highfive.model.errors import HighFiveError

MOUNT = Mount((0.1, -0.2, 1.1), 0.4, 0.2, -0.15)


@pytest.fixture(scope="module", params=shipped())
def folder(request: pytest.FixtureRequest) -> ArmFolder:
    return find_arm(request.param)


@pytest.fixture(scope="module")
def twin(folder: ArmFolder) -> ArmTwin:
    return arm_alone(MOUNT, folder)


@pytest.fixture(scope="module")
def arm(folder: ArmFolder) -> ServoArm:
    return ServoArm(MOUNT, folder=folder)


def draws(arm: ServoArm, count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(arm.packed.low, arm.packed.high, (count, arm.joints))


def test_four_arms_of_four_to_six_joints_come_with_the_project() -> None:
    joints = {name: len(find_arm(name).joints) for name in shipped()}
    assert joints == {"koch_v1_1": 5, "openmanipulator_x": 4, "vx300s": 6, "wx250s": 6}


def test_kinematics_are_mujocos(arm: ServoArm, twin: ArmTwin) -> None:
    data = mujoco.MjData(twin.model)
    for joints in draws(arm, 30):
        data.qpos[twin.qpos] = joints
        mujoco.mj_forward(twin.model, data)
        plate, theirs = arm.plate_at(joints), twin.plate(data)
        assert plate.position == pytest.approx(theirs.position, abs=1e-12)
        assert plate.normal == pytest.approx(theirs.normal, abs=1e-12)
        assert plate.fingers == pytest.approx(theirs.fingers, abs=1e-12)
        assert plate.jacobian == pytest.approx(twin.jacobian(data), abs=1e-12)


def test_jacobians_are_differences(arm: ServoArm) -> None:
    step = 1e-6
    for joints in draws(arm, 10):
        plate = arm.plate_at(joints)
        for j in range(arm.joints):
            there, back = joints.copy(), joints.copy()
            there[j], back[j] = joints[j] + step, joints[j] - step
            one, other = arm.plate_at(there), arm.plate_at(back)
            assert plate.jacobian[:, j] == pytest.approx((one.position - other.position) / (2 * step), abs=1e-8)
            assert plate.normal_jacobian[:, j] == pytest.approx((one.normal - other.normal) / (2 * step), abs=1e-8)


@pytest.mark.slow
def test_dynamics_are_mujocos(arm: ServoArm, twin: ArmTwin) -> None:
    data, count = mujoco.MjData(twin.model), arm.joints
    whole, torques = np.zeros((count, count)), np.zeros(count)
    rng = np.random.default_rng(1)
    for joints in draws(arm, 30):
        speeds, push = rng.normal(0.0, 2.0, count), rng.normal(0.0, 20.0, count)
        data.qpos[twin.qpos], data.qvel[twin.dofs], data.qacc[twin.dofs] = joints, speeds, push
        mujoco.mj_forward(twin.model, data)
        mujoco.mj_fullM(twin.model, data, whole)
        mass, bias = dynamics.dynamics(arm.packed, joints, speeds)
        assert mass == pytest.approx(whole, abs=1e-9)
        assert bias == pytest.approx(data.qfrc_bias, abs=1e-9)
        assert arm.gravity(joints) == pytest.approx(twin.gravity(joints), abs=1e-9)
        data.qacc[twin.dofs] = push
        mujoco.mj_rne(twin.model, data, 1, torques)
        geared = mass - np.diag(arm.packed.armature)  # MuJoCo's recursion leaves the gears out
        assert geared @ push + bias == pytest.approx(torques, abs=1e-9)


def test_limits_and_gears_are_the_models(arm: ServoArm, twin: ArmTwin, folder: ArmFolder) -> None:
    ranges = np.array([twin.model.joint(f"arm_{name}").range for name in folder.names])
    assert np.column_stack([arm.packed.low, arm.packed.high]) == pytest.approx(ranges)
    assert arm.packed.armature == pytest.approx(twin.model.dof_armature[twin.dofs])
    assert arm.packed.friction == pytest.approx(twin.model.dof_frictionloss[twin.dofs])
    assert arm.packed.damping == pytest.approx(twin.model.dof_damping[twin.dofs])
    assert folder.each[0] == pytest.approx(twin.model.jnt_actfrcrange[:, 1])


@pytest.mark.slow
def test_the_ready_posture_is_inside_the_limits_and_clear_of_everything(folder: ArmFolder) -> None:
    arm, ready = ServoArm(folder.mount, folder=folder), np.array(folder.ready)
    assert (arm.margins(ready) > np.radians(3.0)).all()
    assert arm.clearance(ready) > 0.0


@pytest.mark.parametrize("further", [-0.03, 0.05])
def test_a_plate_further_out_is_further_out_along_its_normal(folder: ArmFolder, further: float) -> None:
    usual = compiled_body(folder)
    along = float(usual.plate @ usual.normal)
    moved = compiled_body(folder, along + further)
    assert moved.plate == pytest.approx(usual.plate + further * usual.normal, abs=1e-12)
    assert moved.masses == pytest.approx(usual.masses)
    rest = (moved.masses * moved.centres.T).T - (usual.masses * usual.centres.T).T
    plate = load_spec(folder).body("plate").mass
    assert rest[-1] == pytest.approx(plate * further * usual.normal, abs=1e-12)


def test_a_tilted_axis_is_taken_as_it_is(tmp_path: Path) -> None:
    text = (ARMS / "openmanipulator_x" / "arm.xml").read_text()
    tilted = f'axis="{np.sin(np.radians(0.2)):.9f} {np.cos(np.radians(0.2)):.9f} 0" range="-54'
    other = copied(tmp_path, text.replace('axis="0 1 0" range="-54', tilted))
    packed, twin = ServoArm(MOUNT, folder=other).packed, arm_alone(MOUNT, other)
    assert np.degrees(np.arccos(packed.axes[2] @ [0.0, 1.0, 0.0])) == pytest.approx(0.2, abs=1e-6)
    data = mujoco.MjData(twin.model)
    for joints in np.random.default_rng(2).uniform(packed.low, packed.high, (10, 4)):
        data.qpos[twin.qpos] = joints
        mujoco.mj_forward(twin.model, data)
        plate = ServoArm(MOUNT, folder=other).plate_at(joints)
        assert plate.position == pytest.approx(twin.plate(data).position, abs=1e-9)


def copied(folder: Path, model: str, name: str = "arm.xml", change: tuple[str, str] = ("", "")) -> ArmFolder:
    """The OpenManipulator-X with another model."""
    text = (ARMS / "openmanipulator_x" / "arm.toml").read_text().replace('model = "arm.xml"', f'model = "{name}"')
    (folder / "arm.toml").write_text(text.replace(*change) if change[0] else text)
    (folder / name).write_text(model)
    return find_arm(str(folder))


PLATE = """
[plate]
position = [0.1, 0.0, 0.0]
normal = [1.0, 0.0, 0.0]
fingers = [0.0, 0.0, 1.0]
radius = 0.05
mass = 0.06

[person]"""


def urdf(inertial: bool = True, loop: bool = False, mesh: str = "") -> str:
    """A chain of four joints, a link of 0.1 m each."""
    weight = '<inertial><origin xyz="0.05 0 0"/><mass value="0.1"/>'
    weight += '<inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>'
    shape = f'<collision><geometry><mesh filename="{mesh}"/></geometry></collision>' if mesh else ""
    links = '<link name="base"/>' + "".join(
        f'<link name="link{n}">{weight if inertial else ""}{shape}</link>' for n in range(1, 5)
    )
    joints = ""
    for n, (name, axis) in enumerate(zip(("waist", "shoulder", "elbow", "wrist"), "zyyy", strict=True), 1):
        parent, place = ("base", "0 0 0.1") if n == 1 else (f"link{n - 1}", "0.1 0 0")
        along = " ".join("1" if one == axis else "0" for one in "xyz")
        joints += f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="link{n}"/>'
        joints += (
            f'<origin xyz="{place}"/><axis xyz="{along}"/><limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>'
        )
        joints += "</joint>"
    if loop:
        joints += '<joint name="back" type="fixed"><parent link="base"/><child link="link4"/></joint>'
    return f'<robot name="made_up">{links}{joints}</robot>'


def test_a_urdf_is_an_arm_with_a_plate_put_on_it(tmp_path: Path) -> None:
    arm = ServoArm(MOUNT, folder=copied(tmp_path, urdf(), "arm.urdf", ("\n[person]", PLATE)))
    assert arm.packed.offsets == pytest.approx(np.array([[0.0, 0.0, 0.1], *[[0.1, 0.0, 0.0]] * 3]))
    assert arm.packed.masses == pytest.approx([0.1, 0.1, 0.1, 0.16])
    assert arm.packed.plate == pytest.approx([0.1, 0.0, 0.0])
    assert arm.packed.normal == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    twin = arm_alone(MOUNT, arm.folder)
    data = mujoco.MjData(twin.model)
    for joints in np.random.default_rng(3).uniform(-1.5, 1.5, (10, 4)):
        data.qpos[twin.qpos] = joints
        mujoco.mj_forward(twin.model, data)
        assert arm.plate_at(joints).position == pytest.approx(twin.plate(data).position, abs=1e-9)


@pytest.mark.parametrize(
    ("model", "name", "says"),
    [
        (urdf(inertial=False), "arm.urdf", "link link1 has no inertial"),
        (urdf(loop=True), "arm.urdf", "has a loop: link link4 hangs on two joints"),
        (urdf(mesh="nowhere.stl"), "arm.urdf", "nowhere.stl"),
        (urdf().replace('upper="1.5"', 'upper="92"'), "arm.urdf", "waist turns to 92 rad; are its limits in degrees"),
        (urdf().replace("0.1 0 0", "100 0 0"), "arm.urdf", "shoulder is 100 m from .*millimetres"),
        (urdf().replace('mass value="0.1"', 'mass value="140"'), "arm.urdf", "what waist carries weighs 140 kg"),
        (urdf().replace("0.1 0 0", "nan 0 0"), "arm.urdf", "xyz of origin is 'nan 0 0'; expected finite numbers"),
        ("<robot", "arm.urdf", "is no URDF"),
        ("<mujoco", "arm.xml", "is not an arm that MuJoCo reads"),
    ],
)
def test_a_model_that_is_no_arm_is_refused_in_one_line(tmp_path: Path, model: str, name: str, says: str) -> None:
    folder = copied(tmp_path, model, name, ("\n[person]", PLATE))
    with pytest.raises(HighFiveError, match=says) as refused:
        compiled_body(folder)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("count", [3, 8])
def test_three_or_eight_joints_are_refused(tmp_path: Path, count: int) -> None:
    body = ""
    for number in range(count):
        inertia = '<inertial mass="0.1" pos="0 0 0" diaginertia="1e-4 1e-4 1e-4"/>'
        body += f'<body pos="0.1 0 0"><joint name="joint{number}" axis="0 1 0" range="-1 1"/>{inertia}'
    model = f"<mujoco><worldbody>{body}{'</body>' * count}</worldbody></mujoco>"
    with pytest.raises(HighFiveError, match=f"has {count} joints, expected 4 to 7"):
        compiled_body(copied(tmp_path, model))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('name = "elbow"', 'name = "knee"'), "posts.between: got"),
        (('servo = "XM430-W350"', 'servo = "XM999"'), "there is no servo 'XM999'"),
        (("turret = ", "tower = "), "turret missing"),
        (("acceleration = ", "speed = "), "joint 1: acceleration missing"),
        (('model = "arm.xml"', 'model = "other.xml"'), "there is no such model"),
    ],
)
def test_a_folder_that_makes_no_sense_is_refused(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    with pytest.raises(HighFiveError, match=says):
        compiled_body(copied(tmp_path, (ARMS / "openmanipulator_x" / "arm.xml").read_text(), change=change))


def test_an_arm_that_is_not_there_is_named() -> None:
    with pytest.raises(HighFiveError, match="there is no arm 'panda': known are koch_v1_1, openmanipulator_x"):
        find_arm("panda")
