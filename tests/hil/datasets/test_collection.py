"""A data folder that is collected: its order, what is left of it, and what is refused."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from highfive.hil.datasets.collection import Collection, CollectionFolder, takes_of
from highfive.hil.sim.people.grid import CELLS
from highfive.mocap_bridge.files.trial_table import read_table
from highfive.model.errors import HighFiveError

ASKED = Collection(("happy", "angry", "sad"), CELLS, 4, 1, 5, "human", "avatar")


def test_each_is_asked_once_a_repetition_and_an_emotion_goes_through_its_cells_in_a_row() -> None:
    orders: set[tuple[str, ...]] = set()
    for seed in range(50):
        takes = takes_of(replace(ASKED, seed=seed))
        assert Counter((take.emotion, take.cell) for take in takes) == {
            (emotion, cell): 4 for emotion in ASKED.emotions for cell in CELLS
        }
        blocks = [takes[place].block for place in range(0, len(takes), len(CELLS))]
        assert len(set(blocks)) == 12 and all(takes[n].block == blocks[n // len(CELLS)] for n in range(len(takes)))
        assert [take.repetition for take in takes] == sorted(take.repetition for take in takes)
        assert {take.repetition for take in takes if take.split == "test"} == {3}
        orders.add(tuple(blocks))
    assert len(orders) > 40  # not one order for all
    assert takes_of(ASKED) == takes_of(ASKED)


def test_more_repetitions_change_nothing_of_those_before() -> None:
    before = [(take.emotion, take.cell) for take in takes_of(ASKED)]
    after = [(take.emotion, take.cell) for take in takes_of(replace(ASKED, repetitions=6))]
    assert after[: len(before)] == before


def test_what_is_there_is_not_asked_again_and_the_table_is_what_others_read(tmp_path: Path) -> None:
    folder = CollectionFolder(tmp_path, ASKED)
    folder.begin()
    for take in folder.left[:5]:
        (tmp_path / f"{take.name}.c3d").write_bytes(b"whole")
        folder.accept(take)
    bad = folder.rejects(folder.left[0])
    bad.parent.mkdir()
    bad.write_bytes(b"bad")
    folder.reject(bad, "they did not meet, once")
    again = CollectionFolder(tmp_path, ASKED)
    assert again.left == takes_of(ASKED)[5:] and len(read_table(tmp_path)) == 5
    assert again.rejects(again.left[0]) != bad and again.rejected[0]["why"] == "they did not meet, once"
    assert sum(block["done"] for block in again.blocks) == 5


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"seed": 6}, "begun with seed 5, now it is 6"),
        ({"emotions": ("happy", "angry")}, "begun with emotions happy, angry, sad, now it is happy, angry"),
        ({"avatar": "other"}, "begun with avatar avatar, now it is other"),
        ({"held_out": 4}, "leave nothing to learn from"),
        ({"emotions": ("../happy",)}, "expected a word of small letters"),
        ({"emotions": ("happy", "happy")}, "expected each once"),
        ({"avatar": "human"}, "both people are called human"),
    ],
)
def test_what_is_not_the_same_or_cannot_be_is_refused(changes: dict[str, object], says: str, tmp_path: Path) -> None:
    CollectionFolder(tmp_path, ASKED).begin()
    with pytest.raises(HighFiveError, match=says):
        CollectionFolder(tmp_path, replace(ASKED, **changes))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("trials.csv", "file,emotion,cell,repetition,split\ngone.c3d,happy,A1,0,train\n", "gone.c3d, which is gone"),
        ("trials.csv", "nothing\n", "file is missing"),
        ("rejected.csv", "nothing\nof it\n", "expected the columns file,why"),
        ("collection.toml", "seed = 1\n", "missing"),
        ("collection.toml", "= 1\n", "it is no TOML file"),
    ],
)
def test_a_damaged_folder_is_one_line(name: str, content: str, says: str, tmp_path: Path) -> None:
    CollectionFolder(tmp_path, ASKED).begin()
    (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(HighFiveError, match=says):
        CollectionFolder(tmp_path, ASKED)


def test_a_folder_that_another_command_made_is_not_added_to(tmp_path: Path) -> None:
    (tmp_path / "trials.csv").write_text("file,emotion\na.c3d,happy\n", encoding="utf-8")
    with pytest.raises(HighFiveError, match="was not begun by this command"):
        CollectionFolder(tmp_path, ASKED)
