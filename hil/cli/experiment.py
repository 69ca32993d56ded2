"""``highfive experiment``: studies with people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli import rig as cli_rig
from highfive.hil.cli.options import (
    MOST_SEED,
    ArmCommand,
    Armed,
    Avatar,
    AvatarSet,
    Camera,
    Cells,
    FieldOfView,
    Headset,
    Height,
    Https,
    Human,
    HumanSet,
    Interrupted,
    Json,
    Latencies,
    Latency,
    NoOpen,
    Overwrite,
    Port,
    Publish,
    PublishNetwork,
    RecordLsl,
    Seed,
    WhichArm,
)
from highfive.hil.runtime.console import print_result, progress_bars
from highfive.model.errors import HighFiveError

app = typer.Typer(help="Studies with people.", no_args_is_help=True)


@app.callback()
def experiment() -> None:
    """Studies with people: plans, and what was found in them."""


@app.command()
def analyse(
    study: Annotated[Path | None, typer.Argument(metavar="DIR", help="Folder of a study.")] = None,
    counts: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Right answers: participant,condition,correct,n.")
    ] = None,
    trials: Annotated[
        Path | None,
        typer.Option(metavar="FILE.csv", help="Or every answer: participant,condition,emotion,answer[,weight]."),
    ] = None,
    emotions: Annotated[
        int | None, typer.Option(min=2, max=99, help="Answers to choose from (default: those given, or three).")
    ] = None,
    level: Annotated[float, typer.Option(min=0.5, max=0.999, help="Of all intervals.")] = 0.95,
    questionnaire: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE.toml", help="Items, subscales and answers to score; may be given again."),
    ] = None,
    exclude: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="The lab's own rules for what does not count.")
    ] = None,
    xdf: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE.xdf", help="Recorded beside the runs: events on its time line; may be given again."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for a page, figures for print and a tidy table.")] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Tell whether interaction helps to see emotions: the source study's table, and calibrated estimates beside it."""
    from highfive.hil.commands.experiment_analyse import AnalyseOptions, analyse, print_analysis  # noqa: PLC0415

    options = AnalyseOptions(
        counts,
        trials,
        emotions,
        out,
        overwrite,
        study,
        level,
        tuple(questionnaire or ()),
        exclude,
        tuple(xdf or ()),
    )
    with progress_bars() as bar:
        result = analyse(options, bar)
    print_result(result, json, print_analysis)


