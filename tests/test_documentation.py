"""The documentation says what there is: commands, options, links, pages of the site."""

import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from paths import ROOT
from typer.main import get_command

from highfive.hil.cli.main import app

PAGES = sorted([ROOT / "README.md", ROOT / "examples/README.md", *(ROOT / "docs").rglob("*.md")])
BLOCK = re.compile(r"^```(?:sh|)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"(?<!`)`(highfive [^`\n]+)`(?!`)")
LINK = re.compile(r"(?<!`)\[[^\]]*\]\(([^)\s]+)\)")
NAME = re.compile(r"^(?:\.venv/bin/)?highfive$")


@cache
def program() -> Any:
    """All commands; made once, which takes a fifth of a second."""
    return get_command(app)


def typed(page: Path) -> list[str]:
    """Lines of a page's code blocks that call the program, continued ones joined; and what of its text does."""
    text = page.read_text(encoding="utf-8")
    lines = [line.strip() for block in BLOCK.findall(text) for line in block.replace("\\\n", " ").splitlines()]
    lines += INLINE.findall(text)
    return [line for line in lines if NAME.match(line.split(" ", 1)[0])]


def check(line: str) -> None:
    """Fails unless command and options of a line exist."""
    words = shlex.split(line, comments=True)[1:]
    words = words[: next((n for n, word in enumerate(words) if word in {"|", ">", "&&", ";", "&", "2>"}), len(words))]
    command: Any = program()
    while hasattr(command, "commands"):
        if not words or words[0] in {"--help", "--version"} or words[0].isupper():
            return
        assert words[0] in command.commands, f"{line}: there is no command {words[0]!r}"
        command = command.commands[words.pop(0)]
    known = {name for one in command.params for name in (*one.opts, *one.secondary_opts)} | {"--help"}
    for word in words:
        if word.startswith("--") and not re.match(r"^--[A-Z]", word):
            assert word.split("=", 1)[0] in known, f"{line}: {word} is no option"


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_commands_of_a_page_exist(page: Path) -> None:
    for line in typed(page):
        check(line)


def test_what_does_not_exist_is_found() -> None:
    check(".venv/bin/highfive simulate --emotion happy --cell C2 --trials 1   # one high five")
    for line in ("highfive dance", "highfive simulate --loudly", "highfive rig play x --quickly=2"):
        with pytest.raises(AssertionError):
            check(line)
    assert sum(len(typed(page)) for page in PAGES) > 300


def heads(page: Path) -> set[str]:
    """Anchors of a page, as Markdown makes them."""
    found: set[str] = set()
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            words = re.sub(r"[^\w\- ]", "", line.lstrip("# ").strip().lower())
            found.add(re.sub(r"[\s]", "-", words))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    made = {
        "reference/commands/index.md",
        "reference/python/index.md",
        "reference/messages.md",
        "changes.md",
        "decisions/index.md",
    }  # with the site
    for target in LINK.findall(re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)):
        if "://" in target or target.startswith("mailto:"):
            continue
        name, _, anchor = target.partition("#")
        place = (page.parent / name).resolve() if name else page
        if place.is_relative_to(ROOT / "docs") and place.relative_to(ROOT / "docs").as_posix() in made:
            continue
        assert place.exists(), f"{page.name}: {target}"
        if anchor and place.suffix == ".md":
            assert anchor in heads(place), f"{page.name}: {target}"


def test_the_file_of_an_arm_on_its_page_is_that_of_the_example() -> None:
    page, example = (ROOT / "docs" / "own_arm.md").read_text("utf-8"), ROOT / "examples" / "desk_arm" / "arm.toml"
    assert f"```toml\n{example.read_text('utf-8')}```" in page


def test_segments_on_the_page_of_marker_sets_are_those_of_the_full_body() -> None:
    whole = (ROOT / "mocap_bridge" / "markers" / "marker_sets" / "full_body.toml").read_text("utf-8")
    page = (ROOT / "docs" / "markers.md").read_text("utf-8")
    rows = page[page.index("```toml\n[segments]\nhead") :].split("```")[1].splitlines()[1:]
    assert len(rows) > 20 and all(f"\n{row}\n" in whole for row in rows)
