"""How all figures are drawn: one style, as SVG that follows the page's colours and as PNG."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

INK, FAINT = "#20262c", "#8a9199"
"""Text and axes, which become the page's own colour in SVG; and what stands back, readable on light and dark."""
STYLE: Any = {
    "font.size": 10, "font.family": "DejaVu Sans", "axes.titlesize": 11, "axes.titleweight": "bold",
    "axes.labelsize": 10,
    "axes.edgecolor": INK, "axes.labelcolor": INK, "text.color": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.8, "legend.frameon": False,
    "figure.facecolor": "none", "axes.facecolor": "none", "svg.fonttype": "none", "svg.hashsalt": "high-five",
    "pdf.fonttype": 42, "path.simplify": True, "path.simplify_threshold": 0.3, "lines.linewidth": 1.2,
}  # fmt: skip
HINGES = (
    ("right_shoulder", 0, "shoulder\nflexion", -1.0),
    ("right_shoulder", 1, "shoulder\nabduction", -1.0),
    ("right_shoulder", 2, "shoulder\nrotation", -1.0),
    ("right_elbow", 0, "elbow\nflexion", -1.0),
    ("right_elbow", 2, "forearm\nrotation", 1.0),
    ("right_wrist", 0, "wrist\nflexion", 1.0),
)
"""Joint, hinge, name and the sign that makes the named movement positive."""


FULL_WIDTH = 9.0
"""Inches of a figure that fills the page."""


@dataclass(frozen=True)
class Drawing:
    """A figure.

    Attributes:
        name: of its file, and what a page finds it by.
        caption: the sentence below it.
        figure: matplotlib's.
        section: heading of a session's page that it stands under.
    """

    name: str
    caption: str
    figure: Figure
    section: str = "Movement"


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches on the page."""
    return Figure(figsize=(width, height), layout="constrained", dpi=160)


def draw(painters: Iterable[Callable[[], Drawing | None]]) -> list[Drawing]:
    """What the painters draw, in the style, laid out; those that have nothing to draw give None."""
    with mpl.rc_context(STYLE):
        drawings = [drawing for painter in painters if (drawing := painter()) is not None]
        for drawing in drawings:
            # Laid out once: every later drawing would do it again, at most of its cost.
            if (layout := drawing.figure.get_layout_engine()) is not None:
                layout.execute(drawing.figure)
            drawing.figure.set_layout_engine("none")
    return drawings


def to_svg(figure: Figure) -> str:
    """The figure as an SVG element to put into a page; its ink takes the colour of the text around it."""
    buffer = io.StringIO()
    with mpl.rc_context(STYLE):
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
    text = buffer.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text).replace("xlink:href", "href")
    # A hundredth of a point is enough for where things are; what is written keeps its digits.
    text = re.sub(r"<[^>]*>", lambda tag: re.sub(r"(\d\.\d\d)\d+", r"\1", tag[0]), text)
    # A narrow figure stays narrow on a page whose full width is that of FULL_WIDTH inches.
    width = f"{100.0 * min(1.0, figure.get_figwidth() / FULL_WIDTH):.0f}%"
    head = rf'<svg viewBox="\1" role="img" style="max-width:{width}">'
    text = re.sub(r'<svg [^>]*viewBox="([^"]*)"[^>]*>', head, text, count=1)
    return text.replace(INK, "currentColor").replace("'DejaVu Sans'", "inherit").strip()


def to_png(figure: Figure) -> bytes:
    """The figure as a PNG on white, twice the size on the page."""
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": "high-five"})
    return buffer.getvalue()


def to_svg_file(figure: Figure) -> bytes:
    """The figure as an SVG file of its own, without a date: the same figure gives the same bytes."""
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
    return buffer.getvalue()


def to_pdf(figure: Figure) -> bytes:
    """The figure as a PDF to be printed, letters as letters, without a date."""
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        FigureCanvasPdf(figure).print_pdf(buffer, metadata={"CreationDate": None})
    return buffer.getvalue()
