"""Whether the style shows: a machine observer judges what the model generates and what is played after correction.

Every simulated person is answered in every style, so that the observer cannot go by what the person does: the same
people stand behind each emotion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from hil.avatar import avatar_skeleton
from hil.partners import Partner, simulated_partners
from hil.session import RATE_HZ, Session
from hil.sim.actors import CELLS
from hil.sim.capture import PERSON_SET
from hil.sim.emotions import EMOTIONS
from hil.sim.scene import build_scene
from hil.threads import parallel_map
from hil.training_data import load_trials
from mocap_bridge.marker_sets import load_marker_set
from mocap_bridge.sources import C3DSource
from model import observer
from model.errors import HighFiveError
from model.observer import ANGLES, Motion, Observer
from model.rotations import Array
from model.store import load_model

Bar = Callable[[str, int], Callable[[], None]]

CUES = {"angles and speeds": slice(None), "angles": slice(0, len(ANGLES)), "speeds": slice(len(ANGLES), None)}
"""What an observer is given: columns of the features."""


@dataclass(frozen=True)
class ObserveOptions:
    """What to judge; see ``highfive observe --help``."""

    data: Path
    model: Path
    people: int = 36
    morph_people: int = 36
    morph: tuple[str, str] = ("neutral", "angry")
    seed: int = 1
    human: str = "human"
    avatar: str = "avatar"
    human_set: str | None = None
    avatar_set: str | None = None


@dataclass(frozen=True)
class Shown:
    """What an avatar showed in one high five.

    Attributes:
        features: (2, F) before and after contact correction.
        peak_speed: (2,) m/s, of the palm.
    """

    features: Array
    peak_speed: Array


def observe(options: ObserveOptions, bar: Bar) -> dict[str, Any]:
    """Accuracy on captured, generated and corrected motion, by the person's own emotion too, and the morph's speeds.

    Raises:
        HighFiveError: the recordings show fewer than two emotions, none is held out, or the model knows others.
    """
    model = load_model(options.model, avatar_skeleton().hash)
    pairs = load_trials(
        options.data, options.human, options.avatar, options.human_set, options.avatar_set,
        lambda total: bar("solving markers", total),
    )  # fmt: skip
    trials = [pair.trial for pair in pairs]
    missing = [emotion for emotion in model.emotions if emotion not in {trial.emotion for trial in trials}]
    if missing:
        raise HighFiveError(f"{options.data} shows no {missing[0]}, which the model knows; give what it was trained on")
    motions = [Motion(trial.rate_hz, trial.joints, trial.palm) for trial in trials]
    values = np.array([observer.features(motion, avatar_skeleton()) for motion in motions])
    held, labels = np.array([trial.test for trial in trials]), np.array([trial.emotion for trial in trials])
    if not held.any():
        raise HighFiveError(f"{options.data} has no held-out trial; mark some with split test in trials.csv")

    people = simulated_partners(
        max(options.people, options.morph_people), tuple(EMOTIONS), CELLS, options.seed,
        lambda total: bar("people", total),
    )  # fmt: skip
    answers = _in_styles(people[: options.people], [{e: 1.0} for e in model.emotions], options.model, bar)
    observers = {cue: observer.fit_observer(values[~held][:, own], list(labels[~held])) for cue, own in CUES.items()}
    captured = {
        cue: observer.accuracy(list(labels[held]), seer.recognise(values[held][:, CUES[cue]]))
        for cue, seer in observers.items()
    }
    judged = _judge(observers["angles and speeds"], people, answers, model.emotions)
    seen = observers["angles and speeds"].recognise(values[held])
    return {
        "observer_accuracy": {"captured": captured["angles and speeds"], **judged["accuracy"]},
        "by_person": judged["by_person"],
        "cues": {
            cue: {"captured": captured[cue], **_judge(seer, people, answers, model.emotions, own)["accuracy"]}
            for (cue, own), seer in zip(CUES.items(), observers.values(), strict=True)
        },
        "confusion": {"captured": observer.confusion(list(labels[held]), seen), **judged["confusion"]},
        "morph": _morph(people[: options.morph_people], options, model.emotions, bar),
        "trials_an_emotion": options.people,
        "learned_from": int((~held).sum()),
        "seed": options.seed,
        "simulated": True,
    }


def _judge(
    seer: Observer,
    people: Sequence[Partner],
    answers: Sequence[Sequence[Shown]],
    styles: Sequence[str],
    columns: slice = slice(None),
) -> dict[str, Any]:
    """Accuracies and confusion of answers[person][style], before and after correction."""
    shown = [style for _ in answers for style in styles]
    acting = [person.emotion for person, _ in zip(people, answers, strict=False) for _ in styles]
    result: dict[str, Any] = {"accuracy": {}, "confusion": {}, "by_person": {}}
    for stage, name in enumerate(("generated", "corrected")):
        values = np.array([each.features[stage] for row in answers for each in row])
        seen = seer.recognise(values[:, columns])
        result["accuracy"][name] = observer.accuracy(shown, seen)
        result["confusion"][name] = observer.confusion(shown, seen)
        groups = {emotion: [a == emotion for a in acting] for emotion in dict.fromkeys(acting)}
        groups["the same"] = [a == b for a, b in zip(acting, shown, strict=True)]
        for group, chosen in groups.items():
            if any(chosen):
                own, theirs = (list(np.array(names)[chosen]) for names in (shown, seen))
                result["by_person"].setdefault(group, {})[name] = observer.accuracy(own, theirs)
    return result


def _morph(people: Sequence[Partner], options: ObserveOptions, emotions: Sequence[str], bar: Bar) -> dict[str, Any]:
    """Peak palm speed from one style to another, each person's hand the same all the way."""
    start, end = options.morph
    if start not in emotions or end not in emotions or not people:
        return {}
    weights = np.linspace(0.0, 1.0, 11)
    styles = [{start: 1.0 - w, end: w} for w in weights.tolist()]
    speeds = np.array([[s.peak_speed for s in row] for row in _in_styles(people, styles, options.model, bar)])
    steps = np.diff(speeds, axis=1)
    about = {"from": start, "to": end, "weights": weights.round(1).tolist(), "people": len(people)}
    for stage, name in enumerate(("generated", "corrected")):
        about[f"{name}_peak_speed"] = speeds[:, :, stage].mean(axis=0).round(4).tolist()
        about[f"{name}_people_rising"] = int((steps[:, :, stage].min(axis=1) > 0.0).sum())
        about[f"{name}_people_faster_at_the_end"] = int((speeds[:, -1, stage] > speeds[:, 0, stage]).sum())
    return about


