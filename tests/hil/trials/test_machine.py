"""What last bits depend on is known, and what differs is said."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from highfive.hil.trials.machine import machine, machine_differences

_CODE = """
import numpy as np
from highfive.model.compiled import compiled_entry, compiled_here
import {module} as it
it.doubled(np.ones(3))
print(compiled_here())
"""


def test_the_same_machine_does_not_differ_and_another_is_named() -> None:
    now = machine()
    assert now["processor"] and now["target"] and now["numba"] and now["blas"]
    assert machine_differences(now, now) == [] and machine_differences(None, now) == []
    other = {**now, "processor": "Abacus 7", "blas": "by hand 1.0"}
    assert machine_differences(other, now) == [
        f"processor Abacus 7 then, {now['processor']} now",
        f"blas by hand 1.0 then, {now['blas']} now",
    ]


def test_who_compiled_is_said() -> None:
    now = {**machine(), "compiled": []}
    (line,) = machine_differences({**now, "compiled": ["tick.step", "tick.observe"]}, now)
    assert line.startswith("machine code compiled in the session's process (2 functions) then, from its cache now")


@pytest.mark.slow
def test_the_process_that_compiles_knows_it_and_the_next_one_loads(tmp_path: Path) -> None:
    (tmp_path / "made_up_module.py").write_text(
        "from highfive.model.compiled import compiled_entry\n\n\n@compiled_entry\ndef doubled(x):\n    return 2.0 * x\n"
    )
    told = []
    for _ in range(2):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        environment["PYTHONPATH"] = os.pathsep.join([str(tmp_path), environment.get("PYTHONPATH", "")])
        code = _CODE.format(module="made_up_module")
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        told.append(done.stdout.strip())
    assert told == ["['made_up_module.doubled']", "[]"]
