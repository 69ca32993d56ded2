"""``highfive demo``: a page beside the session; a folder that cannot be written is one line, before a page opens."""

import json
import os
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from command_line import failing

from highfive.hil.commands.demo import page_beside

fails = failing("demo")


def test_folder_that_cannot_be_written_is_one_line(fails, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    Path("out").write_text("a file\n")
    assert "cannot write to out/session-1: Not a directory; give another --out" in fails()
    assert "no folder" in fails("--out", "out")
    Path("full").mkdir()
    (Path("full") / "mine").touch()
    assert "holds something already" in fails("--out", "full")


@pytest.mark.skipif(not Path("/proc/version").exists(), reason="no file system here in which nobody can make a folder")
def test_read_only_folder_is_one_line(fails, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir("/proc")
    assert "cannot write to out/session-1" in fails()


def test_page_is_opened_and_goes_with_the_session(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    """The browser here is a script that writes down what it was to open."""
    browser, opened = tmp_path / "browser", tmp_path / "opened"
    browser.write_text(f'#!/bin/sh\necho "$1" > {opened}.new\nmv {opened}.new {opened}\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    caplog.set_level("INFO")
    with pytest.raises(InterruptedError), page_beside(tmp_path / "session", overwrite=False, page=True):
        until = time.monotonic() + 60.0
        while not opened.exists():
            assert time.monotonic() < until, caplog.messages
            time.sleep(0.05)
        address = opened.read_text().strip()
        with urllib.request.urlopen(address, timeout=60.0) as answer:
            assert b"<title>High Five" in answer.read()
        raise InterruptedError  # whatever ends the session ends the page
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(address, timeout=60.0)
    assert any(address in line for line in caplog.messages)
    assert not (tmp_path / "session").exists()


@pytest.mark.slow(90)
def test_where_nobody_looks_on_it_plays_all_and_ends(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "highfive.hil.cli.main", "demo", "--json"]
    blind = {**os.environ, "MUJOCO_GL": "disable"}  # a film of 36 high fives takes as long again
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, env=blind)
    summary = json.loads(done.stdout)
    assert summary["trials"] == 36 and not summary["missed"]
    folder = tmp_path / "out" / "session-1"
    assert {"report.html", "session.mcap"} <= {path.name for path in folder.iterdir()}
    assert "highfive view out/session-1" in done.stderr
