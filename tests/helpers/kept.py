"""What takes long to make and is the same each time: made once, kept between runs and shared between workers."""

from __future__ import annotations

import fcntl
import shutil
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from paths import ROOT

KEPT = ROOT / ".pytest_cache" / "made"
SOURCES = ("calibration", "hil", "mocap_bridge", "model", "scenes", "tests/helpers")
DIGITS = 16
LIBRARIES = ("jax", "mujoco", "numba", "numpy", "scipy")


def kept(name: str, make: Callable[[Path], None]) -> Path:
    """A folder of this name with what ``make`` writes into an empty one; not to be written to.

    It is made again when a source of the project or a library that it is made with changes. Who needs it meanwhile
    waits. What was made from other sources is removed.
    """
    KEPT.mkdir(parents=True, exist_ok=True)
    folder = KEPT / f"{name}-{sources()[:DIGITS]}"
    with (KEPT / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.is_dir():
            for other in KEPT.glob(f"{name}-{'?' * DIGITS}"):
                shutil.rmtree(other)
            new = KEPT / f".{name}"
            shutil.rmtree(new, ignore_errors=True)
            new.mkdir()
            make(new)
            new.rename(folder)
    return folder


@cache
def sources() -> str:
    """A digest of the project's files and of its libraries' versions."""
    digest = sha256()
    for path in sorted(path for folder in SOURCES for path in (ROOT / folder).rglob("*")):
        if path.suffix in {".py", ".toml", ".xml", ".safetensors"}:
            digest.update(f"{path.relative_to(ROOT)}\n".encode() + sha256(path.read_bytes()).digest())
    digest.update(" ".join(f"{name} {version(name)}" for name in LIBRARIES).encode())
    return digest.hexdigest()
