"""Motors as tendons and drive: the rig's sense of angles and currents, modes by name, limits of the output."""

import math

import pytest
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.hardware.motor import TENDON_MODES, DriveServo, TendonServo
from sinew.hardware.registers import MOTORS, XH430_W350, XM430_W350
from sinew.measure.errors import RegisterError
from sinew.plan.plan import TendonMode
from sinew.plan.servo import SERVOS

COUNT = math.tau / 4096
both_ways = pytest.mark.parametrize("pull", [1, -1])


@pytest.fixture
def bench() -> Bench:
    return Bench()


def tendon(bench: Bench, pull: int = 1, current_limit: float = math.inf, supply: float = 12.0) -> TendonServo:
    return TendonServo(bench.bus, "tendon 1", 1, XH430_W350, pull, current_limit=current_limit, supply=supply)


def drive(bench: Bench, sign: int = 1, zero: int = 2048, window: float = math.pi) -> DriveServo:
    return DriveServo(bench.bus, "drive", 5, XM430_W350, sign, zero=zero, window=window)


def put_into(servo: TendonServo, mode: TendonMode) -> None:
    """Write the operating mode that a plan calls so."""
    servo.set_count("operating_mode", TENDON_MODES[mode])


def powered(mode: TendonMode, pull: int) -> tuple[Bench, TendonServo]:
    """Return a bench whose tendon 1 pulls that way, and that motor under torque in a mode."""
    bench = Bench(paper_rig(tendon_pull=(pull, 1, 1, 1)))
    servo = tendon(bench, pull)
    put_into(servo, mode)
    servo.torque_on()
    return bench, servo


@both_ways
def test_a_tendon_goes_to_its_goal_over_more_than_a_turn(pull: int) -> None:
    bench, servo = powered("position", pull)
    goal = servo.angle() + 9.0
    servo.set_goal_angle(goal)
    bench.wait(5.0)
    assert servo.angle() == pytest.approx(goal, abs=2 * COUNT)


@pytest.mark.parametrize(("mode", "register"), [("position", 4), ("position-with-current-limit", 5), ("current", 0)])
def test_the_modes_of_a_plan_are_these_operating_modes(bench: Bench, mode, register: int) -> None:  # type: ignore[no-untyped-def]
    put_into(tendon(bench), mode)
    assert bench.get(1, "operating_mode") == register


@pytest.mark.parametrize(
    ("mode", "pull", "before", "limit", "register", "count"),
    [
        ("position", 1, None, 0.65, "goal_pwm", int(0.5 / 0.00113)),  # the duty of that stall current: half of 1.3 A
        ("position-with-current-limit", 1, None, 0.269, "goal_current", 100),
        ("current", 1, 0.8, 0.269, "goal_current", 100),
        ("current", 1, 0.1, 1.0, "goal_current", 37),  # it never raises the goal
        ("current", -1, 0.5, 0.269, "goal_current", -100),  # it keeps the goal's sense
        ("position", 1, None, math.inf, "goal_pwm", 885),  # the motor's own
        ("position-with-current-limit", 1, None, math.inf, "goal_current", 648),
    ],
)
def test_the_output_is_limited_by_what_the_mode_goes_by(
    bench: Bench, mode: TendonMode, pull: int, before: float | None, limit: float, register: str, count: int
) -> None:
    servo = tendon(bench, pull)
    put_into(servo, mode)
    servo.torque_on()
    if before is not None:
        servo.set_goal_current(before)
    elif limit == math.inf:
        servo.limit_output(0.1)
    servo.limit_output(limit)
    assert bench.get(1, register) == count


@pytest.mark.parametrize("current", [-0.1, math.nan])
def test_a_limit_that_is_none_is_refused(bench: Bench, current: float) -> None:
    with pytest.raises(RegisterError, match="expected a number that is not negative"):
        tendon(bench).limit_output(current)


def test_a_goal_current_beyond_the_rigs_limit_is_refused_both_ways(bench: Bench) -> None:
    servo = tendon(bench, current_limit=0.5)
    for current in (0.51, -0.51):
        with pytest.raises(RegisterError, match=r"tendon 1 .*0\.51 A.* goal_current.*-0\.4977 to 0\.4977"):
            servo.set_goal_current(current)


@pytest.mark.parametrize("goal", [math.nan, math.inf])
def test_a_goal_that_is_no_number_is_refused(bench: Bench, goal: float) -> None:
    with pytest.raises(RegisterError, match="expected a finite number"):
        tendon(bench).set_goal_angle(goal)


@both_ways
def test_the_drives_angle_counts_from_its_zero(pull: int) -> None:
    bench = Bench(paper_rig(drive_sign=pull, drive_zero_counts=1500))
    bench.plant.angles[4] = 0.25
    bench.wait(0.01)
    assert drive(bench, pull, zero=1500).angle() == pytest.approx(0.25, abs=COUNT)


def test_the_drive_is_told_nothing_beyond_its_window(bench: Bench) -> None:
    with pytest.raises(RegisterError, match=r"drive .*1\.6 rad.* goal_position.* -1\.57"):
        drive(bench, window=math.pi / 2).set_goal_angle(1.6)


def test_a_window_beyond_one_turn_ends_where_position_mode_ends(bench: Bench) -> None:
    servo = drive(bench, zero=4000, window=math.pi / 2)
    assert (servo.lowest_count, servo.highest_count) == (2976, 4095)


def test_every_servo_that_a_rig_may_name_has_its_registers() -> None:
    assert {servo.number for servo in SERVOS.values()} == set(MOTORS)


def test_a_higher_supply_needs_less_duty_for_the_same_current(bench: Bench) -> None:
    servo = tendon(bench, supply=14.4)
    put_into(servo, "position")
    servo.limit_output(0.65)
    assert bench.get(1, "goal_pwm") == int(0.5 / 1.2 / 0.00113)
