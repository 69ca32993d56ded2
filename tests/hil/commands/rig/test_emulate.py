"""``highfive rig emulate`` as a user starts and ends it."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
import serial
from command_line import failing

from highfive.hil.drivers.bus import instruction_packets as wire
from highfive.hil.drivers.bus.packet import Packet
from highfive.hil.drivers.bus.packet_decoder import Decoder

COMMAND = [sys.executable, "-m", "highfive.hil.cli.main", "rig", "emulate"]
fails = failing("rig", "emulate")


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_ended(tmp_path: Path, how: signal.Signals) -> None:
    link = tmp_path / "arm"
    process = subprocess.Popen(
        [*COMMAND, "--port-link", str(link), "--json"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
    )
    try:
        end = time.monotonic() + 30.0
        while not link.is_symlink():
            assert time.monotonic() < end and process.poll() is None
            time.sleep(0.02)
        with serial.Serial(str(link), 1_000_000, timeout=1.0) as line:
            os.write(line.fileno(), wire.ping(8))
            (found,) = Decoder().feed(line.read(14))
            assert isinstance(found, Packet) and found.id == 8
        process.send_signal(how)
        said, _ = process.communicate(timeout=30)
    finally:
        process.kill()
        process.wait()
    result = json.loads(said)
    assert process.returncode == 0
    assert result["instructions"] == {"ping": 1} and result["port"] == str(link)
    assert len(result["servos"]) == 8 and result["watchdog_trips"] == 0
    assert not link.is_symlink()


@pytest.mark.parametrize(
    "wrong", [["--baud", "12"], ["--faults", "dead"], ["--rig", "none.toml"], ["--port-link", "/proc/none/arm"]]
)
def test_bad_input_is_one_line(fails, wrong: list[str]) -> None:
    fails(*wrong)


def test_a_rehearsal_that_cannot_be_is_refused_before_anything_is_written(
    fails, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for wrong, why in (
        (["--mocap-port", "8801"], "--plate"),
        (["--plate", "plate.toml", "--factory"], "without --factory"),
        (["--plate", "plate.toml", "--arm", "wx250s"], "only of vx300s"),
        (["--plate", "plate.toml", "--faults", "dead"], "dead"),
        (["--plate", "plate.json"], "is a TOML file"),
    ):
        assert why in fails(*wrong, "--seconds", "0.1")
    assert not any(tmp_path.iterdir())
    (tmp_path / "plate.toml").write_text("mine")
    assert "is there already" in fails("--plate", "plate.toml", "--seconds", "0.1")
    assert (tmp_path / "plate.toml").read_text() == "mine"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert "port" in fails("--plate", "other.toml", "--mocap-port", str(taken.getsockname()[1]), "--seconds", "0.1")
    assert not (tmp_path / "other.toml").exists()
