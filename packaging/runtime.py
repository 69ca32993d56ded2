"""What ``pip install high-five`` brings along, as it is installed here: names, versions, licences."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.utils import canonicalize_name

from highfive.hil.bench.installed import brought

ROOT = Path(__file__).resolve().parents[1]

# Where a package's metadata names no licence, or another one than the text beside it: as the text reads. SPDX.
READ = {
    "dynamixel-sdk": "Apache-2.0",
    "etils": "Apache-2.0",
    "ezc3d": "MIT",
    "imageio-ffmpeg": "BSD-2-Clause",
    "numba": "BSD-2-Clause",
    "shellingham": "ISC",
}
SPDX = {
    "MIT License": "MIT",
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD-3-Clause",
    "3-Clause BSD License": "BSD-3-Clause",
    "Python Software Foundation License": "PSF-2.0",
}
"""What packages say instead of SPDX's names."""


@dataclass(frozen=True)
class Package:
    """One that comes along.

    Attributes:
        name, version: as installed.
        licence: SPDX expression; empty where it is not known.
        requires: names of those that it brings along itself.
    """

    name: str
    version: str
    licence: str
    requires: tuple[str, ...]


def project(folder: str = ".") -> dict[str, object]:
    """The ``[project]`` table of a folder of the checkout."""
    table: dict[str, object] = tomllib.loads((ROOT / folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return table


def closure(requirements: list[str]) -> list[Package]:
    """All packages that the requirements bring, theirs and so on, by name; of extras only those that are asked for.

    Raises:
        PackageNotFoundError: one is not installed here.
    """
    packages = []
    for name, one in sorted(brought(requirements).items()):
        about = one.about or distribution(name)
        packages.append(Package(about.metadata["Name"], about.version, licence_of(about), tuple(sorted(one.brings))))
    return packages


def licence_of(about: Distribution) -> str:
    """SPDX expression, from the field for it, the free text or the classifiers; empty if none says it."""
    said = about.metadata
    if expression := said.get("License-Expression"):
        return expression
    if read := READ.get(canonicalize_name(said["Name"])):
        return read
    kinds = [one.rpartition(" :: ")[2] for one in said.get_all("Classifier") or () if one.startswith("License ::")]
    named = sorted({SPDX.get(kind, kind) for kind in kinds if kind != "OSI Approved"})
    if named:
        return " AND ".join(named)
    text = (said.get("License") or "").strip()
    return SPDX.get(text, text) if re.fullmatch(r"[\w .,+()/-]{2,60}", text) else ""
