"""An emulated motor on its way to a goal: profiles by velocity, by acceleration and by time, by the manual."""

import pytest
from tests.unit.emulator_motor_bench import COUNT, EXTENDED, VELOCITY, M, law, running
from tests.unit.emulator_stand_in import Bench


def test_without_a_profile_the_goal_is_taken_at_once() -> None:
    bench = running()
    bench.put(M, "goal_position", 6000)
    assert law(bench).goal == pytest.approx((6000 - 2048) * COUNT)


def test_a_rectangular_profile_takes_as_long_as_its_speed_says() -> None:
    bench = running()
    bench.put(M, "profile_velocity", 100)  # 22.9 rpm
    bench.put(M, "goal_position", 2048 + 4096)  # one turn: 60 / 22.9 s
    start = bench.port.now()
    while bench.get(M, "moving_status") & 0x02:
        bench.wait(0.01)
    assert bench.port.now() - start == pytest.approx(60 / 22.9, abs=0.02)


def test_a_trapezoidal_profile_keeps_its_acceleration_and_speed() -> None:
    bench = running()
    bench.put(M, "profile_velocity", 100)
    bench.put(M, "profile_acceleration", 10)  # ramp of 64 · 100 / 10 ms, by the manual
    bench.put(M, "goal_position", 2048 + 4096)
    start = bench.port.now()
    while bench.get(M, "moving_status") & 0x02:
        bench.wait(0.01)
    ramp = 64 * 100 / 10 * 1e-3
    assert bench.port.now() - start == pytest.approx(60 / 22.9 + ramp, abs=0.03)


def test_a_profile_never_goes_past_its_goal() -> None:
    bench = running()
    bench.put(M, "profile_velocity", 100)
    bench.put(M, "profile_acceleration", 10)
    bench.put(M, "goal_position", 4000)
    trajectory = []
    for _ in range(300):
        bench.wait(0.01)
        trajectory.append(bench.get(M, "position_trajectory"))
    assert trajectory == sorted(trajectory)
    assert trajectory[-1] == 4000


def test_a_time_based_profile_takes_its_time() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.put(M, "drive_mode", 4)
    bench.put(M, "torque_enable", 1)
    bench.put(M, "profile_velocity", 800)  # ms in all
    bench.put(M, "profile_acceleration", 200)  # ms
    bench.put(M, "goal_position", 3000)
    start = bench.port.now()
    while bench.get(M, "moving_status") & 0x02:
        bench.wait(0.01)
    assert bench.port.now() - start == pytest.approx(0.8, abs=0.03)


def test_velocity_mode_reaches_its_goal_by_the_acceleration() -> None:
    bench = running(VELOCITY)
    bench.put(M, "profile_acceleration", 10)  # 2145.77 rev/min²: 21.46 rev/min after 0.6 s
    bench.put(M, "goal_velocity", 130)
    bench.wait(0.6)
    assert bench.get(M, "velocity_trajectory") == pytest.approx(2145.77 * 0.01 / 0.229, abs=1)
