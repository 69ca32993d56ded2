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
# The session's own process is at its tracker for so long that the arm's has time for the tick of the model.
ARM = """
from highfive.hil.bench.virtual_play import default_planner
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model
from highfive.model.online.responder import Responder

default_planner()
Responder(load_model(DEFAULT_MODEL), "neutral")
"""


def main() -> int:
    """0 where both parts compile."""
    running = [subprocess.Popen([sys.executable, "-c", part]) for part in (SESSION, ARM)]
    return max(process.wait() for process in running)


if __name__ == "__main__":
    sys.exit(main())
