"""What ``--publish`` says."""

import pytest

from highfive.hil.publish.wanted import Wanted, parse_wanted
from highfive.model.errors import HighFiveError


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("lsl", [Wanted("lsl")]),
        ("vmc", [Wanted("vmc", "127.0.0.1", 39539)]),
        ("vmc://10.0.0.7", [Wanted("vmc", "10.0.0.7", 39539)]),
        ("vmc://[::1]:5000", [Wanted("vmc", "::1", 5000)]),
        ("foxglove://:9000, lsl", [Wanted("foxglove", "", 9000), Wanted("lsl")]),
        ("lsl,vmc,foxglove", [Wanted("lsl"), Wanted("vmc", "127.0.0.1", 39539), Wanted("foxglove", "", 8765)]),
    ],
)
def test_ways(text: str, expected: list[Wanted]) -> None:
    assert list(parse_wanted(text)) == expected


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("ros", "there are lsl, vmc or vmc://HOST:PORT, foxglove"),
        ("", "there are lsl"),
        ("lsl,", "there are lsl"),
        ("LSL", "there are lsl"),
        ("lsl,lsl", "lsl is there twice"),
        ("vmc,vmc://10.0.0.7", "vmc is there twice"),
        ("vmc://host:70000", "a port of 1 to 65535"),
        ("vmc://host:0", "expected an address"),
        ("vmc://host:port", "a port of 1 to 65535"),
        ("vmc://", "expected an address"),
        ("vmc://host/path", "expected an address"),
        ("vmc://me@host", "expected an address"),
        ("vmc://[::1", "expected"),
        ("foxglove://:70000", "as in foxglove://:8765"),
        ("foxglove://", "such as foxglove://:8765"),
        ("foxglove://:9000/path", "such as foxglove://:8765"),
        ("lsl://name", "write lsl"),
        ("foxglove://elsewhere:1", "write foxglove://:8765"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(text: str, says: str) -> None:
    with pytest.raises(HighFiveError) as error:
        parse_wanted(text)
    assert says in str(error.value) and "\n" not in str(error.value)
