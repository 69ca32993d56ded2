"""What a plug-in may hand over as a frame, and as a rate, and what it is told otherwise."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.frame_check import check_frame, checked_rate
from highfive.model.errors import HighFiveError

GOOD = MarkerFrame(("A", "B"), np.ones((2, 3)), np.ones(2, dtype=bool), 1, 2, 3, np.zeros((0, 3)))


def with_change(**change: object) -> MarkerFrame:
    """As whoever does not check its own values builds it: the tests' own check of shapes would refuse some."""
    frame = replace(GOOD)
    for name, value in change.items():
        object.__setattr__(frame, name, value)
    return frame


def test_a_frame_as_it_has_to_be() -> None:
    check_frame(GOOD, "lab")
    check_frame(replace(GOOD, unlabelled=np.ones((4, 3)), covariance=np.ones((2, 3, 3))), "lab")
    check_frame(replace(GOOD, positions=np.full((2, 3), np.nan)), "lab")  # masked later
    check_frame(with_change(number=np.int64(4), positions=np.ones((2, 3), dtype=int)), "lab")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"names": ["A", "B"]}, "names that are not a tuple of strings: "),
        ({"names": ("A", 2)}, "names that are not a tuple of strings: "),
        ({"number": 1.5}, "number 1.5; expected a whole number"),
        ({"source_time_ns": None}, "source_time_ns None; expected a whole number"),
        ({"latency_ns": True}, "latency_ns True; expected a whole number"),
        ({"positions": np.ones((3, 2))}, r"positions of shape \(3, 2\); expected \(2, 3\)"),
        ({"positions": [[1.0] * 3] * 2}, r"positions of type list; expected an array of floats of shape \(2, 3\)"),
        ({"positions": np.array([["1"] * 3] * 2)}, r"positions of type <U1; expected an array of floats"),
        ({"positions": np.ones((2, 3), dtype=complex)}, "positions of type complex128"),
        ({"valid": np.ones(2)}, r"valid of type float64; expected an array of booleans of shape \(2,\)"),
        ({"valid": np.ones(3, dtype=bool)}, r"valid of shape \(3,\)"),
        ({"unlabelled": None}, r"unlabelled of type NoneType; expected an array of floats of shape \(0, 3\)"),
        ({"unlabelled": np.zeros(3)}, r"unlabelled of shape \(3,\); expected \(3, 3\)"),
        ({"unlabelled": np.full((1, 3), np.inf)}, "unlabelled points with NaN or infinity"),
        ({"covariance": np.ones((2, 3))}, r"covariance of shape \(2, 3\); expected \(2, 3, 3\)"),
    ],
)  # fmt: skip
def test_what_is_none_is_named_with_its_source_in_one_line(change: dict, says: str) -> None:
    with pytest.raises(HighFiveError, match=f"^lab gives {says}") as failure:
        check_frame(with_change(**change), "lab")
    assert "\n" not in str(failure.value)


def test_what_is_no_frame() -> None:
    with pytest.raises(HighFiveError, match="lab gives a NoneType; expected a MarkerFrame"):
        check_frame(None, "lab")


def test_rates() -> None:
    assert (checked_rate(0, "lab"), checked_rate(np.float32(100.0), "lab")) == (0.0, 100.0)


@pytest.mark.parametrize("rate", ["fast", np.nan, -5.0, True, None])
def test_what_is_no_rate(rate: object) -> None:
    with pytest.raises(HighFiveError, match=r"lab gives rate_hz .*; expected frames per second"):
        checked_rate(rate, "lab")
