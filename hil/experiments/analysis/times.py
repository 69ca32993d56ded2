"""Figures of trials over a study, in a few numbers: of each condition median and quartiles, or mean and deviation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def quartiles(values: Sequence[float]) -> dict[str, Any]:
    """``n``, ``median`` and the quartiles ``q1`` and ``q3``; None of nothing."""
    if not values:
        return {"n": 0, "median": None, "q1": None, "q3": None}
    low, middle, high = np.percentile(np.array(values, dtype=float), [25.0, 50.0, 75.0]).tolist()
    return {"n": len(values), "median": middle, "q1": low, "q3": high}


def mean_and_sd(values: Sequence[float]) -> dict[str, Any]:
    """``n``, ``mean`` and ``sd``; None of nothing, and no ``sd`` of one."""
    sd = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return {"n": len(values), "mean": float(np.mean(values)) if values else None, "sd": sd}


def by_condition(values: Mapping[str, Sequence[tuple[str, float | None]]]) -> dict[str, dict[str, Any]]:
    """Condition -> figure -> its quartiles, of figures that each have (condition, value) a trial; None is left out."""
    conditions = list(dict.fromkeys(condition for rows in values.values() for condition, _ in rows))
    return {
        condition: {
            name: quartiles([value for own, value in rows if own == condition and value is not None])
            for name, rows in values.items()
        }
        for condition in conditions
    }
