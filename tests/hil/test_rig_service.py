"""``highfive rig scan``, ``check``, ``configure`` and ``release`` on an emulated bus."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil import cli
from hil.drivers.emulator_process import EmulatorOptions, EmulatorProcess

pytestmark = pytest.mark.realtime


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["highfive", "rig", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        return int(str(end.value.code or 0)), out, err

    return run


@pytest.fixture
def factory() -> Iterator[EmulatorProcess]:
    with EmulatorProcess(EmulatorOptions(configured=False)) as emulator:
        yield emulator


def test_servos_are_checked_configured_after_asking_and_checked_again(
    run, factory: EmulatorProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, _ = run("check", factory.port)
    assert code == 1
    assert "NOT ready" in out and "return_delay_time is 250, not 0" in out
    monkeypatch.setattr("typer.confirm", lambda *_, **__: False)
    code, out, err = run("configure", factory.port)
    assert code == 1
    assert "left as they were" in out and "operating_mode is 3, not 5" in err
    code, out, _ = run("configure", factory.port, "--yes")
    assert code == 0 and "written and read back" in out
    code, out, _ = run("check", factory.port, "--json")
    assert code == 0
    said = json.loads(out)
    assert said["ready"] and len(said["servos"]) == 8
    code, out, _ = run("configure", factory.port)
    assert code == 0 and "nothing was written" in out


def test_a_scan_finds_the_rate_and_everyone(run, factory: EmulatorProcess) -> None:
    code, out, _ = run("scan", factory.port, "--json")
    assert code == 0
    (row,) = json.loads(out)["ports"]
    assert row["baud"] == 1_000_000
    assert [servo["id"] for servo in row["servos"]] == [1, 2, 3, 4, 5, 6, 7, 8]
    code, out, _ = run("scan", factory.port)
    assert "XM430-W350" in out


def test_release_asks_first(run, factory: EmulatorProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    code, out, _ = run("release", factory.port, "--yes")
    assert code == 0 and "torque is off" in out
    factory.set_faults("dead=4")
    code, out, _ = run("release", factory.port, "--yes")
    assert code == 1
    assert "MAY STILL BE ON, servos 4 did not" in out


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
