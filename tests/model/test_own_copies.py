"""What a compiled function calls is its own: no other function's copy is taken for it, whoever was there first."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

STEPS = 80
"""Of a function that is too long to be inlined three times."""
_SHARED = "\n".join(f"        s += math.sin(v * {step}.5)" for step in range(STEPS))
_MODULE = f"""
import math

from highfive.model.compiled import compiled, compiled_entry


@compiled
def shared(x):
    s = 0.0
    for v in x:
{_SHARED}
    return s


@compiled_entry
def first(x):
    return shared(x) + shared(x[1:]) * shared(x[2:])


@compiled_entry
def second(x):
    return shared(x[::2]) + first(x)
"""
_CODE = """
import numpy as np
from made_up_shared import first, second
from highfive.model.compiled import compiled_here
result = second(np.linspace(0.0, 1.0, 37)), first(np.linspace(0.0, 2.0, 11))
made = [overload.library._final_module for entry in (first, second) for overload in entry.overloads.values()]
defined = [function for module in made for function in module.functions if not function.is_declaration]
copies = [function for function in defined if "shared" in function.name]
print(len(compiled_here()), [value.hex() for value in result])
print(len(copies), sorted({function.linkage.name for function in defined}))
"""


@pytest.mark.slow
def test_copies_have_no_name_outside_and_the_process_that_loads_has_the_same_bits(tmp_path: Path) -> None:
    (tmp_path / "made_up_shared.py").write_text(_MODULE)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment["PYTHONPATH"] = os.pathsep.join([str(tmp_path), environment.get("PYTHONPATH", "")])
    told = [
        subprocess.run(
            [sys.executable, "-c", _CODE], env=environment, capture_output=True, text=True, check=True
        ).stdout.splitlines()
        for _ in range(2)
    ]
    (made, linkages), (loaded, _) = told
    assert made.startswith("2 ") and loaded == f"0 {made[2:]}"
    copies, names = linkages.split(" ", 1)
    assert int(copies) >= 2 and names == "['external', 'internal']"
