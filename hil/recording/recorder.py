"""Writes the recording of a session: an MCAP file that stays readable whatever ends the session.

Times are ns of one clock, which begins with the session's first tick. Data goes to the file in whole chunks of half a
second: a crash loses no more than the last of them.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.recording import messages, plots, schemas, viewer_messages
from highfive.hil.recording.recorded_tick import RecordedTick, pose_digest
from highfive.hil.recording.sink import Sink
from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.runtime.clock import utc_ns
from highfive.hil.session.shown import Shown
from highfive.hil.session.stream import StreamState
from highfive.hil.session.stream_watch import WatchSettings
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.trials.machine import machine
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import SessionSettings, versions
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.errors import HighFiveError
from highfive.model.files import unfinished

if TYPE_CHECKING:
    from highfive.hil.arm.loop import ArmTick
    from highfive.hil.drivers.bus.cycle_ring import Cycle

CHUNK_NS = 500_000_000
PAUSE_NS = 1_000_000_000
"""Between two high fives whose clocks both start at 0: those of simulated people, played as fast as it goes."""
_ASTRAY = WatchSettings()
"""What the synchroniser does not use: stamps so far from when they came."""
DRAWN_EVERY = 4
"""Ticks between two skeletons, and two sets of transforms: viewers need no more than 30 a second."""


@dataclass(frozen=True)
class TrialHead:
    """What is known of a high five when it begins.

    Attributes:
        number: counted from 0.
        partner: who raises the hand.
        style: in which the avatar answers, in words.
        weights: the same by emotion.
        corrects: the hand is corrected.
        paced: it goes at the pace of the clock.
    """

    number: int
    partner: Partner
    style: str
    weights: Mapping[str, float]
    corrects: bool = True
    paced: bool = False


class SessionRecorder:
    """Writes a session, tick by tick; close it, or use it in ``with``.

    A recording that has that name already stays until this one is closed.

    Encoding a tick takes some 0.7 ms and now and then waits for the disk: in a session it is called from a thread of
    its own (:class:`highfive.hil.recording.background.BackgroundRecorder`).
    """

    def __init__(
        self,
        path: Path,
        settings: SessionSettings,
        chain: Mapping[str, Any] | None = None,
        utc_ns: Callable[[], int] = utc_ns,
    ) -> None:
        """Starts the file with the session's settings.

        Args:
            path: of the file.
            settings: of the session.
            chain: of :class:`highfive.hil.session.session.Session`, where there is one.
            utc_ns: what time it is, ns since 1970.

        Raises:
            HighFiveError: as from every method, the file cannot be written; what was written before stays readable.
        """
        self.path, self._utc_ns = path, utc_ns
        self._file = unfinished(path) if path.is_file() else path
        self._failure: HighFiveError | None = None
        self._chunk_start: int | None = None
        self._zero_ns: int | None = None  # of the session's clock, where the recording's has its 0
        self._head: TrialHead | None = None  # of a high five that has not begun yet
        self._start = self._end = self._safe = self._count = 0  # ns, of the recording's clock; ticks
        self._moments: list[tuple[int, int]] = []  # of the high five's ticks: by the person's clock and by this one, ns
        self._newest = 0  # ns, of what an arm did last
        self._open = False  # messages wait for the end of their chunk
        self._transforms = viewer_messages.Transforms(settings.arm_name or DEFAULT_ARM)
        self._plots = plots.Plots(lambda: find_arm(settings.arm_name or DEFAULT_ARM).names)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._sink = Sink(self._file)
        except OSError as error:
            raise HighFiveError(f"cannot write the recording {path}: {error.strerror or error}") from None
        # The chunks are cut by time below; this only bounds the memory of one.
        self._writer = Writer(self._sink, chunk_size=8 * 1024 * 1024)  # pyright: ignore[reportArgumentType]
        try:
            self._writer.start(profile="", library="high-five")
        except OSError as error:
            raise self._fail(error) from None
        self._channels = {topic: self._register(topic, *fields) for topic, fields in schemas.TOPICS.items()} | {
            topic: self._writer.register_channel(topic, MessageEncoding.Protobuf, register_schema(self._writer, kind))
            for topic, kind in viewer_messages.TOPICS.items()
        }
        kind = self._writer.register_schema(plots.SCHEMA_NAME, SchemaEncoding.ROS2, plots.SCHEMA.encode())
        for topic in plots.TOPICS:
            self._channels[topic] = self._writer.register_channel(topic, MessageEncoding.CDR, kind)
        said = {**asdict(settings), "versions": versions(), "machine": machine()}
        about = {"settings": said, "joints": list(avatar_skeleton().names)}
        units = "m, rad, s; quaternions w x y z, relative to the parent joint"
        self._add("/session", 0, {"format": schemas.FORMAT, **about, "chain": chain, "units": units})
        self._flush()

    def _register(self, topic: str, name: str, fields: Mapping[str, schemas.Field]) -> int:
        schema = json.dumps(schemas.schema(name, fields)).encode()
        number = self._writer.register_schema(name, SchemaEncoding.JSONSchema, schema)
        return self._writer.register_channel(topic, MessageEncoding.JSON, number)

    def begin_trial(self, head: TrialHead) -> None:
        """A high five begins with the next tick."""
        self._head = head

    def record_tick(self, tick: RecordedTick) -> None:
        """One tick."""
        if self._head is not None:
            head, self._head = self._head, None
            self._begin(head, tick)
        now, number = self._at(tick.at_ns), self._count
        self._moments.append((tick.time_ns, now))
        if tick.frame is not None:
            self._add("/frame", now, messages.frame(tick.frame))
        self._add("/person", now, messages.person(tick.person))
        self._add("/generated", now, messages.pose(tick.generated))
        self._add("/avatar", now, messages.pose(tick.played))
        self._add_drawn("/markers", now, viewer_messages.point_cloud(now, tick.markers))
        if number % DRAWN_EVERY == 0:
            self._add_drawn("/tf", now, self._transforms.body(now, tick.played, tick.person))
            self._add_drawn("/skeleton", now, viewer_messages.skeleton(now, tick.played, tick.person))
        if tick.forecast is not None:
            self._add("/forecast", now, messages.forecast(tick.forecast))
        self._add(
            "/tick", now,
            {"trial": self._trial, "phase": tick.phase, "weight": round(tick.weight, 5),
             "time_to_contact": messages.known(tick.expected), "latency_ms": messages.known(tick.tick_ms),
             "time_ns": tick.time_ns, "at_ns": tick.at_ns, "framed": tick.frame is not None,
             "digest": pose_digest(tick.corrected), "sure": tick.sure},
        )  # fmt: skip
        self._count += 1
        self._ended(now)

    def _begin(self, head: TrialHead, tick: RecordedTick) -> None:
        """The recording's clock is the session's; where that starts anew, the high five comes a second later."""
        if self._zero_ns is None:
            self._zero_ns = tick.at_ns
        elif tick.at_ns - self._zero_ns <= self._end:
            self._zero_ns = tick.at_ns - self._end - PAUSE_NS
        self._trial, partner = head.number, head.partner
        self._moments.clear()
        self._start = now = tick.at_ns - self._zero_ns
        utc = datetime.fromtimestamp(1e-9 * self._utc_ns(), UTC).isoformat(timespec="milliseconds")
        self._add(
            "/trial", now,
            {"trial": head.number, "title": partner.title, "simulated": partner.simulated, "emotion": partner.emotion,
             "style": head.style, "weights": dict(head.weights), "corrects": head.corrects, "cell": partner.cell,
             "notes": list(partner.notes), "paced": head.paced,
             "marker_set": partner.marker_set.name, "markers": list(tick.markers.names), "host_ns": tick.at_ns,
             "utc": utc},
        )  # fmt: skip

    def record_arm(self, ticks: Sequence[ArmTick], cycles: Sequence[Cycle]) -> None:
        """What a servo arm did, by the session's clock; after the first tick of the high five."""
        for tick in ticks:
            self._add("/safety", self._at(tick.frame_ns), messages.safety(tick))
        for cycle in cycles:
            now = self._at(cycle.state.time_ns)
            self._add("/arm", now, messages.arm_cycle(cycle))
            if cycle.number % DRAWN_EVERY == 0:
                self._add_drawn("/tf", now, self._transforms.arm(now, cycle.state.positions))
        # On the way back nothing else cuts chunks; and after a stall there is much in one call.
        if times := [self._at(tick.frame_ns) for tick in ticks] + [self._at(cycle.state.time_ns) for cycle in cycles]:
            self._newest = max(times)
            self._cut_chunk(self._newest, min(times))

    def begin_played(self, at_ns: int) -> None:
        """An arm begins, ``at_ns`` of its clock, to play a high five that was recorded before: a second after what came
        before."""
        self._start = self._newest + PAUSE_NS if self._count else 0
        self._zero_ns = at_ns - self._start
        self._count += 1

    def end_trial(self, result: TrialResult) -> None:
        """The judgement of a high five, and makes all of it safe."""
        self._add("/contact", self._end, messages.contact(result, self._met_s(result.contact_time)))
        self._flush()

    def _met_s(self, contact_time: float) -> float:
        """When palms met, s from the first tick by the recording's clock; the result has it by the person's own, and
        frames may have come late."""
        if not (self._moments and math.isfinite(contact_time)):
            return contact_time
        (first_ns, start), wanted = self._moments[0], round(1e9 * contact_time)
        return 1e-9 * (min(self._moments, key=lambda moment: abs(moment[0] - first_ns - wanted))[1] - start)

    def record_event(self, event: str, at_ns: int | None = None, **about: Any) -> None:
        """Something happened, ``at_ns`` of the session's clock; by default with what was recorded last.

        Args:
            event: its name; see docs/recordings.md.
            at_ns: when.
            about: ``trial``, ``emotion``, ``style``, ``cell``, ``detail``, ``weights``, ``corrects``, ``stream``,
                ``moved_ms``.
        """
        now = max(self._end, self._newest) if at_ns is None else self._at(at_ns)
        self._add("/event", now, {"event": event, **about})
        self._add_drawn("/log", now, viewer_messages.log(now, "INFO", viewer_messages.event_text(event, about)))

    def record_shown(self, page: int, shown: Shown, bound_ns: int) -> None:
        """A picture that a page says it has shown, and how far off that page's clock may be; times of the session's."""
        about = {"page": page, "frame": shown.frame, "dropped": shown.dropped, "bound_ns": bound_ns}
        times = {"pose_ns": shown.pose_ns, "display_ns": shown.display_ns}
        self._add("/shown", self._at(shown.display_ns), {**about, **times})

    def record_streams(self, states: Sequence[StreamState], at_ns: int) -> None:
        """How streams stand, asked for ``at_ns`` of the session's clock."""
        for state in states:
            self._add("/streams", self._at(at_ns), asdict(state))

    def record_stream(self, samples: StreamSamples) -> None:
        """Samples of another program's stream; such as are older than the session are of its first moment.

        Where stamps are of no clock that is known, what they say is kept, and the message is of when it came: a viewer
        shows all topics on one line, and chunks are cut by it.
        """
        topic = f"{schemas.STREAMS}{samples.name}"
        key = f"{topic} {'text' if samples.text else 'numbers'}"
        begins = samples.begins or key not in self._channels  # a stream may have begun in a recording before
        if key not in self._channels:
            self._channels[key] = self._register(topic, *schemas.stream_definition(text=samples.text))
        labels = {"labels": list(samples.labels)} if begins else {}
        for values, stamp, time_ns in zip(samples.values, samples.stamps, samples.times_ns, strict=True):
            row = list(values) if samples.text else [messages.number(value) for value in values]
            message = {"values": row, "stamp": stamp, "time_ns": time_ns, **labels}
            sound = -_ASTRAY.old_ns <= time_ns - samples.came_ns <= _ASTRAY.ahead_ns
            of_ns = time_ns if sound else samples.came_ns
            self._write(key, 0 if self._zero_ns is None else max(0, of_ns - self._zero_ns), _as_json(message))
            labels = {}
        if self._zero_ns is not None:
            self._cut_chunk(samples.came_ns - self._zero_ns)

    def record_log(self, level: str, text: str) -> None:
        """Something was said to the user; ``level`` is INFO, WARNING or ERROR."""
        now = max(self._end, self._newest)
        self._add_drawn("/log", now, viewer_messages.log(now, level, text))

    @property
    def safe(self) -> bool:
        """Nothing is still to be written: all that was recorded is in the file."""
        return not self._open

    @property
    def written(self) -> int:
        """Bytes that are in the file."""
        return self._sink.tell()

    def make_safe(self) -> None:
        """All that was recorded until now is in the file, whatever comes."""
        self._flush()

    def close(self) -> None:
        """Writes the index; without it the file is still readable, only slower to open.

        Raises:
            HighFiveError: what was left cannot be written. Where a write failed before, that was told then.
        """
        if self._failure:
            return
        try:
            self._writer.finish()
            self._sink.close()
            self._take_name()
        except OSError as error:
            raise self._fail(error) from None
        self._failure = HighFiveError(f"the recording {self.path} is closed")

    def discard(self) -> None:
        """Leaves nothing of this recording, and closes."""
        self._sink.close()
        self._file.unlink(missing_ok=True)
        self._failure = HighFiveError(f"the recording {self.path} is closed")

    def __enter__(self) -> SessionRecorder:
        """Self."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes."""
        self.close()

    def _at(self, session_ns: int) -> int:
        """The recording's time of a time of the session's clock; nothing comes before the high five that it is of."""
        return self._start if self._zero_ns is None else max(self._start, session_ns - self._zero_ns)

    def _ended(self, now: int) -> None:
        self._end = max(now, self._end)
        self._cut_chunk(now)

    def _cut_chunk(self, now: int, since: int | None = None) -> None:
        """Writes the chunk if it has become long; what came last is of ``since`` to ``now``."""
        began = now if since is None else since
        self._chunk_start = began if self._chunk_start is None else min(began, self._chunk_start)
        if now - self._chunk_start >= CHUNK_NS:
            self._flush()

    def _add(self, topic: str, time_ns: int, message: Mapping[str, Any]) -> None:
        self._write(topic, time_ns, _as_json(schemas.flattened(topic, message)))
        for plotted, data in self._plots.of(topic, time_ns, message):
            self._write(plotted, time_ns, data)

    def _add_drawn(self, topic: str, time_ns: int, message: Any) -> None:
        self._write(topic, time_ns, message.SerializeToString())

    def _write(self, topic: str, time_ns: int, data: bytes) -> None:
        if self._failure:
            raise self._failure
        with self._writing():
            self._writer.add_message(self._channels[topic], time_ns, data, time_ns, self._count)
        self._open = True

    def _flush(self) -> None:
        if self._failure:
            raise self._failure
        self._chunk_start = None
        with self._writing():
            self._writer.flush()
        self._open, self._safe = False, max(self._end, self._newest)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """The file stays readable whatever happens meanwhile."""
        try:
            yield
        except OSError as error:
            raise self._fail(error) from None
        except KeyboardInterrupt:
            self._abandon()
            raise

    def _abandon(self) -> None:
        # Inside the writer, half a record may be in the chunk: the file ends before it.
        self._sink.cut()
        self._failure = HighFiveError(f"the recording {self.path} was interrupted")
        self._take_name()

    def _take_name(self) -> None:
        if self._file != self.path:
            os.replace(self._file, self.path)

    def _fail(self, error: OSError) -> HighFiveError:
        self._sink.cut()
        if self._file != self.path and not self._count:
            self._file.unlink(missing_ok=True)
        self._failure = HighFiveError(
            f"cannot write the recording {self._file}: {error.strerror or error}; "
            f"what it holds up to {1e-9 * self._safe:.1f} s can be read, make room for the rest"
        )
        return self._failure


def _as_json(message: Mapping[str, Any]) -> bytes:
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
