"""Draws docs/architecture.svg: the path of one frame."""

from pathlib import Path

BOXES = [  # column, row, width in columns, title, lines below
    (0, 0, 1, "marker source", ["simulated person,", "C3D recording"]),
    (1, 0, 1, "tracker", ["fills occlusions,", "rejects ghosts"]),
    (2, 0, 1, "human arm", ["head, joints, palm,", "two hand points"]),
    (3, 0, 1, "responder", ["hGPDM: filter in I,", "down to 53 joints"]),
    (4, 0, 1, "reach + correction", ["fades in the miss,", "box QP on trunk and arm"]),
    (5, 0, 1, "MuJoCo scene", ["play-out,", "contact check"]),
    (5, 1, 1, "record and report", ["MCAP, HTML, MP4"]),
]
WIDTH, HEIGHT, STEP_X, STEP_Y, LEFT, TOP = 168, 84, 200, 130, 16, 46
FOLDERS = ["mocap_bridge/", "mocap_bridge/", "mocap_bridge/", "model/", "hil/", "hil/sim/"]


def box(column: int, row: int, width: int, title: str, lines: list[str]) -> str:
    """A station."""
    x, y = LEFT + column * STEP_X, TOP + row * STEP_Y
    text = f'<text x="{x + WIDTH / 2}" y="{y + 28}" class="title">{title}</text>'
    for number, line in enumerate(lines):
        text += f'<text x="{x + WIDTH / 2}" y="{y + 50 + 18 * number}" class="line">{line}</text>'
    return f'<rect x="{x}" y="{y}" width="{WIDTH * width}" height="{HEIGHT}" rx="10"/>{text}'


def arrow(x1: float, y1: float, x2: float, y2: float) -> str:
    """A line with a head."""
    return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" marker-end="url(#head)"/>'


def picture() -> str:
    """The whole picture as SVG."""
    parts = [box(*entry) for entry in BOXES]
    for column in range(5):
        x, y = LEFT + column * STEP_X + WIDTH, TOP + HEIGHT / 2
        parts.append(arrow(x + 2, y, x + STEP_X - WIDTH - 4, y))
    x = LEFT + 5 * STEP_X + WIDTH / 2
    parts.append(arrow(x, TOP + HEIGHT + 2, x, TOP + STEP_Y - 4))
    # The palm of the live person goes straight to the correction.
    start, end = LEFT + 2 * STEP_X + WIDTH / 2, LEFT + 4 * STEP_X + WIDTH / 2
    low = TOP + HEIGHT + 34
    path = f"M {start} {TOP + HEIGHT + 2} V {low} H {end} V {TOP + HEIGHT + 4}"
    parts.append(f'<path d="{path}" marker-end="url(#head)"/>')
    parts.append(f'<text x="{(start + end) / 2}" y="{low - 8}" class="line">the person\'s palm</text>')
    for column, folder in enumerate(FOLDERS):
        parts.append(f'<text x="{LEFT + column * STEP_X + WIDTH / 2}" y="{TOP - 14}" class="folder">{folder}</text>')
    style = (
        "rect{fill:#f3f6fa;stroke:#33506b;stroke-width:1.5}line,path{stroke:#33506b;stroke-width:1.8;fill:none}"
        "text{font-family:system-ui,sans-serif;text-anchor:middle;fill:#1c2b3a}"
        ".title{font-size:15px;font-weight:600}.line{font-size:12.5px}"
        ".folder{font-size:12.5px;font-family:ui-monospace,monospace;fill:#5b7186}"
    )
    head = '<marker id="head" markerWidth="9" markerHeight="9" refX="8" refY="4.5" orient="auto">'
    head += '<path d="M0,0 L9,4.5 L0,9 z" style="fill:#33506b;stroke:none"/></marker>'
    size = f"0 0 {2 * LEFT + 5 * STEP_X + WIDTH} {TOP + STEP_Y + HEIGHT + 16}"
    background = '<rect width="100%" height="100%" style="fill:#ffffff;stroke:none"/>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{size}"><style>{style}</style><defs>{head}</defs>'
        f"{background}{''.join(parts)}</svg>\n"
    )


if __name__ == "__main__":
    Path(__file__).with_name("architecture.svg").write_text(picture(), encoding="utf-8")
