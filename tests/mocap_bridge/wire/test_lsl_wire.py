"""What an LSL stream says about itself: read where it makes sense, refused in one line where it does not."""

import itertools
import math
import random
import sys
from xml.sax.saxutils import escape

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from stamped_senders import send

from highfive.mocap_bridge.wire.lsl import (
    DescriptionError,
    FrameCounter,
    channel_descriptions,
    checked_times,
    library_settings,
    markers_of,
    parse_description,
    samples_of,
)

NAMES = ("human:RFIN", "human:RMC5", "LFHD")


def xml(channels: list[dict[str, str]]) -> str:
    inner = "".join(
        "<channel>" + "".join(f"<{k}>{escape(v)}</{k}>" for k, v in channel.items()) + "</channel>"
        for channel in channels
    )
    return f"<?xml version='1.0'?><info><name>x</name><desc><channels>{inner}</channels></desc></info>"


def labels(*names: str, unit: str = "") -> str:
    return xml([{"label": name} | ({"unit": unit} if unit else {}) for name in names])


def test_what_a_server_describes_is_read_back() -> None:
    layout = parse_description(xml(channel_descriptions(NAMES)), 9)
    assert layout.names == NAMES
    assert np.array_equal(layout.columns, np.arange(9).reshape(3, 3))
    assert np.all(layout.factors == 1.0)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("", 1.0), ("m", 1.0), ("meters", 1.0), ("Metre", 1.0), ("mm", 1e-3), ("millimeters", 1e-3), ("centimetre", 1e-2)],
)
def test_units(unit: str, factor: float) -> None:
    layout = parse_description(labels("RFIN_X", "RFIN_Y", "RFIN_Z", unit=unit), 3)
    points, seen, _ = markers_of(layout, np.array([[1.0, 2.0, 3.0]]))
    assert np.allclose(points[0, 0], factor * np.array([1.0, 2.0, 3.0]))
    assert seen.all()


@pytest.mark.parametrize("label", ["RFIN_", "A:RFIN.", "R FIN ", "a_b_", "x_"])
def test_labels_alone_say_which_coordinate_of_which_marker(label: str) -> None:
    layout = parse_description(labels(f"{label}Z", "frame", f"{label}x", f"{label}Y", "Confidence"), 5)
    assert layout.names == (label[:-1],)
    assert layout.columns.tolist() == [[2, 3, 0]]
    assert layout.frame_column == 1


def test_the_convention_of_xdf_with_a_person_and_other_channels_between() -> None:
    channels = [{"label": "t", "type": "Confidence"}, {"label": "q_X", "type": "OrientationB", "marker": "RFIN"}]
    channels += [{"marker": "RFIN", "object": "A", "type": f"Position{a}", "unit": "mm"} for a in "XYZ"]
    layout = parse_description(xml(channels), 8)  # more channels than are described
    assert layout.names == ("A:RFIN",)
    assert layout.columns.tolist() == [[2, 3, 4]]
    assert np.all(layout.factors == 1e-3)


@pytest.mark.parametrize(
    ("text", "channels", "says"),
    [
        ("", 3, "no XML"),
        ("<info><desc>", 3, "no XML"),
        ("<info/>", 3, "name no marker"),
        ("<info/>", 0, "0 channels"),
        ("<info/>", 10**9, "channels"),
        (labels("a", "b", "c"), 3, "name no marker"),
        (labels("RFIN_X", "RFIN_Y"), 2, "name no marker"),
        (labels("RFIN_X", "RFIN_Y", "RFIN_Z", "RFIN_Z"), 4, "both z"),
        (labels("RFIN_X", "RFIN_Y", "RFIN_Z"), 2, "describes 3 channels"),
        (labels("RFIN_X", "RFIN_Y", "RFIN_Z", unit="inch"), 3, "inch"),
        ('<!DOCTYPE a [<!ENTITY b "ha">]><info>&b;</info>', 3, "document type"),
        ("<a>" * 100_000, 3, "no XML"),
        ("x" * 5_000_000, 3, "characters"),
        ("<info>\ud800</info>", 3, "no XML"),
    ],
)
def test_descriptions_that_are_none(text: str, channels: int, says: str) -> None:
    with pytest.raises(DescriptionError, match=says) as error:
        parse_description(text, channels)
    assert len(str(error.value)) < 400


