"""Two motion capture systems on one simulated person, in virtual time: the merged markers and palm beside the true."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from highfive.hil.bench.live_people import BEFORE_S, System, frames_of
from highfive.hil.bench.sync_hosts import S
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.session.session import RATE_HZ
from highfive.hil.session.session_streams import SessionStreams
from highfive.hil.session.sync_events import Happened, SyncEvent
from highfive.hil.trials.frame_link import FrameLink, SentFrames
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.live_wiring import LiveWiring
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.address import parse_address
from highfive.mocap_bridge.sources.live import Link, LiveSource
from highfive.mocap_bridge.sources.merged_address import merged_part
from highfive.mocap_bridge.sources.scheme import Address
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

ALONE = "vicon://alone"
BOTH = "vicon://a+qtm://b?at=1.2,-0.4,0,90"
"""The second system's origin is elsewhere, and turned."""
SYSTEMS = {
    "vicon": System(120.0, latency_ms=4.0, reported_ms=4.0, delay_ms=0.5, drift_ppm=50.0),
    "qtm": System(100.0, latency_ms=9.0, reported_ms=9.0, delay_ms=0.5, drift_ppm=-80.0),
}
"""By their protocols. Both say how late they are."""
HIDDEN = {"vicon": "hand", "qtm": "head"}
"""What each of two systems does not see; alone one sees everything."""
WARM_UP_S = 1.0
"""Of the stream, that does not count: clocks and tracker begin."""


@dataclass(frozen=True)
class Followed:
    """How far off a person was who was followed.

    Attributes:
        markers_mm: (N,) all seen markers from the true ones.
        palm_mm: (M,) the tracked palm of each frame from the true one.
        off_ms: (K,) the time of each frame of each system, from the first on, from when it was made, beyond the delays
            that a system says of itself.
        resets: how often a system's time began anew.
    """

    markers_mm: Array
    palm_mm: Array
    off_ms: Array
    resets: int


def followed(person: Partner, address: str, seed: int) -> Followed:
    """Follows a person from a first frame on to the end of the high five."""
    with VirtualClock(seed) as clock:
        begins = clock.now() + S // 10
        links = {
            name: FrameLink(clock, one.rate_hz, SentFrames(_sent(person, name, address, begins, seed)))
            for name, one in SYSTEMS.items()
        }

        def connects(one: Address) -> Callable[[], Link]:
            return lambda: links[one.scheme]

        wiring = LiveWiring(clock, VirtualScheduler(clock), connects)
        zero = begins + round(S * BEFORE_S)
        end = zero + round(S * (len(person.recording) - 2) / RATE_HZ)
        with closing(live_source(address, None, wiring)) as source:
            found, frame = list[tuple[int, MarkerFrame]](), None
            off_ms, events = list[float](), list[SyncEvent]()
            for part in source.parts:
                part.hear(_timed(part, begins, off_ms))
            SessionStreams(events.append).follow(source)
            while clock.now() < end:
                frame = source.wait(frame, 0.1) or frame
                if frame is not None and (not found or frame is not found[-1][1]):
                    found.append((source.captured(frame) - zero, frame))
    resets = sum(event.happened is Happened.RESYNCHRONISED for event in events)
    return Followed(*_beside_the_truth(person, found), np.array(off_ms), resets)


def _timed(part: LiveSource, begins: int, off_ms: list[float]) -> Callable[[MarkerFrame], None]:
    rate_hz = SYSTEMS[parse_address(part.title).scheme].rate_hz

    def take(frame: MarkerFrame) -> None:
        made = begins + round(S * frame.number / rate_hz)
        off_ms.append(1e-6 * abs(part.captured(frame) - made))

    return take


def _sent(person: Partner, system: str, address: str, begins: int, seed: int) -> list[MarkerFrame]:
    """What a system sends of a person: all markers, or those that one of two sees, in its own frame."""
    sent = frames_of(person, SYSTEMS[system], begins, np.random.default_rng([seed, len(system)]))
    if address == ALONE:
        return sent
    hidden = getattr(person.marker_set.arm, HIDDEN[system])
    kept = [m for m, name in enumerate(sent[0].names) if name not in hidden]
    names = tuple(sent[0].names[m] for m in kept)
    placed = merged_part(address.rpartition("+")[2]).placed
    back = rotations.conjugate(placed.rotation)

    def own(points: Array) -> Array:
        return rotations.rotate(back, points - placed.translation) if system == "qtm" else points

    return [
        replace(frame, names=names, positions=own(frame.positions[kept]), valid=frame.valid[kept]) for frame in sent
    ]


def _beside_the_truth(person: Partner, found: Sequence[tuple[int, MarkerFrame]]) -> tuple[Array, Array]:
    assert person.palm is not None
    index = np.arange(len(person.palm)) / RATE_HZ
    markers, palm = CubicSpline(index, person.recording.points), CubicSpline(index, person.palm)
    tracker, estimator = Tracker(person.marker_set, RATE_HZ), HumanArmEstimator(person.marker_set)
    off, palms = list[float](), list[float]()
    for captured, frame in found:
        arm = estimator(tracker.update(replace(frame, source_time_ns=captured + round(S * BEFORE_S))))
        at = max(1e-9 * captured, 0.0)
        if captured < S * (WARM_UP_S - BEFORE_S):
            continue
        columns = [person.recording.names.index(name) for name in frame.names]
        gaps = np.linalg.norm(frame.positions - markers(at)[columns], axis=1)
        off += gaps[frame.valid].tolist()
        palms.append(float(np.linalg.norm(arm.palm.position - palm(at))))
    return 1e3 * np.array(off), 1e3 * np.array(palms)
