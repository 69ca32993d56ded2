"""An extrinsic calibration at the wire: a hidden arm, its driver, bus and servos in virtual time, and its cameras."""

import signal
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hidden_poses import postures, seen_poses
from kept_arm import kept_arm

from highfive.calibration.arm_file import load_arm, save_arm
from highfive.calibration.plate_template import template_text
from highfive.calibration.pose_file import TakenPose, load_poses
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.driven_arm import virtual_driven_arm
from highfive.hil.arm.extrinsics import check_directions
from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenTruth, drawn_truth
from highfive.hil.arm.hidden_rig import CameraFaults, PlateCamera, hidden_bus
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.posture_drive import PostureDrive, way_seconds
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.commands.calibrate_extrinsics import (
    Calibrated,
    ExtrinsicsOptions,
    calibrate_extrinsics,
    checked_extrinsics,
    fitted,
    measured,
    print_extrinsics,
)
from highfive.hil.commands.calibrate_servos import ServoOptions, calibrate_servos
from highfive.hil.commands.calibration_room import hidden_room
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.plate_wiring import camera_wiring
from highfive.mocap_bridge.files.recording import EVERYBODY
from highfive.model.errors import HighFiveError

READY = default_arm().ready

ARM = ArmOptions("virtual", slow=True)
TEXT = template_text(TEMPLATE)


def wanted(folder: Path, poses: int = 6) -> Calibrated:
    plate = folder / "plate.toml"
    plate.write_text(TEXT)
    return checked_extrinsics(ExtrinsicsOptions(ARM, "vicon://cameras", plate, poses, out=folder / "arm.toml"))


@contextmanager
def room(
    truth: HiddenTruth, faults: CameraFaults, *on_the_bus: str
) -> Iterator[tuple[PostureDrive, PlateWatch, VirtualClock]]:
    """The arm, ready, and who watches its plate."""
    with VirtualClock(truth.seed) as clock:
        bus, plant = hidden_bus(truth, load_rig())
        bus.set_faults(parse_faults(on_the_bus))
        camera = PlateCamera(clock, truth, plant, faults)
        with closing(live_source("vicon://cameras", EVERYBODY, camera_wiring(clock, camera))) as source:
            watch = PlateWatch(source, TEMPLATE, clock)
            with virtual_driven_arm(VirtualRig(clock, bus), ARM, default_arm(), watch.in_the_way) as drive:
                yield drive, watch, clock


def bar(*_: object):
    return lambda *_, **__: None


def test_ctrl_c_is_the_command_s_also_where_it_comes_upon_a_task_of_the_rehearsal() -> None:
    """The driver does not die of it: the arm is brought to rest."""
    came: list[str] = []
    with hidden_room(drawn_truth(0), ARM, TEMPLATE) as here, here.driven(default_arm()) as drive:
        clock = here.wiring.clock
        assert isinstance(clock, VirtualClock)

        def interrupted() -> None:
            signal.raise_signal(signal.SIGINT)
            came.append("upon the task, which goes on")

        task = clock.start("other", interrupted)
        with pytest.raises(KeyboardInterrupt):
            drive.tick(drive.positions)
        drive.tick(drive.positions)
        assert came and not task.alive and task.error is None


@pytest.mark.sweep
@pytest.mark.slow
def test_a_port_that_dies_half_way_is_gone_on_from(tmp_path: Path) -> None:
    run, truth = wanted(tmp_path, 10), drawn_truth(40)
    with pytest.raises(HighFiveError), room(truth, CameraFaults(), "unplug@55-600") as (drive, watch, _):
        measured(run, drive, watch, bar)
    before = load_poses(run.half_done, run.arm, TEMPLATE.names, 6)
    assert 0 < len(before) < 10
    with room(truth, CameraFaults()) as (drive, watch, _):
        poses = measured(run, drive, watch, bar)
    assert len(poses) == 10
    np.testing.assert_array_equal(poses[0].encoders, before[0].encoders)
    summary = fitted(run, poses, drive.moving_s)
    assert not run.half_done.exists()
    kept = load_arm(run.options.out)
    assert summary["poses"] == kept.registration.poses == 10
    assert np.linalg.norm(np.array(kept.mount)[:2] - default_arm().mount.position[:2]) < 1e-6


