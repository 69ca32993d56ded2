"""Each arm comes with limits and a rig that fit it; those of another arm are refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from highfive.hil.arm.arm_files import ceilings_of, limits_of, rig_file, rig_of
from highfive.hil.arm_model.arm_folder import find_arm, shipped
from highfive.hil.drivers.bus.rig import required_registers
from highfive.hil.drivers.values import JointHealth
from highfive.hil.safety.faults import voltage
from highfive.hil.safety.limits import Ceilings
from highfive.hil.safety.limits_file import FILE
from highfive.model.errors import HighFiveError


@pytest.mark.parametrize("name", shipped())
def test_limits_lie_within_what_joints_and_servos_can(name: str) -> None:
    folder = find_arm(name)
    limits, ceilings = limits_of(folder), ceilings_of(folder)
    low, high = np.array(ceilings.mechanical).T
    assert limits.names == folder.names
    assert (limits.lowest >= low).all() and (limits.highest <= high).all()
    assert (limits.current <= ceilings.stall_currents).all()
    assert limits.way_points[0] == pytest.approx(folder.ready)
    assert (limits.acceleration <= [joint.acceleration for joint in folder.joints]).all()


def test_the_ceilings_that_limits_have_by_themselves_are_the_default_arms() -> None:
    known, found = Ceilings(), ceilings_of(find_arm())
    assert (known.names, known.stall_currents) == (found.names, found.stall_currents)
    assert np.array(known.mechanical) == pytest.approx(np.array(found.mechanical))


@pytest.mark.parametrize("name", shipped())
def test_a_rig_has_the_arms_joints_and_servos(name: str) -> None:
    folder = find_arm(name)
    rig = rig_of(folder, simulated=True)
    assert [joint.name for joint in rig.joints] == list(folder.names)
    assert [joint.model for joint in rig.joints] == [joint.model for joint in folder.joints]
    assert [len(joint.ids) for joint in rig.joints] == [joint.servos for joint in folder.joints]


@pytest.mark.parametrize("name", shipped())
def test_every_arm_that_comes_along_can_be_driven(name: str) -> None:
    assert required_registers(rig_of(find_arm(name)))


def test_voltages_are_those_of_the_servos() -> None:
    """The Koch has two supplies: its XL330 run at 5 V."""
    assert ceilings_of(find_arm("koch_v1_1")).voltages == (12.0, 12.0, 5.0, 5.0, 5.0)
    limits = limits_of(find_arm("koch_v1_1"))

    def trouble(*volts: float) -> str:
        return voltage(limits.ceilings, limits.servo, JointHealth(0, np.full(5, 30.0), np.array(volts)))

    assert trouble(12.0, 11.2, 5.0, 4.7, 5.6) == ""
    assert trouble(12.0, 12.0, 5.0, 5.0, 4.4) == "wrist_roll has 4.4 V, not 4.6 to 5.8"
    assert trouble(12.0, 12.0, 12.0, 5.0, 5.0).startswith("elbow_flex has 12.0 V")
    assert trouble(12.0, 5.0, 5.0, 5.0, 5.0) == "shoulder_lift has 5.0 V, not 11.0 to 14.0"


def test_a_servo_that_does_not_limit_its_current_limits_its_duty() -> None:
    """1.0 A of 1.4 A at stall are 632 of the manual's 885 counts of full duty."""
    rig = rig_of(find_arm("wx250s"))
    last = required_registers(rig)[rig.joints[-1].id]
    assert (last["operating_mode"], last["pwm_limit"], "current_limit" in last) == (
        3, round(rig.joints[-1].current_limit / 1.4 * 885), False,
    )  # fmt: skip
    assert all(one["operating_mode"] == 5 for one in list(required_registers(rig).values())[:-1])


def test_limits_of_another_arm_are_refused() -> None:
    with pytest.raises(HighFiveError, match=r"they are of another arm: \[joint\] has waist, shoulder, elbow, forearm"):
        limits_of(find_arm("koch_v1_1"), FILE)


def test_a_rig_of_another_arm_is_refused() -> None:
    with pytest.raises(HighFiveError, match="this arm has shoulder_pan"):
        rig_of(find_arm("koch_v1_1"), rig_file(find_arm()))


def test_servos_that_do_not_fit_the_joints_are_refused(tmp_path: Path) -> None:
    folder = find_arm("openmanipulator_x")
    other = tmp_path / "rig.toml"
    other.write_text(rig_file(folder).read_text().replace("XM430-W350", "XM540-W270", 1))
    with pytest.raises(HighFiveError, match="waist has 1 × XM540-W270; OpenManipulator-X has 1 × XM430-W350 there"):
        rig_of(folder, other)