def _in_styles(
    people: Sequence[Partner], styles: Sequence[Mapping[str, float]], model: Path, bar: Bar
) -> list[list[Shown]]:
    """What is shown to each person in each style."""
    jobs = [(person, tuple(styles), model) for person in people]
    return list(parallel_map(_answer, jobs, lambda total: bar("high fives", total)))


def _answer(job: tuple[Partner, tuple[Mapping[str, float], ...], Path]) -> list[Shown]:
    person, styles, model = job
    session, frames = _session(model), list(C3DSource(person.recording, RATE_HZ))
    shown = []
    for style in styles:
        session.set_style(style)
        session.reset()
        ticks = [session.step(frame) for frame in frames]
        poses = ([t.generated for t in ticks], [t.pose for t in ticks])
        palms = ([t.generated_palm.position for t in ticks], [t.palm.position for t in ticks])
        motions = [
            Motion(
                RATE_HZ,
                avatar_skeleton().to_rotation_vectors(np.array([pose.quaternions for pose in posed])),
                np.array(palm),
            )
            for posed, palm in zip(poses, palms, strict=True)
        ]
        features = np.array([observer.features(motion, avatar_skeleton()) for motion in motions])
        shown.append(Shown(features, np.array([motion.palm_speed().max() for motion in motions])))
    return shown


@cache
def _session(path: Path) -> Session:
    """One session a process: what it takes to begin is done once."""
    model = load_model(path, avatar_skeleton().hash)
    return Session(model, {model.emotions[0]: 1.0}, load_marker_set(PERSON_SET), build_scene())
