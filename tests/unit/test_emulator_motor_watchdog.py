"""An emulated motor's bus watchdog: when it trips, what it does in each mode, and how it is cleared."""

import pytest
from tests.unit.emulator_motor_bench import COUNT, CURRENT, EXTENDED, PWM, RANGE, VELOCITY, M, law, running
from tests.unit.emulator_stand_in import Bench


def tripped(mode: int = EXTENDED) -> Bench:
    bench = running(mode)
    bench.put(M, "bus_watchdog", 5)
    bench.wait(0.2)
    return bench


@pytest.mark.parametrize("units", [1, 5, 127])
def test_the_watchdog_trips_after_its_time_without_a_packet(units: int) -> None:
    bench = running()
    bench.put(M, "bus_watchdog", units)
    heard = bench.port.now()
    bench.port.wait_until(heard + units * 20e-3 - 2e-3)
    early = bench.rig.motors[M].is_tripped
    bench.port.wait_until(heard + units * 20e-3)
    assert (early, bench.rig.motors[M].is_tripped) == (False, True)


def test_the_watchdog_counts_packets_to_other_devices() -> None:
    bench = running()
    bench.put(M, "bus_watchdog", 2)
    for _ in range(20):
        bench.wait(0.03)
        bench.bus.ping(3)
    assert not bench.rig.motors[M].is_tripped


def test_the_watchdog_does_not_count_packets_that_are_damaged() -> None:
    bench = running()
    bench.put(M, "bus_watchdog", 2)
    for _ in range(3):
        bench.wait(0.03)
        bench.port.write(b"\xff\xff\xfd\x00\x03\x03\x00\x01\x00\x00")
    assert bench.rig.motors[M].is_tripped


def test_the_watchdog_sleeps_while_the_torque_is_off() -> None:
    bench = Bench()
    bench.put(M, "bus_watchdog", 1)
    bench.wait(1.0)
    assert not bench.rig.motors[M].is_tripped


def test_a_tripped_watchdog_reads_minus_one_and_leaves_the_torque_on() -> None:
    bench = tripped()
    assert (bench.get(M, "bus_watchdog"), bench.get(M, "torque_enable")) == (-1, 1)


@pytest.mark.parametrize("goal", ["goal_pwm", "goal_current", "goal_velocity", "goal_position"])
def test_a_tripped_watchdog_refuses_goals_as_out_of_range(goal: str) -> None:
    assert tripped().put(M, goal, 10) == RANGE


def test_only_zero_clears_the_watchdog() -> None:
    bench = tripped()
    assert [bench.put(M, "bus_watchdog", count) for count in (5, 0, 5)] == [RANGE, 0, 0]


def test_a_cleared_watchdog_takes_goals_again() -> None:
    bench = tripped()
    bench.put(M, "bus_watchdog", 0)
    assert bench.put(M, "goal_position", 2100) == 0
    assert law(bench).goal == pytest.approx(52 * COUNT)


def test_the_watchdog_holds_a_motor_where_it_is_on_its_way() -> None:
    bench = running()
    bench.put(M, "profile_velocity", 20)
    bench.put(M, "bus_watchdog", 5)
    bench.put(M, "goal_position", 9000)
    bench.wait(0.2)
    held = bench.plant.angles[0]
    bench.wait(0.5)
    assert bench.plant.angles[0] == pytest.approx(held, abs=COUNT)
    assert held < 0.5 * (9000 - 2048) * COUNT


@pytest.mark.parametrize("mode", [CURRENT, VELOCITY, PWM])
def test_the_watchdog_takes_the_goal_away_in_modes_without_a_position(mode: int) -> None:
    bench = running(mode)
    bench.put(M, {CURRENT: "goal_current", VELOCITY: "goal_velocity", PWM: "goal_pwm"}[mode], 100)
    bench.put(M, "bus_watchdog", 1)
    bench.wait(0.1)
    assert law(bench).goal == 0.0


def test_the_firmwares_fault_moves_a_motor_with_homing_offset_in_extended_mode() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.put(M, "homing_offset", 700)
    bench.put(M, "torque_enable", 1)
    bench.put(M, "bus_watchdog", 1)
    bench.wait(1.0)
    assert bench.plant.angles[0] == pytest.approx(700 * COUNT)
