"""Writes the tables of ``docs/licences.md``: what is bundled, and what an installation brings along, with its licences.

``python packaging/licences.py``; in an environment with the versions of ``constraints.txt``. Exit code 1 where a
licence is not known, or is one that this project does not take.
"""

from __future__ import annotations

import re
import sys
import tomllib

from runtime import ROOT, Package, closure, project

PAGE = ROOT / "docs" / "licences.md"
TAKEN = re.compile(
    r"^(0BSD|Apache-2\.0|BSD-[23]-Clause|CC0-1\.0|ISC|LLVM-exception|MIT|MIT-0|MIT-CMU|PSF-2\.0|Zlib|AND|OR|WITH|MPL-2\.0)$"
)


def main() -> None:
    """The command line."""
    packages = closure(list(project()["dependencies"]))
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), packages), encoding="utf-8")
    if wrong := not_taken(packages):
        sys.exit("\n".join(wrong))


def not_taken(packages: list[Package]) -> list[str]:
    """Those whose licence is unknown or none of the permissive ones, with what they say."""
    return [
        f"{one.name} {one.version}: {one.licence or 'no licence in its metadata'}"
        for one in packages
        if not one.licence or not all(TAKEN.match(word) for word in re.split(r"[\s()]+", one.licence) if word)
    ]


def filled(page: str, packages: list[Package]) -> str:
    """The page with its two tables made anew."""
    for name, lines in (("bundled", bundled()), ("runtime", runtime(packages))):
        mark = f"<!-- {name} -->"
        head, _, rest = page.partition(f"{mark}\n")
        page = "\n".join([f"{head}{mark}", *lines, f"{mark}{rest.partition(mark)[2]}"])
    return page


def bundled() -> list[str]:
    """Rows of what is in the packages."""
    content = tomllib.loads((ROOT / "packaging" / "third_party.toml").read_text(encoding="utf-8"))
    rows = [
        f"| {one['name']} | {one['version']} | {one['licence']} | {one['holder']} | "
        f"{', '.join(f'`{file}`' for file in one['files'])} | `{one['package']}` |"
        for one in content["bundled"]
    ]
    ours = [
        f"| ours | | Apache-2.0 | {one['how']} | {', '.join(f'`{file}`' for file in one['files'])} | `high-five` |"
        for one in content["made"]
    ]
    return [
        "| what | version | licence | whose, or how it is made | where | package |",
        "|---|---|---|---|---|---|",
        *rows,
        *ours,
    ]


def runtime(packages: list[Package]) -> list[str]:
    """Rows of what ``pip install`` brings."""
    rows = [f"| {one.name} | {one.version} | {one.licence} |" for one in packages]
    return ["| package | version | licence |", "|---|---|---|", *rows]


if __name__ == "__main__":
    main()
