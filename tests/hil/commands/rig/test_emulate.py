"""``highfive rig emulate`` as a user starts and ends it."""

import json
import os
import signal
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
