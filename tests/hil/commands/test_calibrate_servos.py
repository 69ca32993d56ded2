"""Servos of a hidden arm, calibrated at the wire: its driver, bus and servos in virtual time, and its cameras."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hidden_calibration import hidden_calibration
from kept_arm import kept_arm

from highfive.calibration.arm_file import CalibratedJoint, arm_text, load_arm, save_arm
from highfive.calibration.pose_file import TakenPose, load_poses
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.driven_arm import virtual_driven_arm
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.hidden_arm import HiddenTruth, drawn_truth
from highfive.hil.arm.hidden_rig import CameraFaults, PlateCamera, hidden_bus
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.servo_poses import SWEEP_SPEED
from highfive.hil.arm.session_check import plate_of
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.commands.calibrate_servos import (
    KnownServos,
    Seen,
    ServoOptions,
    _changes,  # pyright: ignore[reportPrivateUsage]
    checked_servos,
    seen_servos,
    shadows_of,
    written_servos,
)
from highfive.hil.commands.calibration_checks import kept_where_refused
from highfive.hil.commands.rig.service import check, opened
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.virtual_rig import PATH, VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.plate_wiring import camera_wiring
from highfive.mocap_bridge.files.recording import EVERYBODY
from highfive.model.errors import HighFiveError

BEFORE = drawn_truth(41)
"""The arm when its extrinsics were measured."""
SLIPPED = np.radians([0.8, -1.0, 0.6, 1.5, -0.7, 0.0])


def now_there() -> HiddenTruth:
    """The same arm, and the same room: horns were taken off and put on again, and its gears have worn."""
    return replace(BEFORE, zero=BEFORE.zero + SLIPPED, play=np.radians([0.25, 0.1, 0.2, 0.3, 0.15, 0.28]))


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("arm") / "arm.toml"
    hidden_calibration(BEFORE, file)
    return file


def wanted(kept: Path, out: Path, pairs: int = 12) -> KnownServos:
    return checked_servos(
        ServoOptions(ArmOptions("virtual", slow=True, calibration=kept), "vicon://cameras", pairs, out=out)
    )


@contextmanager
def room(
    run: KnownServos, truth: HiddenTruth, *on_the_bus: str
) -> Iterator[tuple[PostureDrive, PlateWatch, dict[str, int]]]:
    with VirtualClock(truth.seed) as clock:
        bus, plant = hidden_bus(truth, load_rig())
        bus.set_faults(parse_faults(on_the_bus))
        camera = PlateCamera(clock, truth, plant, CameraFaults())
        with closing(live_source("vicon://cameras", EVERYBODY, camera_wiring(clock, camera))) as source:
            watch, virtual = PlateWatch(source, plate_of(run.found), clock), VirtualRig(clock, bus)
            shadows = shadows_of(run, PATH, virtual.wiring)
            with virtual_driven_arm(virtual, run.options.arm, run.body, watch.in_the_way) as drive:
                yield drive, watch, shadows


def bar(*_: object) -> Any:
    return lambda *_, **__: None


@dataclass(frozen=True)
class Measured:
    """What was seen in two goes: poses before the port died, and in the end, and for how long the arm moved in all but
    for the pair that was lost."""

    before: list[TakenPose]
    seen: Seen
    moving_s: float


@pytest.fixture(scope="module")
def twice(kept: Path) -> Measured:
    """The whole measurement, of which the port dies half way."""
    run, moved = wanted(kept, kept.with_name("none.toml")), list[float]()
    with pytest.raises(HighFiveError), room(run, now_there(), "unplug@75-600") as (drive, watch, shadows):
        seen_servos(run, drive, watch, shadows, lambda *_: lambda *_, **__: moved.append(drive.moving_s))
    before = load_poses(run.half_done, run.arm, run.found.marker_names, 6)
    with room(run, now_there()) as (drive, watch, shadows):
        seen = seen_servos(run, drive, watch, shadows, bar)
    return Measured(before, seen, moved[-1] + seen.moving_s)


@pytest.fixture
def measured(twice: Measured) -> Seen:
    return twice.seen


@pytest.mark.slow(90)
def test_what_servos_do_not_say_is_found(kept: Path, twice: Measured, tmp_path: Path) -> None:
    measured = twice.seen
    run, truth, shown = wanted(kept, tmp_path / "new.toml"), now_there(), []
    found = written_servos(run, measured, lambda lines: bool(shown.extend(lines) or True))
    new = load_arm(tmp_path / "new.toml")
    for joint, (name, own) in enumerate(new.joints.items()):
        # What cannot be told from the base's yaw was left to the extrinsics: by how much zeros moved can be.
        moved = own.zero - run.found.joints[name].zero
        assert np.degrees(moved) == pytest.approx(np.degrees(SLIPPED[joint]), abs=0.25), name
        assert np.degrees(own.play) == pytest.approx(np.degrees(truth.play[joint]), abs=0.12), name
        gears = default_arm().packed
        friction = gears.friction[joint] + gears.damping[joint] * SWEEP_SPEED
        # How a servo settles after it turned back is in it: a quarter, where servos act some milliseconds late.
        assert own.friction == pytest.approx(friction, rel=0.3), name
    assert found["off_before_mm"] > 5.0 > 4.0 * found["off_mm"]
    assert any(line.startswith("shoulder: zero") for line in shown)
    assert 0.0 < found["moving_s"] < twice.moving_s < 180.0


@pytest.mark.slow
def test_a_port_that_dies_half_way_is_gone_on_from(kept: Path, twice: Measured) -> None:
    run, before, seen = wanted(kept, kept.with_name("none.toml")), twice.before, twice.seen
    assert 0 < len(before) < 24 and len(before) % 2 == 0
    assert len(seen.poses) == 24 and len(seen.friction) == 6
    np.testing.assert_array_equal([p.encoders for p in seen.poses[: len(before)]], [p.encoders for p in before])
    np.testing.assert_array_equal(seen.poses[0].sides, -seen.poses[1].sides)
    found = written_servos(run, seen, lambda _: False)
    assert not found["written"] and run.half_done.exists()  # a no does not cost them
    assert written_servos(run, seen, lambda _: True)["off_mm"] < 2.5 and not run.half_done.exists()


@pytest.mark.slow
def test_what_is_not_agreed_to_is_not_written(kept: Path, measured: Seen, tmp_path: Path) -> None:
    run = wanted(kept, tmp_path / "new.toml")
    assert not written_servos(run, measured, lambda _: False)["written"]
    assert not run.options.out.exists()


@pytest.mark.slow
def test_a_base_that_was_bumped_is_no_zero(kept: Path, measured: Seen, tmp_path: Path) -> None:
    """20 mm that no turn of a joint explains in all postures."""
    up = np.array([0.0, 0.0, 0.02])
    poses = [replace(pose, markers=pose.markers + up) for pose in measured.poses]
    with pytest.raises(HighFiveError, match="no zeros explain what was seen"):
        written_servos(wanted(kept, tmp_path / "new.toml"), replace(measured, poses=poses), lambda _: True)
    assert not (tmp_path / "new.toml").exists()


@pytest.mark.slow
def test_a_horn_on_the_wrong_tooth_is_told(kept: Path, measured: Seen, tmp_path: Path) -> None:
    tooth = np.radians([0.0, 0.0, 15.0, 0.0, 0.0, 0.0])
    poses = [replace(pose, encoders=pose.encoders - tooth) for pose in measured.poses]
    with pytest.raises(HighFiveError, match=r"the zero of elbow comes out 1\d° off"):
        written_servos(wanted(kept, tmp_path / "new.toml"), replace(measured, poses=poses), lambda _: True)


@pytest.mark.slow
def test_a_shadow_that_stands_otherwise_than_it_did_is_refused_at_start_up(kept: Path, tmp_path: Path) -> None:
    """Calibrated 6 counts apart; now the two say the same: 6 counts are harmless, but 12 are more than were allowed."""
    found = load_arm(kept)
    elbow = found.joints["elbow"]
    file = tmp_path / "arm.toml"
    for counts, refused in ((6, False), (12, True)):
        joints = {**found.joints, "elbow": replace(elbow, shadow=counts * 2.0 * np.pi / 4096.0)}
        save_arm(file, replace(found, joints=joints), replace=True)
        run = wanted(file, tmp_path / "new.toml")
        if refused:
            with (
                pytest.raises(HighFiveError, match="12 when they were calibrated: a horn has slipped"),
                room(run, BEFORE),
            ):
                pass
        else:
            with room(run, BEFORE):
                pass


def test_what_is_refused_says_that_its_poses_are_still_there(tmp_path: Path) -> None:
    """Else a marker would be glued, and the poses of before taken for those after."""
    poses = tmp_path / "arm.pairs.json"
    for there in (False, True):
        with pytest.raises(HighFiveError) as refused, kept_where_refused(poses):
            raise HighFiveError("no arm fits")
        assert (f"the poses are kept in {poses}, and the same command goes on" in str(refused.value)) is there
        poses.write_text("{}")


def test_torque_hides_how_shadows_stand(kept: Path, tmp_path: Path) -> None:
    run = wanted(kept, tmp_path / "new.toml")
    with VirtualClock(1) as clock:
        wiring = VirtualRig(clock, hidden_bus(BEFORE, load_rig())[0]).wiring
        with opened(PATH, run.rig, wiring) as line:
            line.write(4, "torque_enable", 1)
        with pytest.raises(HighFiveError, match="servo 4: torque is on, and shadows are looked at without"):
            shadows_of(run, PATH, wiring)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"source": "people.c3d"}, "expected a motion capture system"),
        ({"source": "qtm://cameras"}, "--source is a qtm system"),
        ({"pairs": 3}, "--pairs 3; expected 6 to 60"),
        ({"out": Path("arm.json")}, "write it as arm.toml"),
        ({"arm": ArmOptions("virtual", slow=True)}, "run highfive calibrate extrinsics first"),
        ({"arm": ArmOptions("/dev/ttyUSB99", slow=True)}, "only with --arm"),
    ],
)
def test_what_cannot_be_used_is_said_before_anything_is_opened(kept: Path, changes: dict, says: str) -> None:
    given = {"arm": ArmOptions("virtual", slow=True, calibration=kept), "source": "vicon://cameras"}
    given |= {"out": kept.with_name("not_there.toml")} | changes
    with pytest.raises(HighFiveError) as error:
        checked_servos(ServoOptions(**given))
    assert says in str(error.value)


def test_rig_check_looks_at_the_calibration_too(tmp_path: Path) -> None:
    file, rig = tmp_path / "arm.toml", load_rig()
    found = kept_arm()
    room_now = replace(found.registration, arm=fingerprint(rig), date=datetime.now(UTC))
    mount = find_arm().mount
    good = replace(
        found, registration=room_now, mount=np.array(mount.position), mount_rotation=np.array(mount.quaternion)
    )
    for arm, says in (
        (good, ""),
        (replace(good, registration=replace(good.registration, arm="f" * 12)), "another arm"),
    ):
        file.write_text(arm_text(arm))
        with VirtualClock(1) as clock:
            bus, _ = hidden_bus(BEFORE, rig)
            result = check(PATH, None, VirtualRig(clock, bus).wiring, calibration=file)
        assert result["calibration"]["joints"]["elbow"]["friction_Nm"] == 0.25
        assert says in " ".join(result["troubles"])
        assert result["ready"] is (says == ""), result["troubles"]
        firsts = {servo["joint"]: servo["angle_deg"] for servo in result["servos"]}
        rest = dict(zip(firsts, np.degrees(load_limits().way_points[-1]), strict=True))
        assert all(abs(firsts[joint] - rest[joint]) < 5.0 for joint in rest)  # it rests, and its zeros are off


def test_what_is_within_its_error_is_said_to_be_so_and_nothing_is_minus_nothing() -> None:
    old = CalibratedJoint(np.radians(0.5), 0.0, 0.0, np.zeros(3), np.zeros(3))
    near = replace(old, zero=np.radians(0.52), play=-1e-9)
    errors = np.array([np.radians(0.05), 1e-4, np.radians(0.05)])
    assert _changes("waist", old, near, errors) == ["waist: zero 0.50° -> 0.52°, which is within its error"]
    assert _changes("waist", old, replace(old, zero=np.radians(0.7)), errors) == ["waist: zero 0.50° -> 0.70°"]
