"""Every message with which the program refuses, stops, warns or waits, found in its source for the site's search."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
ROOMS = ("model", "mocap_bridge", "calibration", "hil")
MARK = "<span hidden>highfivemessages</span>"
"""A word of these sections alone, which the search of a pasted message asks for (worker.js)."""
_SHORTEST = 12  # letters; what is shorter is no message
_NO_MESSAGES = {"setting", "Option", "Argument", "compile", "match", "search", "sub", "Typer"}


def on_files(files: Files, config: Any) -> Files:
    """Adds the page."""
    lines = ["# Messages", "",
             "What the program says when it refuses, stops, warns or waits, by the part that says it; "
             "… stands for a name, number or path. What to do is in the message itself; where it is not enough, see "
             "[when something is wrong](../troubleshooting.md).", ""]  # fmt: skip
    for path in sorted(one for room in ROOMS for one in (ROOT / room).rglob("*.py")):
        found = messages(path.read_text(encoding="utf-8"))
        if found:
            lines += [
                f"## `{path.relative_to(ROOT).as_posix()}`",
                "",
                MARK,
                "",
                *(f"- {text}" for text in found),
                "",
            ]
    files.append(File.generated(config, "reference/messages.md", content="\n".join(lines)))
    return files


def messages(source: str) -> list[str]:
    """What is raised, returned, said or kept as some words; f-strings with … for what they take in."""
    said: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            said += [text for part in node.exc.args for text in texts(part)]
        elif isinstance(node, ast.Call) and called(node) not in _NO_MESSAGES:
            said += [text for part in node.args for text in texts(part) if of_words(text)]
        elif isinstance(node, ast.Return | ast.Assign) and node.value is not None:
            said += [text for text in texts(node.value) if of_words(text)]
    shown = dict.fromkeys(" ".join(text.split()) for text in said)
    return [f"`{text.replace('`', chr(39))}`" for text in shown if sum(map(str.isalpha, text)) >= _SHORTEST]


def called(call: ast.Call) -> str:
    """The name of what is called."""
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def of_words(text: str) -> bool:
    """A sentence, not a name, a format or a piece of a file."""
    return len(re.findall(r"(?<![\w<])[a-z]{2,}(?![\w=>(])", text)) >= 3 and not re.search(r"[<{}\n]|%\(|\\\\", text)


def texts(node: ast.expr) -> list[str]:
    """Of an expression: a string, an f-string, either of two, or several that are added."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.JoinedStr):
        parts = [part.value if isinstance(part, ast.Constant) else "…" for part in node.values]
        return ["".join(str(part) for part in parts)]
    if isinstance(node, ast.IfExp):
        return [*texts(node.body), *texts(node.orelse)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = texts(node.left) or ["…"], texts(node.right) or ["…"]
        return [one + other for one in left for other in right]
    return []
