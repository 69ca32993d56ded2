"""Draws docs/arm_states.svg: the states of the safety envelope and what leads from one to another, from its table."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch

from highfive.hil.safety.states import TABLE, Event, State

PLACES = {
    State.UNCHECKED: (0.0, 2.0),
    State.READY: (2.4, 2.0),
    State.TRACKING: (5.0, 3.2),
    State.HOLDING: (8.0, 3.2),
    State.RETRACTING: (5.0, 0.8),
    State.STOPPING: (8.0, 0.8),
    State.STOPPED: (5.0, -0.8),
    State.ESTOPPED: (0.0, -0.8),
}
CALM, MOVING, HALTED = "#0e6b70", "#d9572b", "#8c2f39"
COLOURS = {State.STOPPED: HALTED, State.ESTOPPED: HALTED, State.UNCHECKED: CALM, State.READY: CALM}


def draw() -> Figure:
    """One arrow for each pair of states, with all events that lead that way; the emergency stop is said once."""
    ways: dict[tuple[State, State], list[str]] = defaultdict(list)
    for (state, event), to in TABLE.items():
        if event is not Event.ESTOP:
            ways[state, to].append(event.value)
    figure = Figure(figsize=(9.0, 4.6))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-1.1, 9.2), ylim=(-1.5, 4.0))
    axes.set_axis_off()
    for state, (x, y) in PLACES.items():
        box = {"boxstyle": "round,pad=0.45", "facecolor": COLOURS.get(state, MOVING), "edgecolor": "none"}
        axes.text(x, y, state.value, ha="center", va="center", color="white", fontsize=11, bbox=box, zorder=3)
    for (state, to), events in ways.items():
        bend = 0.0 if (to, state) not in ways else 0.2 if PLACES[state][1] == PLACES[to][1] else 0.5
        start, end = PLACES[state], PLACES[to]
        style = {"arrowstyle": "-|>", "mutation_scale": 13, "shrinkA": 26, "shrinkB": 28, "color": "#5b6470", "lw": 1.2}
        axes.add_patch(FancyArrowPatch(start, end, connectionstyle=f"arc3,rad={-bend}", **style))
        along = (end[0] - start[0], end[1] - start[1])
        part = 0.5 if bend or not along[1] else 0.36  # slanting ones cross in the middle
        x = start[0] + part * along[0] - 0.5 * bend * along[1]
        y = start[1] + part * along[1] + 0.5 * bend * along[0]
        back = {"facecolor": "white", "edgecolor": "none", "pad": 1.2}
        axes.text(x, y, ", ".join(events), ha="center", va="center", fontsize=9, color="#22272e", bbox=back, zorder=2)
    axes.text(-0.95, -1.35, "from each state but itself: estop → estopped", fontsize=9, color=HALTED)
    return figure


if __name__ == "__main__":
    mpl.rcParams.update({"svg.hashsalt": "high five", "svg.fonttype": "none", "font.family": "sans-serif"})
    draw().savefig(Path(__file__).with_name("arm_states.svg"), metadata={"Date": None}, facecolor="white")
