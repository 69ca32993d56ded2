"""Who comes to the high fives of a session: simulated people, a recorded one, or whoever is there live."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle, islice
from pathlib import Path
from typing import TYPE_CHECKING

from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.runtime.console import Bar
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.trials.partners import Partner, recorded_partner, simulated_partners
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.style import style_weights
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.reaction import ReactionModel

if TYPE_CHECKING:
    from highfive.hil.trials.live_partner import LivePerson


def partners_of(
    options: SimulateOptions, model: HGPDM | ReactionModel, bar: Bar, person: LivePerson | None
) -> list[Partner]:
    """One for each high five of the session, in order.

    Raises:
        HighFiveError: the options name something that there is not, or that does not fit.
    """
    if options.lost is None:
        return _partners(options, model, bar, person)
    if person is not None:
        raise HighFiveError("--lost goes with a simulated or recorded person; of a live one pull the cable")
    return [partner.lost(options.lost) for partner in _partners(options, model, bar, person)]


def _partners(
    options: SimulateOptions, model: HGPDM | ReactionModel, bar: Bar, person: LivePerson | None
) -> list[Partner]:
    emotions = options.emotions or (_leading(options.style),) if options.style else options.emotions or model.emotions
    for emotion in (*emotions, *(options.style or {})):
        if emotion not in model.emotions:
            mixture = "; a mixture goes by --style" if "=" in emotion else ""
            raise HighFiveError(f"unknown emotion {emotion!r}; the model knows {', '.join(model.emotions)}{mixture}")
    if options.style is not None:
        style_weights(options.style, model.emotions)
    if options.trials is not None and options.trials < 1:
        raise HighFiveError(f"{options.trials} trials; ask for at least one")
    if options.source is None:
        absent = [emotion for emotion in emotions if emotion not in EMOTIONS]
        if absent:
            raise HighFiveError(f"the simulated person does not know {absent[0]!r}; she knows {', '.join(EMOTIONS)}")
        cells = options.cells or CELLS
        strange = [cell for cell in cells if cell not in CELLS]
        if strange:
            raise HighFiveError(f"unknown cell {strange[0]!r}; the grid has {', '.join(CELLS)}")
        count = options.trials or len(cells) * len(emotions)
        return simulated_partners(count, emotions, cells, options.seed, lambda total: bar("people", total))
    if options.cells:
        raise HighFiveError("--cell goes with the simulated person; a real one raises the hand where she does")
    if person is not None:
        return [person.partner(emotion) for emotion in islice(cycle(emotions), options.trials or len(emotions))]
    first = recorded_partner(Path(options.source), options.human, worn_set(options), emotions[0])
    return [first.in_emotion(emotion) for emotion in emotions][: options.trials]


def worn_set(options: SimulateOptions) -> MarkerSet | None:
    """The marker set that the user named; None finds it."""
    return load_marker_set(options.marker_set) if options.marker_set else None


def _leading(style: Mapping[str, float]) -> str:
    return max(style, key=lambda emotion: style[emotion])
