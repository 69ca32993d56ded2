import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from highfive.model.errors import HighFiveError
from highfive.model.evaluation import baselines
from highfive.model.evaluation import nuisi_windows as windows
from highfive.model.hgpdm.hierarchy import problem
from highfive.model.hgpdm.presets import DEFAULT
from highfive.model.hgpdm.training import train_on

SMALL = replace(DEFAULT, avatar_dims=3, human_dims=2, interaction_dims=3, adam_steps=50, iterations=50)


def sequence(seconds: float, speed: float, channels: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (n, 90) and targets (n, channels) of an arm that waves and a partner who follows it."""
    times = np.arange(0.0, seconds, 1.0 / windows.RATE_HZ)
    phase = speed * times[:, None] + np.linspace(0.0, 1.0, 9)
    arm = np.sin(phase) * np.linspace(0.1, 0.4, 9) + 1e-3 * rng.normal(size=(len(times), 9))
    difference = np.diff(arm, axis=0, prepend=arm[:1])
    frames = np.concatenate([arm, difference], axis=1)
    starts = np.arange(1, len(times) - 10)
    inputs = np.stack([frames[s : s + 5].ravel() for s in starts])
    follow = np.stack([np.tile(np.tanh(arm[s + 5 : s + 10, :4] * 3.0).ravel(), channels // 20 + 1) for s in starts])
    return inputs, follow[:, :channels]


@pytest.fixture
def arrays() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    made = {}
    for part, speeds in (("train", (3.0, 3.5, 5.0, 5.5)), ("test", (3.2, 5.2))):
        pieces = [sequence(3.0, speed, 20, rng) for speed in speeds]
        made[f"{part}_input"] = np.concatenate([x for x, _ in pieces])
        made[f"{part}_target"] = np.concatenate([y for _, y in pieces])
        made[f"{part}_sequence_lengths"] = np.array([len(x) for x, _ in pieces])
        made[f"{part}_action"] = np.array([int(speed > 4.0) for speed in speeds])
    return made


@pytest.fixture
def path(tmp_path: Path, arrays: dict[str, np.ndarray]) -> Path:
    np.savez(tmp_path / "windows.npz", **arrays)
    return tmp_path / "windows.npz"


def test_history_holds_what_the_window_holds(path: Path, arrays: dict[str, np.ndarray]):
    learn, _ = windows.read_windows(path)
    frames = arrays["train_input"].reshape(-1, 5, 2, 9)
    np.testing.assert_allclose(learn.history[:, 0], frames[:, 4, 0])
    np.testing.assert_allclose(learn.history[:, :5] - learn.history[:, 1:], frames[:, ::-1, 1], atol=1e-12)


def test_units_that_a_file_says_are_turned_into_metres_and_radians(tmp_path: Path, arrays: dict[str, np.ndarray]):
    def read(**changes: object) -> windows.Windows:
        np.savez(tmp_path / "other.npz", **(arrays | changes))
        return windows.read_windows(tmp_path / "other.npz")[0]

    seven, plain = (
        {f"{part}_target": arrays[f"{part}_target"][:, [*range(20), *range(15)]] for part in ("train", "test")},
        read(),
    )
    inputs = {f"{part}_input": 1e3 * arrays[f"{part}_input"] for part in ("train", "test")}
    degrees = {name: np.degrees(target) for name, target in seven.items()}
    found = read(**inputs, **degrees, input_unit="mm", target_unit="deg")
    np.testing.assert_allclose(found.history, plain.history, atol=1e-12)
    np.testing.assert_allclose(found.target, seven["train_target"], atol=1e-12)
    assert found.unit == "rad" and found.person is None
    tool = read(**{name: 100.0 * target for name, target in seven.items()}, target_unit="cm")
    np.testing.assert_allclose(tool.target, seven["train_target"], atol=1e-12)
    assert tool.unit == windows.few_sequences(tool, 1, 0).unit == "m"
    with pytest.raises(HighFiveError, match="input_unit 'inch'; expected one of m, cm, mm, rad, deg"):
        read(input_unit="inch")
    with pytest.raises(HighFiveError, match="are these millimetres"):
        read(**inputs)


def test_scores_are_those_of_the_definition(path: Path):
    _, test = windows.read_windows(path)
    rng = np.random.default_rng(1)
    answer = test.target + rng.normal(size=test.target.shape)
    by_hand = [
        np.mean([((answer[n] - test.target[n]) ** 2).sum() / 20 for n in np.flatnonzero(test.action == action)])
        for action in (0, 1)
    ]
    scores = windows.window_scores(answer, test)
    assert list(scores) == ["wave", "handshake"]
    np.testing.assert_allclose(list(scores.values()), by_hand)


def test_a_person_is_scored_by_the_distance_of_the_joints(path: Path):
    _, test = windows.read_windows(path)
    target = np.zeros((len(test.target), 90))
    shifted = target.reshape(-1, 5, 2, 3, 3).copy()
    shifted[:, :, 0, :, 1] += 0.03  # positions
    shifted[:, :, 1] += 5.0  # differences, which do not count
    person = replace(test, target=target, person=windows.Layout())
    scores = windows.window_scores(shifted.reshape(-1, 90), person)
    np.testing.assert_allclose(list(scores.values()), 0.03)


@pytest.mark.sweep
@pytest.mark.slow
def test_the_answer_beats_the_mean_and_knows_nothing_of_later_windows(path: Path):
    learn, test = windows.read_windows(path)
    preset = windows.window_preset(SMALL, learn)
    task = problem(windows.window_set(learn), preset)
    model = train_on(windows.window_set(learn), preset, inducing=30)
    answer = windows.respond(model, test)
    mean = windows.predicted(baselines.constant_mean(task), task.feature_map, test)
    ours, plain = windows.window_scores(answer, test), windows.window_scores(mean, test)
    assert all(ours[name] < 0.3 * plain[name] for name in ours)
    first = np.flatnonzero(test.sequence == 0)[:10]
    cut = windows.Windows(test.history[first], test.target[first], test.sequence[first], test.action[first])
    np.testing.assert_allclose(windows.respond(model, cut), answer[first])


def arms_of_seven_joints(rng: np.random.Generator, frames: int, differences: int) -> dict[str, object]:
    """A robot's arm that waves, deg, and another that follows it."""
    said: dict[str, object] = {"input_frames": frames, "input_differences": differences, "input_unit": "deg"}
    for part, speeds in (("train", (3.0, 3.5, 5.0, 5.5)), ("test", (3.2, 5.2))):
        inputs, targets = [], []
        for speed in speeds:
            times = np.arange(0.0, 3.0, 1.0 / windows.RATE_HZ)
            arm = 40.0 * np.sin(speed * times[:, None] + np.linspace(0.0, 1.0, 7)) + rng.normal(0.0, 0.1, (90, 7))
            rows = np.stack([arm[1:], np.diff(arm, axis=0)], axis=1)[:, : 1 + differences].reshape(89, -1)
            starts = range(89 - frames - 4)
            inputs.append(np.stack([rows[s : s + frames].ravel() for s in starts]))
            targets.append(np.stack([np.radians(arm[s + frames + 1 : s + frames + 6]).ravel() for s in starts]))
        said |= {f"{part}_input": np.concatenate(inputs), f"{part}_target": np.concatenate(targets)}
        lengths = np.array([len(x) for x in inputs])
        said |= {f"{part}_sequence_lengths": lengths, f"{part}_action": np.zeros(len(lengths))}
    return said


@pytest.mark.parametrize(("frames", "differences"), [(5, 0), (1, 1), (1, 0), (8, 1)])
def test_an_input_of_any_width_is_the_history_that_it_tells(tmp_path: Path, frames: int, differences: int):
    said = arms_of_seven_joints(np.random.default_rng(2), frames, differences)
    np.savez(tmp_path / "arms.npz", **said)
    learn, test = windows.read_windows(tmp_path / "arms.npz")
    told = frames + differences
    assert learn.history.shape[1:] == test.history.shape[1:] == (told, 7)
    rows = np.radians(np.asarray(said["train_input"])).reshape(-1, frames, 1 + differences, 7)
    np.testing.assert_allclose(learn.history[:, 0], rows[:, -1, 0])
    first = learn.sequence == 0  # windows of one sequence follow each other frame by frame
    for back in range(told):
        np.testing.assert_allclose(learn.history[first][back:, back], learn.history[first][: sum(first) - back, 0])
    assert learn.unit == "rad" and learn.person is None and windows.action_names(test) == {0: "action_0"}
    assert len(windows.window_preset(SMALL, learn).history) == told - 1


@pytest.mark.sweep
@pytest.mark.slow(20)
@pytest.mark.parametrize(("frames", "differences"), [(5, 0), (1, 0)])
def test_an_arm_that_follows_another_is_learned(tmp_path: Path, frames: int, differences: int):
    np.savez(tmp_path / "arms.npz", **arms_of_seven_joints(np.random.default_rng(3), frames, differences))
    learn, test = windows.read_windows(tmp_path / "arms.npz")
    preset = windows.window_preset(SMALL, learn)
    task = problem(windows.window_set(learn), preset)
    ours = windows.window_scores(windows.respond(train_on(windows.window_set(learn), preset, inducing=30), test), test)
    mean = windows.window_scores(windows.predicted(baselines.constant_mean(task), task.feature_map, test), test)
    assert ours["action_0"] < 0.3 * mean["action_0"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a.pop("test_target"), "lacks test_target"),
        (lambda a: a.update(train_input=a["train_input"][:, :80]), "inputs of 8 coordinates to learn, of 9 to test"),
        (lambda a: a.update(train_input=a["train_input"][:, :81]), "inputs of 81 are not 5 frames with differences"),
        (lambda a: a.update(input_frames=7, input_differences=0), "of 90 are not 7 frames without differences"),
        (lambda a: a.update(input_frames=0), "of 90 are not 0 frames"),
        (lambda a: a.update(input_frames=2.5), "input_frames must be one whole number"),
        (lambda a: a.update(input_frames=[5, 5]), "input_frames must be one whole number"),
        (lambda a: a.update(input_differences="yes"), "input_differences must be one whole number"),
        (lambda a: a.update(input_unit=np.array("m").view(np.uint32) * 0 + 0x7FFFFFFF), "input_unit is no word"),
        (lambda a: a.update(target_unit=np.array([0x7FFFFFFF], np.uint32).view("U1")), "target_unit is no word"),
        (lambda a: a.update(input_unit=np.array(["m", "m"])), "input_unit is no word"),
        (lambda a: a.update(input_differences=np.nan), "input_differences must be one whole number"),
        (lambda a: a.update(test_sequence_lengths=np.array([3, 4])), "do not add up"),
        (lambda a: a.update(train_target=np.full_like(a["train_target"], np.nan)), "NaN"),
        (lambda a: a.update(train_target=np.full_like(a["train_target"], 0.3)), "train_target is the same"),
        (lambda a: a.update(train_input=np.zeros_like(a["train_input"])), "train_input is the same"),
        (lambda a: a.update(test_input=1e3 * a["test_input"]), "test_input reaches .* millimetres"),
        (lambda a: a.update(test_target=1e3 * a["test_target"]), "test_target reaches .* degrees"),
        (
            lambda a: a.update(test_target=np.zeros((len(a["test_target"]), 90))),
            "of 20 numbers to learn, of 90 to test",
        ),
        (lambda a: a.update(train_input=np.array(1.0)), "expected \\(n, w\\)"),
        (lambda a: a.update(train_sequence_lengths=np.array(5)), "do not add up"),
        (lambda a: a.update(train_sequence_lengths=a["train_sequence_lengths"] * [1, 1, 1, 0]), "hold 0; a sequence"),
        (lambda a: a.update(train_action=a["train_action"] + 0.5), "whole numbers"),
        (lambda a: a.update(train_action=a["train_action"] * np.nan), "train_action holds NaN"),
        (lambda a: a.update(train_action=a["train_action"].astype(str)), "train_action holds no numbers"),
        (
            lambda a: a.update(
                train_input=a["train_input"][:9],
                train_target=a["train_target"][:9],
                train_sequence_lengths=np.array([9]),
                train_action=np.array([0]),
            ),
            "9 training windows; at least 50",
        ),
        (lambda a: a.update(test_input=np.empty((0, 90)), test_target=np.empty((0, 20))), "expected|add up"),
    ],
)
def test_broken_files_are_named(tmp_path: Path, arrays: dict[str, np.ndarray], change, message: str):
    change(arrays)
    np.savez(tmp_path / "broken.npz", **arrays)
    with pytest.raises(HighFiveError, match=message):
        windows.read_windows(tmp_path / "broken.npz")


def test_a_damaged_file_is_named_or_read(tmp_path: Path, arrays: dict[str, np.ndarray]):
    """Bytes set to zero anywhere: our error, or windows; nothing else."""
    np.savez_compressed(tmp_path / "whole.npz", **arrays)
    whole, rng = (tmp_path / "whole.npz").read_bytes(), np.random.default_rng(0)
    for _ in range(200):
        start = int(rng.integers(len(whole)))
        (tmp_path / "damaged.npz").write_bytes(whole[:start] + bytes(40) + whole[start + 40 :])
        with contextlib.suppress(HighFiveError):
            windows.read_windows(tmp_path / "damaged.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"hello"])
def test_what_is_no_windows_file_is_one_line(tmp_path: Path, content: bytes):
    (tmp_path / "no.npz").write_bytes(content)
    with pytest.raises(HighFiveError, match="no archive of arrays"):
        windows.read_windows(tmp_path / "no.npz")
    with pytest.raises(HighFiveError, match="not a windows file"):
        windows.read_windows(tmp_path / "missing.npz")
