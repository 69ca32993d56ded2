"""Whether two models are one."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import jax
import numpy as np

from highfive.model.gp.posterior import Posterior
from highfive.model.gp.sparse import with_kernel
from highfive.model.hgpdm.trained import HGPDM


def assert_same_model(one: HGPDM, other: HGPDM) -> None:
    """Every field of theirs holds the same numbers in the same structure."""
    for field in fields(HGPDM):
        before, after = (_plain(getattr(model, field.name)) for model in (one, other))
        assert jax.tree.structure(before) == jax.tree.structure(after)
        for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
            np.testing.assert_array_equal(a, b)


def _plain(value: Any) -> Any:
    """A layer with its kernel, of which a file holds the parameters; other values as their parts."""
    if isinstance(value, Posterior):
        return with_kernel(value)
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return tuple(_plain(part) for part in value)
    return {name: _plain(part) for name, part in vars(value).items()} if is_dataclass(value) else value
