"""Words of the participant's page in the lab's language, from a file beside the instructions (``de.toml``).

    [page]
    go = "Los"

    [answers]
    fearful = "ängstlich"      # as it is shown; the data keep the label

    [sliders.certainty]
    text = "Wie sicher sind Sie?"
    low = "geraten"
    high = "sicher"

What a file leaves out of ``[page]`` stays English. ``[answers]`` and ``[sliders]``, where they are there, have all that
the experiment asks, and may have more.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from highfive.model.errors import HighFiveError
from highfive.model.toml_file import check_keys, is_table, read_toml, typed

PAGE: Mapping[str, str] = {
    "go": "Go",
    "watch": "Watch",
    "raise_hand": "Raise your hand when you hear the tone.",
    "tap": "Tap the shoulder when you hear the tone.",
    "only_watch": "Only watch: keep your arms down.",
    "go_on": "Go on",
    "more": "More",
    "done": "Done",
    "practice": "Practice",
    "next_block": "The next block",
    "question": "Which was it?",
    "pause": "A pause: it goes on soon.",
    "finished": "That was all. Thank you.",
    "ends": "It ends here for now.",
    "no_key": "That key means nothing here.",
    "not_yet": "Not yet: answer when the motion is over.",
    "answered": "The first answer counts.",
    "too_late": "Too late: this trial is over.",
}
"""What is written, or said, there; of every language the same names."""
_SLIDER = ("text", "low", "high")
_LONGEST = 200
Words = Mapping[str, Mapping[str, str]]
"""``page``, ``answers``, ``sliders.NAME`` -> name -> text."""


def read_words(folder: Path, labels: Collection[str], sliders: Collection[str]) -> Mapping[str, Words]:
    """Language -> its words, of files such as ``de.toml``.

    Args:
        folder: with the instructions.
        labels: the answers that there are.
        sliders: names of what else is asked.

    Raises:
        HighFiveError: one cannot be read, or names what there is not.
    """
    return {path.stem: _words(path, labels, sliders) for path in sorted(folder.glob("*.toml"))}


def page_words(words: Words) -> dict[str, str]:
    """All of the page's: these, and English where there is none."""
    return {**PAGE, **words.get("page", {})}


def words_toml(words: Words) -> bytes:
    """The file that :func:`read_words` reads as these."""
    lines = [
        line
        for table, entries in words.items()
        for line in (
            f"[{table}]",
            *(f"{name} = {json.dumps(text, ensure_ascii=False)}" for name, text in entries.items()),
        )
    ]
    return ("\n".join(lines) + "\n").encode()


def _words(path: Path, labels: Collection[str], sliders: Collection[str]) -> Words:
    values = read_toml(path, "the words")
    check_keys(values, str(path), set(), {"page", "answers", "sliders"})
    found = {
        "page": _texts(values.get("page", {}), f"{path}: [page]", PAGE),
        "answers": _texts(_all_of(labels, values, "answers", str(path)), f"{path}: [answers]"),
    }
    shown = found["answers"].values()
    if len({text.casefold() for text in shown}) != len(shown):
        raise HighFiveError(f"{path}: [answers] has one word for two answers")
    for name, entry in _all_of(sliders, values, "sliders", str(path)).items():
        found[f"sliders.{name}"] = _texts(entry, f"{path}: [sliders.{name}]", needed=_SLIDER)
    return {table: entries for table, entries in found.items() if entries}


def _all_of(names: Collection[str], values: Mapping[str, Any], name: str, where: str) -> dict[str, Any]:
    """Those of a table's entries; a slip in a name leaves the right one without words."""
    if name not in values:
        return {}
    given = values[name]
    check_keys(given, f"{where}: [{name}]", set(names), set(given) if is_table(given) else None)
    return {one: given[one] for one in names}


def _texts(
    entry: Any, where: str, known: Collection[str] | None = None, needed: Collection[str] = ()
) -> dict[str, str]:
    check_keys(entry, where, set(needed), set(needed or (entry if known is None else known)))
    texts = {name: typed(entry, f"{where} ", name, str).strip() for name in entry}
    for name, text in texts.items():
        if not (0 < len(text) <= _LONGEST and text.isprintable()):
            raise HighFiveError(f"{where} {name} is {text[:40]!r}, expected a line of 1 to {_LONGEST} characters")
    return texts
