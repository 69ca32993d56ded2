"""The limits file: what is refused, what the command line may change, and what the numbers follow from."""

import math
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.hil.safety import limits as module
from highfive.hil.safety import limits_file
from highfive.hil.safety.contact_force import contact_force, contact_speed
from highfive.hil.safety.limits import JOINTS, LimitsError
from highfive.hil.safety.limits_file import FILE, load_limits, load_safer, lowered, parse_changes
from highfive.model.errors import HighFiveError

LIMITS = load_limits()
ENTRIES = [
    *(f"{section}.{f.name}" for section, kind in limits_file.SECTIONS.items() for f in fields(kind)),
    *(f"joint.{joint}.{f.name}" for joint in JOINTS for f in fields(module.Joint)),
]


def value_of(name: str) -> float:
    section, _, rest = name.partition(".")
    if section != "joint":
        return getattr(getattr(LIMITS, section), rest)
    joint, _, entry = rest.partition(".")
    return getattr(LIMITS.joints[JOINTS.index(joint)], entry)


def span_of(name: str) -> module.Span:
    section, _, rest = name.partition(".")
    kind = module.Joint if section == "joint" else limits_file.SECTIONS[section]
    return next(f.metadata["span"] for f in fields(kind) if f.name == rest.rpartition(".")[2])


