"""Which OpenGL MuJoCo draws with. MuJoCo decides once, while it is imported: best, this runs before that."""

from __future__ import annotations

import ctypes
import importlib
import os
import sys
from collections.abc import Callable, MutableMapping

OFF = ("disable", "disabled", "off", "false", "0")
_WINDOW = ("", "glfw", "glx", "cgl", "wgl", "enable", "enabled", "on", "true", "1")
_LIBRARIES = {"egl": "libEGL.so.1", "osmesa": "libOSMesa.so.8"}


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def choose_backend(
    environment: MutableMapping[str, str], platform: str = sys.platform, loads: Callable[[str], bool] = _loads
) -> str:
    """Sets ``MUJOCO_GL`` to something that MuJoCo can be imported with; returns why there are no pictures, or ''.

    A value that is set is respected if it can work. Otherwise, on Linux without a display, it is EGL, else OSMesa.
    A value that would make MuJoCo's import fail is replaced by ``disable``: all but pictures works without OpenGL.
    """
    requested = environment.get("MUJOCO_GL", "").lower().strip()
    if requested in OFF:
        return f"MUJOCO_GL={requested} switches OpenGL off"
    if requested in _LIBRARIES and platform == "linux":
        if loads(_LIBRARIES[requested]):
            return ""
        problem = f"MUJOCO_GL={requested}, but {_LIBRARIES[requested]} does not load"
    elif requested not in _WINDOW:
        problem = f"MUJOCO_GL={requested} is none of egl, osmesa, glfw, disable"
    elif requested or platform != "linux" or environment.get("DISPLAY"):
        return ""
    else:
        for backend, library in _LIBRARIES.items():
            if loads(library):
                environment["MUJOCO_GL"] = backend
                return ""
        problem = f"no display, and neither {' nor '.join(_LIBRARIES.values())} loads (package libegl1 or libosmesa6)"
    environment["MUJOCO_GL"] = "disable"
    return problem


def _tell_mujoco(backend: str) -> None:
    """Hands the choice to a MuJoCo that a script imported before this package, when it had not been made."""
    if "mujoco" in sys.modules and backend in _LIBRARIES:
        contexts = importlib.import_module("mujoco.rendering.classic.gl_context")
        context = importlib.import_module(f"mujoco.{backend}").GLContext
        contexts.GLContext = context  # pyright: ignore[reportAttributeAccessIssue]


NO_PICTURES = choose_backend(os.environ)
"""Why no pictures can be made in this process, or '' where they should work."""
_tell_mujoco(os.environ.get("MUJOCO_GL", ""))
