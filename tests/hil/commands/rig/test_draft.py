"""An arm of somebody's own, as docs/own_arm.md takes it: drafted, looked at, and on an emulated bus."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import failing, running
from paths import ROOT

from highfive.hil.arm.arm_files import limits_of, rig_of
from highfive.hil.arm_model.arm_folder import ARMS, find_arm
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.commands.rig.service import check
from highfive.hil.drivers.bus.control_table import load_table
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, make_bus
from highfive.hil.drivers.emulator.virtual_rig import PATH, VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock

draft, fails = running("rig", "draft"), failing("rig", "draft")
contact = running("bench", "contact")


@pytest.fixture
def own(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROOT / "examples" / "desk_arm", tmp_path / "my arm"))


@pytest.mark.slow
def test_a_draft_is_what_the_arm_can_be_driven_by(draft, own: Path) -> None:
    code, out, _ = draft(own, "--json")
    assert code == 0
    assert json.loads(out)["ids"] == {
        "waist": [1], "shoulder": [2, 3], "elbow": [4], "wrist_angle": [5], "wrist_rotate": [6],
    }  # fmt: skip
    with VirtualClock() as clock:
        rig = VirtualRig(clock, make_bus(EmulatorOptions(rig=str(own / "rig.toml"))))
        result = check(PATH, None, rig.wiring, arm=str(own))
    assert result["ready"], result["troubles"]
    assert len(result["servos"]) == 6


@pytest.mark.parametrize(
    "name", ["desk arm", "wx250s", pytest.param("openmanipulator_x", marks=pytest.mark.slow), "koch_v1_1"]
)
def test_drafted_limits_hold_the_arm_up_and_lie_inside_its_stops(draft, own: Path, tmp_path: Path, name: str) -> None:
    """By postures that the draft has not drawn, and by MuJoCo's own gravity in the shipped arms' tests."""
    if name != "desk arm":
        own = Path(shutil.copytree(ARMS / name, tmp_path / name))
    assert draft(own, "--overwrite")[0] == 0
    folder = find_arm(str(own))
    limits, arm = limits_of(folder), mounted(folder)
    holds = np.array([joint.contact_current for joint in limits.joints]) / folder.stall_currents * folder.each[0]
    drawn = np.random.default_rng(7).uniform(limits.lowest, limits.highest, (200, len(holds)))
    assert (np.abs([arm.gravity(joints) for joints in drawn]).max(axis=0) < holds).all()
    assert (limits.lowest > arm.packed.low).all() and (limits.highest < arm.packed.high).all()
    for joint, driven in zip(rig_of(folder).joints, limits.joints, strict=True):
        assert load_table(joint.model).motor.stall_current > joint.current_limit >= driven.contact_current
        assert joint.lower < driven.lowest and joint.upper > driven.highest


def test_each_entry_says_its_unit_and_whether_to_change_it(draft, own: Path) -> None:
    assert draft(own)[0] == 0
    for name in ("limits.toml", "rig.toml"):
        entries = [line for line in (own / name).read_text().splitlines() if re.match(r"[a-zA-Z_]+ = ", line)]
        assert len(entries) > 40 and all(line.count("  # ") == 1 for line in entries), name
    text = (own / "rig.toml").read_text()
    assert "operating_mode = 5  # 5: position with a largest current; keep it, also for servos that cannot" in text
    for joint in find_arm(str(own)).joints:
        table = text[text.index(f'name = "{joint.name}"') :].partition("[[joints]]")[0]
        assert ("a largest duty is made of it" in table) is not load_table(joint.model).limits_current


def test_what_is_there_is_kept_and_shipped_arms_are_not_drafted(draft, fails, own: Path) -> None:
    (own / "rig.toml").write_text("mine\n")
    assert "rig.toml is there already" in fails(own)
    assert not (own / "limits.toml").exists() and (own / "rig.toml").read_text() == "mine\n"
    assert "comes with its limits" in fails("wx250s")
    assert "there is no arm" in fails(own / "nowhere")
    assert draft(own, "--overwrite")[0] == 0


@pytest.mark.slow(40)
def test_it_meets_hands_where_it_reaches(draft, contact, own: Path) -> None:
    assert draft(own)[0] == 0
    words = ["--player", "twin", "--cell", "B2", "--emotion", "neutral", "--json"]
    code, out, _ = contact("--arm", own, *words)
    assert code == 0 and json.loads(out)["twin"]["error_mm"]["max"] < 15.0
