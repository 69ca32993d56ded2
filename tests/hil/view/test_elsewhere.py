"""A page on another machine is told what a report is called, and not where it lies on this one."""

import json
from contextlib import ExitStack

import pytest
from websockets.sync.client import connect

from highfive.hil.view.certificate import network_address
from highfive.hil.view.elsewhere import is_here
from highfive.hil.view.live_page import LivePage


@pytest.mark.parametrize(
    ("peer", "own", "here"),
    [
        (("127.0.0.1", 5), ("127.0.0.1", 8150), True),
        (("127.0.0.3", 5), ("127.0.0.1", 8150), True),
        (("192.0.2.2", 5), ("192.0.2.2", 8150), True),  # a browser here that asks for the address in the network
        (("192.0.2.9", 5), ("192.0.2.2", 8150), False),
        (("::1", 5, 0, 0), ("::1", 8150, 0, 0), True),
        (("fe80::1%eth0", 5, 0, 2), ("fe80::2%eth0", 8150, 0, 2), False),
        (None, ("127.0.0.1", 8150), False),  # it is gone already
    ],
)
def test_who_is_on_this_machine(peer: tuple | None, own: tuple, here: bool) -> None:
    assert is_here(peer, own) is here


@pytest.mark.skipif(network_address() is None, reason="this machine has no address of its own")
@pytest.mark.slow
def test_only_pages_of_this_machine_are_told_where_the_report_is() -> None:
    address = str(network_address())
    with LivePage({"mode": "session"}, port=0, host="0.0.0.0", names=(address,)) as page, ExitStack() as stack:
        live = f"{page.port}/live?key={page.address.rpartition('=')[2]}"
        # The third comes from an address that is neither a loopback nor the one that was asked.
        ways = (("127.0.0.1", "127.0.0.1"), (address, address), ("127.0.0.1", address))
        links = [
            stack.enter_context(connect(f"ws://{host}:{live}", compression=None, source_address=(source, 0)))
            for host, source in ways
        ]
        assert [json.loads(link.recv(20.0))["kind"] for link in links] == ["hello"] * 3
        page.tell("over", message="The session is over.", report="/home/she/study/session-1/report.html")
        told = [json.loads(link.recv(20.0)) for link in links]
    assert [text["report"] for text in told] == ["/home/she/study/session-1/report.html"] * 2 + ["report.html"]
    assert {text["message"] for text in told} == {"The session is over."}
