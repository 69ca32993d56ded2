"""The page that every report is: one self-contained file without scripts that follows a light or dark screen."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from PIL import Image as Pictures

from highfive.hil.report.drawing import Drawing, to_svg
from highfive.hil.sim.rendering import Image

_TEMPLATE = Path(__file__).with_name("report_template.html")


def render(title: str, subtitle: str, badges: str, sections: Sequence[str]) -> str:
    """A page of HTML sections; the title is plain text, the rest HTML."""
    template = Template(_TEMPLATE.read_text(encoding="utf-8"))
    body = "\n".join(section for section in sections if section)
    return template.substitute(title=escape(title), subtitle=subtitle, badges=badges, body=body)


def section(name: str, content: str) -> str:
    """A section with its heading; nothing if it is empty."""
    return f"<section><h2>{escape(name)}</h2>\n{content}</section>" if content else ""


def figures(drawn: dict[str, Drawing], *names: str) -> str:
    """The named figures, those that were drawn, with their captions."""
    return "".join(
        f"<figure>{to_svg(drawn[name].figure)}<figcaption>{escape(drawn[name].caption)}</figcaption></figure>"
        for name in names
        if name in drawn
    )


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], words: set[int], *, escaped: bool = False) -> str:
    """A table; columns of ``words`` are set left; ``escaped`` rows are HTML."""

    def cells(tag: str, row: Sequence[str], *, clean: bool) -> str:
        classes = [
            ' class="words notes"' if heads[i] == "notes" else ' class="words"' * (i in words) for i in range(len(row))
        ]
        texts = row if clean else [escape(text) for text in row]
        return "<tr>" + "".join(f"<{tag}{c}>{t}</{tag}>" for c, t in zip(classes, texts, strict=True)) + "</tr>"

    body = "\n".join(cells("td", row, clean=escaped) for row in rows)
    head = cells("th", heads, clean=False)
    return f'<div class="scroll"><table><thead>{head}</thead><tbody>\n{body}\n</tbody></table></div>'


def jpeg(image: Image) -> str:
    """A picture as a data address."""
    buffer = io.BytesIO()
    Pictures.fromarray(image).save(buffer, "JPEG", quality=86)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()
