"""An emulated motor on the line: torque, and what its registers tell of position and motion, by the manual."""

import math

import pytest
from tests.unit.emulator_motor_bench import COUNT, EXTENDED, VELOCITY, M, law, running
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.emulator.plant import Law


def test_torque_on_makes_the_present_position_the_goal() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.plant.angles[0] = 1000 * COUNT
    bench.put(M, "goal_position", 17)
    bench.put(M, "torque_enable", 1)
    assert bench.get(M, "goal_position") == 3048
    assert law(bench).goal == pytest.approx(1000 * COUNT)


def test_torque_on_twice_does_not_touch_the_goal() -> None:
    bench = running()
    bench.put(M, "goal_position", 9000)
    bench.put(M, "torque_enable", 1)
    assert bench.get(M, "goal_position") == 9000


def test_torque_off_lets_the_horn_go() -> None:
    bench = running()
    bench.put(M, "torque_enable", 0)
    assert law(bench) == Law()


def test_position_mode_tells_a_position_within_one_turn_while_free() -> None:
    bench = Bench()
    bench.plant.angles[0] = 3 * math.tau + 100 * COUNT
    assert bench.get(M, "present_position") == 2148


def test_extended_position_counts_the_turns() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.plant.angles[0] = 3 * math.tau + 100 * COUNT
    assert bench.get(M, "present_position") == 2148 + 3 * 4096


def test_the_homing_offset_is_added_to_the_present_position() -> None:
    bench = Bench()
    bench.put(M, "homing_offset", -500)
    assert bench.get(M, "present_position") == 1548


def test_a_goal_is_understood_with_the_homing_offset() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.put(M, "homing_offset", -500)
    bench.put(M, "torque_enable", 1)
    bench.put(M, "goal_position", 1648)
    assert law(bench).goal == pytest.approx(100 * COUNT)


def test_a_homing_offset_beyond_a_quarter_turn_is_ignored_in_position_mode() -> None:
    bench = Bench()
    bench.put(M, "homing_offset", 1025)
    assert bench.get(M, "present_position") == 2048


def test_present_registers_tell_the_motion_in_counts() -> None:
    bench = Bench(paper_rig(tendon_pull=(-1, 1, 1, 1)))
    bench.plant.angles[0], bench.plant.current[0], bench.plant.duty[0] = 100 * COUNT, 0.269, 0.5
    names = ("present_position", "present_current", "present_pwm", "present_input_voltage", "present_temperature")
    assert [bench.get(M, name) for name in names] == [1948, -100, -442, 133, 25]


def test_present_velocity_counts_0_229_rpm() -> None:
    bench = running(VELOCITY)
    bench.put(M, "goal_velocity", -123)
    bench.wait(0.01)
    assert bench.get(M, "present_velocity") == -123


def test_realtime_tick_counts_milliseconds_and_wraps_at_32768() -> None:
    bench = Bench()
    before, then = bench.get(M, "realtime_tick"), bench.port.now()
    bench.port.wait_until(then + 32.768 + 0.1)
    assert abs(bench.get(M, "realtime_tick") - before - 100) <= 2
