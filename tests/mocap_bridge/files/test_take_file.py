"""Raw recordings: nothing that came is lost, and lost frames are gaps, so that time is right."""

from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from stamped_senders import send

from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.c3d_writer import write_frames
from highfive.mocap_bridge.files.take_file import NoFrames, TakeWriter, being_written, take_to_c3d
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.wire.lsl import FrameCounter
from highfive.model.errors import HighFiveError

POINTS = np.random.default_rng(0).uniform(0.1, 1.7, size=(4, 3))
NAMES = ("A:RFIN", "A:RMC5", "B:RFIN", "B:RMC5")


def frame(number: int, arrival_s: float, names: tuple[str, ...] = NAMES, loose: int = 0) -> MarkerFrame:
    order = [NAMES.index(name) for name in names]
    return MarkerFrame(
        names, POINTS[order], np.ones(len(names), dtype=bool), number, 0, round(arrival_s * 1e9), np.ones((loose, 3))
    )


def take(path: Path, frames: list[MarkerFrame], rate: float = 100.0) -> Path:
    writer = TakeWriter(path)
    writer.add(frames, rate)
    writer.close()
    return path


def test_lost_frames_are_gaps_and_late_ones_take_their_place(tmp_path: Path) -> None:
    numbers = [5, 6, 9, 8, 10, 10, 20]
    raw = take(tmp_path / "a.part", [frame(n, n / 100, loose=n % 3) for n in numbers])
    assert take_to_c3d(raw, tmp_path / "a.c3d") == (16, 6)
    recording = read_c3d(tmp_path / "a.c3d")
    assert recording.names == NAMES
    assert recording.rate_hz == 100.0
    assert np.flatnonzero(recording.valid.any(axis=1)).tolist() == [0, 1, 3, 4, 5, 15]
    assert np.allclose(recording.points[3], POINTS, atol=1e-6)
    assert recording.unlabelled_valid.sum(axis=1)[[0, 3, 15]].tolist() == [2, 2, 2]


def test_a_system_that_counts_anew_goes_on_at_the_time_of_arrival(tmp_path: Path) -> None:
    frames = [frame(1000 + k, k / 100) for k in range(50)] + [frame(k, 2.0 + k / 100) for k in range(50)]
    total, came = take_to_c3d(take(tmp_path / "a.part", frames), tmp_path / "a.c3d")
    assert (total, came) == (250, 100)
    wild = [frame(0, 0.0), frame(90_000, 0.01), frame(180_000, 0.02)]
    assert take_to_c3d(take(tmp_path / "b.part", wild), tmp_path / "b.c3d") == (3, 3)


@pytest.mark.parametrize("nominal_hz", [120.0, 0.0], ids=["nominal rate", "irregular"])
@pytest.mark.parametrize("true_hz", [113.0, 120.0])
@pytest.mark.parametrize(
    "case",
    [{"late": 1 / 30}, {"wander_s": 0.003}, {"late": 1 / 30, "wander_s": 0.003}, {"late": 1 / 30, "lost": 0.01}],
    ids=["late bursts", "drift", "both", "late bursts and losses"],
)
@pytest.mark.slow
def test_frames_that_are_stamped_and_not_counted_are_as_many_as_were_due(
    tmp_path: Path, nominal_hz: float, true_hz: float, case: dict[str, float]
) -> None:
    sent = send(5, true_hz, **case)
    counter = FrameCounter(nominal_hz)
    frames = [
        replace(
            frame(counter.next(stamp, stamp), stamp + 0.01),
            positions=POINTS + 1e-3 * (number % 97),
            source_time_ns=round(1e9 * stamp),
            counted=False,
        )
        for number, stamp in zip(sent.numbers.tolist(), sent.stamps.tolist(), strict=True)
    ]
    total, came = take_to_c3d(take(tmp_path / "a.part", frames, nominal_hz), tmp_path / "a.c3d")
    assert (total, came) == (sent.numbers[-1] + 1, len(sent.numbers))
    recording = read_c3d(tmp_path / "a.c3d")
    assert len(recording) / recording.rate_hz == pytest.approx(10.0, abs=1.0 / true_hz)
    shown = np.flatnonzero(recording.valid.any(axis=1))
    where = np.rint(1e3 * (recording.points[shown, 0, 0] - POINTS[0, 0]))
    assert np.array_equal(where, sent.numbers % 97)  # each in its turn
    late = round(1.0 + 0.025 * true_hz) if "late" in case else 0
    assert np.abs(shown - sent.numbers).max() <= late


