"""Operating modes of an emulated motor: what each resets, and what law it makes of the registers."""

import math

import pytest
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.emulator.plant import Law

TENDON, DRIVE = 1, 5
RANGE, LIMIT, ACCESS = 4, 6, 7
CURRENT, VELOCITY, POSITION, EXTENDED, LIMITED, PWM = MODES = (0, 1, 3, 4, 5, 16)
TURN = math.tau


def bench_in(mode: int, device: int = TENDON, *, torque: bool = True) -> Bench:
    bench = Bench()
    assert bench.put(device, "operating_mode", mode) == 0
    if mode == CURRENT:
        bench.put(device, "goal_current", 0)
    if torque:
        assert bench.put(device, "torque_enable", 1) == 0
    return bench


def law(bench: Bench, device: int = TENDON) -> Law:
    bench.wait(1e-3)
    return bench.plant.laws[device - 1]


OWN_GAINS = {"position_p_gain": 900, "position_d_gain": 0, "velocity_p_gain": 100, "velocity_i_gain": 1920}
PROFILE = ("profile_velocity", "profile_acceleration")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("written", "after"),
    [
        (dict.fromkeys(OWN_GAINS, 123), OWN_GAINS),
        (dict.fromkeys(PROFILE, 5), dict.fromkeys(PROFILE, 0)),
        ({"current_limit": 300, "pwm_limit": 400}, {"goal_current": 300, "goal_pwm": 400}),
    ],
    ids=["the gains of the model", "no profile", "goals at their limits"],
)
def test_a_new_mode_puts_gains_profile_and_goals_back(
    written: dict[str, int], after: dict[str, int], mode: int
) -> None:
    bench = bench_in(CURRENT, torque=False)
    for name, count in written.items():
        bench.put(TENDON, name, count)
    bench.put(TENDON, "operating_mode", mode)
    assert {name: bench.get(TENDON, name) for name in after} == after


@pytest.mark.parametrize("mode", [2, 6, 15])
def test_a_mode_that_there_is_not_is_a_range_error(mode: int) -> None:
    assert bench_in(POSITION, torque=False).put(TENDON, "operating_mode", mode) == RANGE


def test_the_mode_cannot_change_while_the_torque_is_on() -> None:
    assert bench_in(EXTENDED).put(TENDON, "operating_mode", CURRENT) == ACCESS


def test_the_drives_gain_is_that_of_the_data_sheet() -> None:
    bench = bench_in(POSITION, DRIVE)
    assert law(bench, DRIVE).gain == pytest.approx(bench.spec.drive.position_gain.value, rel=1e-3)


@pytest.mark.parametrize("mode", [POSITION, EXTENDED, LIMITED])
def test_a_goal_position_is_an_angle_from_where_it_began(mode: int) -> None:
    bench = bench_in(mode)
    assert bench.put(TENDON, "goal_position", 2048 + 1024) == 0
    found = law(bench)
    assert (found.kind, found.goal) == ("position", pytest.approx(TURN / 4))


@pytest.mark.parametrize("mode", [EXTENDED, LIMITED])
def test_the_multi_turn_modes_go_beyond_a_turn(mode: int) -> None:
    bench = bench_in(mode)
    assert bench.put(TENDON, "goal_position", 2048 - 3 * 4096) == 0
    assert law(bench).goal == pytest.approx(-3 * TURN)


def test_position_mode_refuses_a_goal_outside_its_window() -> None:
    bench = bench_in(POSITION, torque=False)
    bench.put(TENDON, "max_position_limit", 3000)
    bench.put(TENDON, "min_position_limit", 1000)
    bench.put(TENDON, "torque_enable", 1)
    assert [bench.put(TENDON, "goal_position", goal) for goal in (999, 1000, 3000, 3001)] == [LIMIT, 0, 0, LIMIT]


