"""The report of a session: ``report.json``, one self-contained ``report.html``, and the figures as PNG.

The page needs nothing but itself: pictures are inside, there is no script, and it follows a light or dark screen.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

from hil.arm_report import arm_section
from hil.colours import colour_of
from hil.console import counted
from hil.drawing import Drawing, to_png
from hil.figures import draw_all
from hil.film import Strip
from hil.page import figures, jpeg, render, section, table, write_file
from hil.sim.rendering import NoPictures
from hil.summary import SessionSettings, Target, kind, targets
from hil.trial import TrialResult

PAGE, DATA, FIGURES = "report.html", "report.json", "figures"
_SIMULATED = (
    "The people in this report are simulated. They stand in for people to test the chain from markers to contact; no "
    "figure here is a finding about people."
)

_COLUMNS = (
    "Error: palm to palm at contact, or at the nearest approach, as played. True: to the person's true palm. Later: "
    "than the palms met originally. Speed step: largest change of a joint's speed from tick to tick while the "
    "correction fades in, as a share of the largest in the motion as generated."
)


def write_report(
    folder: Path,
    summary: dict[str, Any],
    results: Sequence[TrialResult],
    settings: SessionSettings,
    pictures: Sequence[Strip] | NoPictures = (),
    film: Path | NoPictures | None = None,
    arm: Sequence[Drawing] = (),
) -> Path:
    """Writes the report of a session, finished or not, into ``folder``; returns the page.

    Args:
        folder: made if it is not there; older reports in it are replaced.
        summary: from :func:`hil.summary.summarise`; ``report.json`` is the same.
        results: the trials, possibly none.
        settings: what the session was asked to do.
        pictures: from :func:`hil.film.picture_strips`, or why there are none.
        film: from :func:`hil.film.make_film`; None where none was asked for.
        arm: from :func:`hil.arm_report.draw_arm`, where a servo arm took part.

    Raises:
        HighFiveError: a file cannot be written.
    """
    drawings = [*draw_all(results), *arm]
    write_file(folder / DATA, json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False).encode())
    for drawing in drawings:
        write_file(folder / FIGURES / f"{drawing.name}.png", to_png(drawing.figure))
    write_file(folder / PAGE, render_page(summary, settings, drawings, pictures, film).encode())
    return folder / PAGE


def render_page(
    summary: dict[str, Any],
    settings: SessionSettings,
    drawings: Sequence[Drawing],
    pictures: Sequence[Strip] | NoPictures = (),
    film: Path | NoPictures | None = None,
) -> str:
    """The page as text."""
    drawn = {drawing.name: drawing for drawing in drawings}
    sections = [
        _headline(targets(summary)),
        section("Findings", _findings(summary)),
        section("Moments", _strips(pictures) + _film(film, pictures)),
        section("Contact error", figures(drawn, "contact_error", "error_by_cell") + _by_emotion(summary)),
        section("Movement", figures(drawn, "palm_distance", "palm_paths", "joint_angles")),
        section("Servo arm", arm_section(summary["arm"], drawn) if summary["arm"] else ""),
        section("Latency", figures(drawn, "latency")),
        section("Trials", _trials(summary)),
        section("Do it again", _reproduce(summary, settings)),
    ]
    title = f"High Five: a {kind(summary)} session"
    return render(title, _subtitle(summary), _badges(summary), sections)


def _subtitle(summary: dict[str, Any]) -> str:
    trials = counted(summary["trials"], "trial")
    style = summary["style"]
    if style:
        mood = "answered as " + ", ".join(f"{escape(e)} {w:g}" for e, w in style.items())
    elif summary["simulated"]:
        mood = "each answered in the emotion of the person"
    else:
        emotions = [escape(emotion) for emotion in summary["contact_error_mm"]["by_emotion"]]
        mood = "answered as " + ", ".join(emotions) if emotions else "none was finished"
    source = f", {escape(summary['source'])}" if summary["source"] else ""
    return f"{trials}{source}, {mood}. Model {escape(str(summary['model']))}, seed {summary['seed']}."


def _badges(summary: dict[str, Any]) -> str:
    badges = [(f"{kind(summary)} person", False)]
    badges.append(("physics" if summary["physics"] else "kinematic play-out", False))
    if not summary["corrected"]:
        badges.append(("contact correction off", True))
    if summary["interrupted"]:
        badges.append((f"interrupted after {summary['trials']} of {summary['planned']} trials", True))
    return "".join(f'<span class="badge{" loud" * loud}">{escape(text)}</span>' for text, loud in badges)


def _headline(listed: Sequence[Target]) -> str:
    state = {True: '<span class="met">met</span>', False: '<span class="unmet">not met</span>', None: "not judged"}
    cards = (
        f'<div class="figure"><div class="what">{escape(t.what)}</div><div class="value">{escape(t.measured)}</div>'
        f'<div class="target">target {escape(t.target)}: {state[t.met]}</div></div>'
        for t in listed
    )
    return f'<div class="headline">{"".join(cards)}</div>'


def _findings(summary: dict[str, Any]) -> str:
    found = []
    if summary["simulated"]:
        found.append(escape(_SIMULATED))
    if summary["trials"] == 0:
        found.append("No trial was finished, so there is nothing to measure.")
        return "".join(f"<p>{line}</p>" for line in found)
    met = summary["trials"] - summary["missed"]
    found.append(
        f"Palms met in {met} of {summary['trials']} trials." + _list(" No contact: trial", summary["missed_trials"])
    )
    for entry in summary["out_of_reach_trials"]:
        found.append(
            f"Trial {entry['trial']} ({escape(entry['title'])}): the palm was out of reach, "
            f"{_show(entry['distance_mm'])} mm away."
        )
    other = summary["other_error_mm"]
    if not summary["simulated"] and other["median"] is not None:
        found.append(
            f"Who really met that hand came within {_show(other['median'])} mm of it, measured in the same way; "
            f"the avatar within {_show(summary['contact_error_mm']['median'])} mm."
        )
    truth = summary["true_error_mm"]
    if truth["median"] is not None:
        found.append(
            f"Against the person's true palm, which only a simulation knows, rather than the tracked one: median "
            f"{_show(truth['median'])} mm, largest {_show(truth['max'])} mm."
        )
    if summary["unwanted_contacts"] == 0:
        found.append("Nothing touched that should not have.")
    text = "".join(f"<p>{line}</p>" for line in found)
    return text + _unwanted(summary)


def _list(name: str, numbers: Sequence[int]) -> str:
    return f"{name} {', '.join(str(n) for n in numbers)}." if numbers else ""


def _unwanted(summary: dict[str, Any]) -> str:
    if not summary["unwanted"]:
        return ""
    pairs: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for entry in summary["unwanted"]:
        pairs.setdefault((entry["first"], entry["second"]), []).append(entry)
    rows = [
        [
            first,
            second,
            str(len(entries)),
            _show(max(e["deepest_mm"] for e in entries)),
            _numbers(e["trial"] for e in entries),
        ]
        for (first, second), entries in pairs.items()
    ]
    heads = ["avatar's", "touched", "trials", "deepest, mm", "in"]
    count = summary["unwanted_contacts"]
    return f"<p>Unwanted contacts: {count}, one a trial and pair of body parts.</p>" + table(
        heads, rows, words={0, 1, 4}
    )


def _numbers(trials: Iterable[int]) -> str:
    listed = [str(t) for t in trials]
    return ", ".join(listed[:12]) + (" …" if len(listed) > 12 else "")


def _strips(pictures: Sequence[Strip] | NoPictures) -> str:
    if isinstance(pictures, NoPictures):
        return f"<p>{escape(pictures.reason[:1].upper() + pictures.reason[1:])}.</p>"
    if not pictures:
        return "<p>Pictures left out: none were asked for, or no trial was finished.</p>"
    return "".join(_strip(strip) for strip in pictures)


def _film(film: Path | NoPictures | None, pictures: Sequence[Strip] | NoPictures) -> str:
    if film is None or film == pictures:
        return ""
    if isinstance(film, NoPictures):
        return f"<p>{escape(film.reason[:1].upper() + film.reason[1:])}.</p>"
    name = escape(film.name, quote=True)
    return f'<p>The film is beside this page: <a href="{name}">{name}</a>.</p>'


def _strip(strip: Strip) -> str:
    frames = "".join(
        f'<figure><img alt="{escape(label)}" src="{jpeg(image)}"><figcaption>{escape(label)}</figcaption></figure>'
        for label, image in strip.pictures
    )
    return (
        f'<div class="strip"><h3>{_dot(strip.result.emotion)}{escape(strip.result.title)}</h3><div>{frames}</div></div>'
    )


def _dot(emotion: str | None) -> str:
    return f'<span class="dot" style="background:{colour_of(emotion or "")}"></span>'


def _by_emotion(summary: dict[str, Any]) -> str:
    heads = ["emotion", "trials", "after correction, mm: median", "largest", "as generated, mm: median",
             "largest", "palm angle, °: median", "largest", "contact later by, ms", "closing speed, m/s"]  # fmt: skip
    rows = []
    for emotion, error in summary["contact_error_mm"]["by_emotion"].items():
        spreads = {name: summary[name]["by_emotion"][emotion] for name in (
            "uncorrected_error_mm", "palm_angle_deg", "time_error_ms", "approach_speed_m_s")}  # fmt: skip
        generated, angle, late, speed = spreads.values()
        count = sum((row["emotion"] or "unknown") == emotion for row in summary["rows"])
        values = [error["median"], error["max"], generated["median"], generated["max"], angle["median"], angle["max"]]
        shown = [_show(v) for v in values] + [_show(late["median"], 0), _show(speed["median"])]
        rows.append([f"{_dot(emotion)}{escape(emotion)}", str(count), *shown])
    return table(heads, rows, words={0}, escaped=True) if rows else ""


def _trials(summary: dict[str, Any]) -> str:
    if not summary["rows"]:
        return ""
    forced = summary["physics"]
    heads = ["", "emotion", "cell", "met", "error, mm", "as generated, mm", "true, mm", "angle, °", "contact, s",
             "later, ms", "closing, m/s", *(["force, N"] if forced else []), "speed step, ×",
             "markers seen, %", "unwanted", "notes"]  # fmt: skip
    rows = []
    for r in summary["rows"]:
        missed = "out of reach" if r["out_of_reach"] else "no"
        met = "yes" if r["met"] and not r["out_of_reach"] else f'<span class="unmet">{missed}</span>'
        force = [_show(r["peak_force_n"], 0)] if forced else []
        seen = None if r["markers_seen"] is None else 100.0 * r["markers_seen"]
        title = [] if r["simulated"] else [r["title"]]
        rows.append([
            str(r["trial"]), f"{_dot(r['emotion'])}{escape(r['emotion'] or '–')}", escape(r["cell"] or "–"), met,
            _show(r["contact_error_mm"]), _show(r["uncorrected_error_mm"]), _show(r["true_error_mm"]),
            _show(r["palm_angle_deg"], 1), _show(r["contact_time_s"]), _show(r["time_error_ms"], 0),
            _show(r["approach_speed_m_s"]), *force, _show(r["speed_change_ratio"]), _show(seen, 1),
            str(r["unwanted_contacts"]), escape("; ".join([*title, *r["notes"]])),
        ])  # fmt: skip
    last = len(heads) - 1
    if not any(row[-1] for row in rows):
        heads, rows = heads[:-1], [row[:-1] for row in rows]
    return table(heads, rows, words={1, 2, 3, last}, escaped=True) + f'<p class="soft">{_COLUMNS}</p>'


def _show(value: float | None, digits: int = 2) -> str:
    if value is None:
        return "–"
    shown = f"{value:.{digits if abs(value) < 100 else min(digits, 1)}f}"
    return shown.lstrip("-") if float(shown) == 0.0 else shown.replace("-", "−")


def _reproduce(summary: dict[str, Any], settings: SessionSettings) -> str:
    facts = {
        "model": str(summary["model"]),
        "seed": str(summary["seed"]),
        **summary["versions"],
    }
    listed = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts.items())
    command = f"<pre>{escape(settings.command)}</pre>" if settings.command else ""
    again = (
        "A live hand never moves the same again: what it did, and what it was answered, is in "
        "<code>session.mcap</code>."
        if summary["live"]
        else "The same seed, model and versions give the same trajectories and contact figures, bit for bit; timings "
        "are of the machine."
    )
    return (
        f"{command}<p>{again}</p><dl>{listed}</dl>"
        f"<p>To cite: High Five {escape(summary['versions']['high-five'])}, with model, seed and versions as above. "
        "The method follows Taubert et al. 2013. All figures of this page are in "
        f"<code>{DATA}</code>, its pictures in <code>{FIGURES}/</code>.</p>"
    )
