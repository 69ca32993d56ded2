"""The commands around the model: what it learns from, training, scores, and whether people would tell its moods."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli.options import (
    Avatar,
    AvatarSet,
    Human,
    HumanSet,
    Interrupted,
    Json,
    Overwrite,
    OverwriteFile,
    Seed,
)
from highfive.hil.runtime.console import libraries_aside, print_json, print_result, progress_bars
from highfive.model.errors import HighFiveError

app = typer.Typer()


@app.command()
def capture(
    out: Annotated[Path, typer.Option(help="Folder for the C3D files and trials.csv.")] = Path("captured"),
    emotion: Annotated[list[str] | None, typer.Option(help="Only this emotion; may be given again.")] = None,
    repetitions: Annotated[int, typer.Option(min=1, max=1000, help="Trials for each emotion and cell.")] = 4,
    test_repetitions: Annotated[
        int | None,
        typer.Option(min=0, max=1000, help="So many of them are marked as held out (default: the last of several)."),
    ] = None,
    overwrite: Overwrite = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Make the simulated two-actor data set: C3D files at 120 Hz and trials.csv."""
    from highfive.hil.commands.capture import capture_pairs, print_captured  # noqa: PLC0415

    with progress_bars() as bar:
        result = capture_pairs(out, emotion, repetitions, test_repetitions, seed, overwrite, bar)
    print_result(result, json, print_captured)


@app.command()
def train(
    data: Annotated[Path, typer.Argument(help="Folder with C3D files of two people and trials.csv.")],
    out: Annotated[Path, typer.Option(help="The model's file.")] = Path("model.safetensors"),
    preset: Annotated[str, typer.Option(help="default, or paper for the sizes of Taubert et al. 2013.")] = "default",
    inducing: Annotated[
        int,
        typer.Option(
            min=2, max=5000, help="Inducing inputs of each layer; contact layers take more, up to 400, of many frames."
        ),
    ] = 200,
    human: Human = "human",
    avatar: Avatar = "avatar",
    human_set: HumanSet = None,
    avatar_set: AvatarSet = None,
    seed: Seed = 0,
    restarts: Annotated[
        int, typer.Option(min=1, max=1000, help="Train from so many seeds and keep the best objective.")
    ] = 1,
    iterations: Annotated[
        int | None,
        typer.Option(
            min=1, max=1_000_000, help="Steps of training the hierarchy (default: the preset's); others have their own."
        ),
    ] = None,
    whole_arm: Annotated[
        bool | None,
        typer.Option(
            "--whole-arm/--hand-alone",
            help="Elbow, shoulder and head, too, tell where and when palms meet (default: if most trials have them).",
        ),
    ] = None,
    no_distractors: Annotated[
        bool,
        typer.Option("--no-distractors", help="Simulate no waves, stretches and the like as what is no high five."),
    ] = False,
    start: Annotated[
        str | None,
        typer.Option("--from", metavar="MODEL", help="Adapt a model's file, or the shipped one (default), instead."),
    ] = None,
    hosts: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT,HOST,…", help="Train on several hosts; auto: a scheduler (SLURM) says which."),
    ] = None,
    process_id: Annotated[int | None, typer.Option(min=0, max=9999, help="Which of --hosts this is, from 0.")] = None,
    memory: Annotated[
        float | None, typer.Option(min=0.1, max=1e6, help="GB that training may take (default: what is free).")
    ] = None,
    overwrite: OverwriteFile = False,
    json: Json = False,
) -> None:
    """Fit the model to recordings of two people; goes on where it was interrupted."""
    from highfive.hil.commands.train import TrainOptions, after_interruption, summary, train  # noqa: PLC0415

    options = TrainOptions(
        data,
        out,
        preset,
        inducing,
        human,
        avatar,
        human_set,
        avatar_set,
        seed,
        overwrite,
        restarts,
        iterations,
        whole_arm,
        not no_distractors,
        start,
        tuple(hosts.split(",")) if hosts else (),
        process_id,
        memory,
    )
    with progress_bars() as bar, libraries_aside() if hosts else nullcontext():
        try:
            result = train(options, bar)
        except KeyboardInterrupt:
            raise Interrupted(after_interruption(options)) from None
    if json:
        print_json(result)
    else:
        print("\n".join(summary(result)))


