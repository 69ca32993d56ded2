import itertools
import json
import os
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from simulated_reach import simulated_reach

from highfive.hil.bench import tracker as bench_tracker
from highfive.hil.bench import tracker_cases
from highfive.hil.bench.plain_filters import held, kalman
from highfive.hil.bench.protocols import ProtocolBenchOptions, bench_protocols
from highfive.hil.bench.tracker import TrackerBenchOptions, print_tracker_bench
from highfive.hil.bench.tracker_cases import HIDDEN_FRAMES, real_recording, simulated_arm
from highfive.hil.bench.tracking_baseline_models import biorbd_text, opensim_text, peer_model
from highfive.hil.bench.tracking_baseline_runs import follow, installed
from highfive.mocap_bridge.tracking.chain import make_chain, segment_order
from highfive.mocap_bridge.tracking.chain_kinematics import kinematics, on_segments
from highfive.mocap_bridge.tracking.first_pose import first_state
from highfive.model.errors import HighFiveError

PROTOCOLS = ("vicon", "qtm", "natnet", "lsl")


def silent(label: str, total: int):
    return lambda note="", done=None: None


@pytest.fixture(scope="module")
def small() -> dict:
    options = TrackerBenchOptions(seeds=1, seconds=4.0, high_fives=0, pairs=4, episodes=1)
    return json.loads(json.dumps(bench_tracker.bench_tracker(options, silent), allow_nan=False))


@pytest.mark.slow
def test_the_figures_that_are_requested_are_there(small: dict, capsys: pytest.CaptureFixture[str]):
    lost = small["lost_marker_rms_mm"]["simulated"]
    assert {"high_five", "high_five_calibrated", "constant_velocity", "constant_acceleration", "hold"} <= lost.keys()
    assert small["joint_rms_deg"].keys() == {"high_five", *small["peers"]}
    assert 0.0 < small["frame_ms"]["p50"] <= small["frame_ms"]["p99"]
    assert {"palm_jump_mm", "recovery_frames"} <= small["robustness"].keys()
    assert {"swap", "ghosts", "missing"} <= small["robustness"]["by_fault"].keys()
    print_tracker_bench(small)
    assert "high five" in capsys.readouterr().out


@pytest.mark.slow
def test_what_is_not_there_is_left_out_and_said_so(small: dict):
    assert "real" not in small["lost_marker_rms_mm"]
    assert "--real FILE.c3d" in small["real_advice"]
    missing = {"opensim", "biorbd"} - small["peers"].keys()
    assert not missing & small["lost_marker_rms_mm"]["simulated"].keys()
    assert all(name in small.get("peers_advice", "") for name in missing)


@pytest.mark.slow
def test_a_skeleton_is_worth_more_than_a_filter_and_a_filter_more_than_nothing(small: dict):
    lost = small["lost_marker_rms_mm"]["simulated"]
    assert max(lost, key=lost.__getitem__) == "hold"
    assert lost["high_five"] < 0.25 * lost["constant_velocity"]
    assert small["joint_rms_deg"]["high_five"] < 1.0
    assert small["robustness"]["palm_jump_mm"] < 20.0
    assert small["robustness"]["recovery_frames"] <= 5


def test_the_same_arm_comes_from_the_seed_and_only_hand_or_wrist_are_hidden():
    case, again, other = simulated_arm(3, 480), simulated_arm(3, 480), simulated_arm(4, 480)
    np.testing.assert_array_equal(case.measured, again.measured)
    assert np.abs(case.truth - other.truth).max() > 0.05
    hidden = {name for m, name in enumerate(case.marker_set.names) if case.hidden[:, m].any()}
    assert hidden == {"RFIN", "RMC5", "RWRA", "RWRB"}
    runs = [sum(1 for _ in run) for on, run in itertools.groupby(case.hidden[:, -1]) if on]
    assert runs == [HIDDEN_FRAMES] * len(runs)
    assert np.abs(case.measured - case.truth).std() < 0.002
    assert case.without_gaps().seen.all()


def test_the_peers_model_is_the_arm_that_was_simulated():
    case = simulated_arm(0, 240)
    assert [f"{case.peer.segments[s].removeprefix('right_')} {axis}" for s, axis, _ in case.peer.coordinates] == list(
        tracker_cases.ARM_COORDINATES
    )
    columns = case.marker_set.indices(case.peer.markers)
    assert case.coordinates is not None
    np.testing.assert_allclose(case.peer.marker_positions(case.coordinates), case.truth[:, columns], atol=1e-5)


