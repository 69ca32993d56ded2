"""Scores and confusions as tables in the terminal."""

from __future__ import annotations

from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from highfive.hil.evaluation.curves import SHOWN
from highfive.hil.evaluation.score_table import method_label, methods_of, metric_named, rows_of
from highfive.hil.runtime.console import STDOUT

PLAIN_WIDTH = 160  # columns where standard output is no terminal: a file has room


def print_scores(result: dict[str, Any]) -> None:
    """The scores of :func:`highfive.hil.commands.evaluate.evaluate` as a table: median of the seeds, smallest and
    largest in brackets.
    """
    title = str(result.get("windows") or result.get("data"))
    if result.get("leave_out"):
        title += f", each {result['leave_out']} left out in turn"
    if result.get("locked"):
        title += f", judged on locked set {result['locked_set']}"
    console = STDOUT if STDOUT.is_terminal else Console(highlight=False, width=PLAIN_WIDTH)
    table = _score_table(result, title)
    if Console(width=1000).measure(table).maximum > console.width:
        table = _score_table(result, title, ranges=False)
        table.caption = "medians of the seeds; their ranges: --out, --json or a wider window"
    console.print(table)
    if result.get("model"):
        console.print(
            f"{result['model']} is scored as it stands, by what it learned before; the regressions learned from the "
            "training trials here. Trials that it was trained on would flatter it; without a model all learn alike"
        )
    if result.get("false_starts"):
        console.print(_false_starts(result["false_starts"]))
    if "learning_curve" in result:
        _print_curve(result, console)


def _false_starts(found: dict[str, Any]) -> Table:
    """Gestures that are no high five, and what they led to; its caption says what true high fives lose."""
    table = Table(box=SIMPLE_HEAD, title="gestures that are no high five (simulated)", title_justify="left")
    table.add_column("gesture", no_wrap=True)
    for heading in ("played", "reach began, %", "palm led, %", "palm raised, %", "decided after, s", "in 0.2 s, %"):
        table.add_column(heading, justify="right")
    for name, row in [*found["by_gesture"].items(), ("all", found)]:
        shares = [f"{100.0 * row[key]:.0f}" for key in ("started", "led", "raised")]
        table.add_row(
            name, str(row["gestures"]), *shares, f"{row['decided_s_median']:.2f}", f"{100.0 * row['decided_soon']:.0f}"
        )
    table.caption = (
        f"{found['high_fives']} true high fives: {100.0 * found['not_started']:.0f} % not begun, "
        f"{100.0 * found['lost']:.0f} % only because of this; begun {found['delay_ms_median']:.0f} ms later (median), "
        f"{100.0 * found['late']:.0f} % by more than 50 ms"
    )
    table.caption_justify = "left"
    return table


def _print_curve(result: dict[str, Any], console: Console) -> None:
    """Each method's median errors over the trials a style, a table a metric, and what more would bring."""
    curve = result["learning_curve"]
    own = curve["methods"]["hgpdm"]
    for name in [name for name in SHOWN if name in own] or list(own):
        metric = metric_named(name, result.get("unit", ""))
        table = Table(box=SIMPLE_HEAD, title=f"{metric.heading}, over trials a style", title_justify="left")
        table.show_edge = table.pad_edge = False
        table.add_column(f"median of {curve['draws']} draws (range)", no_wrap=True)
        for count in curve["trials_per_style"]:
            table.add_column(str(count), justify="right", no_wrap=True)
        for method, values in curve["methods"].items():
            if name not in values:
                continue
            ends = zip(*(values[name][end] for end in ("median", "smallest", "largest")), strict=True)
            cells = [metric.show(m) + ("" if low == high else f" ({metric.show(low)}–{metric.show(high)})")
                     for m, low, high in ends]  # fmt: skip
            table.add_row(method_label(method), *cells)
        console.print(table)
    for line in curve["advice"]:
        console.print(line, soft_wrap=True)


def _score_table(result: dict[str, Any], title: str, ranges: bool = True) -> Table:
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", caption_justify="left", padding=(0, 1, 0, 0))
    table.show_edge = table.pad_edge = False
    several = result["seeds"] > 1
    table.add_column(f"median of seeds{' (range)' if ranges else ''}" if several else "one seed", no_wrap=True)
    for method in methods_of(result):
        table.add_column(method_label(method), justify="right", no_wrap=True)
    rows = rows_of(result, ranges)
    for number, row in enumerate(rows):
        if len(rows) > 1 and row.group != "error" and row.group != rows[number - 1].group:
            table.add_row(f"[dim]{row.group}[/]")
        table.add_row(row.label, *(f"[bold]{text}[/]" if i in row.best else text for i, text in enumerate(row.cells)))
    return table


def print_observations(result: dict[str, Any]) -> None:
    """What :func:`highfive.hil.commands.classify_style.classified` found, as tables: accuracies, confusions, speeds of
    the morph.
    """
    stages = ("captured", "generated", "corrected")
    rows = {f"by {cue}": values for cue, values in result["by_cue"].items()}
    rows |= {f"person: {emotion}": values for emotion, values in result["by_person"].items()}
    recognised = Table("emotion recognised", *stages, box=SIMPLE_HEAD)
    for name, values in rows.items():
        recognised.add_row(name, *(f"{100.0 * values[k]:.1f} %" if k in values else "" for k in stages))
    STDOUT.print(recognised)
    for stage in stages:
        shown = result["confusion"][stage]
        seen = list(next(iter(shown.values())))
        table = Table(f"{stage}, shown as", *(f"seen as {name}" for name in seen), box=SIMPLE_HEAD)
        for name, counts in shown.items():
            table.add_row(name, *(str(counts[other]) for other in seen))
        STDOUT.print(table)
    morph = result["morph"]
    table = Table(
        f"peak palm speed, share of {morph['to']}", *(f"{stage}, m/s" for stage in stages[1:]), box=SIMPLE_HEAD
    )
    for step, weight in enumerate(morph["weights"]):
        name = {0.0: f"{weight}, {morph['from']}", 1.0: f"{weight}, {morph['to']}"}.get(weight, str(weight))
        table.add_row(name, *(f"{morph[stage]['peak_speed'][step]:.2f}" for stage in stages[1:]))
    for key in ("people_faster_at_each_step", "people_faster_in_the_end"):
        counts = (f"{morph[stage][key]} of {morph['people']}" for stage in stages[1:])
        table.add_row(key.replace("_", " "), *counts)
    STDOUT.print(table)
