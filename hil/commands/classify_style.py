"""Whether the style shows: a style classifier judges what the model generates and what is played after correction.

Every simulated person is answered in every style, so that the classifier cannot go by what the person does: the same
people stand behind each emotion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.datasets.training_data import load_trials
from highfive.hil.report.terminal_tables import print_observations  # noqa: F401 (for the command line)
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.session.session import RATE_HZ, Session
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.mocap_bridge.files.trial_table import TrialRow, read_table
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.evaluation.style_classifier import (
    ANGLES,
    Motion,
    accuracy,
    confusion,
    features,
    fit_style_classifier,
)
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trials import Trial

BOTH = "angles and speeds"
CUES = {BOTH: slice(None), "angles": slice(0, len(ANGLES)), "speeds": slice(len(ANGLES), None)}
"""What a classifier is given: columns of the features."""

STAGES = ("generated", "corrected")


@dataclass(frozen=True)
class ClassifyStyleOptions:
    """What to judge; see ``highfive classify-style --help``. No ``model`` is the one that comes with High Five."""

    data: Path
    model: Path | None = None
    people: int = 36
    morph: tuple[str, str] = ("neutral", "angry")
    seed: int = 1
    human: str = "human"
    avatar: str = "avatar"
    human_set: str | None = None
    avatar_set: str | None = None

    @property
    def model_file(self) -> Path:
        """The model's file."""
        return self.model or DEFAULT_MODEL


@dataclass(frozen=True)
class Shown:
    """What an avatar showed in one high five.

    Attributes:
        features: (2, F) before and after contact correction.
        peak_speed: (2,) m/s, of the palm.
    """

    features: Array
    peak_speed: Array


def classified(options: ClassifyStyleOptions, bar: Bar) -> dict[str, Any]:
    """Accuracies on captured, generated and corrected motion, confusions, and the speeds of a morph.

    Raises:
        HighFiveError: the recordings lack an emotion of the model or held-out trials, or a style is unknown.
    """
    model = load_model(options.model_file, avatar_skeleton().hash)
    for style in options.morph:
        if style not in model.emotions:
            raise HighFiveError(f"--morph: the model knows no {style!r}; it knows {', '.join(model.emotions)}")
    trials = _captured(options, model.emotions, bar)
    values = np.array([features(Motion(t.rate_hz, t.joints, t.palm), avatar_skeleton()) for t in trials])
    people = simulated_partners(
        options.people, tuple(EMOTIONS), CELLS, options.seed, lambda total: bar("people", total)
    )
    answers = _in_styles(people, [{emotion: 1.0} for emotion in model.emotions], options.model_file, bar)
    judged = {cue: _judge(trials, values, people, answers, model.emotions, own) for cue, own in CUES.items()}
    return {
        "observer_accuracy": judged[BOTH]["accuracy"],
        "by_cue": {cue: of["accuracy"] for cue, of in judged.items()},
        "by_person": judged[BOTH]["by_person"],
        "confusion": judged[BOTH]["confusion"],
        "morph": _morph(people, options, bar),
        "generated_trials_an_emotion": len(people),
        "captured_trials": {"train": sum(not t.test for t in trials), "test": sum(t.test for t in trials)},
        "seed": options.seed,
        "simulated": True,
    }


def _captured(options: ClassifyStyleOptions, emotions: Sequence[str], bar: Bar) -> list[Trial]:
    """The recordings that the classifier learns from and is tried on."""
    _check_enough(options.data, read_table(options.data), emotions)  # before anything is worked out for it
    roles = options.human, options.avatar, options.human_set, options.avatar_set
    pairs = load_trials(options.data, *roles, lambda total: bar("solving markers", total))
    trials = [pair.trial for pair in pairs]
    _check_enough(options.data, trials, emotions)  # what could not be read is left out
    return trials


def _check_enough(folder: Path, trials: Sequence[Trial | TrialRow], emotions: Sequence[str]) -> None:
    """Raises HighFiveError if a classifier cannot learn all ``emotions``, or cannot be tried."""
    shown = [trial.emotion for trial in trials if not trial.test]
    if rare := [emotion for emotion in emotions if shown.count(emotion) < 2]:
        count = shown.count(rare[0]) or "no"
        need = "a classifier learns all that the model knows, from two trials each"
        raise HighFiveError(f"{folder} shows {count} {rare[0]} to learn from; {need}")
    if not any(trial.test for trial in trials):
        raise HighFiveError(f"{folder} has no held-out trial; mark some with split test in trials.csv")


def _judge(
    trials: Sequence[Trial],
    values: Array,
    people: Sequence[Partner],
    answers: Sequence[Sequence[Shown]],
    styles: Sequence[str],
    columns: slice,
) -> dict[str, Any]:
    """What a classifier that is given some columns of the features makes of all motion; answers are [person][style]."""
    held, labels = np.array([trial.test for trial in trials]), np.array([trial.emotion for trial in trials])
    classifier = fit_style_classifier(values[~held][:, columns], labels[~held].tolist())
    shown = [style for _ in people for style in styles]
    acting = [person.emotion for person in people for _ in styles]
    seen = {
        name: classifier.recognise(np.array([each.features[stage] for row in answers for each in row])[:, columns])
        for stage, name in enumerate(STAGES)
    }
    tried = classifier.recognise(values[held][:, columns])
    pairs = {"captured": (labels[held].tolist(), tried), **{name: (shown, answer) for name, answer in seen.items()}}
    groups = {emotion: [person == emotion for person in acting] for emotion in dict.fromkeys(acting)}
    groups["as the style"] = [person == style for person, style in zip(acting, shown, strict=True)]
    return {
        "accuracy": {name: accuracy(*pair) for name, pair in pairs.items()},
        "confusion": {name: confusion(*pair) for name, pair in pairs.items()},
        "by_person": {
            group: {name: accuracy(list(compress(shown, own)), list(compress(seen[name], own))) for name in STAGES}
            for group, own in groups.items()
            if any(own)
        },
    }


def _morph(people: Sequence[Partner], options: ClassifyStyleOptions, bar: Bar) -> dict[str, Any]:
    """Peak palm speed from one style to another; each person's hand is the same all the way."""
    start, end = options.morph
    weights = [round(0.1 * n, 1) for n in range(11)]
    styles = [{start: 1.0} if start == end else {start: 1.0 - w, end: w} for w in weights]
    shown = _in_styles(people, styles, options.model_file, bar)
    speeds = np.array([[each.peak_speed for each in row] for row in shown])
    rising = (np.diff(speeds, axis=1).min(axis=1) > 0.0).sum(axis=0)
    faster = (speeds[:, -1] > speeds[:, 0]).sum(axis=0)
    about: dict[str, Any] = {"from": start, "to": end, "weights": weights, "people": len(people)}
    for stage, name in enumerate(STAGES):
        about[name] = {
            "peak_speed": [round(float(v), 4) for v in speeds[:, :, stage].mean(axis=0)],
            "people_faster_at_each_step": int(rising[stage]),
            "people_faster_in_the_end": int(faster[stage]),
        }
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
        seen = np.array([features(motion, avatar_skeleton()) for motion in motions])
        shown.append(Shown(seen, np.array([motion.palm_speed().max() for motion in motions])))
    return shown


@cache
def _session(path: Path) -> Session:
    """One session a process: what it takes to begin is done once."""
    model = load_model(path, avatar_skeleton().hash)
    return Session(model, {model.emotions[0]: 1.0}, load_marker_set(PERSON_SET), build_scene())
