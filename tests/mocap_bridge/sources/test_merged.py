"""Two systems on one person, each with its clock and place, in virtual time: one body, beside the true one."""

import logging
from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.trials.frame_link import FrameLink, SentFrames
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.address import open_source, parse_address
from highfive.mocap_bridge.sources.live import Link, LiveSource
from highfive.mocap_bridge.sources.marker_merge import MergeSettings, Seen, merge
from highfive.mocap_bridge.sources.merged_address import merged_part
from highfive.mocap_bridge.sources.scheme import Address
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

MS, S = 1_000_000, 1_000_000_000
NAMES = ("RWRA", "RWRB", "RFIN", "LFHD")
BOTH = "vicon://a+qtm://b?at=1.2,-0.4,0,90"
TURN, MOVED = rotations.from_axis_angle("z", np.pi / 2), np.array([1.2, -0.4, 0.0])


def truth(seconds: float) -> np.ndarray:
    """(4, 3) m: a hand that goes to and fro at up to 1.9 m/s and 12 m/s², and a head that stays."""
    x = 0.3 * np.sin(6.3 * seconds)
    return np.array([[x, 0.0, 1.2], [x, 0.05, 1.2], [x, 0.0, 1.32], [0.5, 0.0, 1.7]])


def frames(
    names: tuple[str, ...], rate: float, seconds: float, begins_ns: int, ppm: float, delay_ms: float,
    place: Callable[[np.ndarray], np.ndarray] = lambda points: points,
    hidden: Callable[[float], Sequence[int]] = lambda t: (),
) -> list[MarkerFrame]:  # fmt: skip
    """What a system sends: some of the markers, by its own clock and in its own frame; its latency is reported."""
    rng, rows = np.random.default_rng(round(rate)), [NAMES.index(name) for name in names]
    found = []
    for number, at in enumerate(np.arange(0.0, seconds, 1.0 / rate)):
        seen = np.ones(len(rows), dtype=bool)
        seen[list(hidden(at))] = False
        points = np.where(seen[:, None], place(truth(at)[rows]), 0.0)
        arrival = begins_ns + round(S * at + MS * (delay_ms + rng.exponential(0.2)))
        stamp = 77 * S + round(S * at * (1.0 + 1e-6 * ppm))
        labels = tuple(f"anna:{name}" for name in names)
        found.append(MarkerFrame(labels, points, seen, number, stamp, arrival, np.zeros((0, 3)),
                                 latency_ns=round(MS * delay_ms)))  # fmt: skip
    return found


def watched(
    first: Callable[[int], list[MarkerFrame]], second: Callable[[int], list[MarkerFrame]], seconds: float
) -> list[tuple[float, MarkerFrame]]:
    """Merged frames as they come, and when they were captured, s after the beginning."""
    with VirtualClock(3) as clock:
        begins = clock.now() + 50 * MS
        links: dict[str, Link] = {
            "vicon": FrameLink(clock, 120.0, SentFrames(first(begins))),
            "qtm": FrameLink(clock, 100.0, SentFrames(second(begins))),
        }  # fmt: skip

        def connects(address: Address) -> Callable[[], Link]:
            return lambda: links[address.scheme]

        source = open_source(BOTH, scheduler=VirtualScheduler(clock), connects=connects)
        assert isinstance(source, LiveSource)
        found, frame = [], None
        with closing(source):
            while clock.now() < begins + round(S * seconds):
                newer = source.wait(frame, 0.1)
                if newer is not None:
                    frame = newer
                    found.append((1e-9 * (source.captured(frame) - begins), frame))
            assert len(found) > 0
        return found


def there(points: np.ndarray) -> np.ndarray:
    """In the second system's own frame."""
    return rotations.rotate(rotations.conjugate(TURN), points - MOVED)


def test_two_systems_are_one_body_at_the_time_of_each_frame() -> None:
    found = watched(
        lambda t: frames(("RWRA", "RWRB"), 120.0, 6.0, t, 50.0, 4.0),
        lambda t: frames(("RWRB", "RFIN", "LFHD"), 100.0, 6.0, t, -80.0, 9.0, there),
        5.5,
    )
    late = [(at, frame) for at, frame in found if at > 2.0]
    assert len(late) > 0.95 * 3.5 * 120
    times = [frame.source_time_ns for _, frame in found]
    assert all(b > a for a, b in pairwise(times))
    numbers = [frame.number for _, frame in found]
    assert numbers == sorted(set(numbers))
    errors = []
    for at, frame in late:
        assert set(frame.names) == set(NAMES)
        assert frame.valid.all()
        errors.append(np.linalg.norm(frame.positions - truth(at)[[NAMES.index(n) for n in frame.names]], axis=1))
    assert np.percentile(errors, 95) < 0.0015
    assert np.max(errors) < 0.006
    spread = np.array([np.trace(frame.covariance[frame.names.index("RFIN")]) for _, frame in late])  # type: ignore[index]
    wrist = np.array([np.trace(frame.covariance[frame.names.index("RWRA")]) for _, frame in late])  # type: ignore[index]
    assert np.median(spread) > np.median(wrist)  # it is predicted, that one is measured


