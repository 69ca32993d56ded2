"""Points spread over devices and processes: the objective and the gradient of one device."""

import json
import os
import re
import socket
import subprocess
import sys

import numpy as np
import pytest
from paths import HELPERS, ROOT

from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.sharding import host_count, host_number, join_hosts


def begin(preset: str, devices: int, processes: int = 1, number: int = 0, port: int = 0) -> subprocess.Popen[str]:
    environment = os.environ | {
        # Compiled in a hurry, which is most of the work.
        "XLA_FLAGS": f"--xla_force_host_platform_device_count={devices} --xla_backend_optimization_level=0 "
        "--xla_llvm_disable_expensive_passes=true",
        "JAX_PLATFORMS": "cpu",
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": str(ROOT),
    }
    program = HELPERS / "objective_over_devices.py"
    command = [sys.executable, str(program), preset, str(processes), str(number)]
    return subprocess.Popen(
        [*command, f"127.0.0.1:{port}"], env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True
    )


def finish(process: subprocess.Popen[str]) -> dict:
    output, _ = process.communicate()
    assert process.returncode == 0
    return json.loads(output.splitlines()[-1])


def assert_same(found: dict, expected: dict) -> None:
    np.testing.assert_allclose(found["value"], expected["value"], rtol=1e-9)
    # As one vector: an element, or a small parameter, near zero is a difference of large sums and keeps fewer digits.
    got, reference = (np.concatenate(result["gradient"]) for result in (found, expected))
    assert np.linalg.norm(got - reference) < 1e-9 * np.linalg.norm(reference)


def eight_devices_give_those_of_one(preset: str) -> dict:
    one, eight = begin(preset, 1), begin(preset, 8)
    expected, spread = finish(one), finish(eight)
    assert (expected["devices"], spread["devices"]) == (1, 8)
    assert spread["points"] % 8 != 0  # so that rows that do not count fill them up
    assert_same(spread, expected)
    return expected


@pytest.mark.sweep
@pytest.mark.slow(35)
def test_eight_devices_and_two_processes_give_objective_and_gradient_of_one_device() -> None:
    expected = eight_devices_give_those_of_one("default")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    pair = [begin("default", 1, processes=2, number=number, port=port) for number in range(2)]
    for found in map(finish, pair):
        assert found["devices"] == 2
        assert_same(found, expected)


@pytest.mark.sweep
@pytest.mark.slow(15)
def test_eight_devices_give_those_of_one_by_the_papers_preset_too() -> None:
    eight_devices_give_those_of_one("paper")


@pytest.mark.parametrize(
    ("hosts", "process", "message"),
    [
        (["a:1"], 0, "expected auto, or several"),
        (["a", "b"], 0, "with a port behind the first"),
        (["a:1", "b"], None, "2 hosts, which of them is this? --process-id takes its number, from 0 to 1"),
        (["a:1", "b"], 2, "2 hosts, process 2 of 2? --process-id takes its number, from 0 to 1"),
    ],
)
def test_hosts_that_do_not_fit_are_refused_before_any_is_called(hosts, process, message) -> None:
    with pytest.raises(HighFiveError, match=re.escape(message)):
        join_hosts(hosts, process)


def test_without_hosts_this_is_the_only_one() -> None:
    assert (host_number(), host_count()) == (0, 1)
