"""The public API: everything that is promised is there, documented, and imported only where it is used."""

import inspect
import logging
import subprocess
import sys

import pytest
from paths import ROOT

import highfive


def test_all_that_is_promised_is_there_and_documented() -> None:
    for name in highfive.__all__:
        value = getattr(highfive, name)
        if name != "__version__":
            assert inspect.getdoc(value), name
    assert set(highfive.__all__) <= set(dir(highfive))


def test_what_is_not_there_is_named() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = highfive.nothing  # pyright: ignore[reportAttributeAccessIssue]


def run(code: str) -> str:
    """What a process of its own prints, which cannot import what the bridge does without."""
    without = """
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in 'mujoco jax jaxlib matplotlib typer rich serial mcap PIL'.split():
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)
sys.meta_path.insert(0, Without())
"""
    done = subprocess.run([sys.executable, "-c", without + code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_bridge_and_tracker_need_neither_mujoco_nor_jax_nor_a_command_line() -> None:
    made = """
import numpy as np
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
worn = load_marker_set('upper_limb')
points = worn.local_positions[None] + np.linspace(0, 0.1, 30)[:, None, None] + [0, 0, 1.2]
"""
    printed = run(
        made + "import highfive; from highfive.mocap_bridge.tracking.tracker import Tracker; "
        "tracker = Tracker(worn, 120.0); print(len(worn.names), highfive.open_source, highfive.track); "
        "from highfive.mocap_bridge.body import pose_fit; from highfive.calibration import subject"
    )
    assert "open_source" in printed
    assert "track" in printed


def test_what_the_bridge_alone_lacks_is_said_in_one_line() -> None:
    printed = run("import highfive\ntry:\n    highfive.open_session\nexcept ImportError as error:\n    print(error)\n")
    assert printed.strip() == "highfive.open_session needs the package mujoco; pip install high-five"


def test_the_name_alone_imports_nothing() -> None:
    heavy = ("numpy", "scipy", "numba", "jax", "mujoco", "matplotlib", "rich")
    code = f"import sys, highfive; print([name for name in {heavy} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_session_needs_no_jax() -> None:
    code = "import sys, highfive; highfive.load_model(); highfive.open_session; print('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_the_library_is_silent_unless_asked(
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    from highfive.hil.runtime.console import LOGGER, say_aside  # noqa: PLC0415

    handlers, propagate = LOGGER.handlers[:], LOGGER.propagate
    try:
        LOGGER.handlers[:], LOGGER.propagate = [logging.NullHandler()], True
        with caplog.at_level(logging.INFO, logger="highfive"):
            say_aside("a line")
    finally:
        LOGGER.handlers[:], LOGGER.propagate = handlers, propagate
    assert capfd.readouterr() == ("", "")
    assert [record.getMessage() for record in caplog.records] == ["a line"]
