"""A rig's description: what it says of the arm, and that nonsense is reported in one line."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.drivers.bus.control_table import bounds, load_table, to_si
from highfive.hil.drivers.bus.rig import DEFAULT_RIG, RigJoint, angle, count, load_rig, required_registers
from highfive.model.errors import HighFiveError

TEXT = DEFAULT_RIG.read_text(encoding="utf-8")


def test_the_arm_that_comes_with_the_project() -> None:
    rig = load_rig()
    names = ["waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate"]
    assert [joint.name for joint in rig.joints] == names
    assert [joint.ids for joint in rig.joints] == [(1,), (2, 3), (4, 5), (6,), (7,), (8,)]
    assert rig.models == dict.fromkeys(range(1, 8), "XM540-W270") | {8: "XM430-W350"}
    assert math.degrees(rig.joints[1].lower) == pytest.approx(-106.0)


def test_what_its_servos_shall_hold() -> None:
    required = required_registers(load_rig())
    assert {servo["id"] for servo in required.values()} == set(required) == set(range(1, 9))
    for servo in required.values():
        assert servo["velocity_limit"] == 131
        assert servo["bus_watchdog"] == 4
        assert servo["operating_mode"] == 5
        assert servo["baud_rate"] == 3
        assert servo["return_delay_time"] == 0
    assert [required[n]["shadow_id"] for n in range(1, 9)] == [255, 255, 2, 255, 4, 255, 255, 255]
    assert [required[n]["drive_mode"] for n in range(1, 9)] == [0, 1, 0, 1, 0, 0, 1, 0]  # as Interbotix sets them
    assert (required[2]["min_position_limit"], required[2]["max_position_limit"]) == (842, 2867)
    assert (required[1]["min_position_limit"], required[1]["max_position_limit"]) == (0, 4095)


def test_the_servos_take_what_they_shall_hold() -> None:
    rig = load_rig()
    for servo, registers in required_registers(rig).items():
        table = load_table(rig.models[servo])
        for name, raw in registers.items():
            low, high = bounds(table[name])
            assert low <= raw <= high and table[name].writable, name
        assert to_si(table["current_limit"], registers["current_limit"]) <= table.motor.stall_current


JOINT = RigJoint("a", "XM540-W270", 1, None, 0, False, 2048, -1.0, 1.0, 1.0, 800)


@given(st.floats(-10, 10))
def test_a_count_is_the_nearest(required: float) -> None:
    assert abs(angle(JOINT, count(JOINT, required)) - required) <= math.tau / 4096 / 2 + 1e-12


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("id = 2\n", "id = 1\n", "ID 1 is there twice"),
        ('"elbow"', '"waist"', "joint waist is there twice"),
        ("shadow_id = 3", "shadow_id = 253", "0 to 252"),
        ("1_000_000", "1_000_001", "1000001 baud"),
        ("baud_rate = 1_000_000\n", "", "baud_rate missing"),
        ("zero = 2048", "zero = nan", "a whole number"),
        ("current_limit_A = 3.0", "current_limit_A = nan", "0 to 4.4"),
        ("current_limit_A = 1.2", "current_limit_A = 3", "0 to 2.3"),
        ("[-106.0, 72.0]", "[72.0, -106.0]", "upper is -106"),
        ("[-106.0, 72.0]", "[-106.0]", "two numbers"),
        ("[-106.0, 72.0]", '["a", 72.0]', "a number"),
        ("[-180.0, 180.0]", "[-190.0, 180.0]", "-180 to 180"),
        ('"XM430-W350"', '"AX-12"', "AX-12"),
        ("operating_mode = 5", "operating_mode = 2", "operating mode 2"),
        ("operating_mode = 5", "operating_mode = 3", "operating mode 3; expected 5"),
        ("watchdog_s = 0.08", "watchdog_s = -1", "watchdog_s"),
        ("reversed = true", "reversed = 1", "true or false"),
        ("[settings]", "[other]", "settings missing"),
        ("homing_offset = 0", "homing_ofset = 0", "homing_offset missing"),
        ("[[joints]]", "joints = [", "no TOML"),
    ],
)
def test_nonsense_is_one_line(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in TEXT
    file = tmp_path / "rig.toml"
    file.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(HighFiveError) as caught:
        load_rig(file)
    assert says in str(caught.value) and str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match="cannot read"):
        load_rig(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(HighFiveError, match="no TOML"):
        load_rig(tmp_path / "binary.toml")
