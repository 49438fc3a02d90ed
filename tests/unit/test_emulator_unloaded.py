"""Motors with nothing attached, against the mean speeds and end points that their laws name."""

import math
from itertools import pairwise

import pytest

from sinew.emulator.plant import RESPONSE_S, HornMotion, Law, Unloaded
from sinew.plan.toml import load_rig

NO_LOAD = math.pi  # 30 rpm at 12 V


@pytest.fixture
def motors() -> Unloaded:
    motors = Unloaded(4, load_rig("paper"))
    motors.set_supply(12.0)
    return motors


def _after(motors: Unloaded, seconds: float, motor: int = 0) -> HornMotion:
    motors.advance(motors.motion().time + seconds)
    motion = motors.motion()
    return motion.drive if motor == 4 else motion.tendons[motor]


def test_a_goal_position_is_reached(motors: Unloaded) -> None:
    motors.set_law(1, Law("position", -2.0, 4.6))
    assert _after(motors, 2.0, 1).angle == pytest.approx(-2.0, abs=1e-9)


def test_a_far_goal_is_approached_at_the_speed_limit(motors: Unloaded) -> None:
    motors.set_law(0, Law("position", 5.0, 4.6, speed_limit=0.5))
    assert _after(motors, 3.0).angle == pytest.approx(1.5)


def test_a_far_goal_without_speed_limit_is_approached_at_the_no_load_speed(motors: Unloaded) -> None:
    motors.set_law(0, Law("position", 50.0, 4.6))
    assert _after(motors, 2.0).speed == pytest.approx(NO_LOAD)


def test_half_the_duty_makes_half_the_speed(motors: Unloaded) -> None:
    motors.set_law(0, Law("position", 50.0, 4.6, duty_limit=0.5))
    assert _after(motors, 2.0).angle == pytest.approx(NO_LOAD)


def test_a_near_goal_is_never_passed(motors: Unloaded) -> None:
    motors.set_law(0, Law("position", 0.01, 4.6))
    assert all(_after(motors, 1e-3).angle <= 0.01 for _ in range(100))


@pytest.mark.parametrize("current", [0.3, -0.02])
def test_a_current_of_either_sign_brings_a_motor_to_its_no_load_speed(motors: Unloaded, current: float) -> None:
    motors.set_law(2, Law("current", current))
    assert _after(motors, 1.0, 2).speed == pytest.approx(math.copysign(NO_LOAD, current))


def test_duty_scales_the_speed_of_the_drive_with_the_supply(motors: Unloaded) -> None:
    motors.set_supply(6.0)
    motors.set_law(4, Law("pwm", 0.5))
    assert _after(motors, 1.0, 4).speed == pytest.approx(0.25 * 46 * math.tau / 60)


def test_a_goal_speed_is_kept(motors: Unloaded) -> None:
    motors.set_law(4, Law("velocity", -1.5, 1.0))
    _after(motors, 1.0, 4)
    before = motors.motion().drive.angle
    assert _after(motors, 2.0, 4).angle - before == pytest.approx(-3.0)


def test_a_motor_that_is_switched_off_comes_to_rest(motors: Unloaded) -> None:
    motors.set_law(0, Law("pwm", 1.0))
    _after(motors, 1.0)
    motors.set_law(0, Law("off"))
    assert _after(motors, 20 * RESPONSE_S).speed == pytest.approx(0.0, abs=1e-6)


def test_the_angle_is_continuous_whatever_the_law_becomes(motors: Unloaded) -> None:
    laws = [Law("pwm", 1.0), Law("position", -1.0, 4.6), Law("off"), Law("current", -0.1), Law("velocity", 2.0)]
    angles = []
    for law in laws:
        motors.set_law(0, law)
        angles += [_after(motors, 1e-3).angle for _ in range(200)]
    assert max(abs(b - a) for a, b in pairwise(angles)) <= 1.001e-3 * NO_LOAD


@pytest.mark.parametrize("law", [Law("pwm", 0.7), Law("position", 3.0, 4.6), Law("velocity", -1.0), Law("off")])
def test_speed_is_the_derivative_of_the_angle(motors: Unloaded, law: Law) -> None:
    motors.set_law(0, Law("velocity", 1.0))
    _after(motors, 0.5)
    motors.set_law(0, law)
    before = _after(motors, 0.0301)
    here = _after(motors, 1e-5)
    after = _after(motors, 1e-5)
    assert (after.angle - before.angle) / 2e-5 == pytest.approx(here.speed, abs=1e-5)


def test_a_stuck_motor_stays_where_it_is(motors: Unloaded) -> None:
    motors.set_law(3, Law("pwm", 1.0))
    before = _after(motors, 0.3, 3).angle
    motors.stick(3, True)
    assert _after(motors, 1.0, 3).angle == before


def test_a_time_that_has_passed_changes_nothing(motors: Unloaded) -> None:
    motors.set_law(0, Law("pwm", 1.0))
    motors.advance(1.0)
    motion = motors.motion()
    motors.advance(0.5)
    assert motors.motion() == motion
