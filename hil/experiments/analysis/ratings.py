"""Ratings that were asked trial by trial: mean and spread of each, by condition and style."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from highfive.hil.experiments.analysis.times import mean_and_sd


def ratings_by_style(rows: Iterable[tuple[str, str, Mapping[str, float]]], order: Sequence[str] = ()) -> dict[str, Any]:
    """Rating -> condition -> style -> ``n``, ``mean`` and ``sd``, of (condition, style, ratings) a trial.

    Styles come as in ``order``, others behind them.
    """

    def place(style: str) -> int:
        return order.index(style) if style in order else len(order)

    found: dict[str, dict[str, dict[str, list[float]]]] = {}
    for condition, style, values in rows:
        for name, value in values.items():
            found.setdefault(name, {}).setdefault(condition, {}).setdefault(style, []).append(value)
    return {
        name: {
            condition: {style: mean_and_sd(styles[style]) for style in sorted(styles, key=place)}
            for condition, styles in conditions.items()
        }
        for name, conditions in found.items()
    }
