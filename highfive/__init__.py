"""High Five: an avatar, or a servo arm, that meets a raised hand, in the mood you chose.

The public API: what stands in ``__all__`` keeps its name and meaning from one minor version to the next. Everything is
imported where it is first used, so that reading a marker stream needs neither MuJoCo nor JAX. The rooms behind it are
``highfive.model``, ``highfive.mocap_bridge``, ``highfive.calibration``, ``highfive.hil`` and ``highfive.scenes``
(docs/architecture.md).
"""

from __future__ import annotations

import importlib
import logging
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from highfive.hil.commands.library import evaluate, train
    from highfive.hil.recording.recording import SessionRecording, read_recording
    from highfive.hil.recording.session_reader import RecordedHighFive, SessionReader, read_session
    from highfive.hil.session.opening import open_session
    from highfive.hil.session.session import Session, Tick
    from highfive.hil.sim.avatar import Pose, avatar_skeleton
    from highfive.hil.trials.partners import Partner, recorded_partner, simulated_person
    from highfive.mocap_bridge.frames import HumanArm, MarkerFrame
    from highfive.mocap_bridge.markers.marker_set import MarkerSet
    from highfive.mocap_bridge.sources.address import open_source
    from highfive.mocap_bridge.sources.live import Link
    from highfive.mocap_bridge.sources.scheme import Address, Scheme
    from highfive.mocap_bridge.sources.source import Connection, Source, SourceHealth
    from highfive.mocap_bridge.tracking.tracked_recording import TrackedRecording, track
    from highfive.mocap_bridge.wire.errors import LinkError
    from highfive.model.errors import HighFiveError
    from highfive.model.hgpdm.store import load_model, save_model
    from highfive.model.hgpdm.trained import HGPDM
    from highfive.model.hgpdm.trials import Trial
    from highfive.model.online.arm_track import ArmPoints
    from highfive.model.online.contact_forecast import ContactForecast
    from highfive.model.online.reaction import (
        OnlineResponder,
        Reaction,
        ReactionModel,
        SimpleReaction,
    )
    from highfive.model.online.responder import Responder, Response
    from highfive.model.plugins import PluginError

    __version__: str

__all__ = [
    "HGPDM", "Address", "ArmPoints", "Connection", "ContactForecast", "HighFiveError", "HumanArm", "Link", "LinkError",
    "MarkerFrame", "MarkerSet", "OnlineResponder", "Partner", "PluginError", "Pose", "Reaction", "ReactionModel",
    "RecordedHighFive", "Responder", "Response", "Scheme", "Session", "SessionReader", "SessionRecording",
    "SimpleReaction", "Source", "SourceHealth", "Tick", "TrackedRecording", "Trial", "__version__",
    "avatar_skeleton", "evaluate", "load_model", "open_session", "open_source", "read_recording", "read_session",
    "recorded_partner", "save_model", "simulated_person", "track", "train",
]  # fmt: skip

_WHERE = {
    "evaluate": "hil.commands.library",
    "train": "hil.commands.library",
    "SessionRecording": "hil.recording.recording",
    "read_recording": "hil.recording.recording",
    "RecordedHighFive": "hil.recording.session_reader",
    "SessionReader": "hil.recording.session_reader",
    "read_session": "hil.recording.session_reader",
    "open_session": "hil.session.opening",
    "Session": "hil.session.session",
    "Tick": "hil.session.session",
    "Pose": "hil.sim.avatar",
    "avatar_skeleton": "hil.sim.avatar",
    "Partner": "hil.trials.partners",
    "recorded_partner": "hil.trials.partners",
    "simulated_person": "hil.trials.partners",
    "HumanArm": "mocap_bridge.frames",
    "MarkerFrame": "mocap_bridge.frames",
    "MarkerSet": "mocap_bridge.markers.marker_set",
    "open_source": "mocap_bridge.sources.address",
    "Link": "mocap_bridge.sources.live",
    "Address": "mocap_bridge.sources.scheme",
    "Scheme": "mocap_bridge.sources.scheme",
    "Connection": "mocap_bridge.sources.source",
    "Source": "mocap_bridge.sources.source",
    "SourceHealth": "mocap_bridge.sources.source",
    "TrackedRecording": "mocap_bridge.tracking.tracked_recording",
    "track": "mocap_bridge.tracking.tracked_recording",
    "LinkError": "mocap_bridge.wire.errors",
    "HighFiveError": "model.errors",
    "load_model": "model.hgpdm.store",
    "save_model": "model.hgpdm.store",
    "HGPDM": "model.hgpdm.trained",
    "Trial": "model.hgpdm.trials",
    "ArmPoints": "model.online.arm_track",
    "ContactForecast": "model.online.contact_forecast",
    "OnlineResponder": "model.online.reaction",
    "Reaction": "model.online.reaction",
    "ReactionModel": "model.online.reaction",
    "SimpleReaction": "model.online.reaction",
    "Responder": "model.online.responder",
    "Response": "model.online.responder",
    "PluginError": "model.plugins",
}

# A library is silent unless its user asks: logging.basicConfig(level="INFO") shows what it says.
logging.getLogger("highfive").addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

        try:
            value: Any = version("high-five")
        except PackageNotFoundError:
            value = version("high-five-mocap")  # the bridge alone (docs/decisions/2026-11-23-mocap-alone.md)
    elif name in _WHERE:
        try:
            value = getattr(importlib.import_module(f"highfive.{_WHERE[name]}"), name)
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith("highfive."):
                raise ImportError(f"highfive.{name} is not part of high-five-mocap; pip install high-five") from None
            raise ImportError(f"highfive.{name} needs the package {error.name}; pip install high-five") from None
    else:
        raise AttributeError(f"module 'highfive' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
