"""The report of a session: ``report.json``, one self-contained ``report.html``, and the figures as PNG.

The page needs nothing but itself: pictures are inside, there is no script, and it follows a light or dark screen.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from highfive.hil.arm.arm_options import EMULATED, VIRTUAL
from highfive.hil.report.captions import who_is_who
from highfive.hil.report.drawing import Drawing, to_png
from highfive.hil.report.film import Strip
from highfive.hil.report.page import figures, jpeg, render, section, table
from highfive.hil.report.report_tables import dot, show, style_table, trial_table
from highfive.hil.report.session_figures import draw_all, figure_names
from highfive.hil.runtime.console import counted
from highfive.hil.runtime.folders import write_file
from highfive.hil.sim.rendering import NoPictures
from highfive.hil.trials.summary import FAR_OFF_MM, SessionSettings, kind
from highfive.hil.trials.targets import Target, targets
from highfive.hil.trials.trial import style_name
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.errors import HighFiveError

PAGE, DATA, FIGURES, FILM = "report.html", "report.json", "figures", "highfive.mp4"
_ARM_DRAWN = ("arm_joints", "arm_meeting", "arm_effort", "arm_bus")
_SECTIONS = ("Contact error", "Movement", "Servo arm", "Latency")
"""Sections of the page that figures of ours stand in; others follow them."""
_SIMULATED = (
    "The people in this report are simulated. They stand in for people to test the chain from markers to contact; no "
    "figure here is a finding about people. Pairs of a simulated person and an actor were drawn until two could meet, "
    "so all of these hands are within reach."
)
_OTHER = (
    "In the recording the two people's own palms come within {other} mm of each other. That is between palm centres "
    "which are estimated from wrist and hand points (joint centres, where a file has them), not between skins, and "
    "people meet at a slant. The avatar's palm is brought to that same estimate, to {ours}: the two figures do not "
    "compare."
)
_MEDIAN = (
    "Shown is the median high five of each style, by how far the palms were apart; of an even number the nearer one of "
    "the middle two."
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
        folder: made if it is not there; an older report in it is replaced, with its figures and its film.
        summary: from :func:`highfive.hil.trials.summary.summarise`; ``report.json`` is the same.
        results: the trials, possibly none.
        settings: what the session was to do.
        pictures: from :func:`highfive.hil.report.film.picture_strips`, or why there are none.
        film: from :func:`highfive.hil.report.film.make_film`; None where none was requested.
        arm: from :func:`highfive.hil.report.arm_report.draw_arm`, where a servo arm took part.

    Raises:
        HighFiveError: a file cannot be written.
    """
    drawings = [*draw_all(results), *arm]
    write_file(folder / DATA, json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False).encode())
    for drawing in drawings:
        write_file(folder / FIGURES / f"{drawing.name}.png", to_png(drawing.figure))
    write_file(folder / PAGE, render_page(summary, settings, drawings, pictures, film).encode())
    _remove_stale(folder, drawings, film)
    return folder / PAGE


def _remove_stale(folder: Path, drawings: Sequence[Drawing], film: Path | NoPictures | None) -> None:
    """Removes what an earlier session left under names of ours that this one did not write."""
    left = {f"{name}.png" for name in (*figure_names(), *_ARM_DRAWN)} - {f"{drawing.name}.png" for drawing in drawings}
    stale = [*(folder / FIGURES / name for name in sorted(left)), *([] if isinstance(film, Path) else [folder / FILM])]
    for path in stale:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            why = error.strerror or error
            raise HighFiveError(f"cannot remove {path}, which is of an earlier session: {why}; remove it") from None


def render_page(
    summary: dict[str, Any],
    settings: SessionSettings,
    drawings: Sequence[Drawing],
    pictures: Sequence[Strip] | NoPictures = (),
    film: Path | NoPictures | None = None,
) -> str:
    """The page as text."""
    drawn = {drawing.name: drawing for drawing in drawings}

    def under(heading: str) -> str:
        return figures(drawn, *(drawing.name for drawing in drawings if drawing.section == heading))

    others = dict.fromkeys(drawing.section for drawing in drawings if drawing.section not in _SECTIONS)
    sections = [
        _warnings(summary),
        _headline(targets(summary)),
        section("Findings", _findings(summary)),
        section("Moments", _strips(pictures, summary) + _film(film, pictures)),
        section("Contact error", style_table(summary) + under("Contact error")),
        section("Movement", under("Movement")),
        section("Servo arm", _arm(summary, drawn)),
        section("Latency", under("Latency")),
        *(section(heading, under(heading)) for heading in others),
        section("Trials", trial_table(summary)),
        section("Do it again", _reproduce(summary, settings)),
    ]
    title = f"High Five: a {kind(summary)} session"
    return render(title, _subtitle(summary), _badges(summary), sections)