@pytest.mark.parametrize("mode", [POSITION, EXTENDED, LIMITED])
def test_goal_pwm_limits_the_duty_of_a_position(mode: int) -> None:
    bench = bench_in(mode)
    bench.put(TENDON, "goal_pwm", 177)
    assert law(bench).duty_limit == pytest.approx(0.2)


def test_goal_current_limits_the_current_based_mode_only() -> None:
    limits = []
    for mode in (POSITION, EXTENDED, LIMITED):
        bench = bench_in(mode)
        bench.put(TENDON, "goal_current", 100)
        limits.append(law(bench).current_limit)
    assert limits == [math.inf, math.inf, pytest.approx(0.269)]


def test_current_mode_keeps_a_current_of_2_69_milliampere_a_count() -> None:
    bench = bench_in(CURRENT)
    bench.put(TENDON, "goal_current", -200)
    found = law(bench)
    assert (found.kind, found.goal) == ("current", pytest.approx(-0.538))


def test_velocity_mode_keeps_a_speed_of_0_229_rpm_a_count() -> None:
    bench = bench_in(VELOCITY)
    bench.put(TENDON, "goal_velocity", 100)
    found = law(bench)
    assert (found.kind, found.goal) == ("velocity", pytest.approx(22.9 / 60 * TURN))


def test_pwm_mode_gives_the_duty() -> None:
    bench = bench_in(PWM)
    bench.put(TENDON, "goal_pwm", -885)
    found = law(bench)
    assert (found.kind, found.goal) == ("pwm", -1.0)


@pytest.mark.parametrize(
    ("limit", "goal", "count"),
    [("current_limit", "goal_current", 200), ("pwm_limit", "goal_pwm", 200), ("velocity_limit", "goal_velocity", 50)],
)
def test_a_goal_beyond_its_limit_is_a_limit_error(limit: str, goal: str, count: int) -> None:
    bench = bench_in(CURRENT, torque=False)
    bench.put(TENDON, limit, count)
    goals = (count, -count, count + 1, -count - 1)
    assert [bench.put(TENDON, goal, asked) for asked in goals] == [0, 0, LIMIT, LIMIT]


@pytest.mark.parametrize("mode", MODES)
def test_no_mode_controls_anything_while_the_torque_is_off(mode: int) -> None:
    bench = bench_in(mode, torque=False)
    for goal in ("goal_pwm", "goal_current", "goal_velocity", "goal_position"):
        bench.put(TENDON, goal, 50)
    assert law(bench) == Law()


@pytest.mark.parametrize("mode", MODES)
def test_a_motor_mounted_the_other_way_round_gets_the_opposite_of_every_goal(mode: int) -> None:
    goals = []
    for sign in (1, -1):
        bench = Bench(paper_rig(tendon_pull=(sign, 1, 1, 1)))
        bench.put(TENDON, "operating_mode", mode)
        bench.put(TENDON, "torque_enable", 1)
        for name, count in (("goal_pwm", 90), ("goal_current", 80), ("goal_velocity", 70), ("goal_position", 2500)):
            bench.put(TENDON, name, count)
        goals.append(law(bench).goal)
    assert goals[0] == pytest.approx(-goals[1])
    assert goals[0] > 0


def test_reverse_mode_inverts_positions() -> None:
    bench = bench_in(EXTENDED, torque=False)
    before = bench.get(TENDON, "present_position")
    bench.put(TENDON, "drive_mode", 1)
    bench.put(TENDON, "torque_enable", 1)
    start = bench.get(TENDON, "present_position")
    bench.put(TENDON, "goal_position", start + 1024)
    assert law(bench).goal == pytest.approx(-TURN / 4)
    assert start % 4096 == -before % 4096


def test_torque_on_by_goal_starts_with_the_goal() -> None:
    bench = bench_in(EXTENDED, torque=False)
    bench.put(TENDON, "drive_mode", 8)
    bench.put(TENDON, "goal_position", 3072)
    assert law(bench).goal == pytest.approx(TURN / 4)
    assert bench.get(TENDON, "torque_enable") == 1
