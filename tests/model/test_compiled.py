import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from paths import ROOT

from highfive.model.compiled import compiled_entry, exactly_compiled_entry, reached


def made_from_text(text: str) -> Callable:
    """A function that stands in no file, so that there is no place beside it to store its machine code."""
    names: dict[str, Callable] = {}
    exec(compile(text, "<text>", "exec"), names)
    return names["function"]


def test_a_place_that_cannot_be_written_to_is_no_obstacle():
    function = compiled_entry(made_from_text("def function(x):\n    return 2.0 * x"))
    assert function(1.5) == 3.0


def test_infinity_and_not_a_number_keep_their_meaning():
    function = compiled_entry(made_from_text("def function(x):\n    return (x - x) * 0.0, 1.0 / (x - x)"))
    np.testing.assert_array_equal(function(np.inf), [np.nan, np.nan])
    np.testing.assert_array_equal(function(1.0), [0.0, np.inf])


@exactly_compiled_entry
def products(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    result = np.empty(len(a))
    for i in range(len(a)):
        result[i] = a[i] * b[i] + b[i] * c[i] - c[i] * a[i]
    return result


def test_what_is_compiled_exactly_rounds_as_numpy_does() -> None:
    a, b, c = np.random.default_rng(0).normal(size=(3, 10_000))
    np.testing.assert_array_equal(products(a, b, c), a * b + b * c - c * a)


SWALLOWED = """
import sys
from numba.core.codegen import JITCodeLibrary
from highfive.model.compiled import compiled_entry
def ended(library, content):
    raise KeyboardInterrupt  # in LLVM's callback, which swallows it
JITCodeLibrary._object_compiled_hook = classmethod(lambda cls, engine, module: ended(module, None))
sys.unraisablehook = lambda unraisable: print(unraisable.exc_type.__name__)

@compiled_entry
def doubled(x):
    return 2.0 * x

print(doubled(21.0))
"""


@pytest.mark.slow
def test_machine_code_that_an_interrupt_kept_from_being_handed_over_works_and_is_not_kept(tmp_path: Path) -> None:
    """The interrupt is raised again by who swallowed it; an error of the compiler would hide it."""
    program = tmp_path / "program.py"
    program.write_text(SWALLOWED)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(program)], capture_output=True, text=True, timeout=60, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "42.0" and "KeyboardInterrupt" in done.stdout
    assert not list(tmp_path.rglob("*.nbc"))


PROGRAM = """
from highfive.model.compiled import compiled_entry, reached, when_compiling

@compiled_entry
def doubled(x):
    return 2.0 * x

with when_compiling(lambda: print("compiling")):
    print(doubled(21.0), doubled(21))
"""


@pytest.mark.slow
def test_machine_code_for_which_the_disk_has_no_room_works_and_is_not_kept(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n{PROGRAM}")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, str(program)], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-2:] == ["42.0", "42.0"]
    assert not list(tmp_path.rglob("*.nbc"))


@pytest.mark.slow
def test_what_is_only_loaded_is_not_told_as_compiled(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    environment = os.environ | {
        "PYTHONPATH": str(ROOT),
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
    }
    said = [
        subprocess.run(
            [sys.executable, str(program)], env=environment, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert said == ["compiling\n42.0 42.0\n", "42.0 42.0\n"]


CALLEE = """
from highfive.model.compiled import compiled
FACTOR = {factor}

@compiled
def scaled(x):
    return FACTOR * x
"""
BETWEEN = """
import callee
from highfive.model.compiled import compiled

@compiled
def once_more(x):
    return callee.scaled(x) + 1.0
"""
CALLER = """
from between import once_more
from highfive.model.compiled import compiled_entry, reached, when_compiling

@compiled_entry
def entry(x):
    return once_more(x)

with when_compiling(lambda: print("compiling")):
    print(entry(1.0))
"""


@pytest.mark.slow
def test_change_in_one_file_compiles_its_callers_in_another_again(tmp_path: Path) -> None:
    def said(factor: float) -> str:
        (tmp_path / "callee.py").write_text(CALLEE.format(factor=factor))
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, str(tmp_path / "caller.py")], env=environment, capture_output=True, text=True, check=True
        )
        return done.stdout

    (tmp_path / "between.py").write_text(BETWEEN)
    (tmp_path / "caller.py").write_text(CALLER)
    assert said(2.0) == "compiling\n3.0\n"
    assert said(2.0) == "3.0\n"
    assert said(4.0) == "compiling\n5.0\n"
    assert said(4.0) == "5.0\n"


def test_digest_knows_constants_of_other_modules() -> None:
    def made(constant: object) -> str:
        names: dict[str, Callable] = {"LENGTH": constant}  # pyright: ignore
        exec(compile("def function(x):\n    return LENGTH * x", "<text>", "exec"), names)
        return reached(names["function"])

    assert made(1.0) == made(1.0)
    assert len({made(1.0), made(2.0), made(np.ones(2)), made(np.zeros(2))}) == 4
