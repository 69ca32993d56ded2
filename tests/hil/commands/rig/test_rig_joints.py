"""``highfive rig joints``: what is listed is what rig and limits say, and these files are where it says."""

from pathlib import Path

import pytest

from highfive.hil.arm.arm_files import ceilings_of
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.commands.rig.joints import joints, print_joints
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.safety.limits_file import load_limits


@pytest.mark.parametrize("arm", ["vx300s", "koch_v1_1"])
def test_joints_and_files_are_those_of_the_arm(arm: str, capsys: pytest.CaptureFixture[str]) -> None:
    found = joints(arm)
    rig = load_rig(Path(found["files"]["rig"]))
    assert [(one["name"], tuple(one["ids"])) for one in found["joints"]] == [(j.name, j.ids) for j in rig.joints]
    limits = load_limits(Path(found["files"]["limits"]), ceilings_of(find_arm(arm)))
    assert [one["speed"] for one in found["joints"]] == [joint.speed for joint in limits.joints]

    print_joints(found)
    shown = capsys.readouterr().out
    assert found["files"]["limits"] in shown and all(one["name"] in shown for one in found["joints"])
