"""A session with the defaults of ``highfive simulate``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from highfive.hil.session.session import Session
from highfive.hil.sim.scene import build_scene
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.reaction import ReactionModel


def open_session(
    marker_set: str | Path | MarkerSet,
    style: str | Mapping[str, float] = "neutral",
    model: HGPDM | ReactionModel | str | Path = DEFAULT_MODEL,
    *,
    correct: bool = True,
) -> Session:
    """A session, ready: ``session.step(frame)`` takes markers and gives the avatar's pose.

    Args:
        marker_set: the person's marker set; a name, a TOML file, or the set itself.
        style: an emotion, or weights by emotion.
        model: a trained model, or its file.
        correct: correct the avatar's palm so that it meets the person's.

    Raises:
        HighFiveError: no such file, marker set or emotion; the model was trained for another skeleton.
    """
    worn = marker_set if isinstance(marker_set, MarkerSet) else load_marker_set(str(marker_set))
    loaded = load_model(model) if isinstance(model, str | Path) else model
    weights = {style: 1.0} if isinstance(style, str) else dict(style)
    return Session(loaded, weights, worn, build_scene(), correct=correct)
