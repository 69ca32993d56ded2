"""Compiles what most tests need, once and on all cores, before they run: each worker would do it for itself otherwise.

What is compiled stays beside the sources; where it is there already this takes some seconds.
"""

import subprocess
import sys

SESSION = """
from highfive.hil.session.session import Session
from highfive.hil.sim.scene import build_scene
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model

Session(load_model(DEFAULT_MODEL), {"neutral": 1.0}, load_marker_set("paper"), build_scene())
"""
ARM = """
from highfive.hil.bench.virtual_play import default_planner

default_planner()
"""


def main() -> int:
    """0 where both parts compile."""
    running = [subprocess.Popen([sys.executable, "-c", part]) for part in (SESSION, ARM)]
    return max(process.wait() for process in running)


if __name__ == "__main__":
    sys.exit(main())
