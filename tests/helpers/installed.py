"""Packages as an installer leaves them: a module, and metadata with entry points beside it."""

from __future__ import annotations

from pathlib import Path


def install(site: Path, name: str, group: str, points: dict[str, str], modules: dict[str, str] | None = None) -> None:
    """Puts a package of version 1.0 into ``site`` that offers ``points`` in an entry-point group."""
    about = site / f"{name.replace('-', '_')}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"[{group}]", *(f"{point} = {value}" for point, value in points.items())]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")
    for module, source in (modules or {}).items():
        (site / f"{module}.py").write_text(source)