def test_the_peers_model_is_the_trackers_chain():
    """A free base, one pose: the same markers as the tracker's own forward kinematics gives."""
    case = simulated_arm(1, 10)
    model = peer_model(case.marker_set, case.marker_set.names)
    chain = make_chain(case.marker_set)
    state = first_state(chain, tracker_cases.lifting(case.marker_set), case.truth[0], case.seen[0])
    assert state is not None
    pose, _ = kinematics(chain, chain.offsets, state.pose)
    start = tracker_cases.start_of(model, case.marker_set, pose.centres, pose.frames, pose.angles)
    assert len(start) == len(chain.kind)
    assert set(model.segments) == set(segment_order(case.marker_set))
    np.testing.assert_allclose(
        model.marker_positions(start[None])[0], on_segments(chain, pose, chain.places), atol=1e-9
    )


def test_the_models_are_files_that_their_programs_can_read():
    model = simulated_arm(0, 10).peer
    tree = ElementTree.fromstring(opensim_text(model))
    assert [node.get("name") for node in tree.iter("Marker")] == list(model.markers)
    assert [node.get("name") for node in tree.iter("Coordinate")] == [f"q{i}" for i in range(7)]
    text = biorbd_text(model)
    assert text.count("endsegment") == len(model.segments)
    assert text.count("technical 1") == len(model.markers)


def test_peers_find_the_arm_that_they_were_given():
    """With markers that fit exactly they find the coordinates, so the models are right. Needs opensim or biorbd."""
    python = Path(os.environ.get("HIGHFIVE_PEERS_PYTHON", sys.executable))
    found = installed(python)
    if not found:
        pytest.skip("neither opensim nor biorbd is installed here")
    case = simulated_arm(0, 240).without_gaps()
    exact = tracker_cases.replace(case, measured=case.truth)
    assert case.coordinates is not None
    for name in found:
        coordinates, took = follow(python, name, exact)
        assert np.degrees(np.abs(coordinates - case.coordinates)[60:]).max() < 0.5
        assert (took > 0.0).all()


def test_an_interpreter_that_is_none_is_reported():
    with pytest.raises(HighFiveError, match="--peers-python"):
        installed(Path("/no/python"))
    with pytest.raises(HighFiveError, match="--peers-python"):
        installed(Path("/bin/false"))


def test_plain_filters_follow_what_goes_on_as_they_expect():
    time = np.arange(120)[:, None, None] / 120.0
    points = np.concatenate([0.2 + 0.5 * time, 1.0 - 0.3 * time], axis=1) * np.ones(3)
    seen = np.ones((120, 2), dtype=bool)
    seen[80:110, 1] = False
    velocity = kalman(points, seen, 120.0, 2, 1.0, 1e-3)
    assert np.abs(velocity - points)[70:].max() < 2e-3
    squares = points + 2.0 * time**2
    assert np.abs(kalman(squares, seen, 120.0, 3, 10.0, 1e-3) - squares)[70:].max() < 1e-2
    np.testing.assert_array_equal(held(points, seen)[80:110, 1], np.tile(points[79, 1], (30, 1)))
    np.testing.assert_array_equal(held(points, seen)[:, 0], points[:, 0])


@pytest.mark.data
@pytest.mark.slow(15)
def test_the_real_recording_is_compared_where_it_was_left_out(recordings: Path):
    case = real_recording(recordings / "markers" / "85_12.c3d", frames=480)
    assert {name for m, name in enumerate(case.marker_set.names) if case.hidden[:, m].any()} == {
        "RWRA", "RWRB", "RFIN",
    }  # fmt: skip
    at_start = case.peer.marker_positions(case.start[None])[0] - case.truth[0]
    assert np.sqrt((at_start**2).sum(axis=1).mean()) < 0.03


def test_a_recording_that_is_of_no_use_is_reported_at_once(tmp_path: Path):
    simulated_reach(tmp_path / "short.c3d", frames=60)
    for path, said in ((tmp_path / "none.c3d", "no file"), (tmp_path / "short.c3d", "too short")):
        with pytest.raises(HighFiveError, match=said):
            bench_tracker.bench_tracker(TrackerBenchOptions(real=path), silent)


@pytest.mark.slow(25)
def test_every_protocol_is_measured():
    """That each brings every frame is tested where time decides nothing: with ``serve``, and with live sources."""
    result = json.loads(json.dumps(bench_protocols(ProtocolBenchOptions(seconds=2.0), silent), allow_nan=False))
    assert tuple(result["protocols"]) == PROTOCOLS
    for row in result["protocols"].values():
        assert row["frames"] >= row["tracked_frames"] > 0
        assert 0.0 < row["latency_ms"]["p50"] <= row["latency_ms"]["p99"] <= row["latency_ms"]["max"]
        assert 0.0 < row["slow_reader_age_ms"]["p50"] <= row["slow_reader_age_ms"]["max"]


def test_an_unknown_protocol_is_reported():
    with pytest.raises(HighFiveError, match="vicon, qtm, natnet, lsl"):
        bench_protocols(ProtocolBenchOptions(protocols=("vrpn",)), silent)
