"""Window files of interaction benchmarks: an arm over some frames in, what the partner does in the next ones out.

A file holds, for ``train`` and ``test``, the arrays ``input`` (n, w): frames, oldest first, of an arm's coordinates and
of their differences from the frame before; ``target`` (n, d); ``sequence_lengths`` and ``action``. For both parts it
may hold ``input_frames`` (5), ``input_differences`` (1; 0 where there are none), and ``input_unit`` and ``target_unit``
where these are not m, and m of a person or rad of a robot. With inputs of 90 (five frames of three joints) this is the
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

FRAMES = 5  # of a window of a file that does not say how many
PUBLISHED = (6, 9)  # shape of a history of the data set: three joints
RATE_HZ = 30.0  # nominal; what matters is that window follows window
ARM_VARIANCE = 1e-8  # of the arm's coordinates: what a file gives is taken as it is
ROBOT_ACTIONS = ("wave", "handshake", "rocket_fistbump", "parachute_fistbump")  # targets of 20: four joint angles
LAYOUT = {"input_frames": FRAMES, "input_differences": 1}  # of a file that does not say it
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}  # unit of a file → m
TURNS = {"rad": 1.0, "deg": float(np.pi / 180.0)}  # → rad
HUMAN_ACTIONS = ("clap_fist", "fist_bump", "handshake", "high_five", "rocket_fistbump", "wave")  # targets of 90: an arm


@dataclass(frozen=True)
class Layout:
    """How a row of an input is laid out: (frames, 2, P), coordinates and differences, or (frames, 1, P) without these.

    Attributes:
        frames: of a window.
        differences: each frame's coordinates are followed by their differences from the frame before.
    """

    frames: int = FRAMES
    differences: bool = True

    def split(self, rows: Array) -> Array:
        """Rows (n, w) as (n, frames, 1 or 2, P)."""
        return rows.reshape(len(rows), self.frames, 1 + self.differences, -1)

    def history(self, rows: Array) -> Array:
        """(n, H, P) the arm at the newest frame and at those before it, newest first."""
        frames = self.split(rows)
        told = frames[:, :, 0]
        if self.differences:  # the oldest one tells of one frame more
            told = np.concatenate([told[:, :1] - frames[:, :1, 1], told], axis=1)
        return told[:, ::-1]


@dataclass(frozen=True)
class Windows:
    """Consecutive windows of sequences.

    Attributes:
        history: (n, H, P) the arm at the newest frame and at those before it, newest first; m, or rad of a robot.
        target: (n, d) what the partner does in the next frames.
        sequence: (n,) index of the sequence, non-decreasing.
        action: (n,) index of the action.
        unit: of the target: m or rad.
        person: layout of the target where the partner is a person whose joints are given like the input's.
    """

    history: Array
    target: Array
    sequence: NDArray[np.int64]
    action: NDArray[np.int64]
    unit: str = "rad"
    person: Layout | None = None


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
    for what, wide, other in (
        ("targets of {} numbers", learn.target.shape[1], test.target.shape[1]),
        ("inputs of {} coordinates", learn.history.shape[2], test.history.shape[2]),
    ):
        if wide != other:
            raise HighFiveError(f"{path}: {what.format(wide)} to learn, of {other} to test")
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
    if inputs.ndim != 2 or target.ndim != 2 or len(target) != count or not target.size or not inputs.size:
        raise HighFiveError(f"{path}: {name} inputs {inputs.shape} and targets {target.shape}; expected (n, w), (n, d)")
    layout = _layout(path, arrays, inputs.shape[1])
    if np.any(lengths < 1):
        raise HighFiveError(f"{path}: {name}_sequence_lengths hold {lengths.min():g}; a sequence has a window or more")
    if lengths.ndim != 1 or lengths.shape != action.shape or lengths.sum() != count:
        raise HighFiveError(f"{path}: {name}_sequence_lengths do not add up to its {count} windows")
    if np.any(lengths % 1) or np.any(action % 1) or np.any(action < 0):
        raise HighFiveError(f"{path}: {name}_sequence_lengths and {name}_action must be whole numbers, from 0 on")
    factor, of_input = _unit(path, arrays, "input_unit", "m")
    inputs = inputs.astype(float) * factor
    _check_size(f"{path}: {name}_input", inputs, of_input)
    history = layout.history(inputs)
    like_input = target.shape[1] == inputs.shape[1] and history.shape[2] % 3 == 0 and of_input == "m"
    factor, unit = _unit(path, arrays, "target_unit", "m" if like_input else "rad")
    target = target.astype(float) * factor
    _check_size(f"{path}: {name}_target", target, unit)
    sequences, counts = np.arange(len(lengths)), lengths.astype(np.int64)
    rows = np.repeat(sequences, counts), np.repeat(action.astype(np.int64), counts)
    windows = Windows(history, target, *rows, unit, layout if like_input and unit == "m" else None)
    if name == "train":
        _check_enough(path, inputs, target)
    return windows


def _layout(path: Path | str, arrays: dict[str, Array], width: int) -> Layout:
    """How the inputs of a file are laid out.

    Raises:
        HighFiveError: no number of frames, or inputs that are not that many frames wide.
    """
    said = {name: arrays.get(name, np.array(usual)) for name, usual in LAYOUT.items()}
    for name, value in said.items():
        if value.size != 1 or value.dtype.kind not in "biuf" or value.item() % 1 or not 0 <= value.item() <= width:
            raise HighFiveError(f"{path}: {name} must be one whole number, from 0 on")
    layout = Layout(int(said["input_frames"].item()), bool(said["input_differences"].item()))
    parts = layout.frames * (1 + layout.differences)
    if not parts or width % parts:
        form = f"{layout.frames} frames {'with' if layout.differences else 'without'} differences"
        raise HighFiveError(
            f"{path}: inputs of {width} are not {form}: input_frames, input_differences (1, 0) say which"
        )
    return layout


def _unit(path: Path | str, arrays: dict[str, Array], name: str, usual: str) -> tuple[float, str]:
    """SI units that one of a file is, and which: m or rad, the usual one where the file does not say."""
    known = LENGTHS | TURNS
    given = np.asarray(arrays.get(name, usual))
    if given.size != 1 or given.dtype.kind != "U" or not _readable(given):
        raise HighFiveError(f"{path}: {name} is no word; expected one of {', '.join(known)}")
    unit = str(given.item())
    if unit not in known:
        raise HighFiveError(f"{path}: {name} {unit!r}; expected one of {', '.join(known)}")
    return known[unit], "m" if unit in LENGTHS else "rad"


def _readable(word: NDArray[np.str_]) -> bool:
    """Plain characters: of a damaged file they may be none that there are, which NumPy cannot make a text of."""
    if word.dtype.itemsize == 0:
        return False
    return bool(word.reshape(1).view(f"{word.dtype.byteorder}u4").max() < 128)


def _check_size(what: str, values: Array, unit: str) -> None:
    limit, long, other = (FURTHEST, "metres", "millimetres") if unit == "m" else (LARGEST_TURN, "radians", "degrees")
    if (largest := np.abs(values).max()) > limit:
        raise HighFiveError(f"{what} reaches {largest:.3g}; expected {long}: are these {other}?")


def _check_enough(path: Path | str, inputs: Array, target: Array) -> None:
    if len(target) < MINIMUM_POINTS:
        raise HighFiveError(f"{path}: {len(target)} training windows; at least {MINIMUM_POINTS} are needed")
    for key, values in (("input", inputs), ("target", target)):
        if np.all(np.std(values, axis=0) < STILL):
            raise HighFiveError(f"{path}: train_{key} is the same in all windows; there is nothing to learn")


def action_names(windows: Windows) -> dict[int, str]:
    """Names of the actions that occur; those of the data set where the file is laid out as its files are."""
    known: dict[int, tuple[str, ...]] = {}
    if windows.history.shape[1:] == PUBLISHED:
        known = {20: ROBOT_ACTIONS, 90: HUMAN_ACTIONS}
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
    return Windows(windows.history[kept], windows.target[kept], *rows, windows.unit, windows.person)


def _sequences(windows: Windows) -> dict[int, NDArray[np.int64]]:
    """Action → its sequences."""
    actions = np.unique(windows.action)
    return {int(action): np.unique(windows.sequence[windows.action == action]) for action in actions}


def window_preset(preset: Preset, windows: Windows) -> Preset:
    """A preset whose back constraint sees what a window holds."""
    earlier: int = windows.history.shape[1]
    return replace(preset, history=tuple(frame / RATE_HZ for frame in range(1, earlier)))


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
    moving, style, noise = Filter(model, RATE_HZ), np.ones(1), np.full(windows.history.shape[2], ARM_VARIANCE)
    answers: list[Array] = []
    for number in range(windows.sequence[-1] + 1):
        histories = windows.history[windows.sequence == number]
        belief = moving.initial(style)
        for arm in histories[0, :0:-1]:  # the first window holds frames from before its newest
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

    Robot, or whatever is not laid out like the input: squared error, rad² or m², averaged over joints, frames and
    windows. Person: root mean square distance, m, of the joints, over frames and windows.
    """
    error = answer - windows.target
    if windows.person is not None:
        moved = windows.person.split(error)[:, :, 0]
        joints = moved.reshape(*moved.shape[:2], -1, 3)
        squares = np.sum(joints**2, axis=-1).mean(axis=(1, 2))
    else:
        squares = np.mean(error**2, axis=1)
    scores = {name: float(squares[windows.action == k].mean()) for k, name in action_names(windows).items()}
    if windows.person is not None:
        return {name: float(np.sqrt(value)) for name, value in scores.items()}
    return scores
