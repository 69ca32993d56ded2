"""What a kill may cost is judged of every topic: a recording that lacks one before it breaks the law."""

import shutil
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Message, Schema
from mcap.writer import Writer

from highfive.hil.bench.fault_recording import BEHIND, CUT, LOST
from highfive.hil.bench.fault_run import FaultJob, FaultRun
from highfive.hil.bench.fault_schedule import FOLLOWING, RETURNING, FaultSchedule, Happening
from highfive.hil.bench.laws import Laws
from highfive.hil.recording.recording import read_recording
from highfive.hil.safety.posture import STANDS
from highfive.hil.safety.states import HALTED
from highfive.hil.trials.partners import Partner


def up_to_its_end(file: IO[bytes]) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """The messages of a file that has no end."""
    with suppress(McapError, struct.error):
        yield from NonSeekingReader(file).iter_messages(log_time_order=False)


def without(path: Path, topic: str) -> None:
    """The same file without a topic's messages; its channel stays."""
    rewritten(path, lambda channel, time_ns: channel != topic)


def ended(path: Path, time_ns: int) -> None:
    """The same file without what came after some time."""
    rewritten(path, lambda topic, at_ns: at_ns <= time_ns)


def rewritten(path: Path, stays: Callable[[str, int], bool]) -> None:
    """A file again, with the messages that stay by topic and time."""
    whole = path.with_suffix(".whole")
    shutil.copyfile(path, whole)
    with whole.open("rb") as source, path.open("wb") as target:
        writer, numbers = Writer(target), dict[int, int]()
        writer.start()
        for schema, channel, message in up_to_its_end(source):
            if channel.id not in numbers:
                assert schema is not None
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, kind)
            if stays(channel.topic, message.log_time):
                writer.add_message(numbers[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()


@pytest.mark.slow
def test_a_topic_that_is_not_there_before_a_kill_breaks_the_law(partner: Partner, tmp_path: Path) -> None:
    run = FaultRun(FaultJob(FaultSchedule(1, 0, (Happening("machine killed", 2.0),)), partner), tmp_path)
    run.run()
    assert not run.laws.broken and run.laws.worst[CUT] <= 0.5
    recording = run._recording
    assert recording is not None
    for topic in ("/arm", "/safety", "/tick"):
        path = recording._killed
        kept = path.read_bytes()
        without(path, topic)
        laws = Laws()
        recording.judge(laws)
        assert CUT in [law for law, _ in laws.broken] and laws.worst[CUT] > 0.8, topic
        path.write_bytes(kept)
    laws = Laws()
    recording.judge(laws)
    assert not laws.broken and laws.worst[LOST] == 0.0
    del recording.numbers[len(recording.numbers) // 2]
    recording.judge(laws := Laws())
    assert laws.broken == [(LOST, 1.0)]


@pytest.mark.slow
def test_a_host_that_stands_still_for_half_a_minute_has_lost_no_cycle(partner: Partner, tmp_path: Path) -> None:
    run = FaultRun(FaultJob(FaultSchedule(1, 0, (Happening("host stall", 1.5, 30.0),)), partner), tmp_path)
    run.run()
    assert not run.laws.broken and run.laws.worst[LOST] == 0.0


@pytest.mark.parametrize(
    "kind",
    [
        "Ctrl-C",
        *(
            pytest.param(kind, marks=pytest.mark.slow)
            for kind in ("emergency stop", "host killed", "machine killed", "driver killed")
        ),
    ],
)
@pytest.mark.slow
def test_what_the_arm_does_on_the_way_back_is_recorded_as_it_comes(kind: str, partner: Partner, tmp_path: Path) -> None:
    run = FaultRun(FaultJob(FaultSchedule(1, 0, (Happening(kind, 0.4, phase=RETURNING),)), partner), tmp_path)
    run.run()
    assert not run.laws.broken and run.laws.worst[LOST] == 0.0
    recording, trial = run._recording, run.trial
    assert recording is not None and trial is not None
    back = [tick.frame_ns for tick in trial.back.ticks]
    assert 40 < len(back) < 70 and recording.arm_ticks[-len(back) :] == back
    found = read_recording(recording._killed if recording._killed.exists() else recording._path)
    kept = [message.time_ns for message in found.channels["/safety"]]
    assert kept[-1] - (back[0] - recording.ticks[0]) > 150_000_000
    if kind == "Ctrl-C":  # it brakes, and that is recorded, too
        assert trial.back.ticks[-1].report.state in HALTED and kept[-1] == back[-1] - recording.ticks[0]


@pytest.mark.parametrize(
    ("kind", "at_s", "law"),
    [pytest.param("Ctrl-C", 0.4, LOST, marks=pytest.mark.slow), ("host killed", 0.59, BEHIND)],
)
@pytest.mark.slow
def test_a_way_back_that_is_recorded_only_once_it_is_over_breaks_a_law(
    kind: str, at_s: float, law: str, partner: Partner, tmp_path: Path
) -> None:
    run = FaultRun(FaultJob(FaultSchedule(1, 0, (Happening(kind, at_s, phase=RETURNING),)), partner), tmp_path)
    run.run()
    recording, trial = run._recording, run.trial
    assert recording is not None and trial is not None and not run.laws.broken
    # As if the recorder had been given nothing of it: neither list says so, but the driver's own cycles do.
    cycles, ticks = len(trial.back.cycles), len(trial.back.ticks)
    del recording.cycles[-cycles:], recording.numbers[-cycles:], recording.arm_ticks[-ticks:]
    path = recording._killed if recording._killed.exists() else recording._path
    ended(path, recording.arm_ticks[-1] - recording.ticks[0])
    recording.judge(laws := Laws())
    assert [law for law, _ in laws.broken] == [law]


@pytest.mark.slow(20)
@pytest.mark.parametrize("at_s", [0.05, 0.3, 0.5])
@pytest.mark.parametrize("kind", ["Ctrl-C", "emergency stop"])
def test_a_stop_on_the_way_back_is_recorded_until_the_arm_stands(
    kind: str, at_s: float, partner: Partner, tmp_path: Path
) -> None:
    run = FaultRun(FaultJob(FaultSchedule(1, 0, (Happening(kind, at_s, phase=RETURNING),)), partner), tmp_path)
    run.run()
    assert not run.laws.broken and run._recording is not None
    channels = read_recording(run._recording._path).channels
    *_, moved, last = channels["/arm"]
    assert last.data["mode"] == moved.data["mode"] == "stopped"
    assert np.abs(last.data["velocities"]).max() < STANDS
    rows = [message.data for message in channels["/safety"]]
    assert rows[-1]["state"] in ("estopped", "stopped") and "emergency stop" in rows[-1]["reason"]
    assert (
        channels["/arm"][-1].time_ns
        - next(message.time_ns for message in channels["/arm"] if message.data["mode"] == "stopped")
        < 1_100_000_000
    )


@pytest.mark.slow
@pytest.mark.parametrize("phase", [FOLLOWING, RETURNING])
@pytest.mark.parametrize("kind", ["driver killed", "unplug"])
def test_an_arm_of_which_nothing_is_heard_any_more_ends_its_recording_stopped(
    kind: str, phase: str, partner: Partner, tmp_path: Path
) -> None:
    run = FaultRun(FaultJob(FaultSchedule(1, 0, (Happening(kind, 0.4, 30.0, phase=phase),)), partner), tmp_path)
    run.run()
    assert not run.laws.broken and run._recording is not None
    rows = [message.data for message in read_recording(run._recording._path).channels["/safety"]]
    assert rows[-1]["state"] == "stopped" and rows[-1]["reason"]
    assert "not answered" not in run.said[0]  # what is behind it is said, not what follows from it