def test_where_one_system_dies_or_hides_a_marker_the_other_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        found = watched(
            lambda t: frames(("RWRA", "RWRB"), 120.0, 3.0, t, 50.0, 1.0),
            lambda t: frames(("RWRA", "RFIN"), 100.0, 6.0, t, 0.0, 1.0, there, lambda s: (0,) if s < 2.5 else ()),
            5.5,
        )
    for at, frame in found:
        seen = dict(zip(frame.names, frame.valid, strict=True))
        if at > 0.5:
            assert seen["RWRA"]
            assert seen["RFIN"]
        if at > 3.5:
            assert not seen["RWRB"]
    assert sum(at > 3.6 for at, _ in found) > 150
    assert sum("vicon://a" in record.message and "go on" in record.message for record in caplog.records) == 1


def test_where_nobody_is_there_it_is_said_of_each() -> None:
    with VirtualClock(3) as clock:

        def connects(address: Address) -> Callable[[], Link]:
            def connect() -> Link:
                raise LinkError(f"nothing listens at {address.host}")

            return connect

        with closing(open_source(BOTH, scheduler=VirtualScheduler(clock), connects=connects)) as source:
            assert isinstance(source, LiveSource)
            with pytest.raises(HighFiveError, match="nothing listens at a; nothing listens at b"):
                source.first(4.0)


def test_a_label_that_is_swapped_in_one_system_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        watched(
            lambda t: frames(("RWRA", "RFIN"), 120.0, 3.0, t, 50.0, 1.0),
            lambda t: frames(("RWRA", "RFIN"), 100.0, 3.0, t, 0.0, 1.0, lambda points: there(points[::-1])),
            2.5,
        )
    lines = [record.message for record in caplog.records if "mm apart" in record.message]
    assert len(lines) == 1
    assert "RWRA, RFIN" in lines[0]
    assert "vicon://a" in lines[0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("vicon://a+vicon://a", "twice"),
        ("vicon://a+headset", "not merged"),
        ("vicon://a+webcam", "not merged"),
        ("vicon://a+qtm://", "names no host"),
        ("vicon://a+qtm://b?at=1,2", "expected x,y,z in m and degrees"),
        ("vicon://a+qtm://b?at=1,2,3,x", "expected x,y,z in m and degrees"),
        ("vicon://a+qtm://b?where=1", "unknown option 'where'"),
        ("vicon://a+nonsense://b", "unknown address"),
    ],
)
def test_what_cannot_be_merged_is_refused(text: str, says: str) -> None:
    with pytest.raises(HighFiveError, match=says) as refused:
        parse_address(text)
    assert "\n" not in str(refused.value)


def test_an_address_of_several_is_read_back_and_has_places() -> None:
    text = "vicon://a:802?mode=pull+natnet://b?up=z&at=1,2,3,180&person=Anna"
    assert str(parse_address(text)) == text
    assert parse_address(str(parse_address(text))) == parse_address(text)
    part = merged_part("natnet://b?up=z&at=1,2,3,180&person=Anna")
    assert part.address == "natnet://b?up=z"
    assert part.person == "Anna"
    np.testing.assert_allclose(rotations.rotate(part.placed.rotation, [1.0, 0, 0]), [-1.0, 0, 0], atol=1e-12)
    assert parse_address("lsl://A+B").host == "A+B"


def seen(names: tuple[str, ...], points: np.ndarray, covariance: np.ndarray) -> Seen:
    return Seen(names, points, np.ones(len(names), dtype=bool), covariance, np.zeros((0, 3)))


@given(st.integers(0, 10_000))
def test_shared_markers_are_where_least_squares_has_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    factors = rng.normal(0.0, 2e-3, (2, 3, 3))
    one, other = factors @ factors.swapaxes(1, 2) + 1e-6 * np.eye(3)
    a = rng.normal(0.0, 1.0, 3)
    b = a + rng.normal(0.0, 1e-3, 3)
    systems = [seen(("M", "A"), np.array([a, a]), np.stack([one, one])), seen(("M",), b[None], other[None])]
    points, valid, covariance, apart = merge(systems, ("A", "M"), MergeSettings())
    weights = np.linalg.inv(one), np.linalg.inv(other)
    together = np.linalg.inv(weights[0] + weights[1])
    np.testing.assert_allclose(points[1], together @ (weights[0] @ a + weights[1] @ b), atol=1e-9)
    np.testing.assert_allclose(covariance[1], together, rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(points[0], a)
    assert valid.all()
    assert apart == ()


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_places_the_surer_one_counts(order: int) -> None:
    sure = seen(("M",), np.zeros((1, 3)), 1e-6 * np.eye(3)[None])
    vague = seen(("M",), np.full((1, 3), 0.05), 4e-6 * np.eye(3)[None])
    points, _, covariance, apart = merge([sure, vague][::order], ("M",), MergeSettings())
    np.testing.assert_allclose(points, 0.0, atol=1e-12)
    np.testing.assert_allclose(covariance[0], 1e-6 * np.eye(3))
    assert apart == ("M",)