def with_line(tmp_path: Path, name: str, text: str | None) -> Path:
    """The shipped file with one entry written otherwise, or left out."""
    section, _, entry = name.rpartition(".")
    lines, where = [], ""
    for line in FILE.read_text(encoding="utf-8").splitlines():
        where = line.strip("[]") if line.startswith("[") else where
        if where == section and line.startswith(f"{entry} ="):
            if text is not None:
                lines.append(f"{entry} = {text}")
        else:
            lines.append(line)
    path = tmp_path / "limits.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def refused(path: Path) -> str:
    with pytest.raises(LimitsError) as caught:
        load_limits(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_speeds_follow_from_the_forces() -> None:
    """ISO/TS 15066: μ = 0.6 · 1.5 / 2.1 kg for the hand, 4.4 · 1.5 / 5.9 kg for the head; 75 N/mm."""
    hand = 140.0 / math.sqrt(0.6 * 1.5 / 2.1 * 75e3)
    face = 65.0 / math.sqrt(4.4 * 1.5 / 5.9 * 75e3)
    assert hand == pytest.approx(0.78, abs=0.005)
    assert face == pytest.approx(0.22, abs=0.005)
    assert contact_speed(140.0, 0.6, 1.5, 75e3) == pytest.approx(hand)
    for zone, fastest in ((LIMITS.contact, hand), (LIMITS.face, face)):
        assert zone.speed <= fastest
        assert zone.speed == pytest.approx(fastest, abs=0.005)
        assert contact_force(zone.speed, zone.body_mass, zone.robot_mass, zone.stiffness) <= zone.force


@pytest.mark.parametrize("name", ENTRIES)
def test_a_file_for_one_session_is_no_less_safe_than_the_arms_own(tmp_path: Path, name: str) -> None:
    span, own = span_of(name), value_of(name)
    bound = span.least if span.safer > 0 else span.most
    if bound != own:
        riskier = own + 1e-3 * (bound - own)
        path = with_line(tmp_path, name, repr(riskier))
        with pytest.raises(LimitsError) as caught:
            load_safer(path, LIMITS)
        assert "\n" not in str(caught.value)
        assert str(path) in str(caught.value)


def test_a_file_for_one_session_may_be_safer(tmp_path: Path) -> None:
    assert load_safer(FILE, LIMITS) == LIMITS
    path = with_line(tmp_path, "contact.speed", "0.4")
    assert load_safer(path, LIMITS) == lowered(LIMITS, {"contact.speed": 0.4})
    text = FILE.read_text(encoding="utf-8").replace("-1.273, 0.0],", "-1.273, 0.1],")
    path.write_text(text, encoding="utf-8")
    load_limits(path)
    with pytest.raises(LimitsError, match="path cannot be changed"):
        load_safer(path, LIMITS)


@given(st.floats(0.0, 3.0), st.floats(0.1, 80.0), st.floats(0.1, 80.0), st.floats(1e3, 1e6))
@settings(deadline=None)
def test_all_energy_of_relative_motion_goes_into_the_spring(v: float, a: float, b: float, k: float) -> None:
    force = contact_force(v, a, b, k)
    assert force**2 / (2 * k) == pytest.approx(0.5 * (a * b / (a + b)) * v**2)


def test_the_arm_moves_no_faster_than_its_servos_may() -> None:
    assert (LIMITS.speed <= 30 * math.tau / 60).all()  # 30 rpm
    assert (LIMITS.lowest >= module.MECHANICAL[:, 0]).all()
    assert (LIMITS.highest <= module.MECHANICAL[:, 1]).all()
    assert (LIMITS.contact_current < LIMITS.current).all()


def test_stale_times_and_watchdog_are_those_of_the_rules() -> None:
    assert (LIMITS.stale.hold_s, LIMITS.stale.retract_s) == (0.1, 0.5)
    assert 0.06 <= LIMITS.timing.watchdog_s <= 0.1
    assert LIMITS.timing.estop_s <= 0.02


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", '"3"', "true", "[1.0]", "{}"])
@pytest.mark.parametrize("name", ["contact.speed", "joint.elbow.speed", "timing.watchdog_s"])
def test_no_number_is_refused(tmp_path: Path, name: str, text: str) -> None:
    assert f"{name} has to be a number" in refused(with_line(tmp_path, name, text))


@pytest.mark.parametrize("name", ENTRIES)
def test_every_limit_has_a_ceiling_and_a_floor(tmp_path: Path, name: str) -> None:
    span = span_of(name)
    for beyond in (span.most + abs(span.most) * 0.01 + 0.01, span.least - abs(span.least) * 0.01 - 0.001):
        assert name in refused(with_line(tmp_path, name, repr(beyond)))


@pytest.mark.parametrize("name", [*ENTRIES, "retract.path"])
def test_a_missing_limit_is_refused(tmp_path: Path, name: str) -> None:
    if name == "retract.path":
        path = tmp_path / "limits.toml"
        path.write_text(FILE.read_text(encoding="utf-8").partition("path = ")[0] + "[timing]\n", encoding="utf-8")
    else:
        path = with_line(tmp_path, name, None)
    assert "lacks" in refused(path)


@pytest.mark.parametrize("where", ["", "joint", "joint.waist", "contact", "retract"])
def test_an_unknown_name_is_refused(tmp_path: Path, where: str) -> None:
    text = FILE.read_text(encoding="utf-8")
    text = f"fast = 1\n{text}" if not where else f"{text}\n[{where}.fast]\nx = 1\n"
    path = tmp_path / "limits.toml"
    path.write_text(text, encoding="utf-8")
    assert "'fast', which is no limit" in refused(path)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("joint.shoulder.lowest", "-2.0", "joint.shoulder goes from -2"),
        ("joint.shoulder.lowest", "1.23", "it has to rise"),
        ("joint.wrist_rotate.current", "3.0", "stalls at 2.3"),
        ("joint.elbow.contact_current", "2.0", ""),
        ("joint.waist.contact_current", "2.0", ""),
        ("joint.wrist_rotate.contact_current", "1.5", "above that of free motion"),
        ("contact.force", "100.0", "100 N allow 0.558"),
        ("contact.robot_mass", "3.0", "lower the speed"),
        ("face.force", "30.0", "lower the speed"),
        ("servo.voltage_low", "14.0", "below servo.voltage_high"),
        ("stale.retract_s", "0.1", "below stale.retract_s"),
        ("timing.watchdog_s", "0.07", "steps of 0.02"),
        ("joint.elbow.acceleration", "10.0", "lower it, too"),
        ("joint.elbow.highest", "0.9", "retract.path goes through elbow"),
    ],
)
def test_limits_have_to_go_together(tmp_path: Path, name: str, text: str, says: str) -> None:
    path = with_line(tmp_path, name, text)
    if says:
        assert says in refused(path)
    else:
        load_limits(path)


