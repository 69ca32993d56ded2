from dataclasses import replace

import ezc3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.recording import make_recording, resample
from highfive.model.errors import HighFiveError

NAMES = ("human:RWRA", "human:RFIN", "avatar:RWRA")


def walk(frames=40, markers=3, seed=0, rate=120.0):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(scale=0.01, size=(frames, markers, 3)), axis=0) + rng.normal(size=(markers, 3))
    return make_recording(rate, NAMES[:markers], points, rng.random((frames, markers)) > 0.2)


@pytest.fixture(scope="module")
def small_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("c3d") / "small.c3d"
    write_c3d(path, walk(frames=5))
    return path.read_bytes()


@given(st.integers(1, 60), st.integers(0, 1000), st.integers(0, 3))
@settings(max_examples=25, deadline=None)
def test_what_was_written_is_read_again_to_single_precision(tmp_path_factory, frames, seed, ghosts):
    rng = np.random.default_rng(seed)
    recording = walk(frames, seed=seed)
    seen = rng.random((frames, ghosts)) > 0.5
    unlabelled = np.where(seen[..., None], rng.normal(size=(frames, ghosts, 3)), 0.0)
    recording = replace(recording, unlabelled=unlabelled, unlabelled_valid=seen)
    path = tmp_path_factory.mktemp("c3d") / "trial.c3d"
    if not recording.valid.any():
        return
    write_c3d(path, recording)
    again = read_c3d(path)
    assert again.names == recording.names
    assert again.rate_hz == recording.rate_hz
    np.testing.assert_array_equal(again.valid, recording.valid)
    np.testing.assert_array_equal(again.unlabelled_valid, recording.unlabelled_valid)
    np.testing.assert_allclose(again.points, recording.points, rtol=2e-7, atol=0)
    np.testing.assert_allclose(again.unlabelled, recording.unlabelled, rtol=2e-7, atol=0)


@pytest.mark.parametrize(("frames", "markers"), [(70_000, 1), (3, 300)])
def test_more_frames_or_labels_than_a_sixteen_or_eight_bit_count_holds(tmp_path, frames, markers):
    points = np.random.default_rng(0).normal(size=(frames, markers, 3)) + 3.0
    names = [f"human:m{i}" for i in range(markers)]
    recording = make_recording(120.0, names, points, np.ones((frames, markers), dtype=bool))
    write_c3d(
        tmp_path / "long.c3d",
        replace(recording, unlabelled=points[:, :1] + 1.0, unlabelled_valid=recording.valid[:, :1]),
    )
    again = read_c3d(tmp_path / "long.c3d")
    assert again.names == tuple(names)
    np.testing.assert_allclose(again.points, points, rtol=2e-7)


@pytest.mark.data
@pytest.mark.parametrize(
    "name", ["high_five/cmu_20_21_11_high_five", "markers/85_02", "markers/Movement_trial", "markers/markers_analogs"]
)
def test_the_reader_agrees_with_ezc3d_on_real_files(recordings, name):
    path = recordings / f"{name}.c3d"
    ours, peer = read_c3d(path), ezc3d.c3d(str(path))
    columns = [peer["parameters"]["POINT"]["LABELS"]["value"].index(label) for label in ours.names]
    theirs = peer["data"]["points"][:3, columns].transpose(2, 1, 0) / 1000.0
    residuals = peer["data"]["meta_points"]["residuals"][0, columns].T
    np.testing.assert_array_equal(ours.valid, np.isfinite(theirs).all(axis=-1) & (residuals >= 0))
    np.testing.assert_allclose(ours.points[ours.valid], theirs[ours.valid], atol=1e-12)
    assert ours.rate_hz == peer["parameters"]["POINT"]["RATE"]["value"][0]


@pytest.mark.data
def test_model_outputs_are_left_out_and_starred_labels_are_unlabelled(recordings):
    recording = read_c3d(recordings / "markers" / "Movement_trial.c3d")
    assert "LHipAngles" not in recording.names
    assert not any(name.startswith("*") for name in recording.names)
    assert recording.unlabelled.shape[1] > 0


def refusal(data: bytes, tmp_path) -> str:
    path = tmp_path / "bad.c3d"
    path.write_bytes(data)
    with pytest.raises(HighFiveError) as caught:
        read_c3d(path)
    message = str(caught.value)
    assert "\n" not in message
    assert "bad.c3d" in message
    return message


def test_every_truncation_is_refused_in_one_line(small_file, tmp_path):
    needed = read_length(small_file)
    for length in [*range(0, needed, 37), needed - 1]:
        refusal(small_file[:length], tmp_path)


def read_length(data: bytes) -> int:
    """Bytes up to the end of the last frame: the rest of the last block is padding."""
    start = (int.from_bytes(data[16:18], "little") - 1) * 512
    return start + 5 * 3 * 16


