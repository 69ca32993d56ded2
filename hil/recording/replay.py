"""A recorded session once more: the frames as they came in, at their times, and whether the poses are the same."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from highfive.hil.recording.recorded_tick import pose_digest
from highfive.hil.recording.replayed_ticks import TOPICS, ReplayedTicks, is_style, replayed_ticks
from highfive.hil.recording.session_reader import SessionReader
from highfive.hil.recording.trial_spans import TrialSpan
from highfive.hil.recording.viewer_messages import joints_of
from highfive.hil.session.reach_settings import ReachSettings
from highfive.hil.session.session import RATE_HZ, PoseSettings, Session, Tick, TickInput
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.trials.machine import machine, machine_differences
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import versions
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.filter_settings import FilterSettings
from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class ReplayHead:
    """What a recorded high five began with.

    Attributes:
        span: where it is in the recording.
        partner: who raised the hand; without her recording.
        weights, corrects: how it was answered, at first.
    """

    span: TrialSpan
    partner: Partner
    weights: Mapping[str, float]
    corrects: bool


@dataclass
class Replay:
    """The high fives of a recording, and how many of their ticks came out the same.

    Attributes:
        trials: in order.
        read: gives the ticks of one of them; the last one read is kept.
        pose, tracking, reach: settings of the session.
        corrected: the hand is corrected where it was; False: nowhere.
        differs: what is not as it was when it was recorded, in words.
        machine: on which it was recorded, :func:`highfive.hil.trials.machine.machine`; None where that is not said.
        ticks, same: so many were compared, and were the same in every bit.
        first: the first other one: the high five's number in the recording, and s after its begin.
        largest: m, by how far a joint was elsewhere at the most; recordings are rounded to 10 µm.
    """

    trials: Sequence[ReplayHead]
    read: Callable[[TrialSpan], ReplayedTicks]
    pose: PoseSettings
    tracking: FilterSettings
    reach: ReachSettings
    corrected: bool = True
    differs: list[str] = field(default_factory=list)
    machine: object = None
    ticks: int = 0
    same: int = 0
    first: tuple[int, float] | None = None
    largest: float = 0.0
    _place: dict[int, int] = field(default_factory=dict)

    def partners(self, most: int | None) -> list[Partner]:
        """Who raised the hand, for each high five; of the first ``most``."""
        return [trial.partner for trial in self.trials[:most]]

    @property
    def styles(self) -> list[Mapping[str, float]]:
        """In which each was answered, at first."""
        return [trial.weights for trial in self.trials]

    def inputs(self, number: int, session: Session) -> Iterator[TickInput]:
        """Of the high five with that place in the replay; changes the session's answer where that was changed."""
        trial = self.trials[number]
        session.set_correct(trial.corrects and self.corrected)
        ticks = self.read(trial.span)
        for place, begins in enumerate(ticks.inputs):
            yield begins
            if place in ticks.changes:
                weights, corrects = ticks.changes[place]
                session.set_style(weights)
                session.set_correct(corrects and self.corrected)

    def check(self, number: int, tick: Tick) -> None:
        """Compares the next tick of a high five with the recorded one."""
        place = self._place.get(number, 0)
        self._place[number] = place + 1
        span = self.trials[number].span
        trial = self.read(span)
        self.ticks += 1
        if pose_digest(tick.pose) == trial.digests[place]:
            self.same += 1
            return
        if self.first is None:
            self.first = span.number, 1e-9 * (trial.inputs[place].at_ns - trial.inputs[0].at_ns)
        now, then = joints_of([tick.pose, trial.poses[place]])
        self.largest = max(self.largest, float(np.linalg.norm(now - then, axis=-1).max()))

    def summary(self) -> dict[str, Any]:
        """For a session's summary."""
        first = None if self.first is None else {"trial": self.first[0], "time_s": round(self.first[1], 4)}
        others = machine_differences(self.machine, machine()) if self.same < self.ticks else []
        return {
            "ticks": self.ticks,
            "same": self.same,
            "first_difference": first,
            "largest_mm": round(1e3 * self.largest, 3),
            "differs": [*self.differs, *others],
        }


