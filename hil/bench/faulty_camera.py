"""A recorded person before a motion capture system in trouble, in virtual time: a camera for a live source."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from highfive.hil.bench.fault_schedule import FOLLOWING, MOCAP, FaultSchedule
from highfive.hil.session.session import RATE_HZ
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.source import C3DSource

BEFORE_S = 1.8
"""The person's part is played from so long before the contact, s: from the first frame after the arm begins to follow;
until then, and after its end, the person stands still."""

_STARTED_NS = 1_000_000_000_000  # the source's own clock, as the camera begins


class FaultyCamera:
    """Takes pictures; a :class:`highfive.hil.trials.frame_link.Camera`.

    Attributes:
        contact_ns: of the clock, when the palms met originally; None before the person has begun.
    """

    def __init__(
        self, partner: Partner, schedule: FaultSchedule, begun: Callable[[str], int | None], now_ns: int
    ) -> None:
        """Begins now.

        Args:
            partner: the person.
            schedule: what happens to the frames.
            begun: when a phase began, ns; None for not yet.
            now_ns: of the clock.
        """
        self._source = C3DSource(partner.recording, RATE_HZ)
        self._first = max(0, partner.contact_frame - round(BEFORE_S * RATE_HZ))
        self._contact = partner.contact_frame - self._first
        self._happenings, self._begun, self._zero = schedule.of(*MOCAP), begun, now_ns
        self._rng = np.random.default_rng((schedule.seed, 1))
        count = len(partner.recording.names)
        self._pairs = {it: self._rng.choice(count, 2, replace=False) for it in self._happenings}
        self._number = 0  # of the next picture
        self._moves_from: int | None = None
        self._sent: list[MarkerFrame] = []  # on their way
        self.contact_ns: int | None = None

    @property
    def next_ns(self) -> int:
        """When the next picture is taken, or one arrives that is on its way."""
        return min([self._taken(self._number), *(frame.arrival_time_ns for frame in self._sent)])

    def arrived(self, now_ns: int) -> Sequence[MarkerFrame]:
        """Takes the pictures that are due, and hands over those that have arrived."""
        while (at := self._taken(self._number)) <= now_ns:
            if (frame := self._picture(self._number, at)) is not None:
                self._sent.append(frame)
            self._number += 1
        found = [frame for frame in self._sent if frame.arrival_time_ns <= now_ns]
        self._sent = [frame for frame in self._sent if frame.arrival_time_ns > now_ns]
        return found

    def _taken(self, number: int) -> int:
        return self._zero + round(1e9 * number / RATE_HZ)

    def _picture(self, number: int, at: int) -> MarkerFrame | None:
        following = self._begun(FOLLOWING)
        if self._moves_from is None and following is not None and at >= following:
            self._moves_from = number
            self.contact_ns = self._taken(number + self._contact)
        moved = 0 if self._moves_from is None else number - self._moves_from
        frame = self._source.frame(min(self._first + moved, len(self._source) - 1))
        positions, valid, stamp, arrives = frame.positions, frame.valid, at - self._zero + _STARTED_NS, at
        for it in self._happenings:
            begun = self._begun(it.phase)
            since_s = -1.0 if begun is None else 1e-9 * (at - begun) - it.at_s
            if it.kind == "clock jump" and since_s >= 0.0:
                stamp += round(1e9 * it.amount)
            if not 0.0 <= since_s < it.lasts_s:
                continue
            if it.kind == "stall" or (it.kind == "drop" and self._rng.random() < it.amount):
                return None
            if it.kind == "burst":
                arrives = max(arrives, at + round(1e9 * (it.lasts_s - since_s)))
            elif it.kind == "occlusion":
                valid = np.zeros_like(valid)
            elif it.kind == "swap":
                positions, valid = _exchanged(positions, self._pairs[it]), _exchanged(valid, self._pairs[it])
            elif it.kind == "ghost":
                positions = positions.copy()
                positions[self._pairs[it][0]] += self._rng.normal(0.0, it.amount, 3)
        return replace(
            frame,
            positions=positions,
            valid=valid,
            number=number,
            source_time_ns=stamp,
            arrival_time_ns=arrives,
        )


def _exchanged(rows: np.ndarray, pair: np.ndarray) -> np.ndarray:
    found = rows.copy()
    found[pair] = rows[pair[::-1]]
    return found
