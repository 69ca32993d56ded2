"""The reference of the Python interface: a page for each module with public names, from its docstrings."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

import highfive

ROOT = Path(__file__).parents[2]
ROOMS = ("model", "mocap_bridge", "calibration", "hil", "scenes")
INSIDE = ("hil/cli", "hil/bench")
"""Of no use from outside: what reads the command line, and benchmarks."""
_ROLE = re.compile(r":(?:func|class|data|meth|mod|attr|exc):(?=<code)")


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages, and one that lists them by room."""
    lines = ["# Python", "", "What a program of your own imports first is in [`highfive`](highfive.md): "
             "[how to use it](../../library.md). All other public modules follow, by room.", ""]  # fmt: skip
    files.append(File.generated(config, "reference/python/highfive.md", content=exported()))
    room = ""
    for path in modules():
        name = "highfive." + ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if str(path.parent.relative_to(ROOT)) != room:
            room = str(path.parent.relative_to(ROOT))
            lines += ["", f"## {room}", ""]
        page = f"{name.removeprefix('highfive.')}.md"
        # The search would take seconds a page to read all of these; it has their list, with what each is for.
        unread = "---\nsearch:\n  exclude: true\n---\n\n"
        content = f"{unread}# {name}\n\n::: {name}\n    options:\n      show_root_heading: false\n"
        files.append(File.generated(config, f"reference/python/{page}", content=content))
        lines.append(f"- [`{path.stem}`]({page}): {summary(path)}")
    files.append(File.generated(config, "reference/python/index.md", content="\n".join(lines) + "\n"))
    return files


def exported() -> str:
    """The page of what ``import highfive`` gives, each name with a link to where it is described."""
    lines = ["# highfive", "", (highfive.__doc__ or "").strip(), "", "| name | what it is |", "|---|---|"]
    for name in highfive.__all__:
        value = getattr(highfive, name)
        module = getattr(value, "__module__", "")
        about = (getattr(value, "__doc__", None) or "").strip().split("\n\n")[0].replace("\n", " ").replace("|", "\\|")
        own = module.startswith("highfive.") and getattr(value, "__name__", "") == name
        page = f"[`{name}`]({module.removeprefix('highfive.')}.md#{module}.{name})" if own else f"`{name}`"
        lines.append(f"| {page} | {about if own else ''} |")
    return "\n".join(lines) + "\n"


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Roles of docstrings (``:func:`` and the like) are read by editors; on a page the name says enough."""
    return _ROLE.sub("", html) if page.file.src_uri.startswith("reference/python/") else html


def modules() -> list[Path]:
    """Those with a public function, class or value."""
    found: list[Path] = []
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py"), key=lambda one: (str(one.parent), one.name)):
            inside = path.relative_to(ROOT).as_posix()
            private = path.name.startswith("_")
            if private or inside.startswith(INSIDE) or "__pycache__" in path.parts:
                continue
            found.append(path)
    return found


def summary(path: Path) -> str:
    """The first sentence of a module's docstring."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.split("\n\n")[0].replace("\n", " ")
