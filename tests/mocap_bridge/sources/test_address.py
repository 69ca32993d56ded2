"""Addresses: what they mean, and one clear line for those that are none."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.sources.address import connector, open_source, parse_address
from highfive.mocap_bridge.sources.registry import BUILT_IN
from highfive.mocap_bridge.sources.scheme import FILE, Address
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model.errors import HighFiveError


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("vicon://192.168.10.1", Address("vicon", "192.168.10.1", 801)),
        ("vicon://lab-pc:802?mode=pull", Address("vicon", "lab-pc", 802, {"mode": "pull"})),
        ("VICON://lab/", Address("vicon", "lab", 801)),
        ("qtm://[::1]:22225", Address("qtm", "::1", 22225)),
        (
            "natnet://h?up=z&multicast=239.255.42.99",
            Address("natnet", "h", 1510, {"up": "z", "multicast": "239.255.42.99"}),
        ),
        ("natnet://h?data_port=1512", Address("natnet", "h", 1510, {"data_port": "1512"})),
        ("lsl://My Stream", Address("lsl", "My Stream")),
        ("lsl://My%20Stream?up=y", Address("lsl", "My Stream", 0, {"up": "y"})),
        ("lsl://a:b@c", Address("lsl", "a:b@c")),
        (" walk.c3d ", Address(FILE, "walk.c3d")),
        ("C:\\walk.c3d", Address(FILE, "C:\\walk.c3d")),
    ],
)
def test_what_addresses_mean(text: str, address: Address) -> None:
    assert parse_address(text) == address
    assert parse_address(str(address)) == address


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("vrpn://host", "vicon://"),
        ("://host", "unknown"),
        ("vicon://", "names no host"),
        ("vicon://:801", "names no host"),
        ("vicon://a+", "joins two whole addresses"),
        ("vicon://a+b", "joins two whole addresses"),
        ("vicon://two words", "names no host"),
        ("lsl://", "names no stream"),
        ("lsl://it's", "names no stream"),
        ("vicon://host:0", "port 0"),
        ("vicon://host:70000", "port"),
        ("vicon://host:http", "port"),
        ("vicon://[::1", "vicon://host|write it as"),
        ("vicon://host?mood=pull", "unknown option 'mood'; there are: mode"),
        ("vicon://host?mode=fast", "push or pull"),
        ("vicon://host?mode=pull&mode=push", "twice"),
        ("qtm://host?up=z", "there are: none"),
        ("natnet://host?multicast=10.0.0.1", "multicast"),
        ("natnet://host?multicast=all", "multicast"),
        ("natnet://host?data_port=0", "data_port"),
        ("natnet://host?data_port=x", "data_port"),
        ("natnet://host?up=x", "y or z"),
        ("vicon://host/path", "beyond the host"),
        ("vicon://me@host", "beyond the host"),
        ("vicon://host#1", "beyond the host"),
    ],
)
def test_addresses_that_are_none(text: str, says: str) -> None:
    with pytest.raises(HighFiveError, match=says) as error:
        parse_address(text)
    assert "\n" not in str(error.value)


@given(st.one_of(st.text(max_size=40), st.builds(lambda s, r: f"{s}://{r}", st.sampled_from([*BUILT_IN]), st.text())))
def test_any_text_is_an_address_or_our_own_error(text: str) -> None:
    try:
        address = parse_address(text)
    except HighFiveError:
        return
    assert parse_address(str(address)) == address


def test_a_file_is_replayed_in_real_time(tmp_path: Path) -> None:
    path = tmp_path / "a.c3d"
    points = np.random.default_rng(0).uniform(size=(30, 3, 3))
    write_c3d(path, make_recording(60.0, ["A:x", "A:y", "B:z"], points, np.ones((30, 3), dtype=bool)))
    source = open_source(str(path), "A")
    assert isinstance(source, C3DSource)
    assert source.rate_hz == 60.0
    assert source.frame(0).names == ("x", "y")
    assert open_source(str(path), "A", rate_hz=120.0).rate_hz == 120.0
    with pytest.raises(HighFiveError, match="several persons"):
        open_source(str(path))
    with pytest.raises(HighFiveError, match="recording already"):
        open_source(str(path), "A", tap=lambda frames, rate: None)
    with pytest.raises(HighFiveError, match="absent"):
        open_source(str(tmp_path / "absent.c3d"))


def test_every_scheme_has_a_connection() -> None:
    for name in BUILT_IN:
        assert callable(connector(parse_address(f"{name}://here")))
    with pytest.raises(HighFiveError, match="no live system"):
        connector(Address(FILE, "a.c3d"))
