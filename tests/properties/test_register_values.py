"""Values of registers: what is written into one is read back from it."""

from hypothesis import given
from hypothesis import strategies as st

from sinew.hardware.motor import GoalEncoder
from sinew.hardware.registers import IMUS, MOTORS, Register, decode_raw, encode_raw

WRITABLE = [row for table in (*MOTORS.values(), *IMUS.values()) for row in table if row.writable]
GOALS = [table[name] for table in MOTORS.values() for name in ("goal_position", "goal_current")]


@given(st.sampled_from(WRITABLE), st.data())
def test_a_count_survives_the_way_there_and_back(row: Register, data: st.DataObject) -> None:
    count = data.draw(st.integers(row.lowest, row.highest))
    assert decode_raw(row, encode_raw(row, count)) == count


@given(st.sampled_from(GOALS), st.sampled_from([1, -1]), st.integers(-300, 300), st.floats(0.0, 1.0))
def test_a_goal_survives_the_way_there_and_back_within_half_a_count(
    row: Register, sign: int, zero: int, share: float
) -> None:
    value = sign * row.scale * (row.lowest + share * (row.highest - row.lowest) - zero)
    told = sign * row.scale * (int(decode_raw(row, GoalEncoder("motor", row, sign, zero).encode(value))) - zero)
    assert abs(told - value) <= 0.5000001 * row.scale
