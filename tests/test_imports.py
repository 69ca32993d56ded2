"""Who may import whom: the folders stay what they are for."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
OURS = {"model", "mocap_bridge", "calibration", "hil", "scenes"}
# folder -> what of our own, and what of other packages with hardware or clocks in them, it may import
ALLOWED = {
    "scenes": {"scenes"},
    "model": {"model"},
    "mocap_bridge": {
        "mocap_bridge",
        "model.rotations",
        "model.skeleton",
        "model.errors",
        "model.files",
        "model.compiled",
    },
    "calibration": {"calibration", "mocap_bridge", "model"},
    "hil/drivers": {"hil.drivers", "model.errors"},
    "hil/safety": {"hil.safety", "hil.drivers.values", "model.rotations", "model.errors"},
}
FORBIDDEN = {
    "scenes": {"mujoco", "serial", "dynamixel_sdk", "numpy", "jax"},
    "model": {"mujoco", "serial", "dynamixel_sdk", "socket", "time", "mcap", "ezc3d"},
    "mocap_bridge": {"mujoco", "serial", "dynamixel_sdk"},
    "calibration": {"mujoco", "serial", "dynamixel_sdk"},
    "hil/drivers": {"mujoco"},
    "hil/safety": {"mujoco", "serial", "dynamixel_sdk", "time", "socket"},
}


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            assert node.module
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def within(name: str, allowed: set[str]) -> bool:
    return any(name == a or name.startswith(a + ".") for a in allowed)


@pytest.mark.parametrize("folder", sorted(ALLOWED))
def test_folder_imports_only_what_lies_below_it(folder: str) -> None:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    for path in files:
        for name in imports(path):
            if name.partition(".")[0] in OURS:
                assert within(name, ALLOWED[folder]), f"{path.relative_to(ROOT)} imports {name}"
            assert not within(name, FORBIDDEN[folder]), f"{path.relative_to(ROOT)} imports {name}"


def test_nothing_is_unpickled() -> None:
    for folder in OURS:
        for path in (ROOT / folder).rglob("*.py"):
            names = {name.partition(".")[0] for name in imports(path)}
            assert not names & {"pickle", "dill", "cloudpickle", "joblib", "marshal"}, path
            assert "allow_pickle=True" not in path.read_text(encoding="utf-8"), path