@pytest.mark.parametrize("path_text", ["[]", "3", "[[0.0, 0.0]]", "[[0, 0, 0, 0, 0, nan]]", '["a"]'])
def test_a_path_has_to_be_poses(tmp_path: Path, path_text: str) -> None:
    text = FILE.read_text(encoding="utf-8")
    head, _, tail = text.partition("path = ")
    path = tmp_path / "limits.toml"
    path.write_text(f"{head}path = {path_text}\n[timing]{tail.partition('[timing]')[2]}", encoding="utf-8")
    assert "retract.path" in refused(path)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"joint = [", b"joint = 3", b""])
def test_what_is_no_limits_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "limits.toml"
    path.write_bytes(content)
    refused(path)
    refused(tmp_path / "not there.toml")
    refused(tmp_path)


SCRAPS = st.none() | st.integers() | st.text(max_size=3) | st.dictionaries(st.sampled_from(JOINTS), st.none())


@given(st.dictionaries(st.sampled_from(["joint", "x", "retract", *limits_file.SECTIONS]), SCRAPS))
@settings(deadline=None)
def test_any_data_are_limits_or_refused(data: dict[str, Any]) -> None:
    with pytest.raises(LimitsError):
        limits_file._parsed(data, module.Ceilings())


@given(st.sampled_from(ENTRIES), st.floats(allow_nan=True, allow_infinity=True))
@settings(deadline=None)
def test_the_command_line_only_makes_safer(name: str, value: float) -> None:
    span, now = span_of(name), value_of(name)
    try:
        after = lowered(LIMITS, {name: value})
    except LimitsError as error:
        assert "\n" not in str(error)
        return
    assert span.least <= value <= span.most
    assert span.safer * (value - now) >= 0.0
    assert value == now or span.safer != 0
    section, _, rest = name.partition(".")
    found = after.joints[JOINTS.index(rest.partition(".")[0])] if section == "joint" else getattr(after, section)
    assert getattr(found, rest.rpartition(".")[2]) == value


@pytest.mark.parametrize("name", ENTRIES)
def test_a_raise_is_refused_in_one_line(name: str) -> None:
    span, now = span_of(name), value_of(name)
    worse = now - span.safer * 0.01 * max(abs(now), 0.01) if span.safer else now + 1e-6
    with pytest.raises(LimitsError) as caught:
        lowered(LIMITS, {name: worse})
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_one_name_lowers_every_joint() -> None:
    after = lowered(LIMITS, {"joint.speed": 1.0, "joint.elbow.speed": 0.5})
    assert after.speed.tolist() == [1.0, 1.0, 0.5, 1.0, 1.0, 1.0]
    with pytest.raises(LimitsError, match="can only be lowered"):
        lowered(after, {"joint.speed": 0.8})  # the elbow would be raised


@pytest.mark.parametrize("name", ["speed", "contact.fast", "joint.hip.speed", "joint", "contact", "path", ""])
def test_a_limit_that_is_not_there(name: str) -> None:
    with pytest.raises(LimitsError, match="there is no limit"):
        lowered(LIMITS, {name: 0.1})


def test_words_of_the_command_line() -> None:
    assert parse_changes(["contact.speed=0.5", "joint.speed = 1"]) == {"contact.speed": 0.5, "joint.speed": 1.0}
    for word in ("contact.speed", "contact.speed=fast", ""):
        with pytest.raises(HighFiveError, match="write it as"):
            parse_changes([word])
    with pytest.raises(LimitsError, match="has to be a number"):
        lowered(LIMITS, parse_changes(["contact.speed=nan"]))


def test_limits_cannot_be_written_to() -> None:
    for array in (LIMITS.lowest, LIMITS.speed, LIMITS.way_points, LIMITS.contact_current):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    assert np.array_equal(LIMITS.way_points, tomllib.loads(FILE.read_text(encoding="utf-8"))["retract"]["path"])