@app.command()
def plan(
    file: Annotated[Path | None, typer.Argument(metavar="FILE.toml", help="The experiment.")] = None,
    template: Annotated[
        str | None, typer.Option(metavar="NAME", help="Write this one to --out instead: tipping, high_five or morph.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="With --template (default: NAME.toml).")] = None,
    study: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the study, also one to be added to (default: out/study-1, …)."),
    ] = None,
    participants: Annotated[int | None, typer.Option(min=1, max=9999, help="Another number than in the file.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, max=MOST_SEED, help="Another one than in the file.")] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Draw the plans anew of those who did not take part yet.")
    ] = False,
    json: Json = False,
) -> None:
    """Draw everybody's trials, balanced: a table, a picture, and a plan a participant that stays as it is."""
    from highfive.hil.commands import experiment_plan as command  # noqa: PLC0415
    from highfive.hil.runtime.folders import next_folder  # noqa: PLC0415

    if (file is None) == (template is None):
        raise HighFiveError("give FILE.toml, or --template NAME for one to begin with")
    if template is not None:
        result = command.template(template, out or Path(f"{template}.toml"), overwrite)
        print_result(result, json, command.print_template)
        return
    if file is None or out is not None:
        raise HighFiveError("--out goes with --template; the plans go to --study DIR")
    options = command.PlanOptions(file, study or next_folder("study"), participants, seed, overwrite)
    with progress_bars() as bar:
        result = command.plan(options, bar)
    print_result(result, json, command.print_plan)


@app.command()
def power(
    file: Annotated[
        Path | None, typer.Argument(metavar="FILE.toml", help="An experiment, for its trials (default: --trials).")
    ] = None,
    trials: Annotated[
        int | None, typer.Option(min=1, max=100_000, help="A condition and person (default: the source study's 36).")
    ] = None,
    difference: Annotated[
        list[float] | None,
        typer.Option(
            min=-1.0,
            max=1.0,
            help="Of the rate of right answers, such as .05; may be given again (default: .05, .08, .12).",
        ),
    ] = None,
    shift: Annotated[
        list[float] | None,
        typer.Option(min=-5.0, max=5.0, help="Of the PSE, for morphs; may be given again (default: .04, .06, .10)."),
    ] = None,
    people: Annotated[
        list[int] | None,
        typer.Option(help="So many take part; may be given again (default: 5 to 48)."),
    ] = None,
    wanted: Annotated[float, typer.Option(min=0.01, max=0.999, help="How often the effect is to be found.")] = 0.8,
    rate: Annotated[float, typer.Option(min=0.01, max=0.99, help="Right answers in replay.")] = 0.75,
    people_spread: Annotated[float, typer.Option(min=0.0, max=5.0, help="Of their rates, sd in logit.")] = 0.58,
    effect_spread: Annotated[float, typer.Option(min=0.0, max=5.0, help="Of the effect over people, logit.")] = 0.25,
    shift_spread: Annotated[float, typer.Option(min=0.0, max=5.0, help="Of the PSE's shift over people.")] = 0.05,
    pse_error: Annotated[
        float | None,
        typer.Option(min=0.0, max=5.0, help="Standard error of a PSE (default: of the experiment's trials, else .05)."),
    ] = None,
    studies: Annotated[int, typer.Option(min=100, max=1_000_000, help="Simulated ones.")] = 4000,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Tell how many people a study needs, by simulated studies."""
    from highfive.hil.commands.experiment_power import PowerOptions, PowerSettings, power, print_power  # noqa: PLC0415

    settings = PowerSettings(
        rate=rate, people_spread=people_spread, effect_spread=effect_spread, shift_spread=shift_spread, studies=studies
    )
    effects = tuple(difference or ()), tuple(shift or ())
    options = PowerOptions(file, trials, *effects, tuple(people or ()), wanted, settings, pse_error, seed)
    with progress_bars() as bar:
        result = power(options, bar)
    print_result(result, json, print_power)


@app.command(cls=ArmCommand)
def run(
    study: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the study.")],
    participant: Annotated[str, typer.Option(metavar="CODE", help="Who takes part, such as P07.")],
    session: Annotated[int, typer.Option(min=1, max=999, help="Which of her sessions.")] = 1,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a session that has begun (default: it is asked).")
    ] = False,
    consent: Annotated[
        str | None, typer.Option(metavar="VERSION", help="Consent form that she signed (default: it is asked).")
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(help="An address such as vicon://host, headset, or webcam (default: a simulated person moves)."),
    ] = None,
    marker_set: Annotated[str | None, typer.Option(help="The person's marker set: a name or a TOML file.")] = None,
    person: Annotated[
        str | None, typer.Option("--person", "--human", help="Prefix of the person's markers, such as A or human.")
    ] = None,
    model: Annotated[str | None, typer.Option(metavar="FILE", help="Model file (default: the shipped one).")] = None,
    clips: Annotated[
        str | None,
        typer.Option(metavar="DIR", help="Of an experiment that shows clips: their C3D files, or simulated."),
    ] = None,
    tap_switch: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="LSL stream of a switch that says the tap, in place of her hand."),
    ] = None,
    place: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Keeps where a live person stands, for the next session.")
    ] = None,
    latency: Latency = 0.0,
    latencies: Latencies = None,
    rig: Annotated[
        str | None,
        typer.Option(
            help="A servo arm takes part: emulated, or the serial port of a real one, which MOVES (with --arm)."
        ),
    ] = None,
    arm: Armed = False,
    which_arm: WhichArm = None,
    rig_file: cli_rig.ThatArm = None,
    limits: cli_rig.LimitsFile = None,
    lower: cli_rig.Lower = None,
    estop: cli_rig.Estop = None,
    calibration: cli_rig.Calibration = None,
    nobody_near: cli_rig.NobodyNear = False,
    slow: cli_rig.Slow = False,
    faults: cli_rig.Faults = None,
    headset: Headset = None,
    camera: Camera = None,
    height: Height = None,
    fov: FieldOfView = None,
    seed: Seed = 0,
    language: Annotated[
        str | None, typer.Option(metavar="LANG", help="Of the instructions, such as de (default: en, or the only one).")
    ] = None,
    typed: Annotated[
        bool, typer.Option("--typed", help="Answers and commands are typed at this terminal, too; ? shows which.")
    ] = False,
    simulate_participant: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="A simulated participant answers; rows are marked.")
    ] = None,
    no_avatar: Annotated[
        bool, typer.Option("--no-avatar", help="With --simulate-participant: the log alone, as fast as it goes.")
    ] = False,
    port: Port = None,
    no_open: NoOpen = False,
    https: Https = False,
    publish: Publish = None,
    publish_network: PublishNetwork = False,
    record_lsl: RecordLsl = None,
    json: Json = False,
) -> None:
    """Take one participant through the plan, every answer on the disk before the next trial begins."""
    from highfive.hil.commands import experiment_run as command  # noqa: PLC0415
    from highfive.hil.commands.arm_options import arm_options  # noqa: PLC0415
    from highfive.hil.commands.experiment_options import RunOptions  # noqa: PLC0415

    chain = None
    servo_arm = arm_options(rig, arm, rig_file, limits, lower, estop, calibration, nobody_near, slow, faults, which_arm)
    for said, given in (("--publish and --record-lsl", publish or publish_network or record_lsl), ("--rig", servo_arm)):
        if no_avatar and given:
            raise HighFiveError(f"--no-avatar plays nothing: leave out {said}")
    if not no_avatar:
        from highfive.hil.commands.session_outputs import published  # noqa: PLC0415
        from highfive.hil.commands.simulate import which_model  # noqa: PLC0415
        from highfive.hil.commands.simulate_options import PageOptions, SimulateOptions, WebcamOptions  # noqa: PLC0415

        chain = SimulateOptions(
            source=source, human=person, marker_set=marker_set, model=which_model(model),
            seed=seed, place=place, latency_ms=latency, latencies=latencies, arm=servo_arm, headset=headset,
            webcam=WebcamOptions(height, fov, camera), view=PageOptions(port, not no_open, https),
            publish=published(publish), publish_network=publish_network, record_lsl=tuple(record_lsl or ()),
        )  # fmt: skip
    options = RunOptions(
        study,
        participant,
        session,
        resume,
        consent,
        language,
        simulate_participant,
        no_avatar,
        typed,
        clips,
        tap_switch,
        chain,
    )
    try:
        with progress_bars() as bar:
            result = command.run(options, bar)
    except KeyboardInterrupt:
        raise Interrupted("; every trial that was over is in the log: go on with --resume") from None
    print_result(result, json, command.print_run)


@app.command()
def collect(
    source: Annotated[str, typer.Option(help="Address of the system that sees both people, such as vicon://host.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Data folder, also one to be gone on with (default: out/collection-1, …)."),
    ] = None,
    human: Human = "human",
    avatar: Avatar = "avatar",
    human_set: HumanSet = None,
    avatar_set: AvatarSet = None,
    emotion: Annotated[
        list[str] | None, typer.Option(help="Any word; may be given again (default: happy, angry, sad, neutral).")
    ] = None,
    cell: Cells = None,
    repetitions: Annotated[int, typer.Option(min=1, max=1000, help="Takes of each emotion and cell.")] = 3,
    test_repetitions: Annotated[
        int, typer.Option(min=0, max=1000, help="So many of them, the last, are held out.")
    ] = 1,
    seconds: Annotated[float, typer.Option(min=1.0, max=120.0, help="Of a take, from the cue on.")] = 10.0,
    between: Annotated[float, typer.Option(min=0.0, max=120.0, help="Before each cue, s.")] = 2.0,
    any_cell: Annotated[bool, typer.Option("--any-cell", help="Hands may meet anywhere.")] = False,
    simulated: Annotated[bool, typer.Option("--simulated", help="No people act: the folder says so.")] = False,
    seed: Seed = 0,
    typed: Annotated[bool, typer.Option("--typed", help="Commands are typed at this terminal, too.")] = False,
    port: Port = None,
    no_open: NoOpen = False,
    https: Https = False,
    json: Json = False,
) -> None:
    """Lead two people through high fives in every emotion and place, check each take, and fill a data folder."""
    from highfive.hil.commands import experiment_collect as command  # noqa: PLC0415
    from highfive.hil.commands.simulate_options import PageOptions  # noqa: PLC0415
    from highfive.hil.runtime.folders import next_folder  # noqa: PLC0415

    asked = command.asked(emotion, cell, repetitions, test_repetitions, seed, human, avatar, simulated)
    options = command.CollectOptions(
        out or next_folder("collection"), source, asked, human_set, avatar_set, seconds, between, any_cell, typed,
        PageOptions(port, not no_open, https),
    )  # fmt: skip
    try:
        with progress_bars() as bar:
            result = command.collect(options, bar)
    except KeyboardInterrupt:
        raise Interrupted("; every take that was good is in the folder: the same command goes on") from None
    print_result(result, json, command.print_collected)
    if result["left"]:
        raise typer.Exit(1)


@app.command()
def forget(
    code: Annotated[str, typer.Argument(metavar="CODE", help="The participant's code, such as P07.")],
    study: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the study.")],
    json: Json = False,
) -> None:
    """Delete a participant's plan, rows and recordings, and say what remains."""
    from highfive.hil.commands.experiment_forget import forget, print_forgotten  # noqa: PLC0415

    print_result(forget(code, study), json, print_forgotten)
