"""The emulator on a pseudo-terminal: real baud rate, a cable that comes out, a process that ends.

Nothing here asks how soon: what has to happen is waited for, for a minute.
"""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import serial

from highfive.hil.drivers.bus import instruction_packets as wire
from highfive.hil.drivers.bus.packet import Packet
from highfive.hil.drivers.bus.packet_decoder import Decoder
from highfive.hil.drivers.emulator.emulator import Emulator
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess, make_bus
from highfive.model.errors import HighFiveError

BAUD = 1_000_000
PATIENCE_S = 60.0


def reply(line: serial.Serial, said: bytes, seconds: float = PATIENCE_S) -> list[int]:
    """IDs that answered, until somebody has and then nothing more comes."""
    os.write(line.fileno(), said)
    decoder, found = Decoder(), []
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        if not select.select([line.fileno()], [], [], min(left, 0.3 if found else left))[0]:
            break
        found += [one.id for one in decoder.feed(os.read(line.fileno(), 4096)) if isinstance(one, Packet)]
    return found


def test_the_terminals_baud_rate_is_the_hosts() -> None:
    with (
        EmulatorProcess(EmulatorOptions(baud_rate=57_600)) as emulator,
        serial.Serial(emulator.port, 57_600, timeout=0) as line,
    ):
        assert reply(line, wire.ping(3)) == [3]
        line.baudrate = BAUD
        assert reply(line, wire.ping(3), 0.5) == []
        for _ in range(2):  # acknowledged a round of the emulator apart: it has read what there was
            emulator.set_faults("")
        line.baudrate = 57_600
        assert reply(line, wire.ping(3)) == [3]
    assert emulator.summary["instructions"]["ping"] == 3


@pytest.mark.parametrize("baud", [9_600, 57_600])
def test_bytes_are_never_early(baud: int) -> None:
    """Late they may be on a busy machine; a line does not carry bytes faster than its baud rate."""
    said, length = wire.read(1, 578, 60), 71
    with (
        EmulatorProcess(EmulatorOptions(baud_rate=baud)) as emulator,
        serial.Serial(emulator.port, baud, timeout=0) as line,
    ):
        start = time.monotonic()
        os.write(line.fileno(), said)
        got = b""
        while len(got) < length and time.monotonic() - start < PATIENCE_S:
            if select.select([line.fileno()], [], [], 1.0)[0]:
                got += os.read(line.fileno(), 4096)
        assert len(got) == length
        assert time.monotonic() - start >= (len(said) + length) * 10 / baud


def test_the_cable_comes_out_and_goes_in_again(tmp_path: Path) -> None:
    link = tmp_path / "arm"
    with EmulatorProcess(EmulatorOptions(link=str(link))) as emulator:
        assert emulator.port == str(link)
        with serial.Serial(str(link), BAUD, timeout=0) as line:
            assert reply(line, wire.ping(1)) == [1]
            emulator.set_faults("unplug")
            wait_for(lambda: not link.is_symlink())
            with pytest.raises((OSError, serial.SerialException)):
                for _ in range(2):
                    os.write(line.fileno(), wire.ping(1))
                    os.read(line.fileno(), 1)
        emulator.set_faults("")
        wait_for(link.is_symlink)
        with serial.Serial(str(link), BAUD, timeout=0) as line:
            assert reply(line, wire.ping(1)) == [1]
    assert not link.is_symlink()


def wait_for(what, seconds: float = PATIENCE_S) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_faults_while_it_runs() -> None:
    with EmulatorProcess() as emulator, serial.Serial(emulator.port, BAUD, timeout=0) as line:
        assert reply(line, wire.ping(4)) == [4]
        emulator.set_faults("dead=4")
        wait_for(lambda: not reply(line, wire.ping(4), 0.3))
        emulator.set_faults("")
        wait_for(lambda: reply(line, wire.ping(4), 0.3) == [4])
        with pytest.raises(HighFiveError):
            emulator.set_faults("nonsense")
        with pytest.raises(HighFiveError, match="there is no servo 99; there are 1, 2, 3, 4, 5, 6, 7"):
            emulator.set_faults("dead=99")
        assert reply(line, wire.ping(4)) == [4]  # it goes on


