from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file
from same_model import assert_same_model

from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.contact_layer import KNOTS, SPEEDS
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.trained import HGPDM


@pytest.fixture
def path(model: HGPDM, tmp_path: Path) -> Path:
    save_model(model, tmp_path / "model.safetensors")
    return tmp_path / "model.safetensors"


def test_load_after_save_is_the_identity(model: HGPDM, path: Path):
    """Of a model that was just trained, too: the fixture ``model`` sees to that when it is made."""
    assert_same_model(load_model(path, "0123456789abcdef"), model)
    assert not list(path.parent.glob("*.partial"))


def test_a_model_of_before_has_no_clock_to_set_and_an_older_one_knows_no_speed(path: Path):
    """Factors alone; or those by forecast time alone, which then count for every speed."""
    with safe_open(path, "np") as file:
        arrays, about = {name: file.get_tensor(name) for name in file.keys()}, file.metadata()  # noqa: SIM118
    scales = np.ascontiguousarray(arrays.pop("contact.calibration")[..., 1:])
    for of_before in (scales, np.ascontiguousarray(scales[:, 1])):
        save_file(arrays | {"contact.scales": of_before}, path, about)
        layer = load_model(path).contact
        assert layer is not None and layer.calibration.shape == (len(KNOTS), len(SPEEDS), 3)
        assert np.all(layer.calibration[..., 0] == 0.0)
        for column in range(len(SPEEDS)):
            expected = of_before if of_before.ndim == 2 else of_before[:, column]
            np.testing.assert_array_equal(layer.calibration[:, column, 1:], expected)


def test_another_skeleton_is_refused(path: Path):
    with pytest.raises(HighFiveError, match="skeleton 0123456789abcdef, expected ffff"):
        load_model(path, "ffff")


@pytest.mark.parametrize("keep", [0, 4, 100, 5000, -1])
def test_truncated_files_are_refused(path: Path, keep: int):
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(HighFiveError, match=r"cut short|not a High Five model"):
        load_model(path)


def test_other_files_are_refused(tmp_path: Path):
    with pytest.raises(HighFiveError, match=r"/dev/null is no file"):
        load_model("/dev/null")
    with pytest.raises(HighFiveError, match="no model file"):
        load_model(tmp_path / "nothing")
    other = tmp_path / "other.safetensors"
    save_file({"a": np.zeros(3)}, other)
    with pytest.raises(HighFiveError, match="not a High Five model"):
        load_model(other)


def test_a_failed_write_is_named(model: HGPDM, tmp_path: Path):
    with pytest.raises(HighFiveError, match="cannot write"):
        save_model(model, tmp_path / "nowhere" / "model.safetensors")
