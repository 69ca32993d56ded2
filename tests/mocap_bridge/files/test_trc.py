import numpy as np
import pytest
from any_bytes import a_hundred
from foreign_files import trc
from hypothesis import given
from hypothesis import strategies as st
from mutations import mutated

from highfive.mocap_bridge.files.trc import parse_trc
from highfive.model.errors import HighFiveError

RNG = np.random.default_rng(4)
NAMES = ("RSHO", "RELB", "human:R WRI")
POINTS = RNG.normal(0.0, 500.0, (20, 3, 3))
POINTS[4:9, 1] = np.nan
TEXT = trc(NAMES, POINTS, 100.0)


def test_reads_what_the_format_says():
    found = parse_trc(TEXT, "a.trc")
    assert (found.names, found.rate_hz, found.unit) == (NAMES, 100.0, "mm")
    np.testing.assert_allclose(found.points, POINTS, atol=1e-6)


@given(
    st.integers(2, 30),
    st.integers(1, 6),
    st.sampled_from([30.0, 59.94, 120.0, 250.0]),
    st.sampled_from(["m", "cm", "Meters"]),
)
def test_any_numbers_of_frames_and_markers(frames, markers, rate, unit):
    points = np.random.default_rng(frames).normal(size=(frames, markers, 3))
    found = parse_trc(trc([f"M{m}" for m in range(markers)], points, rate, unit), "a.trc")
    assert found.rate_hz == pytest.approx(rate, rel=1e-3) and found.unit == unit.lower().replace("meters", "m")
    np.testing.assert_allclose(found.points, points, atol=1e-6)


def test_a_lost_frame_is_missing_and_spaces_may_stand_for_tabs():
    whole = POINTS[:, :1]
    lines = trc(NAMES[:1], whole, 100.0).splitlines()
    del lines[6 + 7]
    text = "\n".join(lines).replace("\t20\t1\tmm", "\t19\t1\tmm")
    expected = whole.copy()
    expected[7] = np.nan
    np.testing.assert_allclose(parse_trc(text, "a.trc").points, expected, atol=1e-6)
    spaces = trc(NAMES[:1], whole, 100.0).replace("\t", " ")
    np.testing.assert_allclose(parse_trc(spaces, "a.trc").points, whole, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("Frame#\tTime\n" * 9, "is no TRC file"),
        ("PathFileType\n", "is no TRC file, or cut off"),
        (TEXT.replace("\t20\t3\tmm", "\t21\t3\tmm"), "NumFrames is 21, but it holds 20"),
        (TEXT.replace("\t20\t3\tmm", "\t20\t4\tmm"), "NumMarkers is 4, but 3 markers have names"),
        (TEXT.replace("\t20\t3\tmm", "\t20\tmany\tmm"), "NumMarkers: 'many' is no number"),
        (TEXT.replace("\t20\t3\tmm", "\t20\t3\tfeet"), "Units is 'feet'; expected one of mm, cm, m, in"),
        (TEXT.replace("\t20\t3\tmm", "\t20\t3\t"), "does not say Units"),
        (TEXT.replace("100.00\t100.00\t20", "50.00\t50.00\t20"), "DataRate is 50 Hz, but its times go on at 100 Hz"),
        (TEXT.replace("RELB", "RSHO"), "RSHO there twice"),
        (TEXT[:-40], r"line 26: \d+ values, expected 11"),
        (TEXT.replace("\n5\t0.040000", "\n5\t"), "the time is missing"),
        (TEXT.replace("\n5\t0.040000", "\n5\t0.020000"), "does not come after the one before"),
        (TEXT.replace("\n5\t0.040000", "\n5\tnever"), "'never' is no number"),
    ],
)
def test_what_contradicts_itself_is_one_line(text, says):
    with pytest.raises(HighFiveError, match=says) as error:
        parse_trc(text, "a.trc")
    assert str(error.value).startswith("a.trc") and "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(3))
def test_damage_is_refused_or_read_but_nothing_else(seed):
    rng = np.random.default_rng(seed)
    for _ in range(200):
        _tried(mutated(TEXT.encode(), rng))
    for junk in a_hundred(seed):
        _tried(b"PathFileType\n" + junk)


def _tried(data):
    text = bytes(data).decode("latin-1")
    try:
        found = parse_trc(text, "a.trc")
    except HighFiveError:
        return
    assert found.points.shape[1:] == (len(found.names), 3) and len(found.points) > 1
