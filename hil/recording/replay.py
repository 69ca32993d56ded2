"""A recorded session once more: the frames as they came in, at their times, and whether the poses are the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.recording.recorded_tick import pose_digest
from highfive.hil.recording.recording import RecordedMessage, SessionRecording
from highfive.hil.recording.viewer_messages import joints_of
from highfive.hil.session.reach import ReachSettings
from highfive.hil.session.session import RATE_HZ, PoseSettings, Session, Tick, TickInput
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import versions
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.filter_settings import FilterSettings
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

SUFFIX = ".mcap"
"""Of recordings of sessions."""


@dataclass(frozen=True)
class ReplayedTrial:
    """What a recorded high five began with, and what came of it.

    Attributes:
        number: in the recording.
        partner: who raised the hand; without her recording.
        weights, corrects: how it was answered, at first.
        inputs: of its ticks.
        digests: of the poses that were requested in them.
        poses: of the avatar in them, as they were played, rounded.
        changes: how it was answered from after a tick on, by the tick's place.
    """

    number: int
    partner: Partner
    weights: Mapping[str, float]
    corrects: bool
    inputs: tuple[TickInput, ...]
    digests: tuple[str, ...]
    poses: tuple[Pose, ...]
    changes: Mapping[int, tuple[Mapping[str, float], bool]]


@dataclass
class Replay:
    """The high fives of a recording, and how many of their ticks came out the same.

    Attributes:
        trials: in order.
        pose, tracking, reach: settings of the session.
        differs: what is not as it was when it was recorded, in words.
        ticks, same: so many were compared, and were the same in every bit.
        first: the first other one: the high five's number in the recording, and s after its begin.
        largest: m, by how far a joint was elsewhere at the most; recordings are rounded to 10 µm.
    """

    trials: Sequence[ReplayedTrial]
    pose: PoseSettings
    tracking: FilterSettings
    reach: ReachSettings
    differs: list[str] = field(default_factory=list)
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
        session.set_correct(trial.corrects and session.corrects)
        for place, begins in enumerate(trial.inputs):
            yield begins
            if place in trial.changes:
                weights, corrects = trial.changes[place]
                session.set_style(weights)
                session.set_correct(corrects)

    def check(self, number: int, tick: Tick) -> None:
        """Compares the next tick of a high five with the recorded one."""
        place = self._place.get(number, 0)
        self._place[number] = place + 1
        trial = self.trials[number]
        self.ticks += 1
        if pose_digest(tick.pose) == trial.digests[place]:
            self.same += 1
            return
        if self.first is None:
            self.first = trial.number, 1e-9 * (trial.inputs[place].at_ns - trial.inputs[0].at_ns)
        now, then = joints_of([tick.pose, trial.poses[place]])
        self.largest = max(self.largest, float(np.linalg.norm(now - then, axis=-1).max()))

    def summary(self) -> dict[str, Any]:
        """For a session's summary."""
        first = None if self.first is None else {"trial": self.first[0], "time_s": round(self.first[1], 4)}
        return {
            "ticks": self.ticks,
            "same": self.same,
            "first_difference": first,
            "largest_mm": round(1e3 * self.largest, 3),
            "differs": list(self.differs),
        }


def open_replay(recording: SessionRecording, path: Path, model: str, corrected: bool, worn: MarkerSet | None) -> Replay:
    """The high fives of a recording that were played to their end.

    Args:
        recording: of a session.
        path: of it, for messages.
        model: name of the model that answers now.
        corrected: the hand is corrected now.
        worn: the person's marker set; None for the one of the project's own that the recording names.

    Raises:
        HighFiveError: it holds no frames, no high five, or is of another skeleton; there is no such marker set.
    """
    if recording.joints != tuple(avatar_skeleton().names):
        raise HighFiveError(
            f"{path} is the recording of another avatar: {len(recording.joints)} joints, this one has "
            f"{len(avatar_skeleton().names)}"
        )
    if not recording.channels["/frame"] or not recording.channels["/trial"]:
        raise HighFiveError(
            f"{path} holds no marker frames, so it cannot be played again: it is of an earlier version, or of an arm"
        )
    try:
        worn = worn or _named_set(recording, path)
        trials = [_trial(recording, number, worn) for number in range(len(recording.channels["/trial"]))]
        chain = recording.chain or {}
        pose, tracking = PoseSettings(**chain.get("pose", {})), FilterSettings(**chain.get("tracking", {}))
        reach = ReachSettings(**chain.get("reach", {}))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise HighFiveError(f"{path} is a recording of another version: {type(error).__name__}: {error}") from None
    found = [trial for trial in trials if trial is not None]
    if not found:
        raise HighFiveError(f"{path} holds no high five that was played to its end")
    return Replay(found, pose, tracking, reach, _differences(recording.settings, model, corrected))


