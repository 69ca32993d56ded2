"""What tests keep between runs: made once, again where something has changed, and never half."""

import threading
from pathlib import Path

import kept as kept_module
import pytest
from kept import kept


@pytest.fixture(autouse=True)
def place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setattr(kept_module, "KEPT", tmp_path / "made")
    return tmp_path / "made"


def test_it_is_made_once_and_again_when_a_source_has_changed(monkeypatch: pytest.MonkeyPatch, place: Path) -> None:
    made = []

    def make(folder: Path) -> None:
        made.append(folder)
        (folder / "file").write_text(str(len(made)))

    first, same = kept("thing", make), kept("thing", make)
    assert first == same and len(made) == 1 and (first / "file").read_text() == "1"
    monkeypatch.setattr(kept_module, "sources", lambda: "another digest")
    other = kept("thing", make)
    assert other != first and (other / "file").read_text() == "2" and not first.exists()
    assert kept("thing else", make) != other and other.exists()


def test_what_could_not_be_made_is_not_there(place: Path) -> None:
    def fails(folder: Path) -> None:
        (folder / "half").write_text("")
        raise ValueError

    with pytest.raises(ValueError):
        kept("thing", fails)
    assert not list(kept("thing", lambda folder: None).iterdir())


def test_who_needs_it_meanwhile_waits() -> None:
    begun, go_on, found = threading.Event(), threading.Event(), []

    def slowly(folder: Path) -> None:
        begun.set()
        go_on.wait(10.0)
        (folder / "file").write_text("whole")

    def need(make) -> None:
        found.append((kept("thing", make) / "file").read_text())

    makes = threading.Thread(target=need, args=(slowly,))
    makes.start()
    begun.wait(10.0)
    waits = threading.Thread(target=need, args=(lambda folder: pytest.fail("made twice"),))
    waits.start()
    go_on.set()
    makes.join()
    waits.join()
    assert found == ["whole", "whole"]
