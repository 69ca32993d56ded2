"""``highfive calibrate show`` on files as they are kept."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from command_line import failing, running
from kept_arm import kept_arm

from highfive.calibration.arm_file import ArmCalibration, save_arm
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.drivers.bus.rig import load_rig

show, fails = running("calibrate", "show"), failing("calibrate", "show")


@pytest.fixture
def kept(tmp_path: Path) -> ArmCalibration:
    """Of the arm that comes along, four days old, its servos two; nobody measured a lag but the elbow's."""
    mount, now = find_arm().mount, datetime.now(UTC)
    room = replace(kept_arm().registration, arm=fingerprint(load_rig()), date=now - timedelta(days=4))
    found = replace(
        kept_arm(),
        registration=room,
        mount=np.array(mount.position) + np.array([0.0, 0.0, 0.012]),
        mount_rotation=np.array(mount.quaternion),
        servos_date=now - timedelta(days=2),
        latency={"elbow_lag_s": 0.0313},
    )
    save_arm(tmp_path / "arm.toml", found)
    return found


def test_one_is_told_part_by_part(show, kept: ArmCalibration, tmp_path: Path) -> None:
    code, out, _ = show(tmp_path / "arm.toml", "--json")
    (found,) = json.loads(out)["calibrations"]
    days = [None if of is None else round(of["days_ago"]) for of in found["measured"].values()]
    assert code == 0 and days == [4, 2, None] and found["troubles"] == []
    assert list(found["quality_mm"].values()) == [1.2, 2.5, 3.1, 0.8]
    assert [pose["held_out_mm"] for pose in found["poses"]] == [2.0, None, 6.0]
    assert found["base_moved_mm"] == [0.0, 0.0, 12.0]
    assert found["joints"]["elbow"]["lag_ms"] == 31.3 and found["joints"]["waist"]["lag_ms"] is None
    assert found["joints"]["elbow"]["zero_deg"] == pytest.approx(np.degrees(kept.joints["elbow"].zero), abs=1e-3)
    code, out, _ = show(tmp_path / "arm.toml")
    assert code == 0 and "latency     not measured" in out and "posture 3   6.0 mm held out" in out
    wide = [line for line in out.splitlines() if len(line) >= 120 and str(tmp_path) not in line]
    assert not wide and "forearm_roll" in out


def test_an_old_one_says_that_no_real_arm_moves_by_it(show, kept: ArmCalibration, tmp_path: Path) -> None:
    old = replace(kept, registration=replace(kept.registration, date=datetime.now(UTC) - timedelta(days=31)))
    save_arm(tmp_path / "old.toml", old)
    code, out, _ = show(tmp_path / "old.toml")
    assert code == 0 and "no real arm is moved by it" in out and "31 days old" in out


def test_two_that_disagree_end_in_1_and_say_what_moved(show, kept: ArmCalibration, tmp_path: Path) -> None:
    save_arm(tmp_path / "later.toml", replace(kept, mount=kept.mount + np.array([0.0, 0.009, 0.0])))
    code, out, _ = show(tmp_path / "arm.toml", tmp_path / "later.toml", "--json")
    apart = json.loads(out)["difference"]
    assert code == 1 and apart["moved_mm"] == 9.0 and apart["plate_mm"] == {"median": 9.0, "p95": 9.0}
    assert apart["plate_alone_mm"]["p95"] == 0.0 and apart["joints"]["elbow"]["zero_deg"] == 0.0
    code, out, _ = show(tmp_path / "arm.toml", tmp_path / "arm.toml")
    assert code == 0 and "They agree." in out


@pytest.mark.slow
def test_the_picture_is_drawn_and_not_over_another(show, fails, kept: ArmCalibration, tmp_path: Path) -> None:
    file, picture = tmp_path / "arm.toml", tmp_path / "room.png"
    assert show(file, "--picture", picture)[0] == 0
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 20_000
    assert "is there already" in fails(file, "--picture", picture)
    assert "write it as" in fails(file, "--picture", tmp_path / "room.jpg")
    assert show(file, "--picture", picture, "--overwrite", "--arm", "koch_v1_1")[0] == 0


def test_what_cannot_be_compared_is_one_line(fails, kept: ArmCalibration, tmp_path: Path) -> None:
    file, other = tmp_path / "arm.toml", tmp_path / "other.toml"
    save_arm(other, replace(kept, registration=replace(kept.registration, arm="f" * 12)))
    assert "is of another arm" in fails(file, other)
    assert "give --arm NAME" in fails(file, file, "--arm", "koch_v1_1")
    assert "expected one, or two" in fails(file, file, file)
    assert "cannot read the calibration" in fails(tmp_path / "none.toml")
