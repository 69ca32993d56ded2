"""The TOML file of an experiment: read, checked in full, one line an error; and the templates that come along."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from highfive.hil.experiments.protocol import (
    CERTAINTY,
    Block,
    Mode,
    Morph,
    Motion,
    Order,
    Protocol,
    Rating,
    Replay,
    Style,
    Timing,
)  # fmt: skip
from highfive.hil.experiments.words import read_words
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.model.errors import HighFiveError
from highfive.model.files import read_bounded_text
from highfive.model.settings import Settings
from highfive.model.toml_file import check_keys, is_list, number, read_toml, table, typed

CODE = re.compile(r"(?=.*[0-9])[A-Za-z0-9]{2,12}")
"""A participant's: it stands in paths, so it is no name; a first name has no digit."""
TEMPLATES = Path(__file__).with_name("templates")
MOST_TEXT = 1 << 20
"""Bytes of the longest instructions that are read."""
MOST_TRIALS = 100
"""Of a block: longer ones are for nobody, and their orders too many to count."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
_LANGUAGE = re.compile(r"[a-z]{2,3}(-[A-Z]{2})?")
_TOP = {"experiment", "answers", "blocks"}
_TOP_MORE = {"styles", "morph", "ratings", "practice", "replay", "timing", "order"}
Value = TypeVar("Value", bound=Settings)


def templates() -> list[str]:
    """Names of the experiments that come along."""
    return sorted(path.stem for path in TEMPLATES.glob("*.toml"))


def read_protocol(path: Path) -> Protocol:
    """An experiment's file, checked.

    Raises:
        HighFiveError: it cannot be read, or something in it is wrong; the first thing found.
    """
    data = read_toml(path, "the experiment")
    try:
        return _protocol(data, path.parent)
    except HighFiveError as error:
        raise HighFiveError(f"experiment {path}: {error}") from None


def _protocol(data: Mapping[str, Any], folder: Path) -> Protocol:
    check_keys(data, "its tables", _TOP, _TOP_MORE)
    head = table(data, "experiment")
    check_keys(
        head, "[experiment]", {"name", "kind", "participants", "consent_version", "instructions", "motion"},
        {"seed", "cells", "clips", "emotions", "codes"},
    )  # fmt: skip
    where = "[experiment] "
    participants = number(head, where, "participants", int, 1, 9999)
    motion = _one_of(Motion, head, where, "motion")
    emotions = _texts(head, where, "emotions") if "emotions" in head else tuple(EMOTIONS)
    cells = _texts(head, where, "cells") if "cells" in head else ()
    if unknown := [cell for cell in cells if cell not in CELLS]:
        raise HighFiveError(f"{where}cells has {unknown[0]!r}, expected of {CELLS[0]} to {CELLS[-1]}")
    clips = number(head, where, "clips", int, 1, 1000) if "clips" in head else 0
    if (motion is Motion.CLIPS) != (clips > 0):
        raise HighFiveError(
            f"{where}motion is {motion.value!r} with {clips} clips; give clips, how many of each style, with "
            "motion = 'clips' and only with it"
        )
    codes = _texts(head, where, "codes") if "codes" in head else ()
    if bad := [code for code in codes if not CODE.fullmatch(code)]:
        raise HighFiveError(
            f"{where}codes has {bad[0]!r}, expected 2 to 12 letters and digits, one digit at least, and no name"
        )
    if len({code.upper() for code in codes}) != len(codes) or (codes and len(codes) < participants):
        raise HighFiveError(f"{where}codes are {len(codes)}, expected a different one for each of {participants}")
    morph = _morph(table(data, "morph"), motion, emotions) if "morph" in data else None
    if (morph is None) == ("styles" not in data):
        raise HighFiveError("give [[styles]] or [morph], one of them")
    labels, keys, certainty = _answers(table(data, "answers"))
    styles = _levels(morph) if morph is not None else _styles(data["styles"], motion, emotions, labels)
    if morph is not None and set(labels) != {morph.start, morph.end}:
        raise HighFiveError(f"[answers] labels are {', '.join(labels)}, expected {morph.start} and {morph.end}")
    ratings, texts = _ratings(data.get("ratings", [])), folder / _text(head, where, "instructions")
    instructions = _instructions(texts)
    sliders = [*([CERTAINTY] if certainty else ()), *(one.name for one in ratings)]
    _all_different(sliders, "ratings")
    words = read_words(texts, labels, sliders)
    if alone := sorted(set(words) - set(instructions)):
        raise HighFiveError(
            f"{texts}/{alone[0]}.toml has words of a language without instructions; write {alone[0]}.md"
        )
    practice = table(data, "practice") if "practice" in data else {"repetitions": 0}
    check_keys(practice, "[practice]", {"repetitions"})
    protocol = Protocol(
        name=_name(head, where, "name"),
        kind=_name(head, where, "kind"),
        participants=participants,
        seed=number(head, where, "seed", int, 0, 2**62) if "seed" in head else 0,
        consent=_text(head, where, "consent_version"),
        instructions=instructions,
        words=words,
        motion=motion,
        styles=styles,
        blocks=_blocks(data["blocks"]),
        labels=labels,
        keys=keys,
        certainty=certainty,
        ratings=ratings,
        practice=number(practice, "[practice] ", "repetitions", int, 0, 20),
        cells=cells,
        clips=clips,
        morph=morph,
        replay=_replay(data),
        timing=_settings(Timing, data, "timing"),
        order=_settings(Order, data, "order"),
        codes=codes,
    )
    for block in protocol.blocks:
        if (count := protocol.trials_of(block)) > MOST_TRIALS:
            raise HighFiveError(f"block {block.name} has {count} trials, expected {MOST_TRIALS} at most; split it")
    return protocol


def _styles(entries: Any, motion: Motion, emotions: tuple[str, ...], labels: tuple[str, ...]) -> tuple[Style, ...]:
    found: list[Style] = []
    for place, entry in enumerate(_tables(entries, "styles")):
        where = f"style {place + 1}"
        check_keys(entry, where, {"name"}, {"weights", "answer"})
        name = _name(entry, f"{where}: ", "name")
        given = entry.get("weights", {name: 1.0})
        check_keys(given, f"{where}: weights", set(), set(given) if isinstance(given, Mapping) else None)
        weights = {emotion: number(given, f"{where}: weights.", emotion, float, 0.0, 1.0) for emotion in given}
        if abs(sum(weights.values()) - 1.0) > 1e-6:
            raise HighFiveError(f"{where}: weights sum to {sum(weights.values()):g}, expected 1")
        _known(weights, where, motion, emotions)
        answer = _text(entry, f"{where}: ", "answer") if "answer" in entry else name if name in labels else ""
        if answer and answer not in labels:
            raise HighFiveError(f"{where}: answer is {answer!r}, expected one of {', '.join(labels)}")
        found.append(Style(name, weights, answer))
    _all_different([style.name for style in found], "styles")
    return tuple(found)


def _known(weights: Mapping[str, float], where: str, motion: Motion, emotions: tuple[str, ...]) -> None:
    if motion is Motion.CLIPS:
        return
    if unknown := [emotion for emotion in weights if emotion not in emotions]:
        raise HighFiveError(
            f"{where}: unknown style {unknown[0]!r}; known are {', '.join(emotions)}; give emotions of a model of your "
            "own in [experiment], or motion = 'clips'"
        )


def _morph(entry: Mapping[str, Any], motion: Motion, emotions: tuple[str, ...]) -> Morph:
    check_keys(entry, "[morph]", {"start", "end", "method"}, {"levels"})
    start, end = (_text(entry, "[morph] ", name) for name in ("start", "end"))
    _known({start: 1.0, end: 1.0}, "[morph]", motion, emotions)
    if start == end or motion is Motion.CLIPS:
        raise HighFiveError("[morph] needs two different styles, and motion = 'model': clips cannot be mixed")
    method = _text(entry, "[morph] ", "method")
    if method not in ("constant", "adaptive"):
        raise HighFiveError(f"[morph] method is {method!r}, expected constant or adaptive")
    if (method == "constant") != ("levels" in entry):
        raise HighFiveError("[morph] levels go with method = 'constant' and only with it")
    if method == "adaptive":
        return Morph(start, end, ())
    levels = typed(entry, "[morph] ", "levels", list)
    shares = [number({"level": level}, "[morph] ", "level", float, 0.0, 1.0) for level in levels]
    if len(shares) < 3 or sorted(set(shares)) != shares:
        raise HighFiveError(f"[morph] levels are {shares}, expected three or more from 0 to 1 that rise")
    return Morph(start, end, tuple(shares))


def _levels(morph: Morph) -> tuple[Style, ...]:
    """The styles of a morph: its levels, or its two ends, by which an adaptive run is held."""
    named = [(level, f"{morph.end}{level:.3g}") for level in morph.levels or (0.0, 1.0)]
    _all_different([name for _, name in named], "[morph] levels")
    return tuple(Style(name, {morph.start: round(1.0 - level, 9), morph.end: level}) for level, name in named)


def _blocks(entries: Any) -> tuple[Block, ...]:
    found: list[Block] = []
    for place, entry in enumerate(_tables(entries, "blocks")):
        where = f"block {place + 1}"
        check_keys(entry, where, {"name", "mode"}, {"of", "whose", "repetitions", "filler", "part"})
        mode = _one_of(Mode, entry, f"{where}: ", "mode")
        whose = _text(entry, f"{where}: ", "whose") if "whose" in entry else "own"
        fits = {"of": mode is not Mode.INTERACTIVE, "repetitions": mode is Mode.INTERACTIVE}
        wrong = [name for name, wanted in fits.items() if (name in entry) != wanted]
        wrong += ["whose"] if "whose" in entry and mode is not Mode.NO_CONTINGENCY else []
        wrong += ["filler"] if "filler" in entry and mode is not Mode.INTERACTIVE else []
        if wrong or whose not in ("own", "other"):
            raise HighFiveError(
                f"{where}: {wrong[0] if wrong else 'whose'} does not fit; an interactive block has repetitions (and "
                "filler), others have of, and no_contingency whose = 'own' or 'other'"
            )
        found.append(
            Block(
                name=_name(entry, f"{where}: ", "name"),
                mode=mode,
                of=_text(entry, f"{where}: ", "of") if "of" in entry else "",
                other=mode is Mode.OTHER_REPLAY or whose == "other",
                repetitions=number(entry, f"{where}: ", "repetitions", int, 1, 100) if "repetitions" in entry else 1,
                filler=typed(entry, f"{where}: ", "filler", bool) if "filler" in entry else False,
                part=_name(entry, f"{where}: ", "part") if "part" in entry else "",
            )
        )
    _all_different([block.name for block in found], "blocks")
    interactive = {block.name for block in found if block.mode is Mode.INTERACTIVE}
    for block in found:
        if block.of and block.of not in interactive:
            raise HighFiveError(f"block {block.name}: of is {block.of!r}, expected an interactive block")
    return tuple(found)


def _answers(entry: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...], bool]:
    check_keys(entry, "[answers]", {"labels", "keys"}, {"certainty"})
    labels, keys = _texts(entry, "[answers] ", "labels"), _texts(entry, "[answers] ", "keys")
    _all_different(labels, "[answers] labels")
    _all_different([key.lower() for key in keys], "[answers] keys")
    if len(labels) < 2 or len(labels) != len(keys):
        raise HighFiveError(f"[answers] has {len(labels)} labels and {len(keys)} keys, expected two or more of each")
    return labels, keys, typed(entry, "[answers] ", "certainty", bool) if "certainty" in entry else False


def _ratings(entries: Any) -> tuple[Rating, ...]:
    found: list[Rating] = []
    for place, entry in enumerate(_tables(entries, "ratings", none=True)):
        where = f"rating {place + 1}"
        check_keys(entry, where, {"name", "text", "low", "high"}, {"points"})
        texts = [_text(entry, f"{where}: ", name) for name in ("text", "low", "high")]
        points = number(entry, f"{where}: ", "points", int, 2, 101) if "points" in entry else 0
        found.append(Rating(_name(entry, f"{where}: ", "name"), *texts, points=points))
    return tuple(found)


def _replay(data: Mapping[str, Any]) -> Replay:
    if "replay" not in data:
        return Replay()
    entry = table(data, "replay")
    check_keys(entry, "[replay]", {"viewpoint", "own_arm"})
    replay = Replay(_text(entry, "[replay] ", "viewpoint"), _text(entry, "[replay] ", "own_arm"))
    if replay.viewpoint not in ("live", "recorded") or replay.own_arm not in ("live", "ghost"):
        raise HighFiveError("[replay] viewpoint is live or recorded, own_arm live or ghost")
    return replay


def _settings(kind: type[Value], data: Mapping[str, Any], name: str) -> Value:
    given = table(data, name) if name in data else {}
    usual = kind().values()
    check_keys(given, f"[{name}]", set(), set(usual))
    values = {key: number(given, f"[{name}] ", key, type(usual[key]), -1e9, 1e9) for key in given}
    try:
        return kind(**values)
    except HighFiveError as error:
        raise HighFiveError(f"[{name}] {error}") from None


def _instructions(folder: Path) -> Mapping[str, str]:
    """Language -> Markdown, of files such as ``en.md``."""
    try:
        texts = {path.stem: read_bounded_text(path, MOST_TEXT) for path in sorted(folder.glob("*.md"))}
    except (OSError, UnicodeDecodeError) as error:
        raise HighFiveError(f"cannot read the instructions in {folder}: {error}") from None
    except HighFiveError as error:
        raise HighFiveError(f"cannot read the instructions: {error}") from None
    for language, text in texts.items():
        if not (_LANGUAGE.fullmatch(language) and text.strip() and "\0" not in text):
            raise HighFiveError(f"instructions {folder}/{language}.md: expected a text, called as en.md or de-CH.md")
    if not texts:
        raise HighFiveError(f"no instructions in {folder}; write at least en.md there, or de.md, …")
    return texts


def _tables(entries: Any, name: str, none: bool = False) -> list[Any]:
    if not is_list(entries) or not (entries or none):
        raise HighFiveError(f"{name} is no list of tables; write [[{name}]] above each")
    return entries


def _one_of(kind: Any, entry: Mapping[str, Any], where: str, name: str) -> Any:
    text = _text(entry, where, name)
    if text not in [one.value for one in kind]:
        raise HighFiveError(f"{where}{name} is {text!r}, expected one of {', '.join(one.value for one in kind)}")
    return kind(text)


def _text(entry: Mapping[str, Any], where: str, name: str) -> str:
    text = typed(entry, where, name, str)
    if not text.strip():
        raise HighFiveError(f"{where}{name} is empty")
    return text


def _texts(entry: Mapping[str, Any], where: str, name: str) -> tuple[str, ...]:
    texts = typed(entry, where, name, list)
    found = tuple(_text({name: text}, where, name) for text in texts)
    _all_different(found, f"{where}{name}")
    return found


def _name(entry: Mapping[str, Any], where: str, name: str) -> str:
    text = _text(entry, where, name)
    if not _NAME.fullmatch(text):
        raise HighFiveError(f"{where}{name} is {text!r}, expected letters, digits, _ and -, 32 at most")
    return text


def _all_different(names: Any, what: str) -> None:
    if twice := [name for place, name in enumerate(names) if name in names[:place]]:
        raise HighFiveError(f"{what}: {twice[0]!r} is there twice")