@pytest.mark.slow
def test_a_mirrored_stream_is_no_reversed_joint() -> None:
    """Who corrects a direction that is right turns a good arm into a bad one."""
    body = default_arm()
    with room(drawn_truth(40), CameraFaults(mirrored=True)) as (drive, watch, _):
        drive.go(body.ready)
        with pytest.raises(HighFiveError, match="seen as in a mirror") as refused:
            check_directions(drive, watch, drawn_shape(body, TEMPLATE.markers), body)
    assert "reversed" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "says"),
    [
        (CameraFaults(scale=1.03), r"the plate is seen 10[23]\.\d % as large as its template says"),
        (CameraFaults(up="y"), r"the arm seems to lean by (8|9)\d°.*z up"),
    ],
)
def test_a_stream_of_another_size_or_with_another_axis_up_is_refused(faults: CameraFaults, says: str) -> None:
    body = default_arm()
    with room(drawn_truth(40), faults) as (drive, watch, _):
        drive.go(body.ready)
        with pytest.raises(HighFiveError, match=says):
            check_directions(drive, watch, drawn_shape(body, TEMPLATE.markers), body)


def test_what_no_session_would_take_replaces_nothing(tmp_path: Path) -> None:
    """The base was moved by 2 cm between two halves: what is there stays, and so do the poses."""
    run, truth = wanted(tmp_path, 30), drawn_truth(40)
    run = replace(run, options=replace(run.options, overwrite=True))
    save_arm(run.options.out, replace(kept_arm(), registration=replace(kept_arm().registration, arm=run.arm)))
    before = run.options.out.read_bytes()
    taken: list[TakenPose] = []
    for half, moved in ((0, 0.0), (1, 0.02)):
        seen = seen_poses(replace(truth, base=truth.base + np.array([moved, 0.0, 0.0])), postures(30))
        rows = zip(seen.encoders, seen.encoders, seen.sides, seen.markers, seen.seen, strict=True)
        taken += [TakenPose(*row) for row in rows][half::2]
    run.half_done.write_text("poses")
    with pytest.raises(HighFiveError, match=r"arm\.toml stays as it was|residuals"):
        fitted(run, taken, 1.0)
    assert run.options.out.read_bytes() == before and run.half_done.exists()


@pytest.mark.slow
def test_somebody_who_steps_in_stops_the_arm_and_it_goes_on_once_she_is_gone(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level("INFO")
    with room(drawn_truth(41), CameraFaults(visitor=(6.0, 12.0))) as (drive, _, clock):
        drive.go(READY.copy())
        target = READY + np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0])
        begun = drive.moving_s
        places = []
        clock.start("look", lambda: places.extend(_looks(clock, drive)))
        drive.go(target)
        assert drive.moving_s - begun < 0.2 + way_seconds(default_arm(), READY, target)
        stood = [q for seconds, q in places if 7.0 < seconds < 12.0]
        assert len(stood) > 10
        assert max(float(np.abs(q - stood[0]).max()) for q in stood) < 0.005
        np.testing.assert_allclose(drive.positions, target, atol=0.02)
    assert [one.message for one in caplog.records if "waits" in one.message] == [
        "the arm waits: somebody is in the arm's way (RFIN)"
    ]


def _looks(clock: VirtualClock, drive: PostureDrive) -> list[tuple[float, np.ndarray]]:
    begun, found = clock.now() * 0 + 1_000_000_000, []
    while clock.now() < begun + 13_000_000_000:
        clock.wait_until(clock.now() + 100_000_000)
        found.append((1e-9 * (clock.now() - begun), drive.positions.copy()))
    return found


