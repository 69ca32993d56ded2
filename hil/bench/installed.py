"""How many megabytes a package and all that it needs take, by extra, as they are installed here."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

MB = 1e6


@dataclass
class Brought:
    """A package that requirements bring.

    Attributes:
        about: its metadata; None where it is not installed.
        brings: names of those that it brings along itself.
    """

    about: Distribution | None
    brings: set[str] = field(default_factory=set)


def brought(requirements: Iterable[str]) -> dict[str, Brought]:
    """All packages that the requirements bring, theirs and so on, by name; of extras only those that are asked for."""
    found: dict[str, Brought] = {}
    waiting, seen = deque(("", Requirement(one), "") for one in requirements), set[tuple[str, str, str]]()
    while waiting:
        by, wanted, extra = waiting.popleft()
        if (step := (by, str(wanted), extra)) in seen:
            continue
        seen.add(step)
        if wanted.marker is not None and not wanted.marker.evaluate({"extra": extra}):
            continue
        name = canonicalize_name(wanted.name)
        if by:
            found[by].brings.add(name)
        if name not in found:
            try:
                found[name] = Brought(distribution(name))
            except PackageNotFoundError:
                found[name] = Brought(None)
        about = found[name].about
        own = [Requirement(one) for one in (about.requires if about else None) or ()]
        waiting.extend((name, one, more) for more in ("", *sorted(wanted.extras)) for one in own)
    return found


def installed_sizes(name: str, heaviest: int) -> dict[str, dict[str, Any]]:
    """Of a package without extras (under ``""``), and what each of its extras adds.

    Args:
        name: the package's.
        heaviest: how many of the largest packages are named.

    Returns:
        for each extra ``mb``, None where one of its packages is not installed, and ``heaviest``: package → MB.
    """
    base = _sizes(name)
    result = {"": _summary(base, heaviest)}
    for extra in distribution(name).metadata.get_all("Provides-Extra") or []:
        more = {package: size for package, size in _sizes(f"{name}[{extra}]").items() if package not in base}
        result[extra] = _summary(more, heaviest)
    return result


def _summary(sizes: dict[str, float | None], heaviest: int) -> dict[str, Any]:
    known = {package: round(size / MB, 1) for package, size in sizes.items() if size is not None}
    whole = None if None in sizes.values() else round(sum(known.values()), 1)
    largest = sorted(known.items(), key=lambda it: -it[1])[:heaviest]
    return {"mb": whole, "heaviest": dict(largest)}


def _sizes(requirement: str) -> dict[str, float | None]:
    """Bytes of each package that a requirement brings; None of one that is not installed."""
    return {name: None if it.about is None else _size(it.about) for name, it in brought([requirement]).items()}


def _size(dist: Distribution) -> float:
    total = 0
    for file in dist.files or []:
        path = dist.locate_file(file)
        try:
            total += path.stat().st_size  # type: ignore[union-attr]
        except OSError:  # one that is no longer there
            continue
    return float(total)