def mutations(count: int) -> None:
    rng = random.Random(0)
    whole = xml([*channel_descriptions(NAMES[:2]), {"label": "frame"}])
    pieces = [
        "<",
        ">",
        "&",
        "/",
        "X",
        "_Z",
        "mm",
        "\0",
        "\ud800",
        "<channel>",
        "</desc>",
        "&#9;",
        "é",
        " " * 50,
        "9" * 30,
    ]
    read = 0
    for _ in range(count):
        text = whole
        for _ in range(rng.randint(1, 4)):
            i, j = sorted(rng.randrange(len(text) + 1) for _ in range(2))
            text = rng.choice(
                [text[:i] + rng.choice(pieces) + text[i + 1 :], text[:i] + text[min(j, i + 40) :], text[:j] + text[i:]]
            )
        read += digest(text, rng.choice([1, 7, 7, 7, 9]))
    assert read > 0


def test_mutated_descriptions_give_a_layout_or_our_own_error() -> None:
    mutations(5_000)


@pytest.mark.slow
def test_very_many_mutated_descriptions() -> None:
    mutations(100_000)


def described(rng: random.Random) -> str:
    """A description with fields of any kind, some of which make sense, in a tree of any form."""
    words = ("RFIN_X", "RFIN_Y", "RFIN_Z", "x", "PositionX", "PositionY", "PositionZ", "mm", "m", "A", "frame", "", " ")
    tags = ("label", "label", "marker", "type", "unit", "object", "channel", "desc", "a-b")

    def text() -> str:
        if rng.random() < 0.8:
            return escape(rng.choice(words))
        return escape(
            "".join(chr(rng.choice((0, 9, 32, 60, 65, 233, 0x4E00, 0x1F600))) for _ in range(rng.randrange(9)))
        )

    def element(tag: str, depth: int) -> str:
        inside = (
            text() if depth == 0 else "".join(element(rng.choice(tags), depth - 1) for _ in range(rng.randrange(4)))
        )
        return f"<{tag}>{inside}</{tag if rng.random() < 0.995 else 'desc'}>"

    channels = "".join(element("channel", 1) for _ in range(rng.randrange(6)))
    return f"<info><desc><channels>{channels}</channels>{element('desc', 2)}</desc></info>"


def digest(text: str, channels: int) -> bool:
    try:
        layout = parse_description(text, channels)
    except DescriptionError:
        return False
    assert layout.columns.max() < layout.channels
    assert len(layout.names) == len(layout.columns) == len(layout.factors)
    return True


@given(st.text(), st.lists(st.dictionaries(st.sampled_from(["label", "marker", "type", "unit"]), st.text())))
def test_any_description_gives_a_layout_or_our_own_error(text: str, channels: list[dict[str, str]]) -> None:
    digest(text, 3)
    digest(xml(channels), len(channels))


@pytest.mark.slow
def test_a_hundred_thousand_descriptions_give_a_layout_or_our_own_error() -> None:
    read, texts = 0, set()

    @settings(max_examples=1_000, deadline=None)
    @given(st.integers(0, 2**60))
    def a_hundred_of(seed: int) -> None:
        nonlocal read
        rng = random.Random(seed)
        for number in range(140):
            text = xml([*channel_descriptions(NAMES[:2])]) if number % 14 == 0 else described(rng)
            texts.add(hash(text))
            read += digest(text, rng.choice((1, 3, 6, 7, 2**40)))

    a_hundred_of()
    assert len(texts) > 100_000 and read > 1_000


def test_coordinates_that_are_none_hide_a_marker() -> None:
    layout = parse_description(labels("A_X", "A_Y", "A_Z", "B_X", "B_Y", "B_Z"), 6)
    points, seen, impossible = markers_of(layout, np.array([[1, 2, np.nan, 4, 5, 6], [1, 2, 3, np.inf, 5, -np.inf]]))
    assert seen.tolist() == [[False, True], [True, False]]
    assert np.isfinite(points).all()
    assert impossible.tolist() == [0, 1]
    with pytest.raises(DescriptionError):
        markers_of(layout, np.zeros((2, 5)))


@given(st.lists(st.floats(), max_size=5))
def test_time_stamps_are_times_or_refused(stamps: list[float]) -> None:
    good = all(math.isfinite(stamp) and abs(stamp) < 1e12 for stamp in stamps)
    try:
        assert len(checked_times(np.array(stamps))) == len(stamps)
        assert good
    except DescriptionError:
        assert not good


def numbers_of(counter: FrameCounter, stamps: np.ndarray) -> list[int]:
    return [counter.next(stamp, stamp + 0.01) for stamp in stamps.tolist()]


