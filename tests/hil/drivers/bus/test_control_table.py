"""Control tables against the maker's own, which come with its SDK, and the laws of the conversions."""

import math
from importlib import resources

import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.drivers.bus.control_table import (
    BAUD_RATES,
    Table,
    bounds,
    decode,
    encode,
    load_table,
    model_of,
    models,
    to_raw,
    to_si,
)
from highfive.model.errors import HighFiveError

MAKERS = {
    "XM540-W270": "xm540_w270",
    "XM430-W350": "xm430_w350",
    "XL430-W250": "xl430_w250",
    "XL330-M288": "xl330_m288_fw52",  # of the firmware that its manual describes; before it 224 was the first data
    "XL330-M077": "xl330_m077_fw52",
}
SIGN_AND_UNIT = {"Present Velocity", "Goal Velocity", "Present Current", "Goal Current"}


def makers_file(model: str) -> dict[str, list[list[str]]]:
    text = resources.files("dynamixel_easy_sdk").joinpath("control_table", f"{MAKERS[model]}.model").read_text()
    sections: dict[str, list[list[str]]] = {}
    for line in text.splitlines():
        if line.startswith("["):
            rows = sections[line.strip("[]")] = []
        elif line.strip():
            rows.append(line.split("\t"))
    return sections


def ours(table: Table, name: str) -> str:
    """The maker calls the start of what it writes and of what it reads through indirect data by names of their own."""
    if name.startswith("Indirect") and not name.endswith("1"):
        start = {"Write": 1, "Read": 29 if len(table.indirect) == 2 else 7}[name.rsplit(maxsplit=1)[-1]]
        return f"indirect_{name.split()[1].lower()}_{start}"
    return "shadow_id" if "Shadow" in name else name.lower().replace(" ", "_")


@pytest.mark.parametrize("model", MAKERS)
def test_every_address_and_size_is_the_makers(model: str) -> None:
    table = load_table(model)
    rows = makers_file(model)["control table"][1:]
    assert len(rows) > 50
    for address, size, name in rows:
        register = table[ours(table, name)]
        assert (register.address, register.size) == (int(address), int(size)), name
    theirs = {ours(table, row[2]) for row in rows}
    newer = {"startup_configuration", "backup_ready"}  # firmware 45; in the manual, not in these files
    assert {r.name for r in table if not r.name.startswith("indirect")} - theirs == newer


@pytest.mark.parametrize("model", MAKERS)
def test_signs_units_and_zero_are_the_makers(model: str) -> None:
    table, sections = load_table(model), makers_file(model)
    for name, value, unit, sign in sections["unit info"][1:]:
        register = table[ours(table, name)]
        assert register.signed == (sign == "signed"), name
        if unit == "rad/s":
            assert register.si == unit
            assert register.scale == pytest.approx(float(value), rel=1e-3)  # 0.229 rev/min is rounded
    kind = {name: float(value) for name, value in sections["type info"][1:]}
    turn = (kind["max_radian"] - kind["min_radian"]) / (
        kind["value_of_max_radian_position"] + 1 - kind["value_of_min_radian_position"]
    )
    assert table["present_position"].scale == pytest.approx(turn, rel=1e-6)


def test_model_numbers_are_the_makers() -> None:
    text = resources.files("dynamixel_easy_sdk").joinpath("control_table", "dynamixel.model").read_text()
    numbers = {
        file.removesuffix(".model"): int(number) for number, file in (r.split("\t") for r in text.split("\n")[1:] if r)
    }
    for model in models():
        assert load_table(model).number == numbers[MAKERS[model].removesuffix("_fw52")]
        assert model_of(load_table(model).number) == model
    assert model_of(1) is None


@pytest.mark.parametrize("model", MAKERS)
def test_a_table_is_in_order(model: str) -> None:
    table = load_table(model)
    end = 0
    for register in table:
        assert register.address >= end, register.name
        end = register.end
        low, high = bounds(register)
        assert low < high
        assert register.initial is None or low <= register.initial <= high, register.name
        assert register.limited_by is None or register.limited_by in table
        assert decode(register, encode(register, low)) == low and decode(register, encode(register, high)) == high
    assert table["operating_mode"].initial in table.operating_modes
    assert table["baud_rate"].maximum in (len(BAUD_RATES) - 1, len(BAUD_RATES) - 2)


def test_facts_of_the_manual() -> None:
    big, small = load_table("XM540-W270"), load_table("XM430-W350")
    assert to_si(big["goal_position"], 4096) == pytest.approx(math.tau)
    assert to_si(big["velocity_limit"], 131) == pytest.approx(math.pi, rel=1e-3)  # 30 rev/min
    assert to_si(big["profile_acceleration"], 1) == pytest.approx(214.577 * math.tau / 3600.0)
    assert to_si(big["bus_watchdog"], 4) == pytest.approx(0.08)
    assert to_si(big["return_delay_time"], 250) == pytest.approx(500e-6)
    assert to_si(big["present_current"], -100) == pytest.approx(-0.269)
    assert (big["present_current"].address, big["present_position"].end) == (126, 136)  # ten bytes in a row
    assert big["shutdown"].initial == 0b110100
    assert (big["torque_enable"].eeprom, big["shutdown"].eeprom) == (False, True)
    assert (big.motor.stall_torque, small.motor.stall_torque) == (10.6, 4.1)
    assert big.motor.no_load_speed == pytest.approx(math.pi)
    assert "goal_current" not in load_table("XL430-W250")


@given(st.sampled_from([(m, r.name) for m in models() for r in load_table(m)]), st.data())
def test_values_come_back(which: tuple[str, str], data: st.DataObject) -> None:
    register = load_table(which[0])[which[1]]
    raw = data.draw(st.integers(*bounds(register)))
    assert to_raw(register, to_si(register, raw)) == raw
    assert decode(register, encode(register, raw)) == raw
    assert math.copysign(1, to_si(register, raw)) == (-1 if raw < 0 else 1)


@pytest.mark.parametrize("value", [math.nan, math.inf, -1e9, 1e9])
def test_nonsense_is_never_sent(value: float) -> None:
    for register in load_table("XM540-W270"):
        with pytest.raises(HighFiveError):
            to_raw(register, value * register.scale if math.isfinite(value) and register.size < 4 else value * 1e3)


def test_one_line_for_what_there_is_not() -> None:
    with pytest.raises(HighFiveError, match="XM540-W270"):
        load_table("AX-12")
    with pytest.raises(HighFiveError, match="no register"):
        load_table("XL430-W250")["goal_current"]
    with pytest.raises(HighFiveError):
        decode(load_table("XM540-W270")["goal_position"], b"\0")
    with pytest.raises(HighFiveError):
        encode(load_table("XM540-W270")["goal_current"], 40_000)
