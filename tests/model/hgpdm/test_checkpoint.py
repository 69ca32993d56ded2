import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.checkpoint import Checkpoint, Unfitting

ARRAYS = {"a": np.arange(3.0), "b": np.array("text")}


def test_what_is_saved_is_loaded(tmp_path: Path):
    checkpoint = Checkpoint(tmp_path / "run.npz", {"seed": 1})
    assert checkpoint.load() is None
    checkpoint.save(ARRAYS)
    found = checkpoint.load()
    assert found is not None and set(found) == set(ARRAYS)
    for name, value in ARRAYS.items():
        np.testing.assert_array_equal(found[name], value)
    assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]
    checkpoint.path.unlink()
    assert checkpoint.load() is None


def test_what_belongs_to_another_training_is_named(tmp_path: Path):
    Checkpoint(tmp_path / "run.npz", {"seed": 1, "data": "x"}).save(ARRAYS)
    with pytest.raises(Unfitting, match=r"of another training \(seed 1 instead of 2\)"):
        Checkpoint(tmp_path / "run.npz", {"seed": 2, "data": "x"}).load()


@pytest.mark.parametrize(
    "damage", [lambda b: b"", lambda b: b"nonsense", lambda b: b[:-30], lambda b: b[: len(b) // 2]]
)
def test_a_damaged_file_is_named(tmp_path: Path, damage):
    checkpoint = Checkpoint(tmp_path / "run.npz", {"seed": 1})
    checkpoint.save(ARRAYS)
    checkpoint.path.write_bytes(damage(checkpoint.path.read_bytes()))
    with pytest.raises(Unfitting, match="not a whole checkpoint"):
        checkpoint.load()


def test_a_file_with_pickled_objects_is_not_read(tmp_path: Path):
    np.savez(tmp_path / "run.npz", owner=np.array([{"seed": 1}], dtype=object))
    with pytest.raises(Unfitting):
        Checkpoint(tmp_path / "run.npz", {"seed": 1}).load()


FULL = """
import resource, sys, numpy as np
from pathlib import Path
from highfive.model.hgpdm.checkpoint import Checkpoint
checkpoint = Checkpoint(Path(sys.argv[1]), {"seed": 1})
checkpoint.save({"a": np.arange(3.0)})
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
try:
    checkpoint.save({"a": np.random.default_rng(0).normal(size=10_000)})
except Exception as error:
    print(type(error).__name__, error)
"""


def test_a_disk_that_takes_no_more_leaves_the_last_checkpoint(tmp_path: Path):
    """The limit of a file's size is a full disk that needs no disk to fill."""
    path = tmp_path / "run.npz"
    done = subprocess.run([sys.executable, "-c", FULL, path], capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"HighFiveError cannot write the checkpoint {path}: ")
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]
    found = Checkpoint(path, {"seed": 1}).load()
    assert found is not None and found["a"].tolist() == [0.0, 1.0, 2.0]


def test_a_folder_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(HighFiveError, match=r"cannot write the checkpoint .*No such file"):
        Checkpoint(tmp_path / "absent" / "run.npz", {}).save(ARRAYS)
