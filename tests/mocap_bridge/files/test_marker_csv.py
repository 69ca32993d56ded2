import numpy as np
import pytest
from foreign_files import table
from mutations import mutated

from highfive.mocap_bridge.files.marker_csv import parse_csv
from highfive.model.errors import HighFiveError

NAMES = ("head", "human:wrist")
POINTS = np.random.default_rng(5).normal(size=(12, 2, 3))
POINTS[3, 1] = np.nan
TEXT = table(NAMES, POINTS, 50.0)
HEADS = TEXT.splitlines()[0]


@pytest.mark.parametrize(("separator", "comma"), [(",", "."), (";", "."), (";", ","), ("\t", ".")])
def test_reads_any_separator(separator, comma):
    found = parse_csv(table(NAMES, POINTS, 50.0, separator, comma), "a.csv")
    assert (found.names, found.rate_hz, found.unit) == (NAMES, 50.0, None)
    np.testing.assert_allclose(found.points, POINTS, atol=1e-6)


@pytest.mark.parametrize(
    ("heads", "unit"),
    [
        ("t,wrist.x,wrist.y,wrist.z", None),
        ("Time,wrist X,wrist Y,wrist Z", None),
        ("timestamp,wristX,wristY,wristZ", None),
        ("time,wrist:x,wrist:y,wrist:z", None),
        ("time_s,wrist_x_mm,wrist_y_mm,wrist_z_mm", "mm"),
        ("time (s),wrist_x (cm),wrist_y (cm),wrist_z (cm)", "cm"),
        ("time,wrist_x [m],wrist_y [m],wrist_z [m]", "m"),
    ],
)
def test_habits_of_naming(heads, unit):
    found = parse_csv(heads + "\n0,1,2,3\n0.01,4,5,6\n", "a.csv")
    assert (found.names, found.unit, found.rate_hz) == (("wrist",), unit, 100.0)
    np.testing.assert_array_equal(found.points[:, 0], [[1, 2, 3], [4, 5, 6]])


def test_other_columns_are_left_alone_and_order_does_not_count():
    text = "trial,wrist_z,time_ms,max,wrist_x,phase,wrist_y\n0,3,0,9,1,reach,2\n0,6,10,9,4,reach,5\n"
    found = parse_csv(text, "a.csv")
    assert found.names == ("wrist",) and found.rate_hz == 100.0
    np.testing.assert_array_equal(found.points[:, 0], [[1, 2, 3], [4, 5, 6]])


def test_a_lost_frame_is_missing():
    lines = TEXT.splitlines()
    del lines[1 + 6]
    found = parse_csv("\n".join(lines), "a.csv")
    assert len(found.points) == 12 and np.isnan(found.points[6]).all()
    np.testing.assert_allclose(np.delete(found.points, 6, axis=0), np.delete(POINTS, 6, axis=0), atol=1e-6)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (TEXT.replace("time,", "frame,"), "no time column"),
        (TEXT.replace("time,head_x", "time,t"), "2 time columns"),
        ("time,a,b\n0,1,2\n1,2,3\n", "no points"),
        (TEXT.replace("head_y", "head_up"), "no column head_y"),
        (TEXT.replace("head_y", "head_x"), "column head_x twice"),
        (TEXT.replace("head_y", "head_y_mm"), "different units"),
        (HEADS, "holds 0 frames"),
        (HEADS + "\n0,1,2,3,4,5,6\n", "holds 1 frames"),
        (TEXT[:-30], r"row 13: \d cells, its header has 7; is it cut off\?"),
        (TEXT.replace("\n0.040000", "\n0.049000"), "times are uneven"),
        (TEXT.replace("\n0.040000", "\n"), "the time is missing"),
        (TEXT.replace("\n0.040000,", "\n0.040000,x"), "is no number"),
        ("time,trial,a_x,a_y,a_z\n0,0,1,2,3\n0.1,1,1,2,3\n", "holds 2 trials"),
        ("time,a_x,a_y,a_z\n0,1,2,3\n20,1,2,3\n40,1,2,3\n", "expected seconds"),
        ("time,a_x,a_y,a_z\n1,1,2,3\n1,1,2,3\n", "does not come after"),
    ],
)
def test_what_is_no_table_of_points_is_one_line(text, says):
    with pytest.raises(HighFiveError, match=says) as error:
        parse_csv(text, "a.csv")
    assert str(error.value).startswith("a.csv") and "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(3))
def test_damage_is_refused_or_read_but_nothing_else(seed):
    rng = np.random.default_rng(seed)
    for _ in range(200):
        text = bytes(mutated(TEXT.encode(), rng)).decode("latin-1")
        try:
            found = parse_csv(text, "a.csv")
        except HighFiveError:
            continue
        assert found.points.shape[1:] == (len(found.names), 3) and len(found.points) > 1
