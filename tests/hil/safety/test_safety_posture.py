"""Where an arm can stand, by the twin's own physics; and which lost zeros that finds."""

import numpy as np
import pytest
import vx300s_measures as measures

from highfive.hil.arm.simulated_driver import mounted_arm
from highfive.hil.arm_model.servo_arm import DEFAULT_MOUNT, default_arm
from highfive.hil.drivers.values import JointState
from highfive.hil.safety.limits import JOINTS, STALL_CURRENTS
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.posture import posture_mismatches
from highfive.hil.sim.arm_plant import ArmPlant
from highfive.model.geometry.rotations import Array

LIMITS, ARM = load_limits(), default_arm()
REST = LIMITS.way_points[-1]
STRENGTH = np.array([count * servo.stall for servo, count in measures.SERVOS])
NOTHING = np.zeros(6)


def settled(plant: ArmPlant, seconds: float) -> Array:
    """Joints of a limp arm after so long."""
    for _ in range(round(1e3 * seconds)):
        positions, _ = plant.step(NOTHING, 1e-3)
    return positions


def against(positions: Array, given: Array = NOTHING, *, held: bool = False, speed: float = 0.0) -> tuple[str, ...]:
    """What speaks against that posture, with currents that make those torques."""
    state = JointState(
        0, positions, np.full(6, speed), given / STRENGTH * STALL_CURRENTS, np.zeros(6, dtype=np.int64),
        np.ones(6, dtype=bool), np.zeros(6, dtype=bool), NOTHING,
    )  # fmt: skip
    gravity, clearance = ARM.gravity(positions), ARM.clearance(positions)
    return posture_mismatches(LIMITS, state, gravity, STRENGTH, given, clearance, held=held)


def off(positions: Array, joint: str, degrees: float) -> Array:
    claimed = positions.copy()
    claimed[JOINTS.index(joint)] += np.radians(degrees)
    return claimed


@pytest.fixture(scope="module")
def limp() -> Array:
    return settled(mounted_arm(), 3.0)


@pytest.mark.parametrize("seed", range(6))
def test_where_gravity_lays_a_limp_arm_it_may_stand(seed: int) -> None:
    """From anywhere; physics is MuJoCo's, the law that judges it is statics."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(LIMITS.lowest, LIMITS.highest)
    while ARM.clearance(start) < 0.05:
        start = rng.uniform(LIMITS.lowest, LIMITS.highest)
    assert against(settled(ArmPlant(DEFAULT_MOUNT, start), 4.0)) == ()


@pytest.mark.slow
def test_an_arm_that_is_held_by_its_servos_may_stand_anywhere() -> None:
    for pose in LIMITS.way_points:
        gravity = ARM.gravity(pose)
        for share in (0.8, 1.0, 1.2):  # what a current gives is not known better
            assert against(pose, share * gravity) == ()
        assert any("shoulder" in line for line in against(pose, -gravity))


def test_a_limp_arm_in_the_air_is_held_by_something_and_that_may_be_only_where_it_rests() -> None:
    assert "gravity asks for" in against(REST)[0] and "servos give 0.0" in against(REST)[0]
    assert against(REST, held=True) == ()
    assert against(off(REST, "elbow", 11.0), held=True) == ()
    assert against(off(REST, "shoulder", -12.0), held=True) != ()


def test_an_arm_that_moves_is_not_judged() -> None:
    assert against(REST, ARM.gravity(REST), speed=0.06) == ("the arm moves; let it come to rest",)


def test_beyond_a_stop_or_inside_the_mount_is_nowhere(limp: Array) -> None:
    assert "shoulder says 82°, beyond its stops (-106 to 72°)" in against(off(limp, "shoulder", 10.0))[0]
    assert "inside floor, mount or itself" in against(off(limp, "elbow", 85.0))[0]


@pytest.mark.parametrize(
    ("joint", "limp_finds", "held_finds"),
    [
        ("waist", 45, None),
        ("shoulder", 10, 60),
        ("elbow", 60, 45),
        ("wrist_angle", None, 90),
        ("forearm_roll", None, None),
        ("wrist_rotate", None, None),
    ],
)
def test_which_zeros_are_found(joint: str, limp_finds: int | None, held_finds: int | None, limp: Array) -> None:
    """Both ways, and nothing is said of an arm whose zeros are right (the table of docs/safety.md)."""
    gravity = ARM.gravity(REST)
    assert against(limp) == against(REST, gravity) == ()
    for degrees in (10, 30, 45, 60, 90):
        found = [all(against(off(limp, joint, way), held=True) for way in (degrees, -degrees)),
                 all(against(off(REST, joint, way), gravity) for way in (degrees, -degrees))]  # fmt: skip
        assert found == [known is not None and degrees >= known for known in (limp_finds, held_finds)], degrees
