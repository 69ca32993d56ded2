"""Files of motion that say more than they hold, or would take a reader for ever: one line, and soon."""

import json
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from highfive.mocap_bridge.files.bvh import MOST_JOINTS, parse_bvh
from highfive.mocap_bridge.files.c3d import layout_of, read_c3d, write_c3d
from highfive.mocap_bridge.files.marker_csv import parse_csv
from highfive.mocap_bridge.files.named_points import MOST_LINES, frames_of, read_text, unique
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.files.take_file import NoFrames, take_to_c3d
from highfive.mocap_bridge.files.xdf import read_xdf
from highfive.model.errors import HighFiveError


@pytest.fixture
def c3d(tmp_path: Path) -> Path:
    points = np.random.default_rng(0).normal(1.0, 0.3, (4, 3, 3))
    write_c3d(tmp_path / "a.c3d", make_recording(120.0, ("a", "b", "c"), points, np.ones((4, 3), bool)))
    return tmp_path / "a.c3d"


def test_a_signalling_nan_in_a_c3d_is_a_missing_point_without_a_warning(c3d: Path) -> None:
    content = bytearray(c3d.read_bytes())
    start = layout_of(bytes(content), "a").start
    content[start : start + 4] = bytes.fromhex("0100a07f")
    c3d.write_bytes(content)
    assert read_c3d(c3d).valid[0].tolist() == [False, True, True]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 3e38])
@pytest.mark.parametrize("name", [b"USED", b"DATA_START", b"FRAMES"])
def test_counts_of_a_c3d_that_are_no_numbers_are_refused(c3d: Path, name: bytes, value: float) -> None:
    content = bytearray(c3d.read_bytes())
    at = content.index(name) + len(name) + 2  # behind the name: two bytes to the next one, then kind and dimensions
    content[at : at + 6] = struct.pack("<bBf", 4, 0, value)
    c3d.write_bytes(content)
    if name == b"FRAMES" and not value < 1e39:  # then the header says it
        assert len(read_c3d(c3d)) == 4
        return
    with pytest.raises(HighFiveError):
        read_c3d(c3d)


def test_parameters_of_a_c3d_that_lie_in_each_other_end(tmp_path: Path) -> None:
    """Each record says that the next begins a byte further, and that it holds all of the file."""
    record = bytes([1, 1]) + b"A" + struct.pack("<h", 3) + bytes([1, 3, 200, 200, 200])
    content = bytearray(512) + bytes([1, 0x50, 0, 84]) + record * 400_000 + bytes(8_000_000)
    content[0], content[1] = 2, 0x50
    (tmp_path / "a.c3d").write_bytes(content)
    begun = time.process_time()
    with pytest.raises(HighFiveError):
        read_c3d(tmp_path / "a.c3d")
    assert time.process_time() - begun < 3.0


def test_a_skeleton_of_very_many_joints_is_refused() -> None:
    joints = "JOINT a{ OFFSET 0 0 0 }\n" * (MOST_JOINTS + 5)
    head = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n"
    text = f"{head}{joints}}}\nMOTION\nFrames: 2\nFrame Time: 0.01\n1\n1\n"
    with pytest.raises(HighFiveError, match="joints make no sense"):
        parse_bvh(text, "a.bvh")


def test_frames_times_channels_that_fit_nowhere_are_refused_before_room_is_made() -> None:
    channels = " ".join(["Xrotation"] * 100_000)
    head = f"HIERARCHY\nROOT r\n{{\nOFFSET 0 0 0\nCHANNELS 100000 {channels}\n}}\nMOTION\n"
    rows = "1\n" * 100_000
    with pytest.raises(HighFiveError, match="too many"):
        parse_bvh(f"{head}Frames: 100000\nFrame Time: 0.01\n{rows}", "a.bvh")


def test_a_hundred_thousand_names_are_compared_in_no_time() -> None:
    begun = time.process_time()
    assert len(unique([str(n) for n in range(200_000)], "a.csv")) == 200_000
    assert time.process_time() - begun < 2.0


def test_a_text_of_very_many_lines_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\r" * (MOST_LINES + 1) + b"a")
    with pytest.raises(HighFiveError, match="lines"):
        read_text(tmp_path / "a.csv")


