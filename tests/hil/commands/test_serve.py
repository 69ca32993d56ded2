"""``highfive serve`` as a user runs it."""

import json
import signal
import socket
from pathlib import Path

import pytest
from command_line import failing
from live_commands import ended, lab_recording, serving, stop, summary

from highfive.hil.cli import main as cli


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lab_recording(tmp_path_factory.mktemp("serve") / "lab.c3d")


fails = failing("serve")


def test_bad_input_is_one_line(fails, lab: Path, tmp_path: Path) -> None:
    (tmp_path / "text.c3d").write_text("this is no C3D file\n" * 100)
    assert "--host is empty" in fails("vicon", lab, "--host", "")
    assert "vicon, qtm, natnet, lsl" in fails("vrpn", lab)
    assert "absent.c3d" in fails("vicon", tmp_path / "absent.c3d")
    assert "text.c3d" in fails("vicon", tmp_path / "text.c3d")
    assert "flood" in fails("vicon", lab, "--faults", "flood")
    assert "LELB" in fails("vicon", lab, "--port", 0, "--faults", "occlusion=LELB@5")
    assert "Eve" in fails("vicon", lab, "--person", "Eve")
    assert "--rate" in fails("vicon", lab, "--rate", 0)
    assert "--port" in fails("vicon", lab, "--port", 70000)
    assert "--port" in fails("lsl", lab, "--port", 5)


@pytest.mark.parametrize(("protocol", "kind"), [("vicon", socket.SOCK_STREAM), ("qtm", socket.SOCK_STREAM)])
def test_a_port_that_is_taken(fails, lab: Path, protocol: str, kind: int) -> None:
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            taken.listen()
        assert str(taken.getsockname()[1]) in fails(protocol, lab, "--port", taken.getsockname()[1])


def test_ctrl_c_ends_it_well_and_it_says_how_much_was_sent(lab: Path) -> None:
    process, address, about = serving("vicon", lab, "--loop", "--port", 0)
    try:
        assert address.startswith("vicon://127.0.0.1:")
        code, out, err = ended(process, signal.SIGINT)
        assert code == 0, err
        assert "lab.c3d" in about
        assert "human and avatar" in about
        assert out.splitlines()[-1].endswith(" sent")
    finally:
        stop(process)


def test_a_recording_ends_by_itself(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*words: object) -> dict:
        monkeypatch.setattr("sys.argv", ["highfive", "serve", "vicon", str(lab), "--port", "0", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == 0
        return json.loads(capsys.readouterr().out)

    faster = said("--rate", 240, "--seed", 1, "--json")
    assert faster["frames_sent"] == 479  # 240 frames at 120 Hz last 239 periods, of two frames each
    assert faster["rate_hz"] == 240.0
    assert 1 <= said("--loop", "--seconds", 0.3, "--json")["frames_sent"] <= 37


OTHERS = [pytest.param(name, marks=[pytest.mark.slow, pytest.mark.realtime]) for name in ("qtm", "natnet", "lsl")]


@pytest.mark.parametrize("protocol", ["vicon", *OTHERS])
def test_what_is_served_is_what_is_seen(lab: Path, protocol: str) -> None:
    port = [] if protocol == "lsl" else ["--port", 0]
    faults = [
        "--faults",
        "occlusion=RFIN",
        "--faults",
        "gap=30@1.5",
        "--faults",
        "reorder" if protocol != "lsl" else "nan=RWRA",
    ]
    process, address, _ = serving(protocol, lab, "--loop", *port, *faults)
    try:
        said = summary(address, "--person", "human", "--seconds", 2)
    finally:
        stop(process)
    assert said["connection"] == "live"
    assert said["trouble"] == ""
    assert said["source"] == address
    assert said["frames"] > 100
    # None if it was there too late to see the gap. Frames whose order of labels QTM's client hears of too late, on a
    # machine that stands still, are left out rather than shown with other labels.
    unsure = 20 if protocol == "qtm" else 0
    assert 0 <= said["lost_frames"] % 30 <= unsure and said["lost_frames"] <= 30 + unsure
    assert said["nominal_rate_hz"] == 120.0
    assert said["markers"]["RFIN"] == 0.0
    assert said["markers"]["RSHO"] > 0.9
    assert said["marker_set"] == "paper"
    assert set(said["age_ms"]) == {"p50", "p99", "max"}
