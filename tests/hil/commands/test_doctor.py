"""highfive doctor: looks at everything, fails for want of nothing."""

import importlib.util
import json
import re
import subprocess
import sys
from dataclasses import asdict
from importlib.metadata import version

import pytest
from typer.testing import CliRunner

from highfive.hil.cli.main import app
from highfive.hil.commands.doctor import BROKEN, GOOD, MISSING, examine

MACHINE_FIELDS = {"group", "name", "state", "found", "advice"}


def test_everything_that_is_looked_at_is_reported() -> None:
    result = CliRunner().invoke(app, ["doctor", "--json"])
    found = json.loads(result.stdout)
    assert result.exit_code == (0 if found["ready"] else 1)
    rows = {row["name"]: row for row in found["findings"]}
    assert all(set(row) == MACHINE_FIELDS and row["state"] in (GOOD, MISSING, BROKEN) for row in rows.values())
    for name in (
        "Python",
        "platform",
        "processor",
        "real-time priority",
        "mujoco",
        "OpenGL",
        "vicon://",
        "LSL library",
        "webcam's nets",
    ):
        assert rows[name]["found"], name
    assert all(row["advice"] for row in rows.values() if row["group"] == "software" and row["state"] == BROKEN)


def test_the_webcams_nets_are_there_or_how_to_get_them_is_said() -> None:
    (row,) = [asdict(one) for one in examine() if one.name == "webcam's nets"]
    there = importlib.util.find_spec("high_five_webcam") is not None
    assert row["state"] == (GOOD if there else MISSING)
    assert "MB in" in row["found"] if there else "high-five[webcam]" in row["advice"]


def test_for_people_it_ends_with_what_works() -> None:
    result = CliRunner().invoke(app, ["doctor"])
    assert re.search(rf"mcap-protobuf-support {{2,}}{version('mcap-protobuf-support')}\n", result.stdout)
    assert result.stdout.splitlines()[-1].startswith("A simulated session works here")


@pytest.mark.slow
def test_it_does_not_fail_for_want_of_what_it_looks_for() -> None:
    code = """
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in ('mujoco', 'numba', 'pylsl', 'serial', 'imageio_ffmpeg'):
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)
sys.meta_path.insert(0, Without())
sys.argv = ['highfive', 'doctor', '--json']
from highfive.hil.cli.main import main
main()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env={"PATH": "", "PYTHONPATH": ""}
    )
    found = json.loads(done.stdout)
    assert (done.returncode, done.stderr) == (1, "")
    broken = [row["name"] for row in found["findings"] if row["state"] == BROKEN]
    assert {"compiled code", "film", "LSL", "serial"} <= set(broken)
    assert not found["ready"]
