"""The register tables: known numbers, no overlaps, ranges that fit, and the way from bytes to quantities and back."""

import math
from itertools import pairwise

import pytest

from sinew.hardware.registers import (
    IMUS,
    MOTORS,
    OPENCR_NODE,
    XH430_W350,
    XL330_M288,
    XM430_W350,
    Register,
    RegisterTable,
    decode,
    decode_raw,
    encode_raw,
)
from sinew.measure.errors import RegisterError

TABLES = [*MOTORS.values(), *IMUS.values()]
ROWS = [(table, row) for table in TABLES for row in table]
WRITABLE = [row for _, row in ROWS if row.writable]

each_table = pytest.mark.parametrize("table", TABLES, ids=lambda table: table.model)


@each_table
def test_no_two_registers_overlap_and_all_are_in_order(table: RegisterTable) -> None:
    assert [(a.name, b.name) for a, b in pairwise(table) if a.stop > b.address] == []


@each_table
def test_every_range_fits_into_the_bytes_of_its_register(table: RegisterTable) -> None:
    for row in table:
        bits = 8 * row.size
        least, most = (-(1 << bits - 1), (1 << bits - 1) - 1) if row.signed else (0, (1 << bits) - 1)
        assert least <= row.lowest <= row.highest <= most, row.name


@each_table
def test_what_a_register_starts_with_lies_in_its_range(table: RegisterTable) -> None:
    assert [r.name for r in table if r.initial is not None and not r.lowest <= r.initial <= r.highest] == []


@each_table
def test_units_are_si_or_radians_or_celsius(table: RegisterTable) -> None:
    assert {row.unit for row in table} <= {"1", "s", "rad", "rad/s", "rad/s^2", "m/s^2", "A", "V", "V/s", "degC"}


# Name, address, size, writable, counts at the start: typed off the pages XH430-W350 and XM430-W350 of the manual.
MANUAL = [
    ("model_number", 0, 2, False, 1000, 1020),
    ("id", 7, 1, True, 1, 1),
    ("baud_rate", 8, 1, True, 1, 1),
    ("return_delay_time", 9, 1, True, 250, 250),
    ("operating_mode", 11, 1, True, 3, 3),
    ("homing_offset", 20, 4, True, 0, 0),
    ("max_voltage_limit", 32, 2, True, 160, 160),
    ("pwm_limit", 36, 2, True, 885, 885),
    ("current_limit", 38, 2, True, 648, 1193),
    ("velocity_limit", 44, 4, True, 130, 350),
    ("min_position_limit", 52, 4, True, 0, 0),
    ("shutdown", 63, 1, True, 52, 52),
    ("torque_enable", 64, 1, True, 0, 0),
    ("hardware_error_status", 70, 1, False, 0, 0),
    ("velocity_i_gain", 76, 2, True, 1920, 1920),
    ("velocity_p_gain", 78, 2, True, 100, 100),
    ("position_p_gain", 84, 2, True, 900, 800),
    ("bus_watchdog", 98, 1, True, 0, 0),
    ("goal_current", 102, 2, True, None, None),
    ("goal_position", 116, 4, True, None, None),
    ("present_current", 126, 2, False, None, None),
    ("present_velocity", 128, 4, False, None, None),
    ("present_position", 132, 4, False, None, None),
    ("present_temperature", 146, 1, False, None, None),
    ("indirect_address_1", 168, 2, True, 224, 224),
    ("indirect_address_28", 222, 2, True, 251, 251),
    ("indirect_data_28", 251, 1, True, 0, 0),
    ("indirect_address_29", 578, 2, True, 634, 634),
    ("indirect_address_56", 632, 2, True, 661, 661),
    ("indirect_data_56", 661, 1, True, 0, 0),
]


@pytest.mark.parametrize("line", MANUAL, ids=lambda line: line[0])
def test_a_register_is_where_the_manual_says(line: tuple[str, int, int, bool, int | None, int | None]) -> None:
    name, address, size, writable, xh, xm = line
    for table, initial in ((XH430_W350, xh), (XM430_W350, xm)):
        row = table[name]
        assert (row.address, row.size, row.writable, row.initial) == (address, size, writable, initial)


