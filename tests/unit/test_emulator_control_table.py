"""Registers of an emulated device: what may be read and written, by the manual's words on its error numbers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.emulator.device import ControlTable
from sinew.hardware.registers import XH430_W350

RANGE, LENGTH, ACCESS = 4, 5, 7
LED, GOAL_POSITION, PRESENT_POSITION, TORQUE, ID = 65, 116, 132, 64, 7
INDIRECT_ADDRESS, INDIRECT_DATA = 168, 224


@pytest.fixture
def table() -> ControlTable:
    return ControlTable(XH430_W350)


def put(table: ControlTable, address: int, data: bytes, *, locked: bool = False) -> int:
    number, parts = table.parts(address, data, locked=locked)
    for row, count in parts:
        table.store(row, count)
    return number


def point(table: ControlTable, nth: int, *targets: int) -> None:
    for at, target in enumerate(targets):
        assert put(table, INDIRECT_ADDRESS + 2 * (nth - 1 + at), target.to_bytes(2, "little")) == 0


@pytest.mark.parametrize(("address", "length"), [(66, 2), (662, 1), (660, 4), (0, 663), (65_535, 65_535)])
def test_reading_where_nothing_is_is_an_access_error(table: ControlTable, address: int, length: int) -> None:
    assert table.read(address, length) == (ACCESS, b"")


@pytest.mark.parametrize(
    ("address", "data", "number"),
    [
        *((address, bytes(4), ACCESS) for address in (PRESENT_POSITION, 0, 66, 700, 65_535)),  # read-only, or nothing
        (INDIRECT_DATA, b"\x01", ACCESS),  # stands for a byte that is read-only
        (INDIRECT_DATA + 1, b"\x01", LENGTH),  # for one of a longer register
        *((GOAL_POSITION, bytes(size), LENGTH) for size in (1, 2, 3)),
        (TORQUE, b"\x02", RANGE),
        (TORQUE, b"\x01\x02", RANGE),  # of which the first alone would do
        (ID, b"\xfd", RANGE),
        (98, b"\xff", RANGE),
        (GOAL_POSITION, (1_048_576).to_bytes(4, "little"), RANGE),
        (INDIRECT_ADDRESS, ID.to_bytes(2, "little"), RANGE),  # cannot point into the EEPROM
    ],
)
def test_what_cannot_be_written_is_refused_and_stores_nothing(
    table: ControlTable, address: int, data: bytes, number: int
) -> None:
    point(table, 1, PRESENT_POSITION, GOAL_POSITION)
    before = bytes(table.memory)
    assert put(table, address, data) == number
    assert bytes(table.memory) == before


def test_eeprom_is_locked_while_the_torque_is_on(table: ControlTable) -> None:
    assert (put(table, ID, b"\x09", locked=True), table["id"]) == (ACCESS, 1)


def test_a_gap_between_registers_reads_as_zero(table: ControlTable) -> None:
    table["torque_enable"] = table["led"] = 1
    assert table.read(TORQUE, 5) == (0, b"\x01\x01\x00\x00\x02")


def test_an_indirect_byte_stands_for_the_byte_it_points_to(table: ControlTable) -> None:
    point(table, 1, LED)
    assert put(table, INDIRECT_DATA, b"\x01") == 0
    assert table["led"] == 1


def test_a_restart_keeps_the_eeprom_and_forgets_the_rest(table: ControlTable) -> None:
    put(table, ID, b"\x09")
    put(table, LED, b"\x01")
    table.restart()
    assert (table["id"], table["led"]) == (9, 0)


@given(address=st.integers(0, 0xFFFF), data=st.binary(max_size=12), locked=st.booleans())
def test_what_a_table_accepts_it_holds(address: int, data: bytes, locked: bool) -> None:
    table = ControlTable(XH430_W350)
    before = bytes(table.memory)
    if put(table, address, data, locked=locked) == 0:
        assert table.read(address, len(data)) == (0, data)
    else:
        assert bytes(table.memory) == before
