"""Recordings that were damaged, within messages and outside: fewer high fives or one line, never a traceback.

Cases are drawn by seeds from 0 on; ``DAMAGED=2000 pytest tests/hil/recording/test_damaged_recordings.py`` takes so many
of each kind, some 0.1 s a case.
"""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mutations import mutated
from recorded_trials import record_trial
from trial_results import some_results

from highfive.hil.recording.exports.trial_arrays import export_trials
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.replay import open_replay
from highfive.hil.recording.replay_goals import RecordedHighFives
from highfive.hil.recording.session_reader import read_session
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.view.recorded import recorded_trials
from highfive.model.errors import HighFiveError

TICKS = 12
"""Of each high five: what is read of one is read of three hundred."""
FEW, MANY = 24, int(os.environ.get("DAMAGED", "100"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short high fives."""
    folder = tmp_path_factory.mktemp("sound")
    whole, path = folder / "whole.mcap", folder / "session.mcap"
    with SessionRecorder(whole, SessionSettings(seed=3, model="default", trials=2)) as recorder:
        for result in some_results()[:2]:
            record_trial(recorder, result)
    kept = {span.first: span for span in read_session(whole).spans}
    until = [span.start_ns + TICKS * 8_400_000 for span in kept.values()]
    begin = [span.start_ns for span in kept.values()]

    def early(topic: str, time_ns: int, data: bytes) -> bytes | None:
        within = any(first <= time_ns <= last for first, last in zip(begin, until, strict=True))
        return data if within or topic in ("/session", "/contact", "/event") else None

    rewrite(whole, path, early)
    return path


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene()


def rewrite(source: Path, path: Path, change: Callable[[str, int, bytes], bytes | None]) -> None:
    """A recording with the same messages, each as ``change`` has it; without those of which it makes None."""
    with source.open("rb") as file, path.open("wb") as copy:
        writer, channels = Writer(copy, chunk_size=16_384), dict[int, int]()
        writer.start()
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            if channel.id not in channels:
                of = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, of)
            if (data := change(channel.topic, message.log_time, message.data)) is not None:
                writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        writer.finish()


def damaged_within(source: Path, path: Path, rng: np.random.Generator) -> None:
    """Half of the messages are, or one in thirty, of all topics or of one."""
    topics = ["/session", "/trial", "/frame", "/person", "/avatar", "/tick", "/contact", "/markers", None]
    topic, share = topics[int(rng.integers(len(topics)))], 0.5 if rng.random() < 0.5 else 0.03

    def change(of: str, time_ns: int, data: bytes) -> bytes:
        hit = topic in (None, of) and rng.random() < share and len(data) > 0
        return bytes(mutated(data, rng)) if hit else data

    rewrite(source, path, change)


def damaged_outside(source: Path, path: Path, rng: np.random.Generator) -> None:
    """Bytes of the file itself."""
    path.write_bytes(bytes(mutated(source.read_bytes(), rng)))


def every_reading(path: Path, scene: Scene) -> None:
    """Each way in which a recording is read; HighFiveErrors are one line."""
    for number, reading in enumerate(
        (
            lambda: read_recording(path),
            lambda: [one.arrays(topic) for one in read_session(path) for topic in one.messages],
            lambda: [trial.load() for trial in export_trials(read_session(path))],
            lambda: list(recorded_trials(path, scene)),
            lambda: dict(RecordedHighFives(read_session(path))),
            lambda: open_replay(read_session(path), "default", True, None),
        )
    ):
        try:
            reading()
        except HighFiveError as error:
            said = str(error)
            assert said and "\n" not in said, said
            assert not any(f"{word}Error" in said for word in ("Key", "Type", "Value", "Index", "Attribute")), said
        except Exception as error:
            raise AssertionError(f"reading {number} of {path}") from error


def few_and_many() -> list[object]:
    return [*range(FEW), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(FEW, MANY))]


@pytest.mark.slow
@pytest.mark.parametrize("seed", few_and_many())
@pytest.mark.parametrize("damage", [damaged_within, damaged_outside])
def test_what_is_damaged_is_fewer_high_fives_or_one_line(
    damage: Callable[[Path, Path, np.random.Generator], None], seed: int, recorded: Path, scene: Scene, tmp_path: Path
) -> None:
    path = tmp_path / "damaged.mcap"
    damage(recorded, path, np.random.default_rng(seed))
    every_reading(path, scene)


def test_a_sound_one_is_read_in_every_way(recorded: Path, scene: Scene) -> None:
    session = read_session(recorded)
    assert len(session) == 2 and all(TICKS <= span.ticks <= TICKS + 1 for span in session.spans)
    assert len(export_trials(session)) == len(recorded_trials(recorded, scene)) == 2
    assert len(open_replay(session, "default", True, None).trials) == 2