def test_what_cannot_be_emulated_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for options in (
        EmulatorOptions(rig=str(tmp_path / "none.toml")),
        EmulatorOptions(link=str(tmp_path / "file")),
        EmulatorOptions(link=str(tmp_path / "no" / "folder")),
        EmulatorOptions(plant="no.such:plant"),
        EmulatorOptions(faults=("nonsense",)),
        EmulatorOptions(faults=("dead=99",)),
        EmulatorOptions(servos=("1=AX-12",)),
        EmulatorOptions(servos=("300=XM540-W270",)),
        EmulatorOptions(baud_rate=12),
    ):
        with pytest.raises(HighFiveError) as caught, Emulator(make_bus(options), link=options.link):
            pass
        assert "\n" not in str(caught.value)
    assert (tmp_path / "file").read_text() == ""
    with pytest.raises(HighFiveError, match="cannot read"), EmulatorProcess(EmulatorOptions(rig="none.toml")):
        pass


def test_one_that_was_killed_is_told_as_such() -> None:
    with EmulatorProcess() as emulator:
        emulator.kill()
        time.sleep(0.2)
        with pytest.raises(HighFiveError, match="ended"):
            for _ in range(5):
                emulator.set_faults("dead=1")
    assert emulator.summary == {}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_its_end_is_left_to_whoever_started_it(number: signal.Signals) -> None:
    with EmulatorProcess() as emulator, serial.Serial(emulator.port, BAUD, timeout=0) as line:
        assert emulator._process is not None
        emulator._process.send_signal(number)
        assert reply(line, wire.ping(2)) == [2]
    assert emulator.summary["instructions"] == {"ping": 1}


def test_a_plant_is_taken_by_name() -> None:
    bus = make_bus(EmulatorOptions(plant=f"{__name__}:held"))
    assert bus.servos[0].read(132, 4)[1] == (2048 + 652).to_bytes(4, "little")


def held():
    """A body that stands at 1 rad whatever pushes it."""
    import numpy as np  # noqa: PLC0415

    class Held:
        def step(self, torques, seconds):
            return np.full(6, 1.0), np.zeros(6)

    return Held()


def test_it_ends_quietly_with_whoever_started_it(tmp_path: Path) -> None:
    link = tmp_path / "arm"
    program = (
        "import os, time\n"
        "from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess\n"
        f"emulator = EmulatorProcess(EmulatorOptions(link={str(link)!r})).__enter__()\n"
        "os._exit(1)\n"
    )
    said = subprocess.run([sys.executable, "-c", program], check=False, timeout=60, stderr=subprocess.PIPE, text=True)
    assert said.stderr == ""  # of the emulator too: it is read until both have closed it
    wait_for(lambda: not link.is_symlink())


def test_served_in_the_callers_thread(tmp_path: Path) -> None:
    with Emulator(make_bus(EmulatorOptions()), link=tmp_path / "arm") as emulator:
        summary = emulator.run(lambda: False, 0.05)
    assert summary.seconds >= 0.05 and summary.instructions == {}
    assert not (tmp_path / "arm").is_symlink()


def test_a_link_of_the_users_own_is_left_alone(tmp_path: Path) -> None:
    link, (master, slave) = tmp_path / "arm", os.openpty()
    try:
        for target in ("/dev/null", "/dev/ttyS-none", os.ttyname(slave)):
            link.symlink_to(target)
            with pytest.raises(HighFiveError, match=rf"leads to {target}, which somebody uses; choose"):
                Emulator(make_bus(EmulatorOptions()), link=link)
            assert os.readlink(link) == target
            link.unlink()
    finally:
        os.close(master)
        os.close(slave)
    link.symlink_to("/dev/pts/999999")  # what an emulator left that was killed
    with Emulator(make_bus(EmulatorOptions()), link=link):
        link.unlink()
        link.symlink_to("/dev/null")  # and now it is somebody else's
    assert os.readlink(link) == "/dev/null"
