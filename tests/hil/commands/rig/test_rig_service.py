"""``highfive rig scan``, ``check``, ``configure`` and ``release`` on an emulated bus."""

import fcntl
import json
import termios
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from command_line import running

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.lifecycle import PLANT, ready_arm
from highfive.hil.arm.preconditions import check_arm
from highfive.hil.drivers.bus import ports
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess
from highfive.model.errors import HighFiveError

ASYNC_LOW_LATENCY = 0x2000
"""Flag of Linux's ``serial_struct`` (linux/tty_flags.h)."""


run = running("rig")


@pytest.fixture
def factory() -> Iterator[EmulatorProcess]:
    with EmulatorProcess(EmulatorOptions(configured=False)) as emulator:
        yield emulator


@pytest.mark.realtime
def test_servos_are_found_checked_configured_after_asking_checked_again_and_released(
    run, factory: EmulatorProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, _ = run("scan", factory.port, "--json")
    assert code == 0
    (row,) = json.loads(out)["ports"]
    assert row["baud"] == 1_000_000
    assert [servo["id"] for servo in row["servos"]] == [1, 2, 3, 4, 5, 6, 7, 8]
    code, out, _ = run("scan", factory.port)
    assert "XM430-W350" in out
    code, out, _ = run("check", factory.port)
    assert code == 1
    assert "NOT ready" in out and "return_delay_time is 250 (0.5 ms), not 0 (0 ms)" in out
    monkeypatch.setattr("typer.confirm", lambda *_, **__: False)
    code, out, err = run("configure", factory.port)
    assert code == 1
    assert (
        "left as they were" in out and "operating_mode is 3 (position), not 5 (position with a largest current)" in err
    )
    code, out, _ = run("configure", factory.port, "--yes")
    assert code == 0 and "written and read back" in out
    code, out, _ = run("check", factory.port, "--json")
    assert code == 0
    said = json.loads(out)
    assert said["ready"] and len(said["servos"]) == 8
    code, out, _ = run("configure", factory.port)
    assert code == 0 and "nothing was written" in out
    code, out, _ = run("release", factory.port, "--yes")
    assert code == 0 and "torque is off" in out
    factory.set_faults("dead=4")
    code, out, _ = run("release", factory.port, "--yes")
    assert code == 1
    assert "MAY STILL BE ON, servos 4 did not" in out
    code, out, _ = run("scan", factory.port, "--json")
    assert code == 1 and json.loads(out)["ports"][0]["missing"] == [{"id": 4, "joint": "elbow"}]
    code, out, _ = run("scan", factory.port)
    assert code == 1 and "no answer of servo 4 (elbow), which " in out
    assert run("scan", factory.port, "--arm", "openmanipulator_x")[1].count("no answer of servo") <= 1


@pytest.fixture
def adapters(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """What the system shows of its adapters, laid out in a folder of ours."""
    monkeypatch.setattr(ports, "SYSTEM", tmp_path / "devices")
    return tmp_path / "devices"


def latency_timer(adapters: Path, port: str, ms: int) -> Path:
    timer = adapters / Path(port).resolve().name / "latency_timer"
    timer.parent.mkdir(parents=True, exist_ok=True)
    timer.write_text(f"{ms}\n", encoding="ascii")
    return timer


@pytest.mark.realtime
def test_an_adapter_that_stays_slow_is_refused_with_the_line_that_mends_it(run, adapters: Path, tmp_path: Path) -> None:
    """A pseudo-terminal cannot be set to low latency, so whatever the system shows stays."""
    with EmulatorProcess(EmulatorOptions(plant=PLANT, link=str(tmp_path / "arm"))) as emulator:
        timer = latency_timer(adapters, emulator.port, 16)
        mend = f"keeps answers back for 16 ms: echo 1 | sudo tee {timer}"
        code, out, _ = run("check", emulator.port)
        assert code == 1 and mend in out and "NOT ready" in out
        with pytest.raises(HighFiveError, match="keeps answers back for 16 ms"):
            check_arm(ArmOptions(emulator.port, armed=True, nobody_near=True))
        with (
            pytest.raises(HighFiveError, match="nothing moves"),
            ready_arm(ArmOptions(emulator.port, armed=True, nobody_near=True)),
        ):
            pytest.fail("it was let through")
        code, out, _ = run("scan", emulator.port)
        assert mend in out
        timer.write_text("1\n", encoding="ascii")
        assert run("check", emulator.port)[0] == 0
        check_arm(ArmOptions(emulator.port, armed=True, nobody_near=True))


@pytest.mark.realtime
def test_an_adapter_is_set_to_low_latency_whenever_its_port_is_opened(
    run, adapters: Path, monkeypatch: pytest.MonkeyPatch, factory: EmulatorProcess
) -> None:
    """The system's side is stood in for: it takes the flag, and shows 1 ms from then on, as FTDI's driver does."""
    timer, really = latency_timer(adapters, factory.port, 16), fcntl.ioctl

    def ioctl(file: Any, request: int, *arguments: Any) -> Any:
        if request == termios.TIOCGSERIAL:
            return 0
        if request == termios.TIOCSSERIAL:
            (serial_struct,) = arguments
            if serial_struct[4] & ASYNC_LOW_LATENCY:
                timer.write_text("1\n", encoding="ascii")
            return 0
        return really(file, request, *arguments)

    monkeypatch.setattr(fcntl, "ioctl", ioctl)
    code, out, _ = run("scan", factory.port, "--json")
    assert code == 0 and timer.read_text(encoding="ascii") == "1\n"
    (row,) = json.loads(out)["ports"]
    assert row["latency_ms"] == 1 and row["advice"] == ""


def test_bad_ports_and_rigs_are_one_line(run, tmp_path: Path, factory: EmulatorProcess) -> None:
    (tmp_path / "rig.toml").write_text("name = 3")
    for words, said in (
        (("check", tmp_path / "none"), "no such port"),
        (("release", tmp_path / "none", "--yes"), "no such port"),
        (("scan", tmp_path / "none"), "no such port"),
        (("check", factory.port, "--rig", tmp_path / "rig.toml"), "rig.toml"),
        (("check", factory.port, "--rig", tmp_path / "none.toml"), "none.toml"),
    ):
        code, out, err = run(*words)
        assert code == 2, (words, out, err)
        assert out == ""
        assert len(err.strip().splitlines()) == 1
        assert said in err
