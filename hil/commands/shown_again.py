"""A recorded trial shown again: the avatar's recorded poses in the same scene at the same rate, while she watches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from highfive.hil.recording.session_reader import SessionReader, read_session
from highfive.hil.recording.trial_spans import TrialSpan
from highfive.hil.session.session import RATE_HZ, Session, Tick, TickInput
from highfive.hil.sim.avatar import Pose
from highfive.hil.trials.partners import Partner
from highfive.hil.view.recorded import person_of
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import HumanArm, MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

_TOPICS = ("/trial", "/person", "/avatar", "/tick")


@dataclass(frozen=True)
class RecordedMotion:
    """Of a trial with T ticks.

    Attributes:
        times_ns: (T,) from its first tick on, by the clock of the frames' stamps.
        poses: that the avatar showed.
        people: the person in each.
        played_ns: (T,) when each was played, by the clock of that session; None of older recordings.
    """

    times_ns: Array
    poses: tuple[Pose, ...]
    people: tuple[HumanArm, ...]
    played_ns: Array | None = None

    def at(self, time_ns: int) -> tuple[Pose, HumanArm]:
        """The tick nearest to a time."""
        place = self.row(time_ns)
        return self.poses[place], self.people[place]

    def row(self, time_ns: int) -> int:
        """Which tick that is."""
        after = int(np.clip(np.searchsorted(self.times_ns, time_ns), 1, len(self.times_ns) - 1))
        return after - int(time_ns - self.times_ns[after - 1] <= self.times_ns[after] - time_ns)

    def row_played(self, at_ns: int | None) -> int | None:
        """Which tick was played at a time of that session's clock; None where that is not known."""
        if at_ns is None or self.played_ns is None:
            return None
        row = int(np.searchsorted(self.played_ns, at_ns))
        return row if row < len(self.played_ns) else None


def recorded_motion(path: Path, title: str) -> RecordedMotion:
    """The trial of that title in a recording, also one that was cut short behind it.

    Raises:
        HighFiveError: there is none, or it is damaged.
    """
    session, span = recorded_trial(path, title)
    messages = session.read(span, _TOPICS)
    people, times = ({one.time_ns: one.data for one in messages.of(topic)} for topic in ("/person", "/tick"))
    ticks = [message for message in messages.of("/avatar") if message.time_ns in people and message.time_ns in times]
    if len(ticks) < 2:
        raise HighFiveError(f"trial {title} in {path} is damaged: {len(ticks)} of its ticks can be read")
    host_ns = span.about.get("host_ns")
    try:
        stamps = np.array([times[tick.time_ns]["time_ns"] for tick in ticks], dtype=np.int64)
        return RecordedMotion(
            stamps - stamps[0],
            tuple(
                Pose.from_quaternions(np.array(tick.data["root"]), np.array(tick.data["quaternions"])) for tick in ticks
            ),
            tuple(person_of(people[tick.time_ns], tick.time_ns) for tick in ticks),
            None if type(host_ns) is not int else np.array([tick.time_ns - span.start_ns + host_ns for tick in ticks]),
        )
    except (KeyError, ValueError, TypeError):
        raise HighFiveError(f"trial {title} in {path} is of another version, or damaged") from None


def recorded_trial(path: Path, title: str) -> tuple[SessionReader, TrialSpan]:
    """A recording, and where the trial of that title is in it.

    Raises:
        HighFiveError: there is none, or it cannot be read.
    """
    if not path.is_file():
        raise HighFiveError(f"its recording {path} is gone")
    session = read_session(path)
    span = next((one for one in session.spans if one.text("title") == title and not one.broken_off), None)
    if span is None:
        raise HighFiveError(f"{path} has no trial {title}")
    return session, span


class ShownAgain:
    """The session's chain, but that the avatar moves as it did: who is tracked is tracked as ever.

    Attributes:
        met: the contact has been shown.
    """

    def __init__(
        self, session: Session, motion: RecordedMotion, *, recorded_head: bool, recorded_arm: bool,
        contact_ns: int | None = None,
    ) -> None:  # fmt: skip
        """``recorded_head`` and ``recorded_arm`` show the person's head, or arm, as it was; else as it is.

        ``contact_ns`` is when palms met, by the clock of the recorded session; None where that is not to be told.
        """
        self._contact_row, self.met = motion.row_played(contact_ns), False
        self._session, self._motion = session, motion
        self._head, self._arm = recorded_head, recorded_arm
        self._first_ns: int | None = None

    def reset(self) -> None:
        """A new trial."""
        self._session.reset()
        self._first_ns, self.met = None, False

    def step(self, frame: MarkerFrame | None, time_ns: int | None = None) -> Tick:
        """One tick, in which the recorded pose is played."""
        tick = self._session.step(frame, time_ns)
        if self._first_ns is None:
            self._first_ns = tick.time_ns
        shown_ns = tick.time_ns - self._first_ns
        row = self._motion.row(shown_ns)
        pose, then = self._motion.poses[row], self._motion.people[row]
        self.met = self._contact_row is not None and row >= self._contact_row
        now, then = tick.person, replace(then, time_ns=tick.person.time_ns)
        person = then if self._arm else now
        head = then if self._head else now
        person = replace(person, head_position=head.head_position, head_orientation=head.head_orientation)
        return replace(tick, pose=pose, person=person)


def for_as_long(inputs: Iterable[TickInput], motion: RecordedMotion) -> Iterator[TickInput]:
    """The inputs until the motion is over."""
    first: int | None = None
    for begins in inputs:
        first = begins.time_ns if first is None else first
        if begins.time_ns - first > int(motion.times_ns[-1]):
            return
        yield begins


def at_rest(partner: Partner, motion: RecordedMotion) -> Partner:
    """A simulated person who only watches: as she stands before she raises her hand."""
    recording, count = partner.recording, round(RATE_HZ * 1e-9 * float(motion.times_ns[-1])) + 2
    first = int(np.argmax(recording.valid.all(axis=1)))
    points = np.repeat(recording.points[first : first + 1], count, axis=0)
    valid = np.repeat(recording.valid[first : first + 1], count, axis=0)
    standing = make_recording(RATE_HZ, recording.names, points, valid)
    return replace(partner, recording=standing, palm=None, other_palm=None, contact_frame=-1)
