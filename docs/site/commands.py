"""The command reference, made from the command line itself."""

from __future__ import annotations

from typing import Any

import typer
from mkdocs.structure.files import File, Files
from typer.main import get_command

from highfive.hil.cli.main import app


def on_files(files: Files, config: Any) -> Files:
    """A page for each command, and one that lists them."""
    listed: list[str] = []
    for path, command in commands(get_command(app), ()):
        name = "-".join(path) + ".md"
        files.append(File.generated(config, f"reference/commands/{name}", content=page(path, command)))
        listed.append(f"| [`highfive {' '.join(path)}`]({name}) | {first_sentence(command.help)} |")
    content = "\n".join(["# Commands", "", "`highfive COMMAND --help` says the same.", "", "| command | what it does |",
                         "|---|---|", *listed, ""])  # fmt: skip
    files.append(File.generated(config, "reference/commands/index.md", content=content))
    return files


def commands(group: Any, path: tuple[str, ...]) -> list[tuple[tuple[str, ...], Any]]:
    """All that can be typed: words after ``highfive`` and the command, depth first; hidden ones left out."""
    found: list[tuple[tuple[str, ...], Any]] = []
    for name, command in group.commands.items():
        if command.hidden:
            continue
        if hasattr(command, "commands"):
            found += commands(command, (*path, name))
        else:
            found.append(((*path, name), command))
    return found


def metavar(parameter: Any, context: typer.Context) -> str:
    """What stands for an argument's, or an option's, value."""
    if parameter.metavar or parameter.param_type_name == "argument":
        return parameter.metavar or parameter.name.upper()
    return str(parameter.display_type(context)).strip("<>")


def page(path: tuple[str, ...], command: Any) -> str:
    """A command's page: what it does, arguments, options."""
    context = typer.Context(command)
    taken = [metavar(one, context) for one in command.params if one.param_type_name == "argument"]
    usage = " ".join(["[OPTIONS]", *taken])
    lines = [f"# highfive {' '.join(path)}", "", plain(command.help), "", "```", f"highfive {' '.join(path)} {usage}",
             "```", ""]  # fmt: skip
    shown = [one for one in command.params if not getattr(one, "hidden", False)]
    for title, kind, heads in (
        ("Arguments", "argument", "argument | | what it is"),
        ("Options", "option", "option | value | what it does"),
    ):
        rows = [row(one, context) for one in shown if one.param_type_name == kind]
        if rows:
            lines += [f"## {title}", "", f"| {heads} |", "|---|---|---|", *rows, ""]
    return "\n".join(lines)


def row(parameter: Any, context: typer.Context) -> str:
    """A line of the table: how it is written, what it takes, what it does and its default."""
    option = parameter.param_type_name == "option"
    names = "<br>".join(f"`{one}`" for one in (*parameter.opts, *parameter.secondary_opts)) if option else (
        f"`{metavar(parameter, context)}`"
    )  # fmt: skip
    flag = getattr(parameter, "is_flag", False)
    takes = "" if flag or not option else f"`{metavar(parameter, context)}`"
    default = parameter.default
    says = plain(getattr(parameter, "help", "") or "")
    if option and not flag and default not in (None, (), [], "") and not callable(default):
        says += f" Default: `{getattr(default, 'value', default)}`."
    if getattr(parameter, "multiple", False):
        says += " May be given several times."
    return f"| {names} | {takes.replace('|', chr(92) + '|')} | {says.replace('|', chr(92) + '|')} |"


def plain(text: str | None) -> str:
    """Help as Markdown: what stands in brackets is no link."""
    return (text or "").replace("\b\n", "").replace("\f", "").replace("<", "&lt;").strip()


def first_sentence(text: str | None) -> str:
    """Of a help text."""
    return plain(text).split("\n\n")[0].replace("\n", " ").replace("|", "\\|")
