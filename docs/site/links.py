"""Pages as the site has them: links to files beside the documentation become their names, the changelog a page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
_WRAPPED = "<style>.md-typeset pre > code { white-space: pre-wrap; }</style>"
_SHIM = '<script src="https://unpkg.com/iframe-worker/shim"></script>'
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Adds the changelog and a list of the decisions."""
    files.append(File.generated(config, "changes.md", content=(ROOT / "CHANGELOG.md").read_text(encoding="utf-8")))
    decisions = sorted((ROOT / "docs/decisions").glob("*.md"), reverse=True)
    titles = [path.read_text(encoding="utf-8").split("\n", 1)[0].lstrip("# ") for path in decisions]
    rows = [f"- {path.name[:10]}: [{title}]({path.name})" for path, title in zip(decisions, titles, strict=True)]
    content = "# Decisions\n\nWhy things are as they are, newest first; what was tried and failed, too.\n\n"
    files.append(File.generated(config, "decisions/index.md", content=content + "\n".join(rows) + "\n"))
    return files


def on_post_page(output: str, page: Any, config: Any) -> str:
    """The search works from a file without anything from elsewhere, for which Material would fetch a script, and takes
    pasted messages; long lines of code are wrapped, not cut off."""
    own = (Path(__file__).parent / "worker.js").read_text(encoding="utf-8")
    return output.replace(_SHIM, f"<script>{own}</script>").replace("</head>", f"{_WRAPPED}</head>", 1)


def _page_of(place: Path) -> str | None:
    """The page that the site makes of a file outside docs/."""
    if place.parent == ROOT / "examples" and place.suffix == ".ipynb":
        return f"examples/{place.stem}.md"
    names = {"README.md": "index.md", "CHANGELOG.md": "changes.md", "examples/README.md": "examples/index.md"}
    return next((page for name, page in names.items() if place == ROOT / name), None)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Links that lead out of the documentation, to a file of the project, are that file's name."""
    here = Path(page.file.src_uri).parent

    def name(found: re.Match[str]) -> str:
        text, target, anchor = found.groups()
        if "://" in target or target.startswith("mailto:"):
            return found.group(0)
        changes = page.file.src_uri == "changes.md"  # which lies beside docs/, not in it
        if changes and target.startswith("docs/"):
            return f"[{text}]({target.removeprefix('docs/')}{anchor or ''})"
        place = (ROOT / ("" if changes else "docs") / here / target).resolve()
        if (made := _page_of(place)) is not None:
            return f"[{text}]({'../' * len(here.parts)}{made})"
        if place.is_relative_to(ROOT / "docs") or not place.is_relative_to(ROOT) or not place.exists():
            return found.group(0)
        path = place.relative_to(ROOT).as_posix()
        return text if text.strip("`") == path else f"{text} (`{path}`)"

    return _LINK.sub(name, markdown)