@app.command()
def evaluate(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[MODEL] [DATA]", help="Data folder; before it a model's file, or default."),
    ] = None,
    windows: Annotated[Path | None, typer.Option(help="A windows file (.npz) instead of a data folder.")] = None,
    preset: Annotated[str, typer.Option(help="default, or paper: what is trained if no model is given.")] = "default",
    inducing: Annotated[
        int,
        typer.Option(
            min=2, max=5000, help="Inducing inputs of each layer and of the sparse GP; of a given model its own."
        ),
    ] = 200,
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="Trainings; the scores are medians.")] = 3,
    leave_out: Annotated[
        str | None, typer.Option(help="repetition or cell: each is held out in turn, whatever the table's split.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for a report with figures; trainings are kept there and used again.")
    ] = None,
    no_false_starts: Annotated[
        bool, typer.Option("--no-false-starts", help="With a model: play no gestures that are no high five (minutes).")
    ] = False,
    locked: Annotated[
        bool, typer.Option("--locked", help="Judge on the locked set: simulated people kept for that.")
    ] = False,
    learning_curve: Annotated[
        str | None,
        typer.Option(metavar="N,N,…", help="Learn from so many trials a style, as 3,5,10,20,40: errors over trials."),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option("--from", metavar="MODEL", help="Score a model adapted to the trials, too; default: the shipped."),
    ] = None,
    jobs: Annotated[
        int, typer.Option(min=1, max=1024, help="Trainings at the same time, each in a process of its own.")
    ] = 1,
    models_folder: Annotated[
        Path | None,
        typer.Option(
            "--models", help="Folder of trainings (default: OUT/models); hosts with the same one share them out."
        ),
    ] = None,
    also: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE.py:FUNCTION", help="A model of your own beside them (docs/extending.md)."),
    ] = None,
    human: Human = "human",
    avatar: Avatar = "avatar",
    human_set: HumanSet = None,
    avatar_set: AvatarSet = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Score the model beside mean pose, ridge regression, nearest neighbours and a plain sparse GP."""
    from highfive.hil.commands.evaluate import (  # noqa: PLC0415
        EvaluateOptions,
        after_interruption,
        evaluate,
        print_scores,
    )
    from highfive.hil.commands.train import model_file  # noqa: PLC0415

    # What is not there is what its ending says, and whoever reads it says that it is missing.
    files, models, data = [], [], []
    for given in paths or []:
        path = model_file(given)
        folder = path.is_dir() or not (path.is_file() or path.suffix in (".npz", ".safetensors"))
        (data if folder else files if path.suffix == ".npz" else models).append(path)
    if len(data) > 1 or len(models) > 1 or len(files) + (windows is not None) > 1:
        raise HighFiveError("give one data folder or windows file, and at most one model")
    options = EvaluateOptions(
        data=data[0] if data else None,
        windows=windows or (files[0] if files else None),
        model=models[0] if models else None,
        preset=preset,
        inducing=inducing,
        seeds=seeds,
        human=human,
        avatar=avatar,
        human_set=human_set,
        avatar_set=avatar_set,
        leave_out=leave_out,
        out=out,
        overwrite=overwrite,
        also=tuple(also or ()),
        locked=locked,
        gestures=not no_false_starts,
        learning_curve=_counts(learning_curve),
        start=start,
        jobs=jobs,
        models=models_folder,
    )
    with progress_bars() as bar:
        try:
            result = evaluate(options, bar)
        except KeyboardInterrupt:
            raise Interrupted(after_interruption(options)) from None
    if json:
        print_json(result)
    else:
        print_scores(result)
        if out is not None:
            print(f"Open {result['report']}")


def _counts(text: str | None) -> tuple[int, ...]:
    """Numbers of trials, from what was typed."""
    if text is None:
        return ()
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise HighFiveError(f"--learning-curve {text}: expected numbers of trials, as 3,5,10,20,40") from None


@app.command()
@app.command("observe", hidden=True)  # the name until version 0.2
def classify_style(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="[MODEL] DATA", help="Data folder to learn from; before it a model's file, or default."),
    ],
    people: Annotated[
        int, typer.Option(min=1, max=10_000, help="Simulated people, each answered in every style.")
    ] = 36,
    morph: Annotated[str, typer.Option(help="Two styles to go between, in tenths.")] = "neutral,angry",
    human: Human = "human",
    avatar: Avatar = "avatar",
    human_set: HumanSet = None,
    avatar_set: AvatarSet = None,
    seed: Seed = 1,
    json: Json = False,
) -> None:
    """Classify the style of generated and of corrected motion, with a classifier that learned from recordings."""
    from highfive.hil.commands.classify_style import ClassifyStyleOptions, classified, print_observations  # noqa: PLC0415
    from highfive.hil.commands.train import model_file  # noqa: PLC0415

    data = [path for path in paths if path.is_dir()]
    models = [model_file(path) for path in paths if not path.is_dir()]
    if len(data) != 1 or len(models) > 1:
        raise HighFiveError("give one data folder, and at most one model before it")
    between = [name.strip() for name in morph.split(",")]
    if len(between) != 2:
        raise HighFiveError(f"--morph {morph}: expected two styles, as neutral,angry")
    options = ClassifyStyleOptions(
        data=data[0],
        model=models[0] if models else None,
        people=people,
        morph=(between[0], between[1]),
        seed=seed,
        human=human,
        avatar=avatar,
        human_set=human_set,
        avatar_set=avatar_set,
    )
    with progress_bars() as bar:
        result = classified(options, bar)
    print_result(result, json, print_observations)