def _differences(settings: Mapping[str, Any], model: str, corrected: bool) -> list[str]:
    found = []
    if settings.get("model") != model:
        found.append(f"model {settings.get('model')} then, {model} now")
    if bool(settings.get("corrected", True)) != corrected:
        found.append(f"correction {'on' if not corrected else 'off'} then, {'on' if corrected else 'off'} now")
    before = settings.get("versions")
    for name, version in versions().items():
        if (then := before.get(name) if isinstance(before, dict) else None) != version:
            found.append(f"{name} {then} then, {version} now")
    return found


def _named_set(recording: SessionRecording, path: Path) -> MarkerSet:
    name = str(recording.channels["/trial"][0].data["marker_set"])
    try:
        return load_marker_set(name)
    except HighFiveError:
        raise HighFiveError(
            f"{path} was recorded with a marker set of your own, {name!r}: add it (--marker-set FILE)"
        ) from None


def _trial(recording: SessionRecording, place: int, worn: MarkerSet) -> ReplayedTrial | None:
    starts = recording.channels["/trial"]
    first, head = starts[place].time_ns, starts[place].data
    last = starts[place + 1].time_ns if place + 1 < len(starts) else np.iinfo(np.int64).max

    def within(topic: str) -> list[RecordedMessage]:
        return [message for message in recording.channels[topic] if first <= message.time_ns < last]

    events = within("/event")
    if any(event.data["event"] == "trial_broken_off" for event in events):
        return None
    ticks, poses = within("/tick"), within("/avatar")
    frames = {message.time_ns: message.data for message in within("/frame")}
    if len(poses) != len(ticks):
        raise ValueError(f"{len(ticks)} ticks and {len(poses)} poses in high five {head['trial']}")
    places = {message.time_ns: number for number, message in enumerate(ticks)}
    changes = {
        places[event.time_ns]: (event.data["weights"], bool(event.data["corrects"]))
        for event in events
        if event.data["event"] == "answer_changed"
    }
    return ReplayedTrial(
        int(head["trial"]),
        _partner(head, worn),
        head["weights"],
        bool(head["corrects"]),
        tuple(_input(tick, frames) for tick in ticks),
        tuple(str(tick.data["digest"]) for tick in ticks),
        tuple(Pose.from_quaternions(np.array(m.data["root"]), np.array(m.data["quaternions"])) for m in poses),
        changes,
    )


def _partner(head: Mapping[str, Any], worn: MarkerSet) -> Partner:
    nothing = make_recording(RATE_HZ, (), np.zeros((0, 0, 3)), np.zeros((0, 0), dtype=bool))
    names = head["title"], head["emotion"], head["cell"], head["simulated"]
    return Partner(*names, nothing, worn, -1, None, None, ("played again from a recording",))


def _input(tick: RecordedMessage, frames: Mapping[int, Mapping[str, Any]]) -> TickInput:
    frame = _frame(frames[tick.time_ns]) if tick.data["framed"] else None
    return TickInput(frame, int(tick.data["time_ns"]), int(tick.data["at_ns"]))


def _frame(said: Mapping[str, Any]) -> MarkerFrame:
    covariance = said["covariance"]
    return MarkerFrame(
        tuple(said["names"]),
        _points(said["positions"]),
        np.array(said["valid"], dtype=bool),
        said["number"],
        said["source_time_ns"],
        said["arrival_time_ns"],
        _points(said["unlabelled"]),
        said["counted"],
        said["impossible"],
        said["latency_ns"],
        None if covariance is None else np.array(covariance, dtype=float).reshape(-1, 3, 3),
        said["own_clock"],
    )


def _points(rows: Sequence[Sequence[float]]) -> Array:
    return np.array(rows, dtype=float).reshape(-1, 3)
