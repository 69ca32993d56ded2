"""Options that several commands share, and how a command says that it was interrupted."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperCommand

from highfive.model.errors import HighFiveError

Json = Annotated[bool, typer.Option("--json", help="One JSON object on standard output, nothing else.")]
MOST_SEED = 2**62
"""With what is added to it a seed is one of NumPy's 64-bit numbers, still."""
Seed = Annotated[int, typer.Option(min=0, max=MOST_SEED, help="The same seed gives the same result.")]
Inducing = Annotated[int, typer.Option(min=2, max=5000, help="Inducing inputs of each layer.")]
MONTH_S = 30 * 86_400.0
"""The most that a duration may be told, s: what is to go on for longer goes on until Ctrl-C without one."""
Human = Annotated[str, typer.Option("--human", "--person", help="Prefix of the person's markers.")]
Avatar = Annotated[str, typer.Option(help="Prefix of the markers of whom the avatar learns from.")]
HumanSet = Annotated[
    str | None, typer.Option("--human-set", "--person-set", help="The person's marker set: a name or a TOML file.")
]
AvatarSet = Annotated[str | None, typer.Option(help="The other's marker set: a name or a TOML file.")]

Person = Annotated[str | None, typer.Option("--person", "--human", help="Prefix of the person's markers.")]
Cells = Annotated[
    list[str] | None,
    typer.Option(
        help="Only this cell, A1 to C3: A to C are low to high, 1 to 3 go from the avatar's right to its left; may be "
        "given again."
    ),
]

Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Write there though something is there already; other files stay.")
]
"""For results that fill a folder."""
OverwriteFile = Annotated[bool, typer.Option("--overwrite", help="Replace the file that is written if it is there.")]

AnySet = Annotated[str | None, typer.Option(help="The marker set: a name or a TOML file.")]


_SAME = (("--human", "--person"), ("--human-set", "--person-set"))


def refuse_two_people(words: Sequence[str]) -> None:
    """Of two names for one option the parser takes what was said last; two different people are a mistake.

    Raises:
        HighFiveError: the words of a command line say two.
    """
    words = [*words, "--"][: [*words, "--"].index("--")]
    for names in _SAME:
        said: dict[str, str] = {}  # value and how it was said
        for place, word in enumerate(words):
            name, equals, value = word.partition("=")
            if name in names:
                value = value if equals else "".join(words[place + 1 : place + 2])
                said[value] = f"{name} {value}"
        if len(said) > 1:
            raise HighFiveError(f"{' and '.join(said.values())} are one option, the same person's; give one of them")


WHICH_ARM = "--which-arm"
"""What ``--arm NAME`` becomes."""


class ArmCommand(TyperCommand):
    """A command whose ``--arm`` alone lets a real arm move, and whose ``--arm NAME`` says which arm it is."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:
        """As the base class, where a name or a folder behind ``--arm`` belongs to it."""
        from highfive.hil.commands.arm_options import names_arm  # noqa: PLC0415

        end = [*args, "--"].index("--")
        said = "--arm="
        words = [
            f"{WHICH_ARM}={word.removeprefix(said)}" if n < end and word.startswith(said) else word
            for n, word in enumerate(args)
        ]
        for place, (word, name) in enumerate(pairwise(words[:end])):
            if word == "--arm" and names_arm(name):
                words[place] = WHICH_ARM
        return super().parse_args(ctx, words)


Armed = Annotated[
    bool,
    typer.Option(
        "--arm",
        help="Yes, the real arm on that port may move. With a name or folder behind it: which arm that is, no more "
        "(docs/arm.md).",
    ),
]
WhichArm = Annotated[str | None, typer.Option(WHICH_ARM, hidden=True)]


class Interrupted(Exception):
    """Ctrl-C, and what is said behind the word: how to go on."""


PAGE_PORT = "Port of the page (default: 8150, or a free one)."
Port = Annotated[int | None, typer.Option(min=1, max=65535, help=PAGE_PORT)]
PagePort = Annotated[int | None, typer.Option("--page-port", min=1, max=65535, help=PAGE_PORT)]
"""Where ``--port`` is the arm's."""
NoOpen = Annotated[bool, typer.Option("--no-open", help="Open no browser.")]
Https = Annotated[
    bool, typer.Option("--https", help="Serve the page to the network, encrypted, for a phone or a headset.")
]

Publish = Annotated[
    str | None,
    typer.Option(
        metavar="WAYS",
        help="Let other programs hear it: lsl, vmc or vmc://HOST:PORT, foxglove; several with commas between.",
    ),
]
PublishNetwork = Annotated[
    bool, typer.Option("--publish-network", help="With --publish: also programs on other computers.")
]
RecordLsl = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="Record this LSL stream beside the session; may be given again."),
]

Latency = Annotated[
    float,
    typer.Option(
        min=0.0,
        max=200.0,
        help="What cameras, network and screen take, ms, beyond what a live system reports; made up for.",
    ),
]
Latencies = Annotated[
    Path | None,
    typer.Option(metavar="FILE.toml", help="How late streams are, as calibrate event measured; made up for."),
]
Headset = Annotated[
    Path | None,
    typer.Option(metavar="FILE.toml", help="A headset worn beside a lab's system, as calibrate headset registered it."),
]
Camera = Annotated[
    Path | None,
    typer.Option(metavar="VIDEO", help="With --source webcam: an .mjpeg or .y4m instead of a camera, nobody asked."),
]
Height = Annotated[
    float | None, typer.Option(min=1.0, max=2.3, help="With --source webcam: of the person, m (default: 1.75).")
]
FieldOfView = Annotated[
    float | None,
    typer.Option(min=30.0, max=120.0, help="With --source webcam: degrees across the camera's picture (default: 70)."),
]
