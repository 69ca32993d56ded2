"""The documentation site is built as a stranger builds it, and held against the program."""

import ast
import json
import subprocess
import sys
import time
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from paths import ROOT
from typer.main import get_command

import highfive
from highfive.hil.cli.main import app
from highfive.hil.view.browser import Browser, browser_here

SHOWN = ("model", "mocap_bridge", "calibration", "hil", "scenes")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--config-file", str(ROOT / "mkdocs.yml")]
    done = subprocess.run([*words, "--site-dir", str(out)], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return out


class Page(HTMLParser):
    """What a page links to, and what can be linked to on it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and (name == "id" or (tag == "a" and name == "name")):
                self.anchors.add(value)
            if value and ((tag == "a" and name == "href") or (tag in {"img", "script"} and name == "src")):
                self.links.append(value)


@pytest.mark.slow(60)
def test_no_link_is_broken_and_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    pages = {path: Page(path) for path in site.rglob("*.html")}
    assert len(pages) > 300
    broken: list[str] = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or link.startswith("//"):
                continue
            place = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            known = pages.get(place)
            if path.name == "404.html":  # of a server's, from its root
                continue
            if not place.exists() or (parts.fragment and known and unquote(parts.fragment) not in known.anchors):
                broken.append(f"{path.relative_to(site)}: {link}")
    assert not broken, broken[:20]
    index = (site / "index.html").read_text(encoding="utf-8")
    assert 'src="http' not in index and 'href="http' not in index.replace('href="https://squidfunk.github.io', "")


def words(path: Path) -> str:
    return unescape(path.read_text(encoding="utf-8"))


@pytest.mark.slow
@pytest.mark.skipif(browser_here() is None, reason="there is no Chromium here")
def test_the_search_finds_a_message_from_a_file_without_a_network(site: Path) -> None:
    """Pasted as it is in the terminal, names and numbers included; and a question still leads to a guide."""
    with Browser(more=("--host-resolver-rules=MAP * ~NOTFOUND",)) as page:
        page.go((site / "index.html").as_uri())
        for query, first in (
            ("model file cut short", "Messages"),
            ("error: junk.c3d is not a C3D file (no C3D header)", "Messages mocap_bridge/files/c3d.py"),
            ("error: /dev/null: not a serial port", "Messages hil/drivers/bus/servo_port.py"),
            ("error: --style happy=nan: the weights have to be numbers", "Messages"),
            ("how many participants do I need", "Experiments with people"),
        ):
            assert found_first(page, query, first) == first


def found_first(page: Browser, query: str, wanted: str) -> str:
    """What the search shows first, title and section, once it is ``wanted``; else after half a minute."""
    titles = ""
    for _ in range(150):  # the search reads its index, and answers by and by
        page.evaluate(
            "(() => { const query = document.querySelector('[data-md-component=search-query]');"
            "const open = document.querySelector('#__search'); if (!query) return; if (!open.checked) open.click();"
            f"query.value = {json.dumps(query)};"
            "query.dispatchEvent(new Event('keyup', { bubbles: true })); })()"
        )
        parts = len(wanted.split(" ", 1)) if wanted.startswith("Messages") else 1
        titles = str(
            page.evaluate(
                "[...document.querySelectorAll('.md-search-result__item h1, .md-search-result__item h2')]"
                f".slice(0, {parts}).map((title) => title.innerText).join(' ')"
            )
        )
        if titles == wanted:
            break
        time.sleep(0.2)
    return titles


@pytest.mark.slow
def test_every_command_and_option_is_on_a_page(site: Path) -> None:
    def each(group, path):
        for name, command in group.commands.items():
            if not command.hidden:
                yield from each(command, (*path, name)) if hasattr(command, "commands") else [((*path, name), command)]

    found = list(each(get_command(app), ()))
    assert len(found) > 40
    for path, command in found:
        page = words(site / "reference/commands" / f"{'-'.join(path)}.html")
        for one in command.params:
            if not getattr(one, "hidden", False) and one.param_type_name == "option":
                assert all(f"<code>{name}</code>" in page for name in (*one.opts, *one.secondary_opts)), (
                    path,
                    one.opts,
                )


@pytest.mark.slow
def test_every_public_name_is_on_a_page(site: Path) -> None:
    missing: list[str] = []
    for path in (one for room in SHOWN for one in (ROOT / room).rglob("*.py")):
        inside = path.relative_to(ROOT)
        if path.name.startswith("_") or inside.as_posix().startswith(("hil/cli", "hil/bench")):
            continue
        name = ".".join(inside.with_suffix("").parts)
        page = Page(site / "reference/python" / f"{name}.html")
        public = [
            node.name for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
        ]  # fmt: skip
        missing += [f"{name}.{one}" for one in public if f"highfive.{name}.{one}" not in page.anchors]
    assert not missing, missing[:20]
    api = words(site / "reference/python/highfive.html")
    assert all(name in api for name in highfive.__all__)


@pytest.mark.slow
def test_messages_are_found(site: Path) -> None:
    page = words(site / "reference/messages.html")
    for text in ("is not a model file, or it is cut short", "trials of emotion …, but the model to adapt knows …",
                 "no training trials; give at least one trial", "No such command", "requires an argument",
                 "Permission denied"):  # fmt: skip
        assert text in page, text
