"""BVH in: joints are where a reader that knows the format alone has them, whatever order a file has."""

from itertools import permutations

import numpy as np
import pytest
from bvh_by_the_format import read_bvh
from mutations import mutated

from highfive.mocap_bridge.files.bvh import parse_bvh
from highfive.model.errors import HighFiveError

ORDERS = ["".join(order) for order in permutations("XYZ")]


def made(order="ZXY", positions=False, frames=5, seed=0) -> str:
    """Two roots, a branch, end sites, and rotations of any size in an order."""
    turns = " ".join(f"{axis}rotation" for axis in order)
    six, inner = f"6 Xposition Yposition Zposition {turns}", f"3 {turns}"
    inner = six if positions else inner
    text = f"""HIERARCHY
ROOT A Hips
{{
  OFFSET 0 0 0
  CHANNELS {six}
  JOINT Spine {{
    OFFSET 0.5 10 0
    CHANNELS {inner}
    End Site
    {{
      OFFSET 0 3 0
    }}
  }}
  JOINT Leg
  {{
    OFFSET -4 -1 0
    CHANNELS {inner}
    End Site
    {{
      OFFSET 0 -40 2
    }}
  }}
}}
ROOT B
{{
  OFFSET 0 0 0
  CHANNELS {six}
  End Site
  {{
    OFFSET 1 2 3
  }}
}}
MOTION
Frames: {frames}
Frame Time: 0.0083333
"""
    values = np.random.default_rng(seed).uniform(-180.0, 180.0, (frames, 24 if positions else 18))
    return text + "\n".join(" ".join(f"{value:.6f}" for value in row) for row in values) + "\n"


@pytest.mark.parametrize("positions", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_places_are_those_of_an_independent_reader(order, positions, tmp_path):
    text, path = made(order, positions), tmp_path / "a.bvh"
    path.write_text(text.replace("A Hips", "A_Hips"))
    theirs = read_bvh(path).places()
    found = parse_bvh(text, "a.bvh")
    assert found.rate_hz == pytest.approx(120.0, abs=1e-2) and found.unit is None and found.centres
    assert set(found.names) == {name.replace("A_Hips", "A Hips") for name in theirs}
    for m, name in enumerate(found.names):
        np.testing.assert_allclose(found.points[:, m], theirs[name.replace(" ", "_")], atol=1e-9)


def test_a_frame_that_is_no_number_is_missing_from_there_on():
    lines = made(frames=3).splitlines()
    words = lines[-2].split()
    words[7] = "nan"  # of Spine
    lines[-2] = " ".join(words)
    found = parse_bvh("\n".join(lines), "a.bvh")
    missing = {name for m, name in enumerate(found.names) if np.isnan(found.points[1, m]).any()}
    assert missing == {"Spine_end"}
    assert np.isfinite(found.points[[0, 2]]).all()


TEXT = made()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (TEXT.replace("HIERARCHY", "HIER"), "is no BVH file"),
        (TEXT[:300], "is no BVH file, or cut off"),
        (TEXT[: TEXT.index("Frames:")], "after MOTION"),
        (TEXT.replace("Frames: 5", "Frames: 6"), "6 frames are announced, 5 are there"),
        (TEXT.replace("Frames: 5", "Frames: five"), "'five' is no number"),
        (TEXT.replace("Frame Time: 0.0083333", "Frame Time: 0"), "Frame Time is 0 s"),
        (TEXT[:-30], r"line \d+: \d+ values, its skeleton has 18 channels"),
        (TEXT.replace("CHANNELS 3", "CHANNELS 2", 1), "CHANNELS of Spine announces 2"),
        (TEXT.replace("Zrotation", "Wrotation", 1), "Wrotation"),
        (TEXT.replace("OFFSET 0.5 10 0", "OFFSET 0.5 10"), "the OFFSET of Spine has 2 numbers"),
        (TEXT.replace("OFFSET 0.5 10 0", ""), "Spine has no OFFSET"),
        (TEXT.replace("OFFSET 0.5 10 0", "OFFSET 0.5 nan 0"), "the OFFSET of Spine is 0.5 nan 0; expected three"),
        (TEXT.replace("JOINT Leg", "JOINT Spine"), "Spine, Spine_end there twice"),
        (TEXT.replace("JOINT Leg", "JOINT"), "a joint without a name"),
        (TEXT.replace("ROOT B", "JOINT B"), "'JOINT B' is out of place"),
        (TEXT.replace("JOINT Leg\n  {", "JOINT Leg\n"), "is out of place"),
        (TEXT.replace("ROOT B", "}\nROOT B"), "'}' is out of place"),
        (TEXT.replace("OFFSET 1 2 3\n  }\n}", "OFFSET 1 2 3\n  }\n"), "its skeleton is cut off"),
    ],
)
def test_what_contradicts_itself_is_one_line(text, says):
    with pytest.raises(HighFiveError, match=says) as error:
        parse_bvh(text, "a.bvh")
    assert str(error.value).startswith("a.bvh") and "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(3))
def test_damage_is_refused_or_read_but_nothing_else(seed):
    rng = np.random.default_rng(seed)
    for _ in range(200):
        text = bytes(mutated(TEXT.encode(), rng)).decode("latin-1")
        try:
            found = parse_bvh(text, "a.bvh")
        except HighFiveError:
            continue
        assert found.points.shape[1:] == (len(found.names), 3)