def test_a_header_alone_is_refused() -> None:
    with pytest.raises(HighFiveError, match="0 frames"):
        parse_csv("time,a_x,a_y,a_z", "a.csv")


def chunk(tag: int, body: bytes) -> bytes:
    return b"\x04" + struct.pack("<IH", len(body) + 2, tag) + body


_HEADER = (
    b"<info><name>a</name><type>b</type><channel_count>1</channel_count><nominal_srate>100</nominal_srate>"
    b"<channel_format>%s</channel_format></info>"
)


@pytest.mark.parametrize("form", [b"float32", b"string"])
@pytest.mark.parametrize("body", [b"", b"\0", b"\x08", b"\0\x08", b"\0\x01\xff", b"\0" + b"\x08" + b"\xff" * 8])
def test_an_xdf_of_more_samples_than_its_chunk_holds_is_one_line(tmp_path: Path, form: bytes, body: bytes) -> None:
    samples = struct.pack("<I", 1) + b"\x08" + struct.pack("<Q", 2**63) + body
    content = b"XDF:" + chunk(2, struct.pack("<I", 1) + _HEADER % form) + chunk(3, samples)
    (tmp_path / "a.xdf").write_bytes(content)
    with pytest.raises(HighFiveError, match="damaged"):
        read_xdf(tmp_path / "a.xdf")


def block(kind: bytes, body: bytes) -> bytes:
    return struct.pack("<cII", kind, len(body), zlib.crc32(body)) + body


def frame(number: int, arrival_ns: int, points: int = 2) -> bytes:
    return block(b"F", struct.pack("<qqII", number, arrival_ns, points, 0) + bytes(12 * points))


NAMES = block(b"N", json.dumps({"rate_hz": 100.0, "names": ["a", "b"]}).encode())


@pytest.mark.parametrize(
    "blocks",
    [
        lambda: frame(2, 20_000_000, points=3),
        lambda: block(b"F", b"short"),
        lambda: block(b"S", b"short"),
        lambda: block(b"N", b"{"),
        lambda: block(b"N", b"[" * 100_000),
        lambda: block(b"N", b'{"names": [1, 2], "rate_hz": 3}'),
        lambda: block(b"N", b'{"names": ["a"], "rate_hz": 1e999}'),
        lambda: block(b"N", b'{"names": ["a", "a"], "rate_hz": 3}'),
    ],
)
def test_a_raw_take_is_read_up_to_what_is_no_block_of_ours(tmp_path: Path, blocks: Callable[[], bytes]) -> None:
    raw = tmp_path / "a.part"
    raw.write_bytes(b"HIGHFIVE TAKE 1\n" + NAMES + frame(0, 0) + frame(1, 10_000_000) + blocks() + frame(3, 30_000_000))
    assert take_to_c3d(raw, tmp_path / "a.c3d") == (2, 2)
    raw.write_bytes(b"HIGHFIVE TAKE 1\n" + blocks())
    with pytest.raises(NoFrames):
        take_to_c3d(raw, tmp_path / "b.c3d")


def test_a_raw_take_whose_frames_lie_years_apart_is_not_written_out(tmp_path: Path) -> None:
    raw = tmp_path / "a.part"
    raw.write_bytes(b"HIGHFIVE TAKE 1\n" + NAMES + frame(0, 0) + frame(1 << 60, 1 << 60))
    with pytest.raises(HighFiveError, match="apart"):
        take_to_c3d(raw, tmp_path / "a.c3d")
    assert not (tmp_path / "a.c3d").exists()


def test_a_gap_of_an_hour_in_a_raw_take_is_written_as_gaps(tmp_path: Path) -> None:
    raw = tmp_path / "a.part"
    raw.write_bytes(b"HIGHFIVE TAKE 1\n" + NAMES + frame(0, 0) + frame(360_000, 3_600_000_000_000))
    begun = time.process_time()
    assert take_to_c3d(raw, tmp_path / "a.c3d") == (360_001, 2)
    assert time.process_time() - begun < 3.0
    assert (tmp_path / "a.c3d").stat().st_size > 360_001 * 2 * 16


def test_a_step_of_time_that_no_quotient_holds_is_uneven() -> None:
    with pytest.raises(HighFiveError, match="uneven"):
        frames_of(np.array([0.0, 0.01, 0.02, 1e308]), "file")
