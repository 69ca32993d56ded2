"""``highfive import``: motion that is no C3D, as a data folder that ``highfive train`` and ``--source`` read."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.commands.written_files import write_files
from highfive.hil.datasets.dyads import DEFAULT_PREFIXES
from highfive.hil.recording.exports.export_file import ExportFile, of_bytes
from highfive.hil.runtime.console import Bar, counted, say_aside
from highfive.hil.runtime.folders import results_folder
from highfive.mocap_bridge.files.bvh import parse_bvh
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.marker_csv import parse_csv
from highfive.mocap_bridge.files.named_points import (
    PERSON_SPANS,
    UNITS,
    UPS,
    NamedPoints,
    in_world,
    people_of,
    read_text,
    unit_by_size,
)
from highfive.mocap_bridge.files.recording import Recording, make_recording, resample
from highfive.mocap_bridge.files.trc import parse_trc
from highfive.mocap_bridge.files.trial_table import TABLE, table_bytes
from highfive.mocap_bridge.markers.joint_centres import joint_centre_set
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.upright import up_axis
from highfive.model.errors import HighFiveError

PARSERS: dict[str, Callable[[str, str], NamedPoints]] = {
    ".bvh": parse_bvh,
    ".trc": parse_trc,
    ".csv": parse_csv,
    ".tsv": parse_csv,
    ".txt": parse_csv,
}


@dataclass(frozen=True)
class ImportOptions:
    """What to import, and how to read it.

    Attributes:
        files: of a trial each, of one or two people; none where each person has files of her own.
        folder: of the C3D files and the table.
        human, avatar: prefixes of the two people in ``files``; without these the person's file and the other's, or
            folders in which files of one name are one trial; ``human`` alone for trials of one person.
        units: of the numbers, one of :data:`UNITS`, or how many metres one is; None takes what the file says, or what a
            person's size says.
        up: the vertical, y or z; None finds it.
        emotion: of all trials, '' for none.
        overwrite: write into a folder that holds something.
    """

    files: tuple[Path, ...]
    folder: Path
    human: str | None = None
    avatar: str | None = None
    units: str | None = None
    up: str | None = None
    emotion: str = ""
    overwrite: bool = False


def import_motion(options: ImportOptions, bar: Bar) -> dict[str, Any]:
    """Writes a C3D file a trial, and ``trials.csv``; and says what they are.

    Raises:
        HighFiveError: a file is none of those that are read, or damaged; its unit or its vertical is in doubt; or the
            folder cannot be written to.
    """
    if options.units is not None:
        _metres(options.units)
    if options.up is not None and options.up not in UPS:
        raise HighFiveError(f"--up {options.up}: expected {' or '.join(UPS)}")
    sources = _sources(options)
    with results_folder(options.folder, options.overwrite):
        trials = _read(sources, bar)
        files = [ExportFile(name, partial(_write, trial), len(trial)) for name, trial in trials.items()]
        files.append(of_bytes(TABLE, partial(table_bytes, [(name, options.emotion, "", "", "") for name in trials])))
        write_files(files, options.folder, bar)
    return {
        "folder": str(options.folder),
        "files": [str(options.folder / file.name) for file in files],
        "frames": sum(len(trial) for trial in trials.values()),
        "duration": round(sum((len(trial) - 1) / trial.rate_hz for trial in trials.values()), 6),
        "trials": [
            {"file": name, "people": list(trial.prefixes), "points": len(trial.names), "rate_hz": trial.rate_hz}
            for name, trial in trials.items()
        ],
    }


def _read(sources: Mapping[str, Callable[[], Recording]], bar: Bar) -> dict[str, Recording]:
    trials, advance = {}, None
    for name, read in sources.items():
        trials[name] = read()
        advance = advance or bar("reading", len(sources))  # not before: a first file that is refused is one line
        advance()
    alone = sorted(name for name, trial in trials.items() if len(trial.prefixes) < 2)
    if alone:
        say_aside(f"of one person only, for track and simulate --source, not to learn from: {', '.join(alone)}")
    return trials


def print_imported(result: dict[str, Any]) -> None:
    """The same for people."""
    for trial in result["trials"]:
        people = " and ".join(person or "one person" for person in trial["people"])
        print(f"{trial['file']}: {people}, {counted(trial['points'], 'point')} at {trial['rate_hz']:g} Hz")
    folder, trials = result["folder"], result["trials"]
    if any(len(trial["people"]) > 1 for trial in trials):
        use = f"train on them with: highfive train {folder}"
    else:
        use = f"play it with: highfive simulate --source {result['files'][0]}"
    print(f"{counted(len(trials), 'trial')} in {folder}; {use}")


def _sources(options: ImportOptions) -> dict[str, Callable[[], Recording]]:
    """Name of each C3D file -> what reads its trial."""
    if options.files:
        found = [(path, partial(_whole, path, options)) for path in options.files]
    elif options.human and options.avatar:
        pairs = _paired(Path(options.human), Path(options.avatar))
        found = [(human, partial(_pair, human, avatar, options)) for human, avatar in pairs]
    elif options.human:
        found = [(path, partial(_alone, path, options)) for path in _motion_of(Path(options.human))]
    else:
        raise HighFiveError("give files of both people, --human FILE and --avatar FILE, or --human FILE alone")
    names = [f"{path.stem}.c3d" for path, _ in found]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise HighFiveError(f"two files would become {twice[0]}; rename one of them")
    return {name: read for name, (_, read) in zip(names, found, strict=True)}


def _paired(human: Path, avatar: Path) -> list[tuple[Path, Path]]:
    """The two files, or those of one name in the two folders."""
    if human.is_dir() != avatar.is_dir():
        raise HighFiveError(f"--human {human} and --avatar {avatar}: give two files, or two folders")
    if not human.is_dir():
        return [(human, avatar)]
    ours, theirs = (
        {path.stem: path for path in sorted(folder.iterdir()) if path.suffix.lower() in PARSERS}
        for folder in (human, avatar)
    )
    if not ours or ours.keys() != theirs.keys():
        lone = sorted(ours.keys() ^ theirs.keys())
        what = f"{lone[0]} is in one of them only" if lone else f"there is no {', '.join(PARSERS)} in them"
        raise HighFiveError(f"--human {human} and --avatar {avatar}: {what}; files of one name are one trial")
    return [(ours[stem], theirs[stem]) for stem in ours]


def _motion_of(human: Path) -> list[Path]:
    """The file, or those of a folder that can be read."""
    if not human.is_dir():
        return [human]
    found = [path for path in sorted(human.iterdir()) if path.suffix.lower() in PARSERS]
    if not found:
        raise HighFiveError(f"--human {human}: there is no {', '.join(PARSERS)} in it")
    return found


def _alone(path: Path, options: ImportOptions) -> Recording:
    """A file of the person alone."""
    return _placed(_one_person(_parsed(path), DEFAULT_PREFIXES[0]), options)


def _whole(path: Path, options: ImportOptions) -> Recording:
    """A file of one person, or of two by their prefixes."""
    return _placed(_renamed(_parsed(path), options.human, options.avatar), options)


def _pair(human: Path, avatar: Path, options: ImportOptions) -> Recording:
    """Two files of one person each, which begin together, at the higher of the two rates."""
    ours, theirs = (
        _placed(_one_person(_parsed(path), prefix), options)
        for path, prefix in zip((human, avatar), DEFAULT_PREFIXES, strict=True)
    )
    rate = max(ours.rate_hz, theirs.rate_hz)
    ours, theirs = resample(ours, rate), resample(theirs, rate)
    count = min(len(ours), len(theirs))
    if len(ours) != len(theirs):
        longer, over = (human, len(ours)) if len(ours) > len(theirs) else (avatar, len(theirs))
        say_aside(f"{longer.name} goes on {(over - count) / rate:.2f} s after the other, which is left out")
    points, valid = (
        np.concatenate([getattr(ours, part)[:count], getattr(theirs, part)[:count]], axis=1)
        for part in ("points", "valid")
    )
    return replace(make_recording(rate, (*ours.names, *theirs.names), points, valid), source=human.name)


def _parsed(path: Path) -> NamedPoints:
    parse = PARSERS.get(path.suffix.lower())
    if parse is None:
        hint = "it is read as it is, no import needed" if path.suffix.lower() == ".c3d" else "export it as one of these"
        raise HighFiveError(f"{path} is none of {', '.join(PARSERS)}; {hint}")
    found = parse(read_text(path), path.name)
    if found.centres:
        _check_skeleton(found)
    return found


def _check_skeleton(found: NamedPoints) -> None:
    """A skeleton has to have the joints of a right arm and a head: it says which one is missing."""
    for columns in people_of(found):
        labels = [found.names[m].rpartition(":")[2] for m in columns]
        try:
            joint_centre_set(load_marker_set("joint_centres"), labels)
        except HighFiveError as error:
            raise HighFiveError(f"{found.source}: {error}; rename its joints") from None


def _one_person(found: NamedPoints, prefix: str) -> NamedPoints:
    """All points under one prefix, instead of any that they have."""
    if len(people_of(found)) > 1:
        raise HighFiveError(f"{found.source} holds several people; give a file of one, or both in one file by itself")
    return replace(found, names=tuple(f"{prefix}:{name.rpartition(':')[2]}" for name in found.names))


def _renamed(found: NamedPoints, human: str | None, avatar: str | None) -> NamedPoints:
    """The two people under the usual prefixes, where labels begin with theirs and a colon, point, stroke or blank."""
    names = list(found.names)
    for wanted, usual in zip((human, avatar), DEFAULT_PREFIXES, strict=True):
        start = re.compile(re.escape((wanted or usual).rstrip(":")) + r"[:._/| -]", re.IGNORECASE)
        if wanted and not any(start.match(name) for name in found.names):
            raise HighFiveError(f"{found.source} has no labels of {wanted!r}; they are {names[0]} … {names[-1]}")
        names = [f"{usual}:{start.sub('', name, count=1)}" if start.match(name) else name for name in names]
    return replace(found, names=tuple(names))


def _placed(found: NamedPoints, options: ImportOptions) -> Recording:
    """In metres and z up, by what was said, what the file says, or what is beyond doubt."""
    unit = options.units or found.unit or unit_by_size(found)
    if options.units and found.unit and _metres(options.units) != UNITS[found.unit]:
        raise HighFiveError(f"{found.source} gives its numbers in {found.unit}, --units says {options.units}")
    if unit is None:
        sizes = ", ".join(f"{least:g} to {most:g} {name}" for name, (least, most) in PERSON_SPANS.items())
        raise HighFiveError(
            f"{found.source}: the unit of its numbers is in doubt: each person's points should extend over {sizes}; "
            "say --units"
        )
    level = in_world(found, _metres(unit), "z")
    up = options.up or _up(level, found.source)
    return level if up == "z" else in_world(found, _metres(unit), up)


def _metres(unit: str) -> float:
    """Of one unit: a name, or the number itself."""
    try:
        metres = UNITS.get(unit) or float(unit)
    except ValueError:
        metres = 0.0
    if not 0.0 < metres < np.inf:
        raise HighFiveError(f"--units {unit}: expected {', '.join(UNITS)}, or the metres of one unit, such as 0.0254")
    return metres


def _up(level: Recording, source: str) -> str:
    found = {up_axis(level.person(prefix)) for prefix in level.prefixes} - {None}
    if len(found) == 1 and (way := str(found.copy().pop())) in ("+y", "+z"):
        return way[1]
    seen = (
        f"heads are towards {' and '.join(sorted(map(str, found)))}" if found else "no head is clearly above the rest"
    )
    raise HighFiveError(f"{source}: which axis is up is in doubt, {seen}; say --up y or --up z")


def _write(trial: Recording, path: Path) -> None:
    write_c3d(path, trial)
