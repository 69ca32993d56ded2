"""Window files of interaction benchmarks: a person's arm over five frames in, the partner's next five frames out.

A file holds, for ``train`` and ``test``, the arrays ``input`` (n, 90): five frames, oldest first, of three joints'
positions and of their differences from the frame before; ``target`` (n, d); ``sequence_lengths`` and ``action``; for
both parts ``input_unit`` and ``target_unit`` where these are not m, and m of a person or rad of a robot. This is the
protocol of the NuiSI data set (Prasad et al. 2024). Nothing of the test part is used in training, and the action only
to name the scores.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.evaluation.baselines import Predictor
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import FURTHEST, LARGEST_TURN, MINIMUM_POINTS, STILL, TrainingSet
from highfive.model.hgpdm.presets import Preset
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.npz_file import read_npz
from highfive.model.online.belief import Filter

FRAMES, POINTS = 5, 9  # frames of a window; coordinates of the arm's three joints
RATE_HZ = 30.0  # nominal; what matters is that window follows window
ARM_VARIANCE = 1e-8  # of the arm's coordinates: what a file gives is taken as it is
ROBOT_ACTIONS = ("wave", "handshake", "rocket_fistbump", "parachute_fistbump")  # targets of 20: four joint angles
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}  # unit of a file → m
TURNS = {"rad": 1.0, "deg": float(np.pi / 180.0)}  # → rad
HUMAN_ACTIONS = ("clap_fist", "fist_bump", "handshake", "high_five", "rocket_fistbump", "wave")  # targets of 90: an arm


@dataclass(frozen=True)
class Windows:
    """Consecutive windows of sequences.

    Attributes:
        history: (n, 6, 9) the arm at the newest frame and at the five before it, newest first.
        target: (n, d) what the partner does in the next frames.
        sequence: (n,) index of the sequence, non-decreasing.
        action: (n,) index of the action.
        unit: of the target: m or rad.
    """

    history: Array
    target: Array
    sequence: NDArray[np.int64]
    action: NDArray[np.int64]
    unit: str = "rad"


def read_windows(path: Path | str) -> tuple[Windows, Windows]:
    """The training and the test windows of a file.

    Raises:
        HighFiveError: no such file, no window file, or arrays that do not belong together.
    """
    try:
        arrays = read_npz(Path(path))
    except OSError as error:
        raise HighFiveError(f"{path} is not a windows file (.npz): {error.strerror or error}") from None
    if arrays is None:
        raise HighFiveError(f"{path} holds one array; a windows file (.npz) holds train_input, train_target, …")
    learn, test = _part(path, arrays, "train"), _part(path, arrays, "test")
    if (wide := learn.target.shape[1]) != test.target.shape[1]:
        raise HighFiveError(f"{path}: targets of {wide} numbers to learn, of {test.target.shape[1]} to test")
    return learn, test


def _part(path: Path | str, arrays: dict[str, Array], name: str) -> Windows:
    names = {key: f"{name}_{key}" for key in ("input", "target", "sequence_lengths", "action")}
    if missing := [full for full in names.values() if full not in arrays]:
        raise HighFiveError(f"{path} lacks {', '.join(missing)}; it holds {', '.join(arrays) or 'nothing'}")
    inputs, target, lengths, action = (np.asarray(arrays[full]) for full in names.values())
    for full, values in zip(names.values(), (inputs, target, lengths, action), strict=True):
        if values.dtype.kind not in "iuf":
            raise HighFiveError(f"{path}: {full} holds no numbers")
        if not np.all(np.isfinite(values)):
            raise HighFiveError(f"{path}: {full} holds NaN or infinity")
    count = inputs.shape[0] if inputs.ndim else 0
    if inputs.shape != (count, 2 * FRAMES * POINTS) or target.ndim != 2 or len(target) != count or not target.size:
        raise HighFiveError(
            f"{path}: {name} inputs {inputs.shape} and targets {target.shape}; expected (n, 90), (n, d)"
        )
    if np.any(lengths < 1):
        raise HighFiveError(f"{path}: {name}_sequence_lengths hold {lengths.min():g}; a sequence has a window or more")
    if lengths.ndim != 1 or lengths.shape != action.shape or lengths.sum() != count:
        raise HighFiveError(f"{path}: {name}_sequence_lengths do not add up to its {count} windows")
    if np.any(lengths % 1) or np.any(action % 1) or np.any(action < 0):
        raise HighFiveError(f"{path}: {name}_sequence_lengths and {name}_action must be whole numbers, from 0 on")
    inputs = inputs * _unit(path, arrays, "input_unit", LENGTHS)
    _check_size(f"{path}: {name}_input", inputs, FURTHEST, "metres", "millimetres")
    frames = inputs.astype(float).reshape(count, FRAMES, 2, POINTS)
    before = frames[:, :1, 0] - frames[:, :1, 1]  # the oldest difference tells of one frame more
    history = np.concatenate([before, frames[:, :, 0]], axis=1)[:, ::-1]
    sequences, counts = np.arange(len(lengths)), lengths.astype(np.int64)
    person = _of_a_person(target)
    target = target * _unit(path, arrays, "target_unit", LENGTHS if person else TURNS | LENGTHS)
    unit = "m" if person or str(arrays.get("target_unit")) in LENGTHS else "rad"
    rows = np.repeat(sequences, counts), np.repeat(action.astype(np.int64), counts)
    windows = Windows(history, target.astype(float), *rows, unit)
    largest = (FURTHEST, "metres", "millimetres") if unit == "m" else (LARGEST_TURN, "radians", "degrees")
    _check_size(f"{path}: {name}_target", target, *largest)
    if name == "train":
        _check_enough(path, inputs, target)
    return windows


def _unit(path: Path | str, arrays: dict[str, Array], name: str, known: dict[str, float]) -> float:
    """SI units that one of a file is; 1 where the file does not say which it has."""
    if name not in arrays:
        return 1.0
    unit = str(arrays[name])
    if unit not in known:
        raise HighFiveError(f"{path}: {name} {unit!r}; expected one of {', '.join(known)}")
    return known[unit]


def _check_size(what: str, values: Array, limit: float, unit: str, other: str) -> None:
    if (largest := np.abs(values).max()) > limit:
        raise HighFiveError(f"{what} reaches {largest:.3g}; expected {unit}: are these {other}?")


def _check_enough(path: Path | str, inputs: Array, target: Array) -> None:
    if len(target) < MINIMUM_POINTS:
        raise HighFiveError(f"{path}: {len(target)} training windows; at least {MINIMUM_POINTS} are needed")
    for key, values in (("input", inputs), ("target", target)):
        if np.all(np.std(values, axis=0) < STILL):
            raise HighFiveError(f"{path}: train_{key} is the same in all windows; there is nothing to learn")


def is_person(windows: Windows) -> bool:
    """The partner is a person whose arm is given like the input; otherwise a robot."""
    return _of_a_person(windows.target)


def _of_a_person(target: Array) -> bool:
    return target.shape[1] == 2 * FRAMES * POINTS


def action_names(windows: Windows) -> dict[int, str]:
    """Names of the actions that occur."""
    known: dict[int, tuple[str, ...]] = {20: ROBOT_ACTIONS, 90: HUMAN_ACTIONS}
    names = known.get(windows.target.shape[1], ())
    return {int(k): names[k] if 0 <= k < len(names) else f"action_{k}" for k in np.unique(windows.action)}


def most_sequences(windows: Windows) -> int:
    """Number of sequences of the action that has most."""
    return max(len(found) for found in _sequences(windows).values())


def few_sequences(windows: Windows, count: int, seed: int) -> Windows:
    """The windows of ``count`` sequences of each action, all where it has fewer; smaller draws of a seed are parts of
    larger ones.
    """
    rng = np.random.default_rng(seed)
    chosen = np.sort(np.concatenate([rng.permutation(found)[:count] for found in _sequences(windows).values()]))
    kept = np.isin(windows.sequence, chosen)
    sequence = np.searchsorted(chosen, windows.sequence[kept])
    rows = sequence.astype(np.int64), windows.action[kept]
    return Windows(windows.history[kept], windows.target[kept], *rows, windows.unit)


def _sequences(windows: Windows) -> dict[int, NDArray[np.int64]]:
    """Action → its sequences."""
    actions = np.unique(windows.action)
    return {int(action): np.unique(windows.sequence[windows.action == action]) for action in actions}


def window_preset(preset: Preset) -> Preset:
    """A preset whose back constraint sees what a window holds."""
    return replace(preset, history=tuple((np.arange(FRAMES) + 1) / RATE_HZ))


def window_set(windows: Windows) -> TrainingSet:
    """Windows as training points, all of one style: nobody tells the action."""
    channels: int = windows.target.shape[1]
    digest = hashlib.sha256(np.ascontiguousarray(windows.history).tobytes() + windows.target.tobytes()).hexdigest()[:16]
    return TrainingSet(
        ("any",), 1.0 / RATE_HZ, windows.history, windows.target, np.ones(channels),
        np.ones((len(windows.target), 1)), windows.sequence, digest,
    )  # fmt: skip


def respond(model: HGPDM, windows: Windows) -> Array:
    """What the model answers (n, d), online, each sequence from its beginning."""
    moving, style, noise = Filter(model, RATE_HZ), np.ones(1), np.full(POINTS, ARM_VARIANCE)
    answers: list[Array] = []
    for number in range(windows.sequence[-1] + 1):
        histories = windows.history[windows.sequence == number]
        belief = moving.initial(style)
        for arm in histories[0, :0:-1]:  # the first window holds five frames from before it
            belief, _ = moving.step(belief, arm, noise, style)
        for arm in histories[:, 0]:
            belief, generated = moving.step(belief, arm, noise, style)
            answers.append(generated.avatar)
    return np.array(answers)


def predicted(predictor: Predictor, features: Callable[[Array], Array], windows: Windows) -> Array:
    """What a baseline answers (n, d), window by window."""
    return predictor(features(windows.history), np.ones((len(windows.target), 1)))


def window_scores(answer: Array, windows: Windows) -> dict[str, float]:
    """Score of each action.

    Robot (targets of 20): squared error, rad², averaged over joints, frames and windows. Person (targets of 90): root
    mean square distance, m, of the three joints, over frames and windows.
    """
    error, person = answer - windows.target, is_person(windows)
    if person:
        distance = error.reshape(len(error), FRAMES, 2, POINTS // 3, 3)[:, :, 0]
        squares = np.sum(distance**2, axis=-1).mean(axis=(1, 2))
    else:
        squares = np.mean(error**2, axis=1)
    scores = {name: float(squares[windows.action == k].mean()) for k, name in action_names(windows).items()}
    if person:
        return {name: float(np.sqrt(value)) for name, value in scores.items()}
    return scores
