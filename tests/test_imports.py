"""Who may import whom: the rooms stay what they are for (docs/architecture.md)."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from paths import ROOT

PACKAGE = "highfive"
OURS = ("calibration", "hil", "mocap_bridge", "model", "scenes")
ERRORS = {"model.toml_file", "model.errors", "model.files", "model.npz_file", "model.plugins", "model.settings"}
MODEL = {"model"}  # with every room of it
BRIDGE = {"mocap_bridge"}
SIM = {"hil.sim", "hil.arm_model", "hil.runtime", "scenes"}
ARM = {"hil.arm", "hil.drivers", "hil.safety"}

# room -> which of our own rooms and modules it may import, besides itself; what is not listed may import nothing
ALLOWED: dict[str, set[str]] = {
    "scenes": set(),
    "model": {"model.geometry.rotations"},  # the type of an array
    "model.geometry": ERRORS | {"model.compiled", "model.linear_algebra"},
    "model.gp": ERRORS | {"model.compiled", "model.linear_algebra", "model.geometry", "model.gp.kernels"},
    "model.gp.kernels": {"model.errors"},
    "model.hgpdm": ERRORS | {"model.compiled", "model.linear_algebra", "model.geometry", "model.gp"},
    "model.online": ERRORS | {"model.compiled", "model.linear_algebra", "model.geometry", "model.gp", "model.hgpdm"},
    "model.evaluation": ERRORS | {"model.geometry", "model.gp", "model.hgpdm", "model.online"},
    "mocap_bridge": {"model.errors"},
    "mocap_bridge.wire": {"model.errors", "model.geometry"},
    "mocap_bridge.files": ERRORS | {"model.geometry", "mocap_bridge.frames", "mocap_bridge.wire"},
    "mocap_bridge.sources": {"model.errors", "model.plugins", "model.settings", "model.geometry", "mocap_bridge.frames"}
    | {"mocap_bridge.wire", "mocap_bridge.files"},
    "mocap_bridge.servers": {"model.errors", "model.geometry", "mocap_bridge.frames"}
    | {"mocap_bridge.wire", "mocap_bridge.files", "mocap_bridge.sources"},
    "mocap_bridge.markers": ERRORS | {"model.geometry", "mocap_bridge.wire", "mocap_bridge.files"},
    "mocap_bridge.tracking": ERRORS | {"model.compiled", "model.linear_algebra", "model.geometry"}
    | {"mocap_bridge.frames", "mocap_bridge.markers", "mocap_bridge.files"},
    "mocap_bridge.body": ERRORS | {"model.compiled", "model.geometry", "mocap_bridge.markers", "mocap_bridge.files"},
    "calibration": ERRORS | {"model.geometry"} | BRIDGE,
    "hil": set(),
    "hil.runtime": ERRORS,
    "hil.arm_model": {"model.errors", "model.toml_file", "model.compiled", "model.linear_algebra", "model.geometry"}
    | {"scenes"},
    "hil.sim": {"model.errors", "model.settings", "model.geometry", "mocap_bridge.frames", "mocap_bridge.markers"}
    | {"hil.arm_model", "hil.runtime", "scenes"},
    "hil.sim.people": ERRORS
    | {"model.geometry", "mocap_bridge.markers", "mocap_bridge.files", "mocap_bridge.frames"}
    | SIM,
    "hil.session": MODEL | BRIDGE | SIM,
    "hil.drivers": {"model.errors", "hil.runtime"},
    "hil.drivers.bus": ERRORS | {"hil.drivers", "hil.runtime"},
    "hil.drivers.emulator": {"model.errors", "hil.drivers", "hil.runtime"},
    "hil.safety": ERRORS | {"model.geometry", "hil.drivers.values", "hil.drivers.servo_errors"},
    "hil.arm": MODEL | BRIDGE | SIM | ARM | {"hil.session", "calibration"},
    "hil.datasets": MODEL | BRIDGE | {"calibration", "hil.runtime", "hil.sim.avatar"},
    "hil.trials": MODEL | BRIDGE | SIM | ARM | {"hil.session", "hil.datasets", "calibration"},
    "hil.recording": MODEL | BRIDGE | SIM | ARM | {"hil.session", "hil.trials"},
    "hil.recording.exports": MODEL | BRIDGE | SIM | {"hil.recording"},
    "hil.experiments": ERRORS
    | {"hil.runtime", "hil.sim.people.emotions", "hil.sim.people.grid", "hil.experiments.analysis"},
    "hil.experiments.recorded": MODEL
    | {"hil.experiments", "hil.experiments.analysis", "hil.recording", "hil.runtime", "hil.sim.avatar"}
    | {"mocap_bridge.files.xdf"},
    "hil.publish": MODEL | BRIDGE | SIM | ARM | {"hil.session", "hil.trials", "hil.recording"},
    "hil.experiments.analysis": MODEL,
    "hil.evaluation": MODEL | BRIDGE | SIM | {"calibration", "hil.datasets", "hil.session"},
    "hil.report": MODEL | BRIDGE | SIM | ARM
    | {"hil.session", "hil.datasets", "hil.trials", "hil.recording", "hil.evaluation", "hil.experiments"},
    "hil.view": MODEL | BRIDGE | SIM
    | {"hil.drivers.latch", "hil.session", "hil.trials.events", "hil.trials.trial_result", "hil.recording"},
    "hil.commands": MODEL | BRIDGE | SIM | ARM
    | {"calibration", "hil.session", "hil.datasets", "hil.trials", "hil.recording", "hil.evaluation", "hil.report"}
    | {"hil.view", "hil.publish", "hil.experiments"},
    "hil.bench": {"calibration", "hil", "mocap_bridge", "model", "scenes"},
    "hil.cli": {"model.errors", "hil.runtime", "hil.commands", PACKAGE},  # the package for its version
    PACKAGE: {"calibration", "hil", "mocap_bridge", "model", "scenes"},
}  # fmt: skip
ALLOWED["hil.commands"] |= {"hil.commands", "hil.bench"}
ALLOWED["hil.commands.rig"] = ALLOWED["hil.commands.stream"] = ALLOWED["hil.commands"]
HARDWARE = {"mujoco", "serial", "dynamixel_sdk"}
# folder -> packages of others that it does without
FORBIDDEN = {
    "scenes": HARDWARE | {"numpy", "jax"},
    "model": HARDWARE | {"socket", "time", "mcap", "ezc3d"},
    "mocap_bridge": HARDWARE,
    "mocap_bridge.wire": {"socket", "select", "time", "threading", "pylsl"},
    "calibration": HARDWARE,
    "hil.experiments.analysis": HARDWARE | {"time", "socket"},
    "hil.arm_model": (HARDWARE - {"mujoco"}) | {"time", "socket"},  # it compiles the arm's model
    "hil.drivers": {"mujoco"},
    "hil.safety": HARDWARE | {"time", "socket"},
}
NOT_BELOW = {"hil.bench", "hil.commands", "hil.cli"}  # only the command line and benchmarks know of these


def modules() -> dict[str, Path]:
    """Every module of ours, with its name below the package."""
    found = {PACKAGE: ROOT / PACKAGE / "__init__.py"}
    for folder in OURS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            found[".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")] = path
    return found


MODULES = modules()


@cache
def imported(path: Path) -> tuple[str, ...]:
    """What a file imports, also inside its functions: modules, or names in them."""
    return tuple(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            assert node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def own(name: str) -> str | None:
    """The module of ours that an imported name means; None if it is none of ours."""
    if not (name == PACKAGE or name.startswith(PACKAGE + ".")):
        return None
    rest = name.removeprefix(PACKAGE).removeprefix(".") or PACKAGE
    while rest not in MODULES:
        rest = rest.rpartition(".")[0] or PACKAGE
    return rest


def room(module: str) -> str:
    """The package that a module lies in."""
    return module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]


def within(name: str, places: set[str]) -> bool:
    return any(name == place or name.startswith(place + ".") for place in places)


def test_every_room_has_its_rule() -> None:
    assert {room(module) for module in MODULES} == set(ALLOWED)


@pytest.mark.parametrize("place", sorted(ALLOWED))
def test_room_imports_only_what_lies_below_it(place: str) -> None:
    for module, path in MODULES.items():
        if room(module) != place:
            continue
        for name in imported(path):
            assert name.partition(".")[0] not in OURS, f"{module} imports {name}: it is {PACKAGE}.{name}"
            target = own(name)
            if target is not None and room(target) != place:
                assert within(target, ALLOWED[place]), f"{module} imports {target}"


@pytest.mark.parametrize("place", sorted(FORBIDDEN))
def test_room_does_without_packages_with_hardware_or_clocks(place: str) -> None:
    for module, path in MODULES.items():
        if within(module, {place}):
            for name in imported(path):
                assert not within(name, FORBIDDEN[place]), f"{module} imports {name}"


def test_nothing_below_imports_a_command_a_benchmark_or_the_command_line() -> None:
    """One module starts benchmarks; benchmarks and the public API may use commands, nobody the command line."""
    users = {"hil.bench": {"hil.bench", "hil.commands.bench"}, "hil.cli": {"hil.cli"}}
    users["hil.commands"] = {"hil.bench", "hil.commands", "hil.cli", PACKAGE}
    assert users.keys() == NOT_BELOW
    for module, path in MODULES.items():
        for name in imported(path):
            target = own(name)
            for place in NOT_BELOW:
                if target is not None and within(target, {place}):
                    assert within(module, users[place]), f"{module} imports {target}"


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = {
        module: {target for name in imported(path) if (target := own(name)) not in (None, module, room(module))}
        for module, path in MODULES.items()
    }
    left = dict(graph)
    while True:
        done = [module for module, targets in left.items() if not targets & left.keys()]
        if not done:
            break
        for module in done:
            del left[module]
    assert not left, f"in circles, or above one: {', '.join(sorted(left))}"


def test_hil_itself_holds_no_module() -> None:
    assert [path.name for path in (ROOT / "hil").glob("*.py")] == ["__init__.py"]


def test_nothing_is_unpickled() -> None:
    for module, path in MODULES.items():
        names = {name.partition(".")[0] for name in imported(path)}
        assert not names & {"pickle", "dill", "cloudpickle", "joblib", "marshal"}, module
        assert "allow_pickle=True" not in path.read_text(encoding="utf-8"), module
