"""Calibration as somebody types it: a serial port, a motion capture system on the network, the machine's clock.

What computes between two ticks stops an arm that is not told of its place: in virtual time nobody sees that.
"""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from highfive.calibration.arm_file import load_arm
from highfive.hil.bench.hidden_arm import TEMPLATE

SEED = 41
HIGHFIVE = [sys.executable, "-m", "highfive.hil.cli.main"]
ROOM = Path(__file__).parents[2] / "helpers" / "arm_in_a_room.py"


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


@pytest.fixture
def room(tmp_path: Path) -> Iterator[tuple[str, str]]:
    """Port of the arm, and address of the cameras."""
    link, port = tmp_path / "arm", free_port()
    with subprocess.Popen(
        [sys.executable, str(ROOM), str(link), str(port), str(SEED)], stdout=subprocess.PIPE, text=True
    ) as lab:
        assert lab.stdout is not None and lab.stdout.readline() == "ready\n"
        yield str(link), f"vicon://127.0.0.1:{port}"
        lab.terminate()


@pytest.mark.slow
@pytest.mark.realtime
def test_an_arm_at_a_port_is_calibrated_as_the_documentation_has_it(room: tuple[str, str], tmp_path: Path) -> None:
    plate, (arm, cameras) = tmp_path / "plate.toml", room
    lines = ["[plate]", f"centre_m = {TEMPLATE.centre.tolist()}", f"normal = {TEMPLATE.normal.tolist()}", "[markers]"]
    lines += [f"{name} = {at.tolist()}" for name, at in zip(TEMPLATE.names, TEMPLATE.places, strict=True)]
    plate.write_text("\n".join(lines))
    told = ["--source", cameras, "--arm", "--json", "--plate", str(plate), "--poses", "10", "--out", "arm.toml"]
    first = subprocess.run(
        [*HIGHFIVE, "calibrate", "extrinsics", arm, *told],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert first.returncode == 0, first.stderr
    summary = json.loads(first.stdout)
    assert summary["poses"] == 10 and summary["held_out_mm"]["median"] < 5.0
    assert load_arm(tmp_path / "arm.toml").registration.poses == 10
