"""How long a frame takes from a server's wire to the tracked palm, for each live protocol, on this machine."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from highfive.hil.bench.tracker_cases import frames_of, simulated_arm
from highfive.hil.runtime.threads import quick_switching, use_one_blas_thread
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.address import open_source, parse_address
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.registry import BUILT_IN
from highfive.mocap_bridge.sources.source import RATE_HZ
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.runtime.console import Advance, Bar

READ_S = 0.030
"""What a slow reader does with each frame, s."""

SLOW_S = 10.0
"""Longest that the slow reader reads, s."""

SETTLED_S = 1.0
"""What comes in so long after the first frame does not count, s."""

_WARM_UP = 240  # frames that the tracker has followed before anything is timed
_ENDING_S = 10.0
_MADE_FRAMES = 1200


@dataclass(frozen=True)
class ProtocolBenchOptions:
    """What is measured; see ``highfive bench protocols --help``.

    Attributes:
        file: what is sent; None makes a simulated person.
        protocols: of :data:`highfive.mocap_bridge.sources.registry.BUILT_IN`.
        seconds: how long each is listened to.
        person: prefix of the person who is followed; None takes the only one there is.
    """

    file: Path | None = None
    protocols: tuple[str, ...] = tuple(BUILT_IN)
    seconds: float = 60.0
    person: str | None = None


def bench_protocols(options: ProtocolBenchOptions, bar: Bar) -> dict[str, Any]:
    """For each protocol ``latency_ms``, ``lost_frames``, ``slow_reader_age_ms`` and how many frames that rests on.

    Raises:
        HighFiveError: no such file, person or protocol; no marker set fits; a server does not start or send.
    """
    for name in options.protocols:
        if name not in BUILT_IN:
            raise HighFiveError(f"unknown protocol {name!r}; there are {', '.join(BUILT_IN)}")
    use_one_blas_thread()
    with tempfile.TemporaryDirectory() as folder:
        file = options.file or _simulated(Path(folder) / "simulated.c3d")
        recording = read_c3d(file).person(options.person)
        marker_set = find_marker_set(recording.names)
        columns = slice(0, _WARM_UP)
        _warm_up(marker_set, list(frames_of(recording.names, recording.points[columns], recording.valid[columns])))
        slow = min(options.seconds, SLOW_S)
        advance = bar("protocols", round(len(options.protocols) * (options.seconds + slow)))
        with quick_switching():
            result = {
                name: _measure(name, file, options, marker_set, slow, Path(folder), advance)
                for name in options.protocols
            }
    return {
        "source": options.file.name if options.file else "simulated",
        "marker_set": marker_set.name,
        "markers": len(recording.names),
        "rate_hz": RATE_HZ,
        "seconds": options.seconds,
        "frame_ms": round(1e3 / RATE_HZ, 3),
        "protocols": result,
    }


def _simulated(path: Path) -> Path:
    """Somebody who moves an arm there and back, so that it can begin again without a jump, with gaps, as a C3D file."""
    case = simulated_arm(0, _MADE_FRAMES)
    points = np.concatenate([case.measured, case.measured[::-1]])
    seen = np.concatenate([case.seen, case.seen[::-1]])
    names = [f"human:{name}" for name in case.marker_set.names]
    write_c3d(path, make_recording(RATE_HZ, names, points, seen))
    return path


def _warm_up(marker_set: MarkerSet, frames: list[MarkerFrame]) -> None:
    tracker, arm = Tracker(marker_set, RATE_HZ), HumanArmEstimator(marker_set)
    for frame in frames:
        arm(tracker.update(frame))


@contextmanager
def _serving(protocol: str, file: Path, out: Path) -> Iterator[str]:
    """The address of a server in a process of its own; afterwards its send times are in ``out``.

    Raises:
        HighFiveError: it does not start, or does not end.
    """
    command = [sys.executable, "-m", "highfive.hil.bench.protocol_server", protocol, str(file), str(out)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            address = process.stdout.readline().strip() if process.stdout else ""
            if not address:
                _, said = process.communicate(timeout=_ENDING_S)
                raise HighFiveError(f"the {protocol} server does not start: {(said.strip().splitlines() or [''])[-1]}")
            yield address
            process.communicate(timeout=_ENDING_S)  # the end of its input ends it
        except subprocess.TimeoutExpired:
            raise HighFiveError(f"the {protocol} server does not end") from None
        finally:
            if process.poll() is None:
                process.kill()


@dataclass
class _Read:
    """Frames' numbers, and ns: their own time, when they had arrived, were taken up, and were done with."""

    numbers: list[int] = field(default_factory=list)
    source_ns: list[int] = field(default_factory=list)
    arrived_ns: list[int] = field(default_factory=list)
    begun_ns: list[int] = field(default_factory=list)
    done_ns: list[int] = field(default_factory=list)

    def add(self, frame: MarkerFrame, begun_ns: int = 0) -> None:
        """The frame, taken up at ``begun_ns``, is done with now."""
        self.done_ns.append(time.monotonic_ns())
        self.numbers.append(frame.number)
        self.source_ns.append(frame.source_time_ns)
        self.arrived_ns.append(frame.arrival_time_ns)
        self.begun_ns.append(begun_ns)

    def extend(self, frames: Sequence[MarkerFrame]) -> None:
        """Several frames are."""
        for frame in frames:
            self.add(frame)


