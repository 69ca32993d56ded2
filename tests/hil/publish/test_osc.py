"""OSC against the examples of its specification and, where it is installed, against python-osc."""

import pytest

from highfive.hil.publish import osc


def test_messages_are_those_of_the_specification() -> None:
    # opensoundcontrol.org, "OSC spec 1.0 examples"
    frequency = b"/oscillator/4/frequency\0,f\0\0\x43\xdc\0\0"
    assert osc.message("/oscillator/4/frequency", 440.0) == frequency
    foo = b"/foo\0\0\0\0,iisff\0\0\0\0\x03\xe8\xff\xff\xff\xffhello\0\0\0\x3f\x9d\xf3\xb6\x40\xb5\xb2\x2d"
    assert osc.message("/foo", 1000, -1, "hello", 1.234, 5.678) == foo


@pytest.mark.parametrize("count", [0, 1, 7, 40])
def test_bundles_hold_all_messages_in_order_and_are_no_longer_than_asked(count: int) -> None:
    messages = [osc.message(f"/m{i}", i, 0.5 * i, "x" * i) for i in range(count)]
    bundles = list(osc.bundles(messages, 200))
    assert all(len(bundle) <= 200 for bundle in bundles) and all(len(bundle) % 4 == 0 for bundle in bundles)
    found = []
    for bundle in bundles:
        assert bundle.startswith(b"#bundle\0\0\0\0\0\0\0\0\x01")
        rest = bundle[16:]
        while rest:
            size = int.from_bytes(rest[:4], "big")
            found.append(rest[4 : 4 + size])
            rest = rest[4 + size :]
    assert found == messages


def test_an_independent_reader_reads_them() -> None:
    reader = pytest.importorskip("pythonosc.osc_bundle", reason="python-osc (extra dev) is not installed")
    given = [("/a", (1, 2.5, "drei")), ("/VMC/Ext/Bone/Pos", ("Hips", 0.25, -1.0)), ("/ü", ("", "abc", "abcd"))]
    (bundle,) = osc.bundles((osc.message(address, *values) for address, values in given), 1400)
    assert reader.OscBundle.dgram_is_bundle(bundle)
    found = [(one.address, tuple(one.params)) for one in reader.OscBundle(bundle)]
    assert found == given
