"""XDF: what was written is read, clocks that drift are followed, what is damaged is one line or read up to there."""

from pathlib import Path

import numpy as np
import pytest
from helpers.xdf_by_the_format import Written, write_xdf, xdf

from highfive.mocap_bridge.files.xdf import named, read_xdf
from highfive.model.errors import HighFiveError

NUMBERS = [(10.0 + 0.01 * n if n % 5 == 0 else None, (0.5 * n, -1.0 * n)) for n in range(300)]
STREAMS = (
    Written("EEG", "EEG", 100.0, "float32", NUMBERS, labels=("Fz", "Cz")),
    Written("Counts", "Misc", 100.0, "int16", [(1.0 * n, (n,)) for n in range(10)]),
    Written("Words", "Markers", 0.0, "string", [(2.5, ("one",)), (3.5, ("zwei äö" * 60,)), (9.0, ("",))]),
    Written("Silent", "Misc", 0.0, "double64", []),
)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    eeg, counts, words, silent = read_xdf(write_xdf(tmp_path / "a.xdf", STREAMS))
    np.testing.assert_allclose(eeg.stamps, 10.0 + 0.01 * np.arange(300), atol=1e-9)  # also those left out
    np.testing.assert_allclose(eeg.values, [values for _, values in NUMBERS])
    assert (eeg.labels, eeg.rate_hz, eeg.kind) == (("Fz", "Cz"), 100.0, "EEG")
    assert counts.values[:, 0].tolist() == list(range(10)) and counts.labels == ("1",)
    assert words.texts == (("one",), ("zwei äö" * 60,), ("",)) and words.stamps.tolist() == [2.5, 3.5, 9.0]
    assert len(silent.stamps) == 0 and silent.on_recorder_clock(np.array([3.0])).tolist() == [3.0]


@pytest.mark.parametrize("seed", range(4))
def test_a_clock_that_drifts_and_is_set_is_followed_beside_measurements_that_are_off(seed: int, tmp_path: Path) -> None:
    """50 ppm over an hour, set back by five minutes in the middle; a measurement in 20 is off by up to 40 ms."""
    rng = np.random.default_rng(seed)
    true = np.arange(0.0, 3600.0, 5.0)  # by the recorder's clock

    def theirs(at: np.ndarray) -> np.ndarray:
        return 1000.0 + at * (1.0 + 50e-6) - np.where(at > 1800.0, 300.0, 0.0)

    off = rng.normal(0.0, 3e-4, len(true)) + np.where(
        rng.random(len(true)) < 0.05, rng.uniform(0, 0.04, len(true)), 0.0
    )
    offsets = [(float(t), float(o)) for t, o in zip(theirs(true), true - theirs(true) + off, strict=True)]
    made = Written("EEG", "EEG", 0.0, "double64", [(0.0, (0.0,))], offsets)
    (stream,) = read_xdf(write_xdf(tmp_path / "a.xdf", [made]))
    early, late = rng.uniform(0.0, 1500.0, 200), rng.uniform(2200.0, 3600.0, 200)
    found = stream.on_recorder_clock(theirs(early))
    assert np.abs(found - early).max() < 2e-4
    assert len(stream.offsets) == len(true)
    # Stamps of after the clock was set say the same times as some before it: those of the file's end are told apart.
    last = theirs(late)
    told_apart = last > stream.offset_times[len(true) // 2 - 1]
    assert np.abs(stream.on_recorder_clock(last[told_apart]) - late[told_apart]).max(initial=0.0) < 2e-4


def test_times_that_no_clock_says_move_no_others(tmp_path: Path) -> None:
    offsets = [(1.0, 0.5), (2.0, 0.5), (1.2e308, 1.2e308), (-1.7e308, 0.5), (3.0, -1e300), (4.0, 0.5)]
    made = Written("EEG", "EEG", 0.0, "double64", [(0.0, (0.0,)), (1.5e308, (0.0,))], offsets)
    (stream,) = read_xdf(write_xdf(tmp_path / "a.xdf", [made]))
    assert stream.offsets.tolist() == [0.5, 0.5, 0.5]
    np.testing.assert_allclose(stream.on_recorder_clock(stream.stamps), [0.5, 1.5e308])


def test_a_recorder_that_was_killed_leaves_what_it_had_written(tmp_path: Path) -> None:
    whole = xdf(STREAMS)
    path, before = tmp_path / "a.xdf", 0
    for cut in range(700, len(whole), 97):
        path.write_bytes(whole[:cut])
        found = read_xdf(path)
        count = sum(len(stream.stamps) for stream in found)
        assert count >= before
        before = count
    assert before >= 300


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is no XDF file"),
        (b"C3D!" + bytes(100), "is no XDF file"),
        (b"XDF:" + b"\x07", "its first chunk has no length"),
        (xdf(STREAMS).replace(b"float32", b"float99"), "stream 1: its channels are of format 'float99'"),
        (xdf(STREAMS).replace(b"<channel_count>2<", b"<channel_count>0<"), "stream 1: it has 0 channels"),
        (xdf(STREAMS).replace(b"<info><name>EEG", b"<info<<name>EEG"), "stream 1"),
        (xdf(STREAMS).replace(b'?xml version="1.0"?>', b"!DOCTYPE x []>      "), "none that"),
    ],
)  # fmt: skip
def test_what_is_damaged_is_one_line(content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "a.xdf"
    path.write_bytes(content)
    with pytest.raises(HighFiveError, match=says) as told:
        read_xdf(path)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("seed", range(3))
def test_bytes_that_flip_are_read_or_one_line(seed: int, tmp_path: Path) -> None:
    whole, rng, path = xdf(STREAMS), np.random.default_rng(seed), tmp_path / "a.xdf"
    for _ in range(100):
        content = bytearray(whole)
        for place in rng.integers(4, len(whole), 3):
            content[place] = rng.integers(256)
        path.write_bytes(bytes(content))
        try:
            read_xdf(path)
        except HighFiveError as error:
            assert "\n" not in str(error)


def test_a_stream_is_found_by_its_name(tmp_path: Path) -> None:
    path = write_xdf(tmp_path / "a.xdf", STREAMS)
    assert named(read_xdf(path), "Words", path).kind == "Markers"
    with pytest.raises(HighFiveError, match="has no stream Gaze; there are EEG, Counts, Words, Silent"):
        named(read_xdf(path), "Gaze", path)
    with pytest.raises(HighFiveError, match="cannot read"):
        read_xdf(tmp_path / "absent.xdf")