@pytest.mark.parametrize("region", [24, 512, 4096])
def test_damaged_bytes_give_a_recording_or_our_own_error(small_file, tmp_path, region):
    rng = np.random.default_rng(region)
    path = tmp_path / "mutant.c3d"
    refused = 0
    for _ in range(700):
        mutant = bytearray(small_file)
        for place in rng.integers(0, min(region, len(mutant)), size=rng.integers(1, 5)):
            mutant[place] = rng.integers(0, 256)
        path.write_bytes(mutant)
        try:
            recording = read_c3d(path)
        except HighFiveError as error:
            refused += 1
            assert "\n" not in str(error)
        else:
            assert np.isfinite(recording.points).all()
            assert recording.points.nbytes < 100 * len(small_file)
    assert refused > 0


def rewritten(tmp_path, points, unit="mm", labels=NAMES) -> bytes:
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["RATE"]["value"] = [120.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(labels)
    homogeneous = np.ones((4, points.shape[1], len(points)))
    homogeneous[:3] = points.transpose(2, 1, 0)
    file["data"]["points"] = homogeneous
    file.write(str(tmp_path / "made.c3d"))
    return (tmp_path / "made.c3d").read_bytes()


def test_metres_and_millimetres_mean_the_same(tmp_path):
    points = walk().points + 1.0
    (tmp_path / "m.c3d").write_bytes(rewritten(tmp_path, points, "m"))
    (tmp_path / "mm.c3d").write_bytes(rewritten(tmp_path, points * 1e3, "mm"))
    np.testing.assert_allclose(read_c3d(tmp_path / "m.c3d").points, read_c3d(tmp_path / "mm.c3d").points, rtol=1e-6)


@pytest.mark.parametrize(("unit", "factor", "hint"), [("m", 1e3, "millimetres"), ("mm", 1.0, "metres")])
def test_a_body_of_the_wrong_magnitude_is_refused(tmp_path, unit, factor, hint):
    message = refusal(rewritten(tmp_path, (walk().points + 1.0) * factor, unit), tmp_path)
    assert hint in message
    assert "UNITS" in message


def test_bad_units_rates_and_labels_say_what_is_wrong(tmp_path):
    points = (walk().points + 1.0) * 1e3
    assert "'inch'" in refusal(rewritten(tmp_path, points, "inch"), tmp_path)
    for rate in (0.0, -1.0, np.nan, 1e9):
        whole = rewritten(tmp_path, points)
        assert "rate of" in refusal(whole.replace(np.float32(120).tobytes(), np.float32(rate).tobytes()), tmp_path)
    assert "no labels" in refusal(rewritten(tmp_path, points, labels=("*1", "*2", "*3")), tmp_path)
    assert "not one measured point" in refusal(rewritten(tmp_path, np.full_like(points, np.nan)), tmp_path)
    assert "empty" in refusal(b"", tmp_path)
    assert "not a C3D" in refusal(b"#!/bin/sh\n" * 100, tmp_path)


def test_missing_huge_and_other_paths_are_refused(tmp_path, small_file):
    with pytest.raises(HighFiveError, match="no file"):
        read_c3d(tmp_path / "absent.c3d")
    with pytest.raises(HighFiveError, match="not a file"):
        read_c3d(tmp_path)
    (tmp_path / "huge.c3d").write_bytes(small_file)
    with pytest.raises(HighFiveError, match="more than the limit"):
        read_c3d(tmp_path / "huge.c3d", max_bytes=100)


def test_a_failed_write_leaves_nothing_behind(tmp_path):
    with pytest.raises(HighFiveError, match="cannot write"):
        write_c3d(tmp_path / "no_such_folder" / "trial.c3d", walk())
    (tmp_path / "taken.c3d").mkdir()
    with pytest.raises(HighFiveError, match="cannot write"):
        write_c3d(tmp_path / "taken.c3d", walk())
    with pytest.raises(HighFiveError, match="cannot write"):
        write_c3d(tmp_path / "trial.c3d", replace(walk(), rate_hz=0.0))
    assert [p.name for p in tmp_path.iterdir()] == ["taken.c3d"]


def test_persons_are_chosen_by_prefix():
    recording = walk()
    human = recording.person("human:")
    assert human.names == ("RWRA", "RFIN")
    np.testing.assert_array_equal(human.points, recording.points[:, :2])
    assert recording.person("avatar").person().names == ("RWRA",)
    with pytest.raises(HighFiveError, match=r"no labels of 'Bob'.*human, avatar"):
        recording.person("Bob")
    with pytest.raises(HighFiveError, match="several persons"):
        recording.person()


def test_resampling_is_exact_on_parabolas_and_keeps_gaps():
    times = np.arange(50) / 100.0
    points = np.stack([2.0 + times, times**2, 1.0 - 3.0 * times**2], axis=-1)[:, None]
    valid = np.ones((50, 1), dtype=bool)
    valid[20:25] = False
    slow = make_recording(100.0, ["RFIN"], points, valid)
    fast = resample(slow, 120.0)
    at = np.arange(len(fast)) / 120.0
    truth = np.stack([2.0 + at, at**2, 1.0 - 3.0 * at**2], axis=-1)
    inside = fast.valid[:, 0] & (np.abs(at - 0.215) > 0.05) & (at > 0.01) & (at < 0.48)
    np.testing.assert_allclose(fast.points[inside, 0], truth[inside], atol=1e-12)
    assert not fast.valid[(at > 0.1901) & (at < 0.2499), 0].any()
    assert resample(fast, 120.0) is fast