# Name, address, counts at the start, counts allowed: typed off the page XL330-M288 of the manual.
SMALL = [
    ("model_number", 0, 1200, None),
    ("baud_rate", 8, 1, (0, 6)),
    ("temperature_limit", 31, 70, (0, 100)),
    ("max_voltage_limit", 32, 70, (31, 70)),
    ("min_voltage_limit", 34, 35, (31, 70)),
    ("pwm_limit", 36, 885, (0, 885)),
    ("current_limit", 38, 1750, (0, 1750)),
    ("velocity_limit", 44, 445, (0, 2047)),
    ("pwm_slope", 62, 140, (1, 255)),
    ("shutdown", 63, 53, None),
    ("velocity_i_gain", 76, 1600, (0, 16_383)),
    ("velocity_p_gain", 78, 180, (0, 16_383)),
    ("position_p_gain", 84, 400, (0, 16_383)),
    ("present_current", 126, None, None),
    ("indirect_address_1", 168, 208, (64, 227)),
    ("indirect_address_20", 206, 227, (64, 227)),
    ("indirect_data_20", 227, 0, (0, 255)),
]


@pytest.mark.parametrize("line", SMALL, ids=lambda line: line[0])
def test_a_register_of_the_small_servo_is_as_its_page_says(
    line: tuple[str, int, int | None, tuple[int, int] | None],
) -> None:
    name, address, initial, allowed = line
    row = XL330_M288[name]
    assert (row.address, row.initial) == (address, initial)
    assert allowed in (None, (row.lowest, row.highest))


def test_the_small_servo_has_no_register_behind_its_twentieth_indirect_one() -> None:
    assert XL330_M288.size == 228


def test_the_models_have_the_numbers_that_the_manual_prints() -> None:
    assert {table.number: table.model for table in TABLES} == {
        1000: "XH430-W350",
        1020: "XM430-W350",
        1200: "XL330-M288",
        0x7400: "OpenCR node",
    }


@pytest.mark.parametrize(
    ("table", "name", "raw", "value"),
    [
        (XH430_W350, "present_current", -1, -2.69e-3),
        (XM430_W350, "present_current", 372, 1.00068),
        (XL330_M288, "present_current", -1470, -1.47),
        (XH430_W350, "present_position", 2048, math.pi),
        (XH430_W350, "present_velocity", 131, 131 * 0.229 / 60 * 2 * math.pi),
        (XH430_W350, "return_delay_time", 250, 500e-6),
        (XH430_W350, "bus_watchdog", 5, 0.1),
        (XH430_W350, "pwm_limit", 885, 1.00005),
        (XH430_W350, "present_input_voltage", 119, 11.9),
        (XH430_W350, "profile_acceleration", 1, 214.577 * 2 * math.pi / 3600),
        (OPENCR_NODE, "gyro_x", -16_384, -1000 * math.pi / 180),
        (OPENCR_NODE, "acceleration_z", 16_384, 9.80665),
        (OPENCR_NODE, "yaw", -1800, -math.pi),
        (OPENCR_NODE, "sample_time", 4_294_967_295, 4294.967295),
    ],
    ids=lambda value: getattr(value, "model", value),
)
def test_counts_are_the_quantity_that_the_manual_gives(table: RegisterTable, name: str, raw: int, value: float) -> None:
    row = table[name]
    assert decode(row, raw.to_bytes(row.size, "little", signed=row.signed)) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("row", WRITABLE, ids=lambda row: row.name)
def test_both_ends_of_a_range_survive_the_way_there_and_back(row: Register) -> None:
    assert [decode_raw(row, encode_raw(row, count)) for count in (row.lowest, row.highest)] == [row.lowest, row.highest]


@pytest.mark.parametrize("row", WRITABLE, ids=lambda row: row.name)
def test_one_count_beyond_a_range_is_refused(row: Register) -> None:
    for count in (row.lowest - 1, row.highest + 1):
        with pytest.raises(RegisterError, match=f"{row.name} cannot hold {count} counts"):
            encode_raw(row, count)


def test_a_register_for_reading_only_cannot_be_written() -> None:
    with pytest.raises(RegisterError, match="present_position can only be read"):
        encode_raw(XH430_W350["present_position"], 0)


def test_a_register_that_is_not_there_is_refused_with_what_is_there() -> None:
    with pytest.raises(RegisterError, match=r"no register 'actual_position'; there is .*goal_position"):
        XH430_W350["actual_position"]
