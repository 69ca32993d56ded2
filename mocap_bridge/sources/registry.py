"""Every protocol that can be listened to: our own, one line each, and those of installed plug-ins."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from types import MappingProxyType

from highfive.mocap_bridge.sources.scheme import Scheme
from highfive.model.plugins import PluginError, load_plugin, plugin_names

GROUP = "highfive.sources"
"""Entry-point group: the name is the protocol's, the object a :class:`Scheme`."""

BUILT_IN: Mapping[str, str] = MappingProxyType(
    {
        "vicon": "highfive.mocap_bridge.sources.vicon:SCHEME",
        "qtm": "highfive.mocap_bridge.sources.qtm:SCHEME",
        "natnet": "highfive.mocap_bridge.sources.natnet:SCHEME",
        "lsl": "highfive.mocap_bridge.sources.lsl:SCHEME",
    }
)
"""Our own protocols; each one's library is imported only where it is needed."""

_OURS: Mapping[str, str] = MappingProxyType({**BUILT_IN, "headset": "highfive.mocap_bridge.sources.headset:SCHEME"})
"""With what comes through the live page, and not over the network by itself."""


def scheme_names() -> list[str]:
    """Names of all protocols, our own first."""
    return [*_OURS, *(name for name in plugin_names(GROUP) if name not in _OURS)]


def is_known(name: str) -> bool:
    """Whether there is a protocol of that name; installed packages are looked through for none of ours."""
    return name in _OURS or name in plugin_names(GROUP)


@cache
def scheme_named(name: str) -> Scheme:
    """A protocol.

    Raises:
        PluginError: two of that name, none, or one that cannot be loaded or is no :class:`Scheme`.
    """
    found = load_plugin(GROUP, name, _OURS.get(name))
    if not isinstance(found, Scheme):
        raise PluginError(f"the plug-in {name!r} offers a {type(found).__name__}; expected a highfive Scheme")
    return found


def examples() -> str:
    """How addresses of all protocols are written; of those that cannot be loaded only the name."""
    shown = []
    for name in scheme_names():
        example = f"{name}://…"
        with suppress(PluginError):
            example = scheme_named(name).example
        shown.append(example)
    return ", ".join(shown)
