"""What is asked of the live page reaches it, or is refused in one line, before anything is opened."""

import socket
from contextlib import nullcontext
from pathlib import Path

import pytest

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.commands.headset_session import with_page
from highfive.hil.commands.live_options import check_live_options
from highfive.hil.commands.page_options import check_port, page_options
from highfive.hil.commands.simulate import simulate
from highfive.hil.commands.simulate_options import PageOptions, SimulateOptions
from highfive.hil.runtime.console import progress_bars
from highfive.model.errors import HighFiveError


@pytest.mark.parametrize("source", ["headset", "Headset", "headset?hand=left", "webcam", "webcam?hand=left", None])
def test_what_is_asked_of_the_page_reaches_it(source: str | None) -> None:
    options = page_options(source is None, source, None, 9153, True, True)
    assert options == PageOptions(9153, open_browser=False, https=True)
    if source is not None and source.lower().startswith("headset"):
        assert with_page(SimulateOptions(source=source, view=options)).view == options


def test_a_headset_beside_a_lab_has_the_page() -> None:
    assert page_options(False, "vicon://lab", Path("headset.toml"), None, False, False) == PageOptions()


@pytest.mark.parametrize(("port", "real"), [("emulated", False), ("virtual", False), ("/dev/ttyUSB0", True)])
def test_nobody_in_a_headset_stands_before_a_real_arm(port: str, real: bool) -> None:
    options = SimulateOptions(source="vicon://lab", headset=Path("headset.toml"), arm=ArmOptions(port=port))
    with pytest.raises(HighFiveError, match=r"may be a real arm.*leave out --headset") if real else nullcontext():
        check_live_options(options, True)


@pytest.mark.parametrize("source", [None, "pair.c3d", "vicon://lab", "session.mcap"])
def test_what_is_asked_of_no_page_is_refused(source: str | None) -> None:
    assert page_options(False, source, None, None, False, False) is None
    for name, words in (
        ("--port", (9153, False, False)),
        ("--no-open", (None, True, False)),
        ("--https", (None, False, True)),
    ):
        with pytest.raises(HighFiveError, match=f"^{name} is of the live page; add --view$"):
            page_options(False, source, None, *words)


@pytest.mark.parametrize("https", [False, True])
def test_a_port_in_use_is_said_before_people_are_made(https: bool, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        view = PageOptions(taken.getsockname()[1], https=https)
        with progress_bars() as bar, pytest.raises(HighFiveError, match=f"^port {view.port} is in use: choose another"):
            simulate(SimulateOptions(view=view), tmp_path / "out", bar)
    assert not (tmp_path / "out").exists()
    check_port(view)  # it is free again
    check_port(PageOptions())


def test_where_port_is_the_arms_the_pages_has_a_name_of_its_own() -> None:
    options = page_options(True, None, None, 9153, False, False, port_name="--page-port")
    assert options is not None and options.port == 9153
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(HighFiveError, match=r"in use: choose another \(--page-port\), or"):
            check_port(PageOptions(taken.getsockname()[1], port_name="--page-port"))
    with pytest.raises(HighFiveError, match=r"^--page-port is of the live page; add --view$"):
        page_options(False, None, None, 9153, False, False, port_name="--page-port")