def test_where_only_some_frames_are_stamped_the_numbers_hold(tmp_path: Path) -> None:
    frames = [replace(frame(n, n / 100), source_time_ns=1, counted=n > 2) for n in (0, 1, 2, 5)]
    assert take_to_c3d(take(tmp_path / "a.part", frames), tmp_path / "a.c3d") == (6, 4)


def test_markers_that_come_in_another_order_later_or_not_at_all(tmp_path: Path) -> None:
    frames = [frame(0, 0.0, NAMES[:2]), frame(1, 0.01, NAMES[::-1]), frame(2, 0.02, NAMES[1:3])]
    take_to_c3d(take(tmp_path / "a.part", frames), tmp_path / "a.c3d")
    recording = read_c3d(tmp_path / "a.c3d")
    seen = {name: recording.valid[:, m].tolist() for m, name in enumerate(recording.names)}
    assert seen["A:RFIN"] == [True, True, False]
    assert seen["A:RMC5"] == [True, True, True]
    assert seen["B:RMC5"] == [False, True, False]
    for m, name in enumerate(recording.names):
        assert np.allclose(recording.points[1, m], POINTS[NAMES.index(name)], atol=1e-6)


def test_what_was_cut_off_or_damaged_ends_the_recording_there(tmp_path: Path) -> None:
    whole = take(tmp_path / "whole.part", [frame(k, k / 100) for k in range(20)]).read_bytes()
    rng = np.random.default_rng(0)
    for k in range(300):
        raw = tmp_path / "cut.part"
        data = bytearray(whole[: rng.integers(0, len(whole))] if k % 2 else whole)
        if k % 2 == 0:
            data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        raw.write_bytes(data)
        try:
            total, came = take_to_c3d(raw, tmp_path / "cut.c3d")
            assert 1 <= came <= total <= 20
        except HighFiveError:
            pass
    with pytest.raises(NoFrames):
        take_to_c3d(take(tmp_path / "none.part", []), tmp_path / "none.c3d")
    assert not list(tmp_path.glob(".*"))


def test_a_file_that_is_being_written_is_known(tmp_path: Path) -> None:
    writer = TakeWriter(tmp_path / "a.part")
    assert being_written(tmp_path / "a.part")
    writer.close()
    assert not being_written(tmp_path / "a.part")
    with pytest.raises(HighFiveError, match="cannot record"):
        TakeWriter(tmp_path / "a.part")


@pytest.mark.parametrize(("count", "markers"), [(1, 1), (70_000, 3), (10, 600)])
def test_the_independent_library_reads_what_is_written(tmp_path: Path, count: int, markers: int) -> None:
    names = [f"human:marker{m}" for m in range(markers)]
    points = np.random.default_rng(0).uniform(0.1, 1.7, size=(markers, 3))
    seen = np.ones(markers, dtype=bool)
    seen[1:2] = False
    path = tmp_path / "a.c3d"
    write_frames(path, 119.5, names, count, ((points, seen) for _ in range(count)))
    other = ezc3d.c3d(str(path))
    assert other["data"]["points"].shape == (4, markers, count)
    assert other["parameters"]["POINT"]["RATE"]["value"][0] == 119.5
    assert np.allclose(other["data"]["points"][:3, 0, -1], points[0] * 1e3, atol=1e-3)
    ours = read_c3d(path)
    assert len(ours) == count
    assert list(ours.names) == names
    assert np.array_equal(ours.valid[-1], seen)
    with pytest.raises(HighFiveError):
        write_frames(path, 120.0, [], 1, ())
    with pytest.raises(HighFiveError, match="came"):
        write_frames(path, 120.0, names, 2, [(points, seen)])
