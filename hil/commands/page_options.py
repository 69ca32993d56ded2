"""What is asked of the live page, and whether it can be had: before anything is opened."""

from __future__ import annotations

import errno
import socket
from pathlib import Path

from highfive.hil.commands.simulate_options import PageOptions
from highfive.mocap_bridge.sources.address import WEBCAM, parse_address
from highfive.model.errors import HighFiveError


def page_options(
    view: bool,
    source: str | None,
    headset: Path | None,
    port: int | None,
    no_open: bool,
    https: bool,
    *,
    port_name: str = "--port",
) -> PageOptions | None:
    """The live page of ``simulate``: as asked for by ``--view``, or as whoever is tracked through it needs it.

    Where ``--port`` is the arm's, ``port_name`` is what chooses the page's.

    Raises:
        HighFiveError: there is none, and something is asked of it.
    """
    tracks = source is not None and parse_address(source).scheme in ("headset", WEBCAM)
    if view or headset is not None or tracks:
        return PageOptions(port, not no_open, https, port_name)
    for name, given in ((port_name, port is not None), ("--no-open", no_open), ("--https", https)):
        if given:
            raise HighFiveError(f"{name} is of the live page; add --view")
    return None


def check_port(options: PageOptions) -> None:
    """That the page's port, where one was chosen, can be listened on.

    Raises:
        HighFiveError: it cannot.
    """
    if options.port is None:
        return
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does: who was here may have ended
        try:
            probe.bind((options.host, options.port))
            probe.listen()
        except OSError as error:
            why = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be had ({error.strerror})"
            raise HighFiveError(
                f"port {options.port} {why}: choose another ({options.port_name}), or leave it out for a free one"
            ) from None
