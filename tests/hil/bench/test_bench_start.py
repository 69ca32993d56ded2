"""What starting costs, measured as a user would see it."""

from pathlib import Path

import pytest

from highfive.hil.bench.installed import installed_sizes
from highfive.hil.bench.start import ALSO, CAUSES, StartOptions, bench_start, print_start, started
from highfive.model.errors import HighFiveError


def quiet(_: str, __: int):
    return lambda: None


@pytest.mark.slow
def test_a_command_is_run_in_a_terminal_and_what_it_shows_is_timed(tmp_path: Path) -> None:
    run = started(["track", "--help"], tmp_path, r"Usage: \S+ track")
    assert run.code == 0 and run.first_s is not None and run.first_s <= run.seconds
    assert "--marker-set" in run.shown and "\x1b" not in run.shown
    assert 10.0 < run.memory_mb < 500.0 and run.processor_s > 0.0
    failed = started(["track", "nothing.c3d"], tmp_path, "never shown")
    assert failed.code == 2 and failed.first_s is None and "nothing.c3d" in failed.shown


@pytest.mark.slow
def test_an_installation_has_all_that_it_needs_and_extras_count_what_they_add() -> None:
    sizes = installed_sizes("high-five", 3)
    whole = sizes[""]
    assert len(whole["heaviest"]) == 3
    assert sum(whole["heaviest"].values()) < whole["mb"] < 5000.0
    assert "numpy" in installed_sizes("high-five", 99)[""]["heaviest"]
    dev = sizes["dev"]
    assert dev["mb"] is not None and not set(dev["heaviest"]) & set(installed_sizes("high-five", 99)[""]["heaviest"])


@pytest.mark.sweep
@pytest.mark.slow(120)
def test_all_commands_start_and_the_figures_are_there(capsys: pytest.CaptureFixture[str]) -> None:
    found = bench_start(StartOptions(repeats=1), quiet)
    assert len(found["help_s"]) > 40 and all(seconds > 0.0 for seconds in found["help_s"].values())
    assert set(found["first_s"]) == {"track", "stream", "simulate"} and min(found["first_s"].values()) > 0.0
    assert set(found["memory_mb"]) == {"--help", "track", "stream", "simulate", *ALSO}
    assert all(30.0 < mb < 3000.0 for mb in found["memory_mb"].values())
    assert set(found["causes_s"]) == set(CAUSES) and "scipy" in found["causes_s"]["simulate"]
    print_start(found)
    shown = capsys.readouterr().out
    assert "s to the first high five" in shown and "installed: " in shown


def test_a_command_that_does_not_end_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("highfive.hil.bench.start.LONGEST_S", 0.0)
    with pytest.raises(HighFiveError, match="has not ended within 0 s"):
        started(["--version"], tmp_path)