def open_replay(session: SessionReader, model: str, corrected: bool, worn: MarkerSet | None) -> Replay:
    """The high fives of a recording that were played to their end; all are read once, to see that they can be.

    Args:
        session: the recording.
        model: name of the model that answers now.
        corrected: the hand is corrected now.
        worn: the person's marker set; None for the one of the project's own that the recording names.

    Raises:
        HighFiveError: it holds no frames, no high five that can be played again, or is of another skeleton; there is no
            such marker set.
    """
    path = session.path
    if session.joints != tuple(avatar_skeleton().names):
        raise HighFiveError(
            f"{path} is the recording of another avatar: {len(session.joints)} joints, this one has "
            f"{len(avatar_skeleton().names)}"
        )
    if not any("/frame" in span.topics for span in session.spans):
        raise HighFiveError(
            f"{path} holds no marker frames, so it cannot be played again: it is of an earlier version, or of an arm"
        )
    worn = worn or _named_set(session)
    pose, tracking, reach = _chain(session)
    read = lru_cache(maxsize=1)(lambda span: replayed_ticks(session.read(span, TOPICS)))
    found, left_out = list[ReplayHead](), list[str]()
    for span in session.spans:
        if not span.broken_off:
            try:
                head = _head(span, worn)
                read(span)
                found.append(head)
            except HighFiveError as error:
                left_out.append(f"high five {span.number + 1} cannot be played again: {error}")
    if not found:
        why = f"; {left_out[0]}" if left_out else ""
        raise HighFiveError(f"{path} holds no high five that can be played again to its end{why}")
    differs = _differences(session.settings, model, corrected) + left_out
    return Replay(found, read, pose, tracking, reach, corrected, differs, session.settings.get("machine"))


_BEFORE = {"reach": {"closing": 0.0}}
"""What sessions did whose recordings do not name a setting yet."""


def _chain(session: SessionReader) -> tuple[PoseSettings, FilterSettings, ReachSettings]:
    """Of pose, tracker and reach, as they were."""
    kinds = {"pose": PoseSettings, "tracking": FilterSettings, "reach": ReachSettings}
    made = []
    for name, kind in kinds.items():
        said = _BEFORE.get(name, {}) | (session.chain or {}).get(name, {})
        try:
            made.append(kind(**said))
        except (TypeError, ValueError, HighFiveError):
            raise HighFiveError(
                f"{session.path} is a recording of another version: this one has other settings of {name}; play it "
                "again with the version that recorded it"
            ) from None
    return made[0], made[1], made[2]


def _differences(settings: Mapping[str, Any], model: str, corrected: bool) -> list[str]:
    found = []
    if settings.get("model") != model:
        found.append(f"model {settings.get('model')} then, {model} now")
    if bool(settings.get("corrected", True)) and not corrected:  # the other way each is answered as it was
        found.append("correction on then, off now")
    before = settings.get("versions")
    for name, version in versions().items():
        if (then := before.get(name) if isinstance(before, dict) else None) != version:
            found.append(f"{name} {then} then, {version} now")
    return found


def _named_set(session: SessionReader) -> MarkerSet:
    name = next((name for span in session.spans if (name := span.text("marker_set"))), "")
    try:
        return load_marker_set(name)
    except HighFiveError:
        raise HighFiveError(
            f"{session.path} was recorded with a marker set of your own, {name!r}: add it (--marker-set FILE)"
        ) from None


def _head(span: TrialSpan, worn: MarkerSet) -> ReplayHead:
    weights, corrects, simulated = (span.about.get(name) for name in ("weights", "corrects", "simulated"))
    if not is_style(weights) or not isinstance(corrects, bool):
        raise HighFiveError("its /trial does not say how it was answered: it is of another version, or damaged")
    nothing = make_recording(RATE_HZ, (), np.zeros((0, 0, 3)), np.zeros((0, 0), dtype=bool))
    names = span.text("title"), span.text("emotion"), span.text("cell"), simulated is True
    partner = Partner(*names, nothing, worn, -1, None, None, ("played again from a recording",))
    return ReplayHead(span, partner, weights, corrects)
