"""Ratings that were asked trial by trial: mean and spread of each, by condition and style."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from highfive.hil.experiments.analysis.times import mean_and_sd


def ratings_by_style(rows: Iterable[tuple[str, str, Mapping[str, float]]]) -> dict[str, Any]:
    """Rating -> condition -> style -> ``n``, ``mean`` and ``sd``, of (condition, style, ratings) a trial."""
    found: dict[str, dict[str, dict[str, list[float]]]] = {}
    for condition, style, values in rows:
        for name, value in values.items():
            found.setdefault(name, {}).setdefault(condition, {}).setdefault(style, []).append(value)
    return {
        name: {
            condition: {style: mean_and_sd(values) for style, values in styles.items()}
            for condition, styles in conditions.items()
        }
        for name, conditions in found.items()
    }
