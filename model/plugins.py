"""Plug-ins: objects that other installed packages offer by an entry point (packaging.python.org, "Entry points")."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from highfive.model.errors import HighFiveError


class PluginError(HighFiveError):
    """A plug-in cannot be loaded, or does not do what it promises; the message names it."""


def plugin_names(group: str) -> list[str]:
    """Names that installed packages offer in an entry-point group, sorted, each once."""
    return sorted({point.name for point in entry_points(group=group)})


def load_plugin(group: str, name: str, built_in: str | None = None) -> Any:
    """The object behind a name: our own, or the one that an installed package offers.

    Args:
        group: entry-point group, such as ``highfive.sources``.
        name: name within the group.
        built_in: our own object of that name as ``module:attribute``; None where there is none.

    Raises:
        PluginError: nobody offers the name, two packages do, or the object cannot be imported.
    """
    found = list(entry_points(group=group, name=name))
    if len(found) + (built_in is not None) > 1:
        who = [f"{point.value} (package {_package(point)})" for point in found]
        who += [] if built_in is None else [f"{built_in} (High Five itself)"]
        raise PluginError(f"two plug-ins are called {name!r}: {' and '.join(who)}; uninstall or rename one")
    if built_in is not None:
        return load_object(built_in, f"{name!r}")
    if not found:
        known = ", ".join(plugin_names(group)) or "none is installed"
        raise PluginError(f"no plug-in is called {name!r}; of {group} there are: {known}")
    return load_object(found[0].value, f"the plug-in {name!r} of package {_package(found[0])}")


def load_object(reference: str, title: str) -> Any:
    """The object that ``module:attribute`` or ``file.py:attribute`` names; importing the module runs its code.

    Raises:
        PluginError: the reference is not of that form, or the import fails, in whatever way.
    """
    module, colon, attribute = (part.strip() for part in reference.rpartition(":"))
    if not (module and colon and attribute):
        raise PluginError(
            f"{title}: {reference!r} is no reference to an object; expected module:attribute or file.py:attribute"
        )
    try:
        found: Any = _module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except Exception as error:  # somebody else's code: whatever it raises is reported in one line
        raise PluginError(f"{title} cannot be loaded ({reference}): {fault(error)}") from error
    return found


def _module(name: str) -> ModuleType:
    """A module by its dotted name, or by the path of its file."""
    if not name.endswith(".py"):
        return importlib.import_module(name)
    spec = importlib.util.spec_from_file_location(Path(name).stem, name)
    assert spec is not None  # of a name that ends so
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(spec.name, module)  # dataclasses look their module up by name
    spec.loader.exec_module(module)
    return module


def fault(error: BaseException) -> str:
    """An exception of a plug-in in one line: its class and what it says."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _package(point: EntryPoint) -> str:
    return "unknown" if point.dist is None else f"{point.dist.name} {point.dist.version}"
