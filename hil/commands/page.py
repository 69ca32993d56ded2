"""The live page of a command: its address is told, and a browser opened."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from highfive.hil.commands.page_options import check_port
from highfive.hil.commands.simulate_options import PageOptions
from highfive.hil.drivers.latch import Latch
from highfive.hil.runtime.console import say_aside
from highfive.hil.view.live_page import LivePage
from highfive.model.errors import HighFiveError

PATIENCE_S = 120.0
"""So long a session waits for somebody to open the page."""


@contextmanager
def open_page(
    options: PageOptions,
    about: dict[str, Any],
    estop: Latch | None = None,
    opened: Callable[[LivePage], None] | None = None,
    *,
    tracks: bool = False,
) -> Iterator[LivePage]:
    """A page that somebody has opened, or could have.

    Args:
        options: where it is.
        about: what it is told first.
        estop: is pulled by its button.
        opened: opens it, instead of somebody.
        tracks: a person is tracked through it, in a headset or before its camera.

    Raises:
        HighFiveError: the port is in use, or this machine is in no network that the page could be served to.
    """
    check_port(options)
    with LivePage(about, port=options.port, estop=estop, tracks=tracks, **_network(options)) as page:
        say_aside(f"open {page.address} in a browser")
        if about.get("mode") == "experiment":
            say_aside(f"that is the experimenter's; for who takes part: {page.participant_address}")
        if opened is not None:
            opened(page)
        else:
            say_aside(f"it goes on once a page is open, or without one in {PATIENCE_S / 60.0:g} minutes")
            if options.open_browser:
                webbrowser.open(page.address)
        if not page.wait_for_page(PATIENCE_S):
            say_aside("nobody looks on; it begins")
        yield page


def saying_to(page: LivePage | None) -> Callable[[str], None]:
    """What tells a person what to do: on the terminal, and on the page where there is one."""

    def say(message: str) -> None:
        say_aside(message)
        if page is not None:
            page.tell("say", message=f"{message[:1].upper()}{message[1:]}")

    return say


def _network(options: PageOptions) -> dict[str, Any]:
    """This machine alone, or with TLS whoever has the address."""
    if not options.https:
        return {}
    from highfive.hil.view.certificate import certificate, network_address  # noqa: PLC0415

    address = network_address()
    if address is None:
        raise HighFiveError("this machine is in no network: leave out --https, and open the page here")
    say_aside(
        "the page is open to this network for who has its address; the browser warns of a connection that is not "
        "private, for nobody vouches for this machine: compare the address, and go on (Advanced)"
    )
    return {"host": options.host, "names": (address,), "tls": certificate((address,))}
