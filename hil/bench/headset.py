"""People in a headset: are their hands met where they truly are?"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from highfive.hil.bench.headset_limit import limit_figures, palm_limit
from highfive.hil.bench.headset_model import Device, Wearer
from highfive.hil.bench.live_people import BEFORE_S, LiveFelt, meet
from highfive.hil.bench.live_people import parts as model_and_scene
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.session.session import RATE_HZ, UNSEEN_AT_REST, PoseSettings, Session
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import CLEAN
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.trials.partners import Partner, partner_of
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.headset import HeadsetLink, HeadsetSettings
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.tracking.filter_settings import HEADSET, FilterSettings
from highfive.mocap_bridge.wire.headset import encode_headset
from highfive.model.errors import HighFiveError

DEVICES = {
    "60 Hz, 35 ms": Device(60.0, 35.0),
    "30 Hz, 45 ms": Device(30.0, 45.0),
    "30 Hz, 128 ms, told": Device(30.0, 128.0, told_ms=83.0),
}
"""Two that lag as a headset is taken to by itself, and the latest one that is published, of which the host is told."""
JUDGED = tuple(DEVICES)[:2]
"""Of these the worse one is what the benchmark says on its first level."""
_DRAWS = 48_611  # keeps these people apart from those of other benchmarks with the same seed


@dataclass(frozen=True)
class HeadsetOptions:
    """What is played: every emotion at these cells, before each device."""

    cells: tuple[str, ...] = CELLS
    seed: int = 0
    devices: tuple[str, ...] = tuple(DEVICES)


@dataclass(frozen=True)
class HeadsetJob:
    """One high five before a device."""

    emotion: str
    cell: str
    seed: int
    device: Device
    tracking: FilterSettings = HEADSET
    pose: PoseSettings = UNSEEN_AT_REST
    settings: HeadsetSettings = field(default_factory=HeadsetSettings)


class _Feed:
    """The page's messages, handed over when they arrive."""

    def __init__(self, clock: VirtualClock, messages: Sequence[tuple[int, bytes]]) -> None:
        self._clock, self._messages, self._next = clock, messages, 0

    def take(self, timeout_s: float) -> list[bytes]:
        until = self._clock.now() + round(1e9 * timeout_s)
        due = self._messages[self._next][0] if self._next < len(self._messages) else until
        self._clock.wait_until(min(due, until))
        begin = self._next
        while self._next < len(self._messages) and self._messages[self._next][0] <= self._clock.now():
            self._next += 1
        return [data for _, data in self._messages[begin : self._next]]


def _wearer(job: HeadsetJob) -> tuple[Partner, Wearer]:
    """The person, and what a headset makes of her; the same draws each time."""
    rng = np.random.default_rng([job.seed, list(EMOTIONS).index(job.emotion), CELLS.index(job.cell), _DRAWS])
    pair = simulate_pair(job.emotion, job.cell, 0, rng)
    person = partner_of(pair, job.emotion, job.cell, rng, CLEAN)
    return person, Wearer(pair.person, rng)


def limit_of(job: HeadsetJob) -> float:
    """m, see :func:`highfive.hil.bench.headset_limit.palm_limit`."""
    person, wearer = _wearer(job)
    assert person.palm is not None
    return palm_limit(wearer, job.device, person.palm, person.contact_frame / RATE_HZ)


def play_headset(job: HeadsetJob) -> LiveFelt:
    """Plays one high five as a session with a headset does: page's messages, source, tracker, model, correction."""
    person, wearer = _wearer(job)
    model, scene = model_and_scene()
    session = Session(
        model, {job.emotion: 1.0}, load_marker_set("headset"), scene, settings=job.pose, tracking=job.tracking
    )
    settings = replace(job.settings, late_ms=job.settings.late_ms + job.device.told_ms)
    with VirtualClock(job.seed) as clock:
        zero = clock.now() + 100_000_000 + round(1e9 * BEFORE_S)
        messages = [
            (zero + round(1e9 * arrives), encode_headset(replace(pose, holds_ms=1e-6 * zero + 1e3 * holds)))
            for arrives, holds, pose in wearer.poses(job.device, BEFORE_S)
        ]
        link = HeadsetLink(_Feed(clock, messages).take, "right", clock.now, settings)
        with closing(LiveSource("headset", lambda: link, None, 60.0, VirtualScheduler(clock))) as source:
            clock.wait_until(zero)
            return meet(person, session, source, clock, zero)


def bench_headset(options: HeadsetOptions, bar: Bar) -> dict[str, Any]:
    """Palm to true palm at first touch, of the worse of the two usual devices, and ``devices``: of each.

    Beside it ``limit_mm``: what a Kalman filter makes of the same messages at the person's own contact.

    Raises:
        HighFiveError: an unknown cell or device.
    """
    for strange, known in ((set(options.cells) - set(CELLS), CELLS), (set(options.devices) - set(DEVICES), DEVICES)):
        if strange:
            raise HighFiveError(f"unknown {min(strange)!r}; there are {', '.join(known)}")
    jobs = [
        HeadsetJob(emotion, cell, options.seed, DEVICES[device])
        for device in options.devices
        for cell in options.cells
        for emotion in EMOTIONS
    ]
    felt = list(parallel_map(play_headset, jobs, lambda total: bar("high fives", total)))
    limits = list(parallel_map(limit_of, jobs, lambda total: bar("limits", total)))
    count = len(options.cells) * len(EMOTIONS)
    parts = {device: slice(i * count, (i + 1) * count) for i, device in enumerate(options.devices)}
    rows = {device: {**figures(felt[part]), "limit_mm": limit_figures(limits[part])} for device, part in parts.items()}
    judged = [rows[device] for device in JUDGED if device in rows] or list(rows.values())
    return {
        **max(judged, key=lambda row: (row["trials"] - row["touched"], row["true_error_mm"]["p95"] or 0.0)),
        "devices": rows,
    }


def figures(felt: Sequence[LiveFelt]) -> dict[str, Any]:
    """How many were touched, and of these the median and the 95th percentile, mm, of palm to true palm."""
    errors = 1e3 * np.array([one.error for one in felt if one.touched])
    median, p95 = np.percentile(errors, [50, 95]).round(2).tolist() if len(errors) else (None, None)
    return {
        "trials": len(felt),
        "touched": len(errors),
        "true_error_mm": {"median": median, "p95": p95},
    }


def print_headset(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print("headset                touched    palm to true palm, median / 95 %   a Kalman filter's, at her own contact")
    for device, row in result["devices"].items():
        error = " / ".join("-" if value is None else f"{value:.1f}" for value in row["true_error_mm"].values())
        limit = row["limit_mm"]
        best = f"{limit['median']:.1f} / {limit['p95']:.1f} mm of {limit['seen']}" if limit["seen"] else "-"
        print(f"{device:<22} {row['touched']:>3} of {row['trials']:<3}  {f'{error} mm':<33} {best}")
