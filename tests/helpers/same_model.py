"""Whether two models are one."""

from __future__ import annotations

from dataclasses import fields

import jax
import numpy as np

from highfive.model.gp.posterior import Posterior
from highfive.model.gp.sparse import with_kernel
from highfive.model.hgpdm.trained import HGPDM


def assert_same_model(one: HGPDM, other: HGPDM) -> None:
    """Every field of theirs holds the same numbers in the same structure."""
    for field in fields(HGPDM):
        before, after = getattr(one, field.name), getattr(other, field.name)
        if field.name == "feature_map":
            before, after = (before.matrix, before.offset), (after.matrix, after.offset)
        if field.name == "contact":
            before, after = (before.posterior, before.scales), (after.posterior, after.scales)
        if field.name == "task_space" and before is not None and after is not None:
            before, after = vars(before), vars(after)
        if field.name == "ensemble" and before is not None and after is not None:
            before, after = ((one.regression, vars(one.neighbours), one.spread) for one in (before, after))
        before, after = (jax.tree.map(_whole, value, is_leaf=_is_layer) for value in (before, after))
        assert jax.tree.structure(before) == jax.tree.structure(after)
        for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
            np.testing.assert_array_equal(a, b)


def _is_layer(value: object) -> bool:
    return isinstance(value, Posterior)


def _whole(value: object) -> object:
    """A layer with its kernel, of which a file holds the parameters; anything else as it is."""
    return with_kernel(value) if isinstance(value, Posterior) else value
