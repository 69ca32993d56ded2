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
_SHORTEST = 10  # letters; what is shorter is no message
_MOST = 8  # texts of one f-string
OF_THE_COMMAND_LINE = (
    "No such command '…'", "No such option: …", "Missing command", "Missing option '…'", "Missing argument '…'",
    "Option '…' requires an argument", "Invalid value for '…': …",
    "it should be less than or equal to …", "it should be greater than or equal to …",
    "it should be a valid integer, unable to parse string as an integer",
    "it should be a valid number, unable to parse string as a number", "Got unexpected extra argument (…)",
)  # fmt: skip
"""What the library of the command line says, and ..."""
OF_THE_SYSTEM = (
    "…: Permission denied", "…: No such file or directory", "…: Is a directory", "…: No space left on device",
    "…: Read-only file system", "…: File name too long",
)  # fmt: skip
"""... the operating system; neither stands in our source."""
_NO_MESSAGES = {"setting", "Option", "Argument", "compile", "match", "search", "sub", "Typer"}


def on_files(files: Files, config: Any) -> Files:
    """Adds the page."""
    lines = ["# Messages", "",
             "What the program says when it refuses, stops, warns or waits, by the part that says it; "
             "… stands for a name, number or path. What to do is in the message itself; where it is not enough, see "
             "[when something is wrong](../troubleshooting.md).", ""]  # fmt: skip
    for head, advice, said in (
        (
            "The command line",
            "`highfive COMMAND --help` lists a command's options and what they take.",
            OF_THE_COMMAND_LINE,
        ),
        (
            "The operating system",
            "Of a file or folder that is named: look who may read or write it, and for room.",
            OF_THE_SYSTEM,
        ),
    ):
        lines += [f"## {head}", "", MARK, "", advice, "", *(f"- `{text}`" for text in said), ""]
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
    """Whatever is made of some words, but documentation; f-strings with … for what they take in."""
    tree = ast.parse(source)
    passed = _not_said(tree)
    raised = {id(part) for node in ast.walk(tree) if isinstance(node, ast.Raise) for part in ast.walk(node)}
    said: list[str] = []
    for node in ast.walk(tree):
        if id(node) not in passed and isinstance(node, ast.Constant | ast.JoinedStr | ast.BinOp):
            said += [text for text in texts(node) if of_words(text) or (id(node) in raised and " " in text)]
    shown = dict.fromkeys(" ".join(text.split()) for text in said)
    return [f"`{text.replace('`', chr(39))}`" for text in shown if sum(map(str.isalpha, text)) >= _SHORTEST]


def _not_said(tree: ast.Module) -> set[int]:
    """Nodes that are no message: documentation, what other names of calls take, and parts of a larger text."""
    found: set[int] = set()
    for node in ast.walk(tree):
        parts: list[ast.AST] = []
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            parts = [node.value]
        elif isinstance(node, ast.Call) and called(node) in _NO_MESSAGES:
            parts = [node]
        elif isinstance(node, ast.JoinedStr):
            parts = [part for part in node.values if isinstance(part, ast.Constant)]
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add) and texts(node):
            parts = [node.left, node.right]
        for part in parts:
            whole = isinstance(node, ast.Call)
            found |= {id(one) for one in (ast.walk(part) if whole else [part])}
    return found


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
        return _joined(node)
    if isinstance(node, ast.IfExp):
        return [*texts(node.body), *texts(node.orelse)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = texts(node.left), texts(node.right)
        return [one + other for one in left or ["…"] for other in right or ["…"]] if left or right else []
    return []


def _joined(node: ast.JoinedStr) -> list[str]:
    """What an f-string may say, where it takes in one of several texts: with each of them, to a few."""
    said = [""]
    for part in node.values:
        inner = texts(part.value) if isinstance(part, ast.FormattedValue) else texts(part)
        choices = inner if inner and len(said) * len(inner) <= _MOST else ["…"]
        said = [one + choice for one in said for choice in choices]
    return said