@pytest.mark.parametrize("nominal_hz", [120.0, 0.0], ids=["nominal rate", "irregular"])
@pytest.mark.parametrize(
    "case",
    [{"late": 1 / 30}, {"wander_s": 0.003}, {"late": 1 / 30, "wander_s": 0.003}, {"late": 1 / 30, "lost": 0.01}],
    ids=["late bursts", "drift", "both", "late bursts and losses"],
)
def test_late_samples_leave_no_gap_in_the_numbers_and_lost_ones_do(nominal_hz: float, case: dict[str, float]) -> None:
    for true_hz in (113.0, 119.8, 120.0):
        sent = send(3, true_hz, 10.0, **case)
        later = send(4, true_hz, 2.0).stamps  # what was lost is known half a second later, with what comes after
        stamps = np.concatenate([sent.stamps, later + sent.stamps[-1] + 1.0 / true_hz - later[0]])
        numbers = numbers_of(FrameCounter(nominal_hz), stamps)
        assert numbers[0] == 0
        assert numbers[-1] == sent.numbers[-1] + 1 + round(2.0 * true_hz) - 1


@pytest.mark.parametrize("rate_hz", [118.0, 120.0, 122.0])
def test_what_is_lost_while_a_stream_is_gone_shows_when_it_is_back(rate_hz: float) -> None:
    """However long the stream ran, at whatever rate near its nominal one."""
    counter = FrameCounter(120.0)
    numbers_of(counter, 1e6 + np.arange(3000) / rate_hz)
    counter.set_rate(120.0)
    numbers = numbers_of(counter, 1e6 + np.arange(3200, 3300) / rate_hz)
    assert numbers[0] == 3000
    assert numbers[-1] == 3299


def test_a_stream_that_is_back_with_another_rate_goes_on_counting() -> None:
    counter = FrameCounter(120.0)
    numbers_of(counter, np.arange(300) / 120.0)
    counter.set_rate(60.0)
    assert numbers_of(counter, 2.5 + np.arange(300) / 60.0) == list(range(300, 600))


def test_a_clock_that_is_set_back_goes_on_counting() -> None:
    counter, arrivals = FrameCounter(120.0), np.arange(400) / 120.0
    stamps = np.where(np.arange(400) < 200, 1000.0, 5.0) + arrivals
    assert [counter.next(*both) for both in zip(stamps, arrivals, strict=True)] == list(range(400))


@given(st.floats(allow_nan=True), st.lists(st.floats(-1e12, 1e12), max_size=60))
@example(sys.float_info.min, [0.0] * 80)  # a period that is no number any more
def test_numbers_always_advance(rate: float, stamps: list[float]) -> None:
    counter = FrameCounter(rate)
    numbers = [counter.next(stamp, 0.01 * k) for k, stamp in enumerate(stamps)]
    assert all(after > before for before, after in itertools.pairwise(numbers))


def test_a_stream_that_counts_is_believed() -> None:
    counter = FrameCounter(120.0)
    stated = [7.0, 8.0, 12.0, math.nan]
    assert [counter.next(k / 120.0, k / 120.0, number) for k, number in enumerate(stated)] == [7, 8, 12, 13]


def test_samples_have_the_order_of_the_stream() -> None:
    points = np.arange(9.0).reshape(3, 3)
    sample = samples_of(("a", "b", "c", "d"), ("c", "a", "e"), points, np.array([True, True, True]))
    assert np.array_equal(sample[:3], points[1])
    assert np.isnan(sample[3:6]).all()
    assert np.array_equal(sample[6:9], points[0])
    assert np.isnan(samples_of(("a",), (), np.zeros((0, 3)), np.zeros(0, dtype=bool))).all()


def test_settings_keep_what_the_user_set_and_stay_on_this_machine() -> None:
    own = "[lab]\nSessionID = ours\nKnownPeers = {10.0.0.7}\n[multicast]\nResolveScope = site\n[log]\nlevel = 3\n"
    wide, narrow = library_settings(own, local_only=False), library_settings(own, local_only=True)
    assert "SessionID = ours" in wide
    assert "10.0.0.7" in wide
    assert "ResolveScope = site" in wide
    assert "level = 3" in wide
    assert "10.0.0.7" not in narrow
    assert "ResolveScope = machine" in narrow
    assert "ResolveScope = machine" in library_settings("no [ settings at all", local_only=True)


@pytest.mark.parametrize(
    ("stated", "captured"),
    [
        ("<acquisition><compensated_lag>0.008</compensated_lag></acquisition>", True),
        ("<acquisition><compensated_lag>0</compensated_lag></acquisition>", True),
        ("<acquisition><compensated_lag>unknown</compensated_lag></acquisition>", False),
        ("<acquisition><compensated_lag>nan</compensated_lag></acquisition>", False),
        ("<acquisition/>", False),
        ("", False),
    ],
)
def test_who_states_the_lag_of_stamps_has_put_them_back(stated: str, captured: bool) -> None:
    labels = "".join(f"<channel><label>RFIN_{axis}</label></channel>" for axis in "XYZ")
    xml = f"<info><desc><channels>{labels}</channels>{stated}</desc></info>"
    assert parse_description(xml, 3).captured is captured
