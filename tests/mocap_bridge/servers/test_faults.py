"""Faults do what they say, when they say it, and the same for a seed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.faults import KINDS, Fault, Faults, parse_fault
from highfive.mocap_bridge.servers.serving import frames_of
from highfive.model.errors import HighFiveError

NAMES = ("human:RFIN", "human:RMC5", "human:RWRA", "human:RWRB")


def frames(count: int = 240, rate: float = 120.0) -> list[MarkerFrame]:
    points = np.random.default_rng(0).uniform(size=(count, len(NAMES), 3))
    return list(frames_of(make_recording(rate, NAMES, points, np.ones((count, len(NAMES)), dtype=bool))))


def sent(*texts: str, seed: int = 0) -> list[MarkerFrame]:
    faults = Faults([parse_fault(text) for text in texts], seed)
    return [changed for frame in frames() for changed in faults.of(frame)]


def times(frames: list[MarkerFrame]) -> np.ndarray:
    return np.array([frame.number for frame in frames]) / 120.0


def test_without_faults_frames_pass() -> None:
    for before, after in zip(frames(), sent(), strict=True):
        assert after.names == before.names
        assert np.array_equal(after.positions, before.positions)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_seed_gives_the_same_faults(seed: int) -> None:
    texts = ["occlusion=0.3", "ghosts=3", "reorder"]
    for one, other in zip(sent(*texts, seed=seed), sent(*texts, seed=seed), strict=True):
        assert one.names == other.names
        assert np.array_equal(one.valid, other.valid)
        assert np.array_equal(one.unlabelled, other.unlabelled)
    different = [f.valid for f in sent("occlusion=0.3", seed=seed + 1)]
    assert any(not np.array_equal(a, b.valid) for a, b in zip(different, sent("occlusion=0.3", seed=seed), strict=True))


def test_named_markers_are_hidden_in_their_time_alone() -> None:
    for frame, time in zip(shown := sent("occlusion=RFIN+RWRB@0.5-1"), times(shown), strict=True):
        hidden = 0.5 <= time < 1.0
        assert frame.valid.tolist() == [not hidden, True, True, not hidden]


def test_a_share_of_markers_is_hidden() -> None:
    assert 0.25 < 1.0 - np.mean([frame.valid for frame in sent("occlusion=0.3")]) < 0.35


def test_a_swap_keeps_labels_and_exchanges_points() -> None:
    for before, after in zip(frames(), sent("swap=human:RWRA+RFIN"), strict=True):
        assert after.names == before.names
        assert np.array_equal(after.positions[[2, 1, 0, 3]], before.positions)


def test_reordered_labels_keep_their_points() -> None:
    orders = set()
    for before, after in zip(frames(), sent("reorder"), strict=True):
        orders.add(after.names)
        where = dict(zip(after.names, after.positions, strict=True))
        assert all(np.array_equal(where[n], p) for n, p in zip(before.names, before.positions, strict=True))
    assert len(orders) > 5


def test_ghosts_numbers_and_units() -> None:
    assert all(frame.unlabelled.shape == (3, 3) for frame in sent("ghosts=3"))
    for frame in sent("nan=RFIN"):
        assert np.isnan(frame.positions[0]).all()
        assert frame.valid[0]
        assert np.isfinite(frame.positions[1:]).all()
    for before, after in zip(frames(), sent("metres"), strict=True):
        assert np.allclose(after.positions * 1e3, before.positions)


def test_a_gap_leaves_out_so_many_frames_and_their_numbers() -> None:
    numbers = [frame.number for frame in sent("gap=12@1")]
    assert numbers == [k for k in range(240) if not 120 <= k < 132]


@pytest.mark.parametrize("kind", ["stall", "disconnect"])
def test_nothing_comes_for_a_while(kind: str) -> None:
    assert [f.number for f in sent(f"{kind}@0.5-1")] == [k for k in range(240) if not 60 <= k < 120]
    faults = Faults([parse_fault("disconnect@0.5-1")])
    assert [faults.connected(round(t * 1e9)) for t in (0.0, 0.49, 0.5, 0.99, 1.0)] == [True, True, False, False, True]


def test_a_burst_loses_nothing_and_comes_at_once() -> None:
    faults = Faults([parse_fault("burst@0.5-1")])
    came = [faults.of(frame) for frame in frames()]
    assert [f.number for group in came for f in group] == list(range(240))
    assert max(len(group) for group in came) == 61
    assert all(not group for group in came[60:120])


@pytest.mark.parametrize(
    "text",
    [
        "", "flood", "occlusion", "stall=3", "occlusion=RFIN@2-1", "occlusion=1.5", "swap=RFIN", "ghosts=RFIN",
        "gap=-1", "nan=3", "occlusion=RFIN@a-b", "occlusion=RFIN@1.2.3", "ghosts=1e9", "gap=nan", "swap=RFIN+RFIN",
        "ghosts=5000", "burst@0",
    ],
)  # fmt: skip
def test_faults_that_are_none(text: str) -> None:
    with pytest.raises(HighFiveError) as error:
        parse_fault(text)
    assert "\n" not in str(error.value)


def test_markers_that_are_not_there() -> None:
    with pytest.raises(HighFiveError, match="LELB"):
        sent("occlusion=LELB")


@given(st.text(alphabet="abcdeghilmnoprstuw=+@-.0123456789R", max_size=30))
def test_any_text_is_a_fault_or_our_own_error(text: str) -> None:
    try:
        fault = parse_fault(text)
    except HighFiveError:
        return
    assert isinstance(fault, Fault)
    assert fault.kind in KINDS
    assert fault.start < fault.end
