from dataclasses import fields
from pathlib import Path

import jax
import numpy as np
import pytest
from safetensors.numpy import save_file

from highfive.model.errors import HighFiveError
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.sparse import with_kernel
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.trained import HGPDM


@pytest.fixture
def path(model: HGPDM, tmp_path: Path) -> Path:
    save_model(model, tmp_path / "model.safetensors")
    return tmp_path / "model.safetensors"


def is_layer(value: object) -> bool:
    return isinstance(value, Posterior)


def whole(value: object) -> object:
    """A layer with its kernel, of which a file holds the parameters; anything else as it is."""
    return with_kernel(value) if isinstance(value, Posterior) else value


def test_load_after_save_is_the_identity(model: HGPDM, path: Path):
    loaded = load_model(path, "0123456789abcdef")
    for field in fields(HGPDM):
        before, after = getattr(model, field.name), getattr(loaded, field.name)
        if field.name == "feature_map":
            before, after = (before.matrix, before.offset), (after.matrix, after.offset)
        if field.name == "contact":
            before, after = (before.posterior, before.scales), (after.posterior, after.scales)
        before, after = (jax.tree.map(whole, value, is_leaf=is_layer) for value in (before, after))
        assert jax.tree.structure(before) == jax.tree.structure(after)
        for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
            np.testing.assert_array_equal(a, b)
    assert not list(path.parent.glob("*.partial"))


def test_another_skeleton_is_refused(path: Path):
    with pytest.raises(HighFiveError, match="skeleton 0123456789abcdef, expected ffff"):
        load_model(path, "ffff")


@pytest.mark.parametrize("keep", [0, 4, 100, 5000, -1])
def test_truncated_files_are_refused(path: Path, keep: int):
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(HighFiveError, match=r"cut short|not a High Five model"):
        load_model(path)


def test_other_files_are_refused(tmp_path: Path):
    with pytest.raises(HighFiveError, match="no model file"):
        load_model(tmp_path / "nothing")
    other = tmp_path / "other.safetensors"
    save_file({"a": np.zeros(3)}, other)
    with pytest.raises(HighFiveError, match="not a High Five model"):
        load_model(other)


def test_a_failed_write_is_named(model: HGPDM, tmp_path: Path):
    with pytest.raises(HighFiveError, match="cannot write"):
        save_model(model, tmp_path / "nowhere" / "model.safetensors")
