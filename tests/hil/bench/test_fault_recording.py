"""What a kill may cost is judged of every topic: a recording that lacks one before it breaks the law."""

import shutil
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Message, Schema
from mcap.writer import Writer

from highfive.hil.bench.fault_recording import CUT, LOST
from highfive.hil.bench.fault_run import FaultJob, FaultRun
from highfive.hil.bench.fault_schedule import FaultSchedule, Happening
from highfive.hil.bench.laws import Laws
from highfive.hil.trials.partners import Partner


def up_to_its_end(file: IO[bytes]) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """The messages of a file that has no end."""
    with suppress(McapError, struct.error):
        yield from NonSeekingReader(file).iter_messages(log_time_order=False)


def without(path: Path, topic: str) -> None:
    """The same file without a topic's messages; its channel stays."""
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
            if channel.topic != topic:
                writer.add_message(numbers[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()


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
