"""The site's page of messages has every one that the program can print."""

import ast
import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = runpy.run_path(str(ROOT / "docs/site/messages.py"))


def sentences(source: str) -> set[str]:
    """Pieces of text of five words and more, by another way: from the source's strings, documentation aside."""
    tree = ast.parse(source)
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):  # what options and settings say of themselves is help
        if isinstance(node, ast.Call) and PAGE["called"](node) in {"setting", "Option", "Argument", "Typer"}:
            told |= {id(part) for part in ast.walk(node)}
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in told]
    plain = [" ".join(text.split()) for text in texts if isinstance(text, str) and not re.search(r"[<{}\n`|\\=]", text)]
    return {text for text in plain if len(re.findall(r"(?<!\S)[a-z]{2,}(?!\S)", text)) >= 5}


@pytest.mark.slow
def test_every_sentence_is_on_the_page() -> None:
    missing, count = [], 0
    for room in PAGE["ROOMS"]:
        for path in (ROOT / room).rglob("*.py"):
            source = path.read_text(encoding="utf-8")
            page = "\n".join(PAGE["messages"](source))
            found = sentences(source)
            count += len(found)
            missing += [f"{path.relative_to(ROOT)}: {text}" for text in sorted(found) if text not in page]
    assert count > 1000
    assert not missing, "\n".join(missing)