def _arm(summary: dict[str, Any], drawn: Mapping[str, Drawing]) -> str:
    if not summary["arm"]:
        return ""
    from highfive.hil.report.arm_report import arm_section  # noqa: PLC0415 (the arm's planner takes a second)

    return arm_section(summary["arm"], dict(drawn))


def _subtitle(summary: dict[str, Any]) -> str:
    trials = counted(summary["trials"], "trial")
    if summary["simulated"] and not summary["style"] and not _style_changed(summary):
        mood = "each answered in the emotion of the person"
    else:
        styles = [escape(style) for style in summary["contact_error_mm"]["by_emotion"]]
        mood = "answered as " + ", ".join(styles) if styles else "none was finished"
    people = list(dict.fromkeys(row["person_emotion"] for row in summary["rows"] if row["person_emotion"]))
    if summary["style"] and people:
        mood += "; the person herself is " + " or ".join(escape(emotion) for emotion in people)
    source = f", {escape(summary['source'])}" if summary["source"] else ""
    return f"{trials}{source}, {mood}. Model {escape(str(summary['model']))}, seed {summary['seed']}."


def _style_changed(summary: dict[str, Any]) -> bool:
    """On the page, while it ran; not known of a recorded person, whose emotion nobody says."""
    asked = style_name(summary["style"]) if summary["style"] else None
    answered = [(row["style"], asked or row["person_emotion"]) for row in summary["rows"]]
    return any(style and first and style != first for style, first in answered)


def _badges(summary: dict[str, Any]) -> str:
    badges = [(f"{kind(summary)} person", False)]
    badges.append(("physics" if summary["physics"] else "kinematic play-out", False))
    if summary["rig"]:
        arms = {EMULATED: "emulated servo arm", VIRTUAL: "emulated servo arm, virtual time"}
        real = f"servo arm on {summary['rig']}"
        badges.append((arms.get(summary["rig"], real), summary["rig"] not in arms))
        if summary["arm"] and summary["arm"]["stopped"]:
            badges.append(("the arm was stopped", True))
    if summary["warnings"]:
        rows = summary["rows"]
        far = [row for row in rows if (row["uncorrected_error_mm"] or 0.0) > FAR_OFF_MM]
        met = sum(row["met"] for row in far)
        where = "" if met == len(rows) else f" in {met} of {len(rows)}"
        badges.append((f"the correction did all of it{where}" if met else "palms far apart", True))
    if not summary["corrected"]:
        badges.append(("contact correction off", True))
    if summary["interrupted"]:
        badges.append((f"interrupted after {summary['trials']} of {summary['planned']} trials", True))
    return "".join(f'<span class="badge{" loud" * loud}">{escape(text)}</span>' for text, loud in badges)


def _warnings(summary: dict[str, Any]) -> str:
    return "".join(f'<p class="warning">{escape(line)}</p>' for line in summary["warnings"])


