"""Motion capture and whole chain, at the wire: cameras whose age nobody reads, and a wand that an arm follows."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hidden_calibration import hidden_calibration

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.chirp import ChirpSettings
from highfive.hil.arm.arm_files import limits_of
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.calibrated import known_arm
from highfive.hil.arm.driven_arm import virtual_driven_arm
from highfive.hil.arm.hidden_arm import drawn_truth
from highfive.hil.arm.hidden_rig import hidden_bus
from highfive.hil.arm.mocap_lags import MocapDelay, angles_seen, together
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.servo_lags import PlateSeen, lead_along, servo_lags
from highfive.hil.arm.session_check import plate_of
from highfive.hil.arm.wand_lag import follow_wand
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.bench.late_camera import WAND, LateCamera
from highfive.hil.commands.calibrate_latency import LatencyOptions, calibrate_latency, plate_seen, seen_lags
from highfive.hil.commands.live_session import late_by
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.plate_wiring import camera_wiring
from highfive.mocap_bridge.files.recording import EVERYBODY
from highfive.model.errors import HighFiveError

TRUTH = drawn_truth(41)
AGE_S, JITTER_S = 0.0113, 0.0004


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> ArmCalibration:
    return hidden_calibration(TRUTH, tmp_path_factory.mktemp("arm") / "arm.toml")


@dataclass
class Room:
    """All that takes part."""

    drive: PostureDrive
    body: ServoArm
    plate: PlateSeen
    camera: LateCamera
    options: LatencyOptions
    clock: VirtualClock
    hand: list[float]


@contextmanager
def room(found: ArmCalibration) -> Iterator[Room]:
    """The hidden arm, its cameras, and somebody with a wand, who begins when she is told to."""
    hand = [np.inf]

    def wand(seconds: float) -> np.ndarray:
        t = max(0.0, seconds - hand[0])
        return np.array([2.5, 0.022 * np.sin(2.5 * t) + 0.006 * np.sin(6.9 * t), 1.3])

    arm = ArmOptions("virtual", slow=True, calibration=found.registration.path)
    options, body = LatencyOptions(arm, "vicon://cameras", WAND), known_arm(find_arm(), found)
    with VirtualClock(5) as clock:
        bus, plant = hidden_bus(TRUTH, load_rig())
        rig = VirtualRig(clock, bus)
        camera = LateCamera(clock, TRUTH, (rig, plant), AGE_S, JITTER_S, wand=wand)
        with closing(live_source("vicon://cameras", EVERYBODY, camera_wiring(clock, camera))) as source:
            source.first()
            plate = plate_seen(options, source, found, load_rig(), clock)
            watch = PlateWatch(source, plate_of(found), clock)
            with virtual_driven_arm(rig, arm, body, watch.in_the_way) as drive:
                yield Room(drive, body, plate, camera, options, clock, hand)


def told(at: Room, line: str) -> None:
    assert WAND in line
    at.hand[0] = 1e-9 * at.clock.now() - 1.0


@pytest.mark.slow(30)
def test_parts_and_whole_are_found_and_a_stream_that_changed_is_refused(kept: ArmCalibration) -> None:
    with room(kept) as at:
        limits = limits_of(find_arm())
        joints = find_arm().names[:3]
        settings = ChirpSettings(seconds=6.0)
        led = lead_along(at.drive, at.body, limits, joints, settings=settings, frames=at.plate.frames)
        lags = servo_lags(led, at.body, limits, at.plate, load_rig().reply_s)
        assert set(at.plate.delays) == set(joints) == set(lags)
        found = seen_lags(at.plate, follow_wand(at.drive, at.body, limits, at.plate, lambda line: told(at, line)))
        assert found.mocap.age == pytest.approx(AGE_S + JITTER_S, abs=0.002)
        assert 0.0 < found.mocap.age - found.mocap.late < 0.001  # the least that a frame takes is not seen by a session
        assert found.whole is not None and found.whole.followed == "waist"
        assert abs(found.whole.disagreement) < 0.002
        assert set(found.kept) == {"mocap_age_s", "mocap_late_s", "host_s", "end_to_end_s"}
        at.hand[0], at.camera.age_s = np.inf, AGE_S + 0.006
        with pytest.raises(HighFiveError, match="motion capture's delay changed between the two"):
            seen_lags(at.plate, follow_wand(at.drive, at.body, limits, at.plate, lambda line: told(at, line)))


@pytest.mark.slow
def test_a_wand_that_nobody_moves_is_said(kept: ArmCalibration) -> None:
    with room(kept) as at:
        at.plate.delays |= {name: MocapDelay(0.01, 0.01, 1e-3) for name in "abc"}
        with pytest.raises(HighFiveError, match="it has to go to and fro"):
            seen_lags(at.plate, follow_wand(at.drive, at.body, limits_of(find_arm()), at.plate, lambda _: None))


def test_an_angle_is_seen_whatever_markers_are_hidden() -> None:
    """Markers on circles about an axis, each with a place and a radius of its own; half of the looks are lost."""
    rng = np.random.default_rng(0)
    angles = 0.08 * np.sin(np.linspace(0.0, 20.0, 400))
    centres, turned = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    way = np.cross([0.0, 0.0, 1.0], turned)
    markers = centres + turned + angles[:, None, None] * way
    markers[rng.random((400, 5)) < 0.5] = np.nan
    found = angles_seen(markers, way)
    seen = np.isfinite(markers).all(axis=2).any(axis=1)
    assert (np.isfinite(found) == seen).all()
    off = found[seen] - angles[seen]
    assert float(np.std(off)) < 0.01


@pytest.mark.parametrize(
    ("ages", "says"), [((0.01, 0.011), "2 joints move the plate"), ((0.01, 0.011, 0.016), "than for another by 6.0 ms")]
)
def test_joints_that_do_not_tell_are_refused(ages: tuple[float, ...], says: str) -> None:
    with pytest.raises(HighFiveError, match=says):
        together([MocapDelay(age, age, 2e-4) for age in ages])


def test_the_surer_joint_counts_more() -> None:
    found = together([MocapDelay(0.010, 0.010, 1e-4), MocapDelay(0.012, 0.012, 1e-3), MocapDelay(0.010, 0.010, 1e-4)])
    assert 0.010 < found.age < 0.0101 and found.error < 1e-3


@pytest.mark.parametrize(
    ("kept_s", "latency_ms", "ns"), [(0.0121, 0.0, 12_100_000), (0.0121, 20.0, 0), (-0.001, 0.0, 0)]
)
def test_a_session_makes_up_for_what_was_measured(
    kept: ArmCalibration, kept_s: float, latency_ms: float, ns: int
) -> None:
    found = replace(kept, latency={"mocap_late_s": kept_s})
    assert late_by(found, SimulateOptions(latency_ms=latency_ms)) == ns
    assert late_by(None, SimulateOptions()) == 0


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"wand": "wand"}, "give --source, too"),
        ({"source": "people.c3d"}, "expected a motion capture system"),
        ({"source": "qtm://cameras"}, "is of a vicon system"),
        ({"source": "vicon://cameras", "wand": "stalk"}, "is a marker of the plate"),
    ],
)
def test_bad_input_is_one_line_before_anything_moves(
    kept: ArmCalibration, tmp_path: Path, changes: dict[str, str], says: str
) -> None:
    file = kept.registration.path
    port = "virtual" if "source" not in changes else "/dev/ttyUSB99"
    arm = ArmOptions(port, slow=True, armed=True, calibration=None if port == "virtual" else file)
    with pytest.raises(HighFiveError, match=says):
        calibrate_latency(LatencyOptions(arm, out=tmp_path / "new.toml", **changes), lambda *_: lambda *_, **__: None)
