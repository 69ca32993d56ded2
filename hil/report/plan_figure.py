"""The picture of an experiment's plans: a row a participant, a bar a trial, in the colour of its style."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import groupby

from matplotlib.axes import Axes
from matplotlib.patches import Patch

from highfive.hil.experiments.plan import Plan
from highfive.hil.experiments.protocol import ADAPTIVE, Mode, Morph, Protocol
from highfive.hil.report.colours import blend_of, colour_of
from highfive.hil.report.drawing import FAINT, FULL_WIDTH, Drawing, draw, new_figure

_MOST = 24
"""Participants that are drawn; of more the first ones."""
_FULL, _LOW = 0.64, 0.36
"""Height of a trial in which the person acts, and of one that she watches."""
_GAP = 1.0
"""Between two blocks, in trials."""


def draw_plans(protocol: Protocol, plans: Sequence[Plan]) -> Drawing:
    """The figure of some plans, of which there is at least one."""
    return draw([partial(_plans, protocol, plans)])[0]


def _plans(protocol: Protocol, plans: Sequence[Plan]) -> Drawing:
    shown = plans[:_MOST]
    figure = new_figure(FULL_WIDTH, 1.0 + 0.36 * len(shown))
    axes = figure.subplots()
    for row, plan in enumerate(shown):
        _participant(axes, row, plan, protocol)
    axes.set_yticks(range(len(shown)), [plan.participant for plan in shown])
    axes.set_ylim(len(shown) - 0.3, -0.9)
    axes.set_xticks([])
    axes.margins(x=0.0)
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.tick_params(length=0)
    names = list(dict.fromkeys(trial.style for plan in shown for trial in plan.trials))
    names.sort(key=[*(style.name for style in protocol.styles), ADAPTIVE].index)
    handles = [Patch(color=_colour(protocol, name), label=name) for name in names]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(8, len(handles)))
    more = f"; {len(plans) - len(shown)} more participants" if len(plans) > len(shown) else ""
    caption = (
        "Plans: a row a participant, a bar a trial, from left to right as they are asked, in the colour of the style. "
        f"Low bars are watched, all others acted{more}."
    )
    return Drawing("plan", caption, figure, "Plan")


def _participant(axes: Axes, row: int, plan: Plan, protocol: Protocol) -> None:
    bars: dict[tuple[str, bool], list[tuple[float, float]]] = {}
    place = 0.0
    for block, trials in groupby(plan.trials, lambda trial: trial.block):
        start = place
        for trial in trials:
            watched = trial.mode in (Mode.OWN_REPLAY, Mode.OTHER_REPLAY)
            bars.setdefault((trial.style, watched), []).append((place + 0.07, 0.86))
            place += 1.0
        text = block if len(block) <= 1.2 * (place - start) else block[0]
        label = axes.text(0.5 * (start + place), row - 0.36, text, ha="center", va="bottom", fontsize=5.5, color=FAINT)
        label.set_in_layout(False)
        place += _GAP
    for (style, watched), spans in bars.items():
        height = _LOW if watched else _FULL
        span = (row + 0.5 * _FULL - height, height)
        axes.broken_barh(spans, span, facecolors=_colour(protocol, style), linewidth=0)


def _colour(protocol: Protocol, name: str) -> str:
    """Of a style: its emotion's, or what lies between the two of a morph."""
    weights = next((style.weights for style in protocol.styles if style.name == name), {})
    morph: Morph | None = protocol.morph
    if morph is not None and weights:
        return blend_of(morph.start, morph.end, weights[morph.end])
    return colour_of(max(weights, key=lambda emotion: weights[emotion]) if weights else name)