@pytest.mark.parametrize("same", [True, False])
def test_what_is_known_of_the_servos_is_kept_or_said_to_be_gone(
    tmp_path: Path, same: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    run, truth = wanted(tmp_path, 30), replace(drawn_truth(40), play=np.full(6, 0.002))
    before, now = kept_arm(), datetime.now(UTC)
    joints = {name: replace(joint, play=0.002) for name, joint in before.joints.items()}
    room = replace(before.registration, arm=run.arm if same else "f" * 12, date=now)
    save_arm(run.options.out, replace(before, registration=room, joints=joints, latency={"elbow_lag_s": 0.03}))
    run = replace(run, options=replace(run.options, overwrite=True))
    seen = seen_poses(truth, postures(30))
    rows = zip(seen.encoders, seen.encoders, seen.sides, seen.markers, seen.seen, strict=True)
    summary = fitted(run, [TakenPose(*row) for row in rows], 1.0)
    print_extrinsics(summary)
    said, found = capsys.readouterr().out, load_arm(run.options.out)
    assert len(found.poses) == 30
    assert float(np.sqrt(np.mean([p.residual**2 for p in found.poses]))) == pytest.approx(
        1e-3 * np.sqrt(3.0) * summary["residual_mm"], rel=0.25
    )  # of three axes together, and strays in full
    if same:
        assert found.joints["elbow"].play == 0.002 and found.joints["waist"].friction == 0.25
        assert found.latency == {"elbow_lag_s": 0.03} and summary["not_kept"] == []
        assert said.count("Kept of the calibration") == 2
    else:
        assert found.joints["elbow"].play == 0.0 and found.joints["waist"].friction is None and not found.latency
        assert f"highfive calibrate servos virtual --arm --source vicon://cameras --calibration {tmp_path}" in said
        assert f"highfive calibrate latency virtual --arm --calibration {tmp_path}" in said


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"source": "people.c3d"}, "expected a motion capture system"),
        ({"source": "webcam"}, "expected a motion capture system"),
        ({"poses": 9}, "--poses 9; expected 10 to 100"),
        ({"out": Path("arm.json")}, "write it as arm.toml"),
        ({"plate": Path("nowhere.toml")}, "cannot read the plate's template"),
        ({"arm": ArmOptions("/dev/ttyUSB99", slow=True)}, "only with --arm"),
        ({"plate": None}, "--plate: which file"),
        ({"source": None}, "--plate: a rehearsal has a plate of its own"),
        ({"source": None, "arm": ArmOptions("emulated", slow=True)}, "take virtual for the port"),
        ({"source": None, "arm": ArmOptions("virtual", slow=True, arm="koch_v1_1")}, "only of vx300s is it known"),
        ({"source": None, "arm": ArmOptions("/dev/ttyUSB99", armed=True, slow=True)}, "give --source"),
    ],
)
def test_what_cannot_be_used_is_said_before_anything_is_opened(tmp_path: Path, changes: dict, says: str) -> None:
    plate = tmp_path / "plate.toml"
    plate.write_text(TEXT)
    given = {"arm": ARM, "source": "vicon://cameras", "plate": plate, "out": tmp_path / "arm.toml"} | changes
    with pytest.raises(HighFiveError) as error:
        checked_extrinsics(ExtrinsicsOptions(**given))
    assert says in str(error.value)


@pytest.mark.slow(40)
def test_a_rehearsal_needs_neither_arm_nor_motion_capture_and_is_nothing_for_a_real_arm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "arm.toml"
    found = calibrate_extrinsics(ExtrinsicsOptions(ARM, None, None, 10, seed=3, out=out), bar)
    print_extrinsics(found)
    # Who rehearses is told what nobody knows of a real arm, and that is near what poses held out of the fit say.
    rehearsal = found["rehearsal"]
    assert rehearsal["hidden"]["zero_deg"]["shoulder"] == pytest.approx(np.degrees(drawn_truth(3).zero[1]), abs=0.01)
    assert rehearsal["truly_off_mm"]["p95"] < 4.0 and "where palms meet the plate is really" in capsys.readouterr().out

    calibrated = replace(ARM, calibration=out)
    assert check_options(calibrated)[1].joints[2].astray != 0.0
    with pytest.raises(HighFiveError, match="was rehearsed with an emulated arm"):
        check_options(replace(calibrated, port="/dev/ttyUSB99", armed=True, nobody_near=True))


@pytest.mark.sweep
@pytest.mark.slow(90)
def test_its_servos_are_rehearsed_too(tmp_path: Path) -> None:
    out = tmp_path / "arm.toml"
    calibrate_extrinsics(ExtrinsicsOptions(ARM, None, None, 10, seed=3, out=out), bar)
    servos = ServoOptions(replace(ARM, calibration=out), None, 6, seed=3, out=out, overwrite=True)
    assert calibrate_servos(servos, bar, lambda lines: True)["written"]
    assert load_arm(out).joints["elbow"].friction is not None
