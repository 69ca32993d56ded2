"""The session from a live system: a person who raises her hand again and again, over the wire."""

import json
import signal
import time
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from live_commands import ended, lab_recording, serving, start, stop

from highfive.calibration.placement import Placement
from highfive.hil.trials.live_partner import PRACTICE_S, LivePerson, live_source
from highfive.hil.trials.partners import simulated_partners
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.model.geometry import rotations

pytestmark = [pytest.mark.slow, pytest.mark.realtime]


@pytest.fixture(scope="module")
def greeting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A C3D file of one person's high five; it is served again and again."""
    path = tmp_path_factory.mktemp("greeting") / "greeting.c3d"
    write_c3d(path, simulated_partners(1, ("neutral",), ("B2",), 3)[0].recording)
    return path


@pytest.mark.parametrize("where", [("vicon", "--port", 0), ("lsl",)], ids=["vicon", "lsl"])
def test_a_hand_that_is_raised_before_a_live_system_is_met(where: tuple, greeting: Path, tmp_path: Path) -> None:
    server, address, _ = serving(where[0], greeting, "--loop", *where[1:])
    try:
        words = ("--source", address, "--emotion", "neutral", "--trials", 2, "--no-pictures", "--json")
        code, out, err = ended(start("simulate", *words, "--out", tmp_path / "session"), within=90.0)
        rows = json.loads(out)["rows"]
        assert any(row["met"] and row["contact_error_mm"] < 5.0 for row in rows), (err, rows)
        assert code in (0, 1) and (tmp_path / "session" / "session.mcap").stat().st_size > 10_000
        assert all("without a new frame" in row["notes"][-1] for row in rows)
    finally:
        stop(server)


def test_a_system_that_dies_costs_no_more_than_the_rest(greeting: Path, tmp_path: Path) -> None:
    server, address, _ = serving("vicon", greeting, "--loop", "--port", 0)
    words = ("--source", address, "--emotion", "neutral", "--trials", 9, "--no-pictures", "--json")
    session = start("simulate", *words, "--out", tmp_path / "session")
    time.sleep(20.0)
    server.send_signal(signal.SIGKILL)
    code, out, err = ended(session, within=90.0)
    result = json.loads(out)
    assert code == 1 and result["interrupted"] and 1 <= len(result["rows"]) < 9
    assert "nothing has come" in err
    assert (tmp_path / "session" / "report.html").exists()


def test_a_system_that_dies_in_the_first_high_five_leaves_nothing_behind(greeting: Path, tmp_path: Path) -> None:
    server, address, _ = serving("vicon", greeting, "--loop", "--port", 0)
    folder = tmp_path / "session"
    session = start("simulate", "--source", address, "--emotion", "neutral", "--no-pictures", "--out", folder)
    end = time.monotonic() + 60.0
    while not (folder.exists() and any(folder.iterdir())):  # the recording is begun, and with it the first high five
        assert session.poll() is None and time.monotonic() < end
        time.sleep(0.01)
    server.send_signal(signal.SIGKILL)
    code, _, err = ended(session, within=60.0)
    assert code == 2 and "no high five could be played" in err
    assert not folder.exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--source", "vicon://127.0.0.1:9"), "nothing listens"),
        (("--source", "vicom://127.0.0.1"), "unknown address"),
    ],
)
def test_what_is_not_there_is_one_line(words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    code, _, err = ended(start("simulate", *words, "--out", tmp_path / "none"), within=40.0)
    assert code == 2 and message in err and err.strip().count("\n") == 0


def test_somebody_with_other_markers_is_told_what_was_wanted(tmp_path: Path) -> None:
    path = lab_recording(tmp_path / "lab.c3d")
    server, address, _ = serving("vicon", path, "--loop", "--port", 0)
    try:
        words = ("--source", address, "--human", "avatar", "--out", tmp_path / "none")
        code, _, err = ended(start("simulate", *words), within=40.0)
        assert code == 2 and "RFIN" in err
    finally:
        stop(server)


def test_in_a_registered_room_the_world_is_where_the_file_says_and_nobody_is_watched(greeting: Path) -> None:
    """Every marker lies where rotation and translation take it, from the first frame on, wherever the person stands."""
    turn, shift = rotations.from_axis_angle("z", 0.7), np.array([2.0, -1.0, 0.1])
    registered = Placement(turn, shift, ("the room is registered",))
    server, address, _ = serving("vicon", greeting, "--loop", "--port", 0)
    try:
        with closing(live_source(address, None)) as source:
            began = time.monotonic()
            person = LivePerson(source, address, None, registered)
            assert time.monotonic() - began < PRACTICE_S  # she need not raise the hand to be found
            frames = list(islice(person.trial(), 20))
    finally:
        stop(server)
    recording = read_c3d(greeting)
    where = rotations.rotate(turn, recording.points) + shift
    for frame in frames:
        columns = [recording.names.index(name) for name in frame.names]
        seen = frame.positions[None] - where[:, columns]
        away = np.where(frame.valid[None] & recording.valid[:, columns], np.linalg.norm(seen, axis=2), 0.0).max(axis=1)
        assert away.min() < 1e-3 or not frame.valid.any()
    assert any(frame.valid.all() for frame in frames)