def _headline(listed: Sequence[Target]) -> str:
    state = {True: '<span class="met">met</span>', False: '<span class="unmet">not met</span>', None: "not judged"}
    cards = (
        f'<div class="figure"><div class="what">{escape(t.what)}</div><div class="value">{escape(t.measured)}</div>'
        f'<div class="target">target {escape(t.target)}: {state[t.met]}</div>'
        + (f'<div class="why">{escape(t.why)}</div>' if t.why else "")
        + "</div>"
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
    for row in summary["rows"]:
        if row["why_not_met"]:
            found.append(f"Trial {row['trial'] + 1} ({escape(row['title'])}): {escape(row['why_not_met'])}.")
    for entry in summary["out_of_reach_trials"]:
        if entry["trial"] not in summary["missed_trials"]:
            found.append(
                f"Trial {entry['trial'] + 1} ({escape(entry['title'])}): the palm was out of reach, "
                f"{show(entry['distance_mm'])} mm away."
            )
    other = summary["other_error_mm"]
    if not summary["simulated"] and other["median"] is not None:
        ours = _spread(summary["contact_error_mm"], summary, "mm")
        found.append(_OTHER.format(other=show(other["median"]), ours=ours))
    truth, closing = summary["true_error_at_touch_mm"], summary["closing_speed_at_touch_m_s"]
    if truth["median"] is not None:
        found.append(
            "From the avatar's palm as played to the person's true palm, which only a simulation knows, as they first "
            f"touched: {_spread(truth, summary, 'mm', 1)}. They closed in at {_spread(closing, summary, 'm/s')}."
        )
    if summary["unwanted_contacts"] == 0:
        found.append("Nothing touched that should not have; the two hands may, fingers too.")
    text = "".join(f"<p>{line}</p>" for line in found)
    return text + _unwanted(summary)


def _spread(extent: Mapping[str, float | None], summary: Mapping[str, Any], unit: str, digits: int = 2) -> str:
    """Median and largest; of a single trial the one figure that there is."""
    if summary["trials"] == 1:
        return f"{show(extent['median'], digits)} {unit}"
    return f"{show(extent['median'], digits)} {unit} (median; largest {show(extent['max'], digits)})"


def _list(name: str, numbers: Sequence[int]) -> str:
    return f"{name} {', '.join(str(n + 1) for n in numbers)}." if numbers else ""


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
            show(max(e["deepest_mm"] for e in entries)),
            _numbers(e["trial"] for e in entries),
        ]
        for (first, second), entries in pairs.items()
    ]
    heads = ["avatar's", "touched", "trials", "deepest, mm", "in"]
    count = summary["unwanted_contacts"]
    return f"<p>Unwanted contacts: {count}, one per trial and pair of body parts.</p>" + table(
        heads, rows, words={0, 1, 4}
    )


def _numbers(trials: Iterable[int]) -> str:
    listed = [str(t + 1) for t in trials]
    return ", ".join(listed[:12]) + (" …" if len(listed) > 12 else "")


def _strips(pictures: Sequence[Strip] | NoPictures, summary: Mapping[str, Any]) -> str:
    if isinstance(pictures, NoPictures):
        return f"<p>{escape(pictures.reason[:1].upper() + pictures.reason[1:])}.</p>"
    if not pictures:
        return "<p>Pictures left out: none were requested, or no trial was finished.</p>"
    several = summary["trials"] > len({strip.result.number for strip in pictures})
    return (f"<p>{_MEDIAN}</p>" if several else "") + "".join(_strip(strip) for strip in pictures)


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
    result = strip.result
    answers, _ = who_is_who(result, arm=strip.arm)
    heading = f"{dot(result.style)}{escape(f'{answers}; {result.title}')}"
    return f'<div class="strip"><h3>{heading}</h3><div>{frames}</div></div>'


def _reproduce(summary: dict[str, Any], settings: SessionSettings) -> str:
    facts = {
        "model": str(summary["model"]),
        "seed": str(summary["seed"]),
        **summary["versions"],
    }
    listed = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts.items())
    command = f"<pre>{escape(settings.command)}</pre>" if settings.command else ""
    kept = "is in <code>session.mcap</code>, which <code>simulate --source</code> plays again."
    again = (
        f"A live hand never moves the same again: what it did, and what it was answered, {kept}"
        if summary["live"]
        else "The style was changed on the page; a high five is called by the one in which palms met. When, and what "
        f"was answered, {kept}"
        if _style_changed(summary)
        else "The same seed, model and versions give the same trajectories and contact figures, bit for bit; timings "
        "are of the machine."
    )
    return (
        f"{command}<p>{again}</p><dl>{listed}</dl>"
        f"<p>To cite: High Five {escape(summary['versions']['high-five'])}, with model, seed and versions as above. "
        "The method follows Taubert et al. 2013. All figures of this page are in "
        f"<code>{DATA}</code>, its pictures in <code>{FIGURES}/</code>.</p>"
    )