def _measure(
    protocol: str,
    file: Path,
    options: ProtocolBenchOptions,
    marker_set: MarkerSet,
    slow_s: float,
    folder: Path,
    advance: Advance,
) -> dict[str, Any]:
    came = _Read()  # all that came in, requested or not
    out = folder / f"{protocol}.npz"
    with _serving(protocol, file, out) as address:
        if protocol == "lsl":
            from highfive.mocap_bridge.sources.lsl import configure  # noqa: PLC0415

            configure(local_only=True)
        source = open_source(parse_address(address), options.person, tap=lambda frames, _: came.extend(frames))
        if not isinstance(source, LiveSource):
            raise HighFiveError(f"{address} is no live system")
        try:
            source.first(10.0)
            tracked = _follow(source, marker_set, options.seconds, advance)
            slow = _read_slowly(source, slow_s, advance)
            health = source.health(time.monotonic_ns())
        finally:
            source.close()
    with np.load(out, allow_pickle=False) as stamps:
        sent = dict(zip(stamps["numbers"].tolist(), stamps["times_ns"].tolist(), strict=True))
    sent_ns = _sent(tracked, sent, protocol)
    latency = 1e-6 * (np.array(tracked.done_ns) - sent_ns)
    age = 1e-6 * (np.array(slow.done_ns) - _sent(slow, sent, protocol))
    steps = np.diff(np.array([sent_ns, tracked.arrived_ns, tracked.begun_ns, tracked.done_ns]), axis=0)
    arrived = set(_numbers(came, sent, protocol))
    expected = range(min(arrived), max(arrived) + 1)
    p50, p99, longest = np.percentile(latency, [50, 99, 100])
    return {
        "latency_ms": {"p50": _rounded(p50), "p99": _rounded(p99), "max": _rounded(longest)},
        "of_which_p50_ms": {
            part: _rounded(1e-6 * np.median(step))
            for part, step in zip(("wire_and_decoding", "handed_over", "tracking"), steps, strict=True)
        },
        "lost_frames": len(expected) - len(arrived),
        "frames": len(expected),
        "tracked_frames": len(latency),
        "said_lost": health.lost,
        "slow_reader_age_ms": {"p50": _rounded(np.median(age)), "max": _rounded(age.max())},
    }


def _follow(source: LiveSource, marker_set: MarkerSet, seconds: float, advance: Advance) -> _Read:
    """Tracks the arm in every frame from a second after now on, and notes when it was done."""
    tracker, arm = Tracker(marker_set, source.rate_hz), HumanArmEstimator(marker_set)
    begun, seen, shown = time.monotonic(), None, 0
    read = _Read()
    while (gone := time.monotonic() - begun) < SETTLED_S + seconds:
        frame = source.wait(seen, 0.5)
        if frame is None:
            continue
        seen, taken_up = frame, time.monotonic_ns()
        arm(tracker.update(frame))
        if gone > SETTLED_S:
            read.add(frame, taken_up)
        if gone - SETTLED_S > shown + 1:
            shown += 1
            advance()
    if not read.numbers:
        raise HighFiveError(f"no frame came: {source.health(time.monotonic_ns()).trouble or 'nothing was sent'}")
    return read


def _read_slowly(source: LiveSource, seconds: float, advance: Advance) -> _Read:
    """Reads the newest frame and is busy for 30 ms, again and again."""
    begun, shown = time.monotonic(), 0
    read = _Read()
    while (gone := time.monotonic() - begun) < seconds:
        frame = source.newest(time.monotonic_ns())
        if frame is not None:
            read.add(frame)
        time.sleep(READ_S)
        if gone > shown + 1:
            shown += 1
            advance()
    return read


def _numbers(read: _Read, sent: dict[int, int], protocol: str) -> list[int]:
    """The server's numbers of the frames. LSL sends none: there the time says which frame it is."""
    if protocol != "lsl":
        return read.numbers
    start = min(time_ns - number * 1e9 / RATE_HZ for number, time_ns in sent.items())  # as it would be, sent promptly
    return [round((time_ns - start) * 1e-9 * RATE_HZ) for time_ns in read.source_ns]


def _sent(read: _Read, sent: dict[int, int], protocol: str) -> NDArray[np.int64]:
    """When each frame was sent, ns."""
    numbers = _numbers(read, sent, protocol)
    strange = [number for number in numbers if number not in sent]
    if strange:
        raise HighFiveError(f"the {protocol} client got frame {strange[0]}, which was never sent")
    return np.array([sent[number] for number in numbers])


def _rounded(value: float | np.floating) -> float:
    return round(float(value), 3)


def print_protocol_bench(result: dict[str, Any]) -> None:
    """The figures for people."""
    print(f"{result['markers']} markers at {result['rate_hz']:g} Hz, {result['seconds']:g} s each, on loopback")
    print("  from the wire to the tracked palm, ms; frames lost; age of what a slow reader reads, ms")
    for name, row in result["protocols"].items():
        latency, slow = row["latency_ms"], row["slow_reader_age_ms"]
        print(
            f"  {name:<8} p50 {latency['p50']:.2f}, p99 {latency['p99']:.2f}   {row['lost_frames']} of {row['frames']}"
            f"   p50 {slow['p50']:.1f}, largest {slow['max']:.1f}"
        )
