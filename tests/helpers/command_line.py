"""The command line in this process: made once in a test file, ``run = running("rig")`` is a fixture."""

from collections.abc import Callable
from typing import Any

import pytest

from highfive.hil.cli import main as cli


def running(*command: str) -> Any:
    """A fixture: runs the command with more words; exit code, standard output and standard error."""

    @pytest.fixture
    def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
        def run(*words: object) -> tuple[int, str, str]:
            monkeypatch.setattr("sys.argv", ["highfive", *command, *map(str, words)])
            with pytest.raises(SystemExit) as end:
                cli.main()
            out, err = capsys.readouterr()
            return int(str(end.value.code or 0)), out, err

        return run

    return run


def failing(*command: str) -> Any:
    """A fixture: runs the command with more words, which it refuses in one line; that line."""

    @pytest.fixture
    def fails(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
        def run(*words: object) -> str:
            monkeypatch.setattr("sys.argv", ["highfive", *command, *map(str, words)])
            with pytest.raises(SystemExit) as end:
                cli.main()
            out, err = capsys.readouterr()
            assert end.value.code == 2
            assert out == ""
            assert len(err.strip().splitlines()) == 1
            assert err.startswith("error:")
            return err

        return run

    return fails
