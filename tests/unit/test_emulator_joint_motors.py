"""The tendon motors and the drive of the joint: laws, limits, faults, time."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.emulator.joint import TICK_S
from sinew.emulator.joint_plant import GEAR_HOLD, JointPlant
from sinew.emulator.plant import Law
from sinew.measure.errors import SpecError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig

RIG = load_rig("paper")
RADIUS = RIG.tendons.pulley_radius.value
NEWTON = RADIUS / RIG.tendons.torque_constant.value  # [A/N]
CABLE, SERVO = RIG.tendons.cable_stiffness.value, RIG.tendons.servo_stiffness.value
SERIES = 1 / (1 / CABLE + 1 / SERVO)
GAIN = 900 / 128 / 885 * 4096 / math.tau
NO_LOAD = math.pi  # 30 rpm at 12 V
STALL_N = 3.4 / RADIUS  # at 12 V


def _plant(slack_m: float = 0.0, rig: RigSpec = RIG, **given_too: object) -> JointPlant:
    plant = JointPlant(rig, slack_m=[slack_m] * rig.tendons.count, **given_too)  # type: ignore[arg-type]
    plant.set_supply(12.0)
    plant.set_law(rig.tendons.count, Law("position", 0.0, RIG.drive.position_gain.value))
    return plant


def _by_position(wound_m: float, **limits: float) -> Law:
    return Law("position", wound_m / RADIUS, GAIN, **limits)


def _by_tension(tension_n: float) -> Law:
    return Law("current", tension_n * NEWTON)


def _run(plant: JointPlant, seconds: float, laws: list[Law] | Law | None = None) -> JointPlant:
    if laws is not None:
        for tendon, law in enumerate(laws if isinstance(laws, list) else [laws] * plant.count):
            plant.set_law(tendon, law)
    plant.advance(plant.motion().time + seconds)
    return plant


@pytest.mark.slow
def test_a_far_goal_is_approached_at_the_no_load_speed_while_slack() -> None:
    plant = _run(_plant(0.05), 0.2, _by_position(0.04))
    assert plant.motion().tendons[0].angle == pytest.approx(0.2 * NO_LOAD, rel=1e-6)


def test_a_speed_limit_holds_for_the_approach() -> None:
    plant = _run(_plant(0.05), 0.2, _by_position(0.04, speed_limit=0.5))
    assert plant.motion().tendons[0].speed == pytest.approx(0.5)


def test_half_the_supply_makes_half_the_speed() -> None:
    plant = _plant(0.05)
    plant.set_supply(6.0)
    assert _run(plant, 0.2, _by_position(0.04)).motion().tendons[0].speed == pytest.approx(NO_LOAD / 2)


def test_a_current_limit_bounds_the_tension_of_a_position_goal() -> None:
    plant = _run(_plant(), 4.0, _by_position(15e-3, current_limit=30 * NEWTON))
    assert plant.tension == pytest.approx([30.0] * 4)


def test_a_duty_limit_bounds_the_tension_of_a_position_goal() -> None:
    plant = _run(_plant(), 15.0, _by_position(15e-3, duty_limit=0.1))
    assert plant.tension == pytest.approx([0.1 * STALL_N] * 4, rel=1e-3)


def test_a_yielding_motors_encoder_follows_the_cable() -> None:
    plant = _run(_plant(), 4.0, _by_position(15e-3, current_limit=30 * NEWTON))
    # the cable is the span and what is wound up, stretched by its tension
    wound = plant.state.motion.shortening + 30.0 / CABLE
    assert plant.motion().tendons[2].angle * RADIUS == pytest.approx(wound, rel=1e-6)


def test_a_loaded_motor_stands_behind_its_goal_by_the_servos_give() -> None:
    plant = _run(_plant(), 4.0, _by_position(8e-3))
    assert plant.motion().tendons[1].angle * RADIUS == pytest.approx(8e-3 - plant.tension[1] / SERVO, rel=1e-9)


def test_the_servo_gives_less_with_a_higher_gain() -> None:
    plant = _run(_plant(), 4.0, Law("position", 8e-3 / RADIUS, 2 * GAIN))
    assert plant.motion().tendons[1].angle * RADIUS == pytest.approx(8e-3 - plant.tension[1] / SERVO / 2, rel=1e-9)


def test_duty_pulls_with_its_share_of_the_stall_torque() -> None:
    assert _run(_plant(3e-3), 15.0, Law("pwm", 0.08)).tension == pytest.approx([0.08 * STALL_N] * 4, rel=1e-3)


def test_a_speed_is_kept_while_slack() -> None:
    assert _run(_plant(0.05), 0.5, Law("velocity", -0.8)).motion().tendons[3].angle == pytest.approx(-0.4)


def test_a_speed_is_kept_until_the_current_limit_holds_it_up() -> None:
    plant = _run(_plant(), 4.0, Law("velocity", 1.0, current_limit=25 * NEWTON))
    assert plant.tension == pytest.approx([25.0] * 4, rel=1e-3)


def test_negative_current_pays_cable_out() -> None:
    plant = _run(_run(_plant(), 3.0, _by_tension(20.0)), 0.5, _by_tension(-1.0))
    assert plant.motion().tendons[0].speed < -0.9 * NO_LOAD


def test_a_lower_current_is_reached_from_above() -> None:
    plant = _run(_run(_plant(), 3.0, _by_tension(60.0)), 2.0, _by_tension(15.0))
    assert plant.tension == pytest.approx([15.0] * 4)


def test_no_horn_turns_faster_than_its_line_allows_during_a_pull() -> None:
    plant = _run(_plant(), 0.0, _by_tension(60.0))
    excess = []
    for _ in range(200):
        load = plant.tension[0] / STALL_N
        excess.append(_run(plant, TICK_S).motion().tendons[0].speed - NO_LOAD * (1 - load))
    assert max(excess) < 1e-6


def test_a_motor_switched_off_lets_go_down_to_what_its_gear_holds() -> None:
    plant = _run(_run(_plant(), 3.0, _by_tension(50.0)), 4.0, Law("off"))
    assert plant.tension == pytest.approx([GEAR_HOLD / RADIUS] * 4)


def test_a_motor_switched_off_under_a_light_load_stays_where_it_is() -> None:
    plant = _run(_plant(), 3.0, _by_tension(5.0))
    before = [horn.angle for horn in plant.motion().tendons]
    _run(plant, 2.0, Law("off"))
    assert [horn.angle for horn in plant.motion().tendons] == pytest.approx(before, abs=1e-3)


def test_a_stuck_tendon_keeps_its_horn_whatever_it_is_told() -> None:
    plant = _run(_plant(), 3.0, _by_tension(20.0))
    plant.stick(1, True)
    before = plant.motion().tendons[1].angle
    _run(plant, 1.0, [_by_tension(40.0), _by_position(0.02), _by_tension(40.0), Law("off")])
    assert plant.motion().tendons[1].angle == before


def test_a_stuck_motor_by_position_draws_its_limit() -> None:
    plant = _run(_plant(5e-3), 1.0, _by_position(1e-3))
    plant.stick(1, True)
    _run(plant, 1.0, _by_position(20e-3, current_limit=0.2))
    assert plant.motion().tendons[1].current == pytest.approx(0.2)


def test_a_tendon_let_go_goes_to_its_goal() -> None:
    plant = _run(_plant(5e-3), 0.1)
    plant.stick(1, True)
    _run(plant, 1.0, _by_position(3e-3))
    plant.stick(1, False)
    assert _run(plant, 1.0).motion().tendons[1].angle * RADIUS == pytest.approx(3e-3)


def test_a_slip_lowers_the_tension_by_the_stiffness_of_cable_and_servo() -> None:
    plant = _run(_plant(), 4.0, _by_position(8e-3))
    before = plant.tension
    plant.slip(2, 0.1e-3)
    assert before[2] - plant.tension[2] == pytest.approx(SERIES * 0.1e-3)


def test_a_slip_is_missing_from_the_pretension() -> None:
    plant = _run(_plant(), 4.0, _by_position(8e-3))
    before = plant.pretension
    for tendon in range(4):
        plant.slip(tendon, 0.3e-3)
    assert before - _run(plant, 4.0).pretension == pytest.approx(0.3e-3, rel=1e-6)


LAWS = st.sampled_from(
    [
        Law("off"),
        *(Law("current", ampere) for ampere in (-0.1, 0.0, 0.05, 0.4)),
        *(_by_position(wound) for wound in (-5e-3, 0.0, 4e-3, 9e-3)),
        _by_position(12e-3, current_limit=0.1),
        _by_position(12e-3, duty_limit=0.1, speed_limit=0.3),
        Law("position", 0.5, 0.4 * GAIN),
        *(Law("velocity", speed) for speed in (-1.0, 0.0, 1.0)),
        *(Law("pwm", duty) for duty in (-0.2, 0.0, 0.2)),
    ]
)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), LAWS, st.sampled_from([1, 3, 40])), min_size=4, max_size=25))
def test_a_horn_never_jumps_whatever_its_law_becomes(orders: list[tuple[int, Law, int]]) -> None:
    plant = _plant(1e-3, rest_tilt=(0.02, -0.01))
    angles = [[horn.angle for horn in plant.motion().tendons]]
    for tendon, law, ticks in orders:
        plant.set_law(tendon, law)
        for _ in range(ticks):
            _run(plant, TICK_S)
            angles.append([horn.angle for horn in plant.motion().tendons])
    farthest = max(abs(b - a) for old, new in pairwise(angles) for a, b in zip(old, new, strict=True))
    # a motor that is unwound by the cable turns faster than unloaded, at most by load over stall; 0.4 A is 84 N
    assert farthest < 1.6 * NO_LOAD * TICK_S


def test_a_tendon_that_goes_slack_and_taut_again_carries_what_it_did() -> None:
    plant = _run(_plant(), 12.0, _by_position(6e-3))
    before = plant.tension
    _run(plant, 2.0, _by_position(-6e-3))
    assert _run(plant, 12.0, _by_position(6e-3)).tension == pytest.approx(before, rel=1e-4)


def test_a_joint_of_stiff_cables_and_light_head_needs_no_smaller_tick() -> None:
    values = {"tendons.cable_stiffness": 1e6, "tendons.servo_stiffness": 5e5, "inertia.head_mass": 0.3}
    guides = {"tendons.head_radius": 0.045, "tendons.base_radius": 0.045}
    plant = _run(_plant(rig=RIG.with_values(values | guides)), 12.0, _by_position(5e-3))
    before = plant.tension
    # cables so stiff ring on for long: the silicone that damps them has 2 % of their stiffness
    assert _run(plant, 0.5).tension == pytest.approx(before, rel=0.02)


@pytest.mark.slow
def test_a_joint_may_have_three_tendons() -> None:
    data = RIG.model_dump(exclude={"wiring"})
    data["tendons"]["count"] = 3
    plant = _run(_plant(rig=RigSpec.model_validate(data)), 4.0, _by_tension(15.0))
    assert plant.tension == pytest.approx([15.0] * 3)


def test_the_drive_by_duty_turns_at_the_speed_of_its_line() -> None:
    plant = _run(_plant(), 3.0, _by_tension(10.0))
    plant.set_law(4, Law("pwm", 0.6))
    _run(plant, 4.0)
    drive = RIG.drive
    torque = 0.6 * (drive.stall_torque.value + drive.friction.value) - drive.friction.value
    line = torque / drive.stall_torque.value * drive.no_load_speed.value
    assert plant.motion().drive.speed == pytest.approx(line, rel=0.02)


def test_the_drive_by_current_turns_with_the_torque_that_belongs_to_it() -> None:
    plant = _run(_plant(), 3.0, _by_tension(10.0))
    plant.set_law(4, Law("current", 0.5))
    _run(plant, 0.02)
    assert plant.motion().drive.current == pytest.approx(0.5)


def test_the_drive_by_speed_keeps_it() -> None:
    plant = _run(_plant(), 3.0, _by_tension(10.0))
    plant.set_law(4, Law("velocity", 2.0, 5.0))
    _run(plant, 4.0)
    assert plant.motion().drive.speed == pytest.approx(2.0, rel=0.05)


def test_the_drives_current_stays_within_its_limit() -> None:
    plant = _plant()
    plant.set_law(4, Law("position", 1.0, 4.6, current_limit=0.3))
    currents = [abs(_run(plant, TICK_S).motion().drive.current) for _ in range(400)]
    assert max(currents) == pytest.approx(0.3)


def test_the_drives_goal_is_approached_at_its_speed_limit() -> None:
    plant = _run(_plant(), 3.0, _by_tension(30.0))
    plant.set_law(4, Law("position", 3.0, 40.0, speed_limit=0.6))
    first = _run(plant, 2.0).motion().drive.angle
    assert _run(plant, 1.0).motion().drive.angle - first == pytest.approx(0.6, rel=0.02)


def test_a_drive_without_torque_draws_no_current() -> None:
    plant = _run(_plant(), 0.1)
    plant.set_law(4, Law("off"))
    assert _run(plant, 0.1).motion().drive.current == 0.0


def test_motors_start_where_they_are_said_to_be() -> None:
    plant = JointPlant(RIG, slack_m=[0.01] * 4, motors_at=[0.1, -0.2, 0.3, 0.0, 0.5])
    motion = plant.motion()
    assert [horn.angle for horn in (*motion.tendons, motion.drive)] == pytest.approx([0.1, -0.2, 0.3, 0.0, 0.5])


def _in_motion() -> JointPlant:
    plant = _run(_plant(), 3.0, _by_tension(20.0))
    plant.set_law(4, Law("position", 0.6, RIG.drive.position_gain.value))
    return _run(plant, 40 * TICK_S)


def test_a_reading_between_two_ticks_lies_on_the_way_between_them() -> None:
    plant = _in_motion()
    before = plant.motion().torsion
    between = _run(plant, 0.6 * TICK_S).motion().torsion
    after = _run(plant, 0.4 * TICK_S).motion().torsion
    assert between - before == pytest.approx(0.6 * (after - before), rel=0.02)


def test_many_short_advances_are_one_long_one() -> None:
    ours, others = _in_motion(), _in_motion()
    for _ in range(50):
        _run(ours, 0.37 * TICK_S)
    others.advance(ours.motion().time)
    assert ours.motion() == others.motion()


def test_a_time_that_has_passed_changes_nothing() -> None:
    plant = _in_motion()
    motion = plant.motion()
    plant.advance(1.0)
    assert plant.motion() == motion


def test_every_tendon_needs_its_slack() -> None:
    with pytest.raises(SpecError, match="3 slacks"):
        JointPlant(RIG, slack_m=[0.0] * 3)


@pytest.mark.parametrize("phase", [0.0, 0.1, 0.5, 0.9])
def test_a_goal_of_the_drive_is_in_its_current_at_once_wherever_in_a_tick_it_comes(phase: float) -> None:
    # At rest a motor without inductance carries δV/R = gain · goal · stall current · V/V_nominal (data sheet).
    drive, goal = RIG.drive, 0.1
    plant = JointPlant(RIG, slack_m=[0.01] * 4)
    _run(plant, (7 + phase) * TICK_S)
    plant.set_law(4, Law("position", goal, drive.position_gain.value))
    share = drive.supply_voltage.value / drive.nominal_voltage.value
    expected = drive.position_gain.value * goal * drive.stall_current.value * share
    assert plant.horn(4).current == pytest.approx(expected, rel=1e-6)
