"""Protocols: ours, and those of installed packages, listened to by their address."""

import contextlib
import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from installed import install
from live_frames import PATIENCE_S
from paths import ROOT

from highfive.mocap_bridge.sources.address import open_source, parse_address
from highfive.mocap_bridge.sources.registry import BUILT_IN, GROUP, examples, scheme_named, scheme_names
from highfive.mocap_bridge.sources.source import Source
from highfive.model.errors import HighFiveError
from highfive.model.plugins import PluginError

BASE = """
from highfive import LinkError, MarkerFrame, Scheme
import numpy as np
def frame(number, names=("A", "B"), positions=np.ones((2, 3)), valid=np.ones(2, bool)):
    apart = positions * (1.0 + np.arange(len(positions))[:, None])
    return MarkerFrame(names, apart, valid, number, 0, 0, np.zeros((0, 3)))
class Link:
    rate_hz = 100.0
    def __init__(self, address): self.number = 0
    def close(self): pass
    def receive(self, timeout_s):
        import time; time.sleep(0.005); self.number += 1
        return [{what}]
SCHEME = Scheme("odd://host", Link, port=1)
"""


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.syspath_prepend(str(tmp_path))
    scheme_named.cache_clear()
    yield tmp_path
    scheme_named.cache_clear()


@pytest.fixture
def lab(site: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The example package, installed, and an address of it that nobody uses."""
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "lab_source"))
    install(site, "lab-source", GROUP, {"lab": "lab_source:SCHEME"})
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"lab://127.0.0.1:{probe.getsockname()[1]}"


def until(source: Source, trouble: str, seconds: float = PATIENCE_S) -> str:
    """What the source says is wrong with it, once it says something that fits."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        said = source.health(time.monotonic_ns()).trouble
        if re.search(trouble, said):
            return said
        time.sleep(0.01)
    raise AssertionError(f"it says {said!r}")


def test_every_protocol_of_ours_says_how_its_addresses_are_written() -> None:
    assert scheme_names()[: len(BUILT_IN)] == list(BUILT_IN)
    for name in BUILT_IN:
        example = scheme_named(name).example
        assert example.startswith(f"{name}://")
        assert parse_address(example).scheme == name
        assert example in examples()


def test_the_example_package_is_listened_to(lab: str) -> None:
    address = parse_address(lab)
    assert (address.scheme, str(address)) == ("lab", lab)
    with contextlib.closing(open_source(lab)) as source, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        frame = None
        for number in range(500):
            out.sendto(f"{number} {number / 100} RSHO 0 0 1.4 RWRA 0.3 0 1.2 RELB nan nan nan".encode(),
                       ("127.0.0.1", address.port))  # fmt: skip
            if (frame := source.newest(time.monotonic_ns())) is not None:
                break
            time.sleep(0.01)
        assert frame is not None
        assert frame.names == ("RSHO", "RWRA", "RELB")
        assert frame.valid.tolist() == [True, True, False]
        np.testing.assert_allclose(frame.positions[1], [0.3, 0.0, 1.2])


def test_a_line_that_is_not_of_the_protocol_is_reported(lab: str) -> None:
    with contextlib.closing(open_source(lab)) as source, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end and "protocol" not in source.health(time.monotonic_ns()).trouble:
            out.sendto(b"hello", ("127.0.0.1", parse_address(lab).port))
            time.sleep(0.02)
        assert "not of the protocol" in source.health(time.monotonic_ns()).trouble


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("1 / 0", r"^odd://host:1: ZeroDivisionError: division by zero$"),
        (
            "frame(self.number, positions=np.ones((3, 3)), valid=np.ones(3, bool))",
            r"^odd://host:1 gives positions of shape \(3, 3\); expected \(2, 3\)$",
        ),
        ("7", r"^odd://host:1 gives a int; expected a MarkerFrame$"),
        ("exit(2)", r"^odd://host:1: SystemExit: 2$"),
    ],
)  # fmt: skip
def test_a_plug_in_that_misbehaves_is_named_in_one_line(site: Path, what: str, says: str) -> None:
    module = f"odd_{abs(hash(what))}"
    install(site, "odd", GROUP, {"odd": f"{module}:SCHEME"}, {module: BASE.replace("{what}", what)})
    with contextlib.closing(open_source("odd://host")) as source:
        assert "\n" not in until(source, says)


def test_a_plug_in_that_forgets_the_mask_has_its_nan_masked(site: Path) -> None:
    what = "frame(self.number, positions=np.array([[0.1, 0.2, 0.3], [np.nan] * 3]))"
    install(site, "odd", GROUP, {"odd": "odd_nan:SCHEME"}, {"odd_nan": BASE.replace("{what}", what)})
    with contextlib.closing(open_source("odd://host")) as source:
        end = time.monotonic() + PATIENCE_S
        while (frame := source.newest(0)) is None and time.monotonic() < end:
            time.sleep(0.01)
        assert frame is not None
        assert frame.valid.tolist() == [True, False]


def test_what_is_no_scheme_is_refused_where_the_address_is_read(site: Path) -> None:
    install(site, "odd", GROUP, {"odd": "odd_number:SCHEME"}, {"odd_number": "SCHEME = 3\n"})
    with pytest.raises(PluginError, match=r"'odd' offers a int"):
        parse_address("odd://host")


def test_a_plug_in_may_have_capitals_in_its_name(site: Path) -> None:
    install(site, "odd", GROUP, {"Odd": "odd_capital:SCHEME"}, {"odd_capital": BASE.replace("{what}", "1")})
    assert parse_address("Odd://host").scheme == "Odd"
    assert parse_address("QTM://host").scheme == "qtm"


def test_a_plug_in_by_the_name_of_ours_is_refused_with_both_names(site: Path) -> None:
    install(site, "rival", GROUP, {"vicon": "rival:SCHEME"})
    with pytest.raises(HighFiveError, match=r"rival:SCHEME \(package rival 1\.0\) and highfive\.mocap_bridge"):
        parse_address("vicon://host")


def test_other_addresses_work_beside_a_broken_plug_in(site: Path) -> None:
    install(site, "odd", GROUP, {"odd": "not_there:SCHEME"})
    assert parse_address("qtm://host").port == 22223
    with pytest.raises(HighFiveError, match="odd://…"):
        parse_address("nothing://host")
