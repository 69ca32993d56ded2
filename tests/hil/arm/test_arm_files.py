"""Each arm comes with limits and a rig that fit it; those of another arm are refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from highfive.hil.arm.arm_files import ceilings_of, limits_of, rig_file, rig_of
from highfive.hil.arm_model.arm_folder import find_arm, shipped
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


@pytest.mark.parametrize("name", ["koch_v1_1", "wx250s"])
def test_a_bus_with_a_servo_that_does_not_limit_its_current_is_refused(name: str) -> None:
    with pytest.raises(HighFiveError, match="XL430-W250 does not limit its current"):
        rig_of(find_arm(name))


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
