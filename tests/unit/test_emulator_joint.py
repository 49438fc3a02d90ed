"""The joint behind its motors, against the twin and against closed forms."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.emulator.joint import TICK_S
from sinew.emulator.plant import GEAR_HOLD, JointPlant, Law
from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.solve.march import Track
from sinew.solve.programs import configure
from sinew.twin.simulate import lane_parameters, simulate_tracks

# The joint behind its motors, against the twin and against closed forms.


configure()
RIG = load_rig("paper")
RADIUS = RIG.tendons.pulley_radius.value
NEWTON = RADIUS / RIG.tendons.torque_constant.value  # [A/N]
GUIDE = RIG.tendons.head_radius.value
CABLE, SERVO = RIG.tendons.cable_stiffness.value, RIG.tendons.servo_stiffness.value
SERIES = 1 / (1 / CABLE + 1 / SERVO)
GAIN = 900 / 128 / 885 * 4096 / math.tau
BENDING = 1.5 * RIG.silicone.torsional_rigidity.value / RIG.silicone.length.value
DRIVE_GAIN = RIG.drive.position_gain.value
SETTLED_S = 12.0


def _by_position(wound_m: float, limit_n: float = math.inf) -> Law:
    return Law("position", wound_m / RADIUS, GAIN, current_limit=limit_n * NEWTON)


def _pulled(laws: list[Law], rig: RigSpec = RIG, **settings: object) -> JointPlant:
    """Return a joint that has come to rest under laws of its tendon motors, the lever held."""
    plant = JointPlant(rig, **{"slack_m": [0.0] * 4, **settings})  # type: ignore[arg-type]
    for tendon, law in enumerate(laws):
        plant.set_law(tendon, law)
    plant.set_law(4, Law("position", 0.0, DRIVE_GAIN))
    plant.advance(SETTLED_S)
    return plant


def _swing(plant: JointPlant, frequency_hz: float, seconds: float) -> np.ndarray:
    """Return (torsion, lever, shortening, gyro) every 5 ms while the lever is told to swing by 20°, in steps."""
    start = plant.motion().time
    seen = []
    for tick in range(round(seconds / TICK_S)):
        if tick % 4 == 0:
            state = plant.state.motion
            seen.append((state.torsion, state.lever, state.shortening, state.gyro))
        half_way = (tick + 0.5) * TICK_S
        goal = math.radians(20) * math.sin(math.tau * frequency_hz * half_way)
        plant.set_law(4, Law("position", goal, DRIVE_GAIN))
        plant.advance(start + (tick + 1) * TICK_S)
    return np.array(seen).T


def _twin(pretension_mm: float, mode: TendonMode, rig: RigSpec = RIG) -> tuple[list[Law], Track]:
    """Return (laws that set the twin's pretension, the twin's swing at 3.6 Hz)."""
    group = Group("steady", pretension_mm, 3.6, 20.0, 0, 0.0, 2.0)
    lanes = lane_parameters([group], rig, mode=mode)
    end, held = float(lanes[0].cable_end[0]), float(lanes[0].held_tension[0])
    wound = RIG.tendons.free_span.value - end
    laws: dict[str, Law] = {
        "position": _by_position(wound),
        "position-with-current-limit": _by_position(wound, held),
        "current": Law("current", held * NEWTON),
    }
    return [laws[mode]] * 4, simulate_tracks(lanes, [group], 200.0)[0]


MODES: list[TendonMode] = ["position", "position-with-current-limit", "current"]


SLIDING = RIG.model_copy(update={"tendons": RIG.tendons.model_copy(update={"guide_law": "maxwell-slip"})})


@pytest.mark.parametrize(
    ("mode", "rig"), [*((mode, RIG) for mode in MODES), pytest.param("position", SLIDING, marks=pytest.mark.slow)]
)
def test_the_joint_swings_as_the_twin_does(mode: TendonMode, rig: RigSpec) -> None:
    laws, track = _twin(6.0, mode, rig)
    seen = _swing(_pulled(laws, rig), 3.6, 2.0)
    truth = np.array([track.torsion, track.lever, track.shortening, track.gyro])[:, : seen.shape[1]]
    assert (np.abs(seen - truth).max(axis=1) / (0.5 * np.ptp(truth, axis=1)) < 1e-3).all()


@pytest.mark.parametrize("mode", MODES)
def test_pretension_is_what_the_twin_calls_so(mode: TendonMode) -> None:
    assert _pulled(_twin(6.0, mode)[0]).pretension == pytest.approx(6e-3, abs=1e-8)


def test_a_pull_by_current_from_unequal_slack_ends_with_the_tension_asked_for() -> None:
    plant = _pulled([Law("current", 12.0 * NEWTON)] * 4, slack_m=[1e-3, 3e-3, 0.0, 5e-3])
    assert plant.tension == pytest.approx([12.0] * 4, rel=0.01)


def test_a_rest_bend_under_equal_tensions_is_amplified_as_an_arc_is() -> None:
    rest, tension = math.radians(2.0), 20.0
    plant = _pulled([Law("current", tension * NEWTON)] * 4, rest_tilt=(0.0, rest))
    span = RIG.tendons.free_span.value - plant.state.motion.shortening
    # V = ½ B (t - t_0)² + 4 T ℓ (1 - t²/24): the chords of an arc are shorter than the arc
    expected = BENDING * rest / (BENDING - 4 * tension * span / 12)
    assert plant.motion().tilt == pytest.approx((0.0, expected), rel=0.02, abs=1e-6)


def test_tendons_pulled_unequally_tilt_the_plate_towards_the_shorter() -> None:
    differ = 0.2e-3
    plant = _pulled([_by_position(7e-3 + share * differ) for share in (1, 0, -1, 0)])
    tendons = 2 * SERIES * GUIDE**2
    bending = BENDING - sum(plant.tension) * RIG.tendons.free_span.value / 12
    # tendon 1 is at +y, where a rotation about z makes the plate sink
    assert plant.motion().tilt == pytest.approx(
        (0.0, differ / GUIDE * tendons / (tendons + bending)), rel=0.02, abs=1e-6
    )


def test_a_tilted_plate_leans_the_accelerometer() -> None:
    plant = _pulled([Law("off")] * 4, slack_m=[5e-3] * 4, rest_tilt=(math.radians(3), math.radians(-4)))
    lean = 9.80665 * math.sin(math.radians(5)) / 5
    force = plant.motion().acceleration
    assert force == pytest.approx((9.80665 * math.cos(math.radians(5)), 4 * lean, 3 * lean), rel=1e-5)


def test_the_gyro_turns_with_the_head_when_the_plate_tilts_back() -> None:
    plant = _pulled([Law("current", 20 * NEWTON)] * 4, rest_tilt=(0.02, 0.0))
    plant.set_law(4, Law("position", 1.5, DRIVE_GAIN))
    plant.set_law(1, Law("current", 35 * NEWTON))
    plant.advance(SETTLED_S + 0.05)
    before = plant.motion()
    plant.advance(SETTLED_S + 0.05 + TICK_S)
    after = plant.motion()
    rate = np.subtract(after.tilt, before.tilt) / TICK_S
    turn = before.torsion
    seen = [math.cos(turn) * rate[0] + math.sin(turn) * rate[1], math.cos(turn) * rate[1] - math.sin(turn) * rate[0]]
    assert before.gyro[1:] == pytest.approx(seen, rel=0.05, abs=1e-3)


def test_a_lever_that_is_placed_by_hand_takes_no_time() -> None:
    plant = JointPlant(RIG, slack_m=[-5e-4] * 4)
    plant.push(0.3)
    plant.advance(0.05)
    before = plant.motion()
    plant.place_lever(before.drive.angle)
    after = plant.motion()
    assert abs(before.torsion_rate) > 0.1
    assert (after.torsion, after.torsion_rate, after.tension) == (before.torsion, before.torsion_rate, before.tension)


# The tendon motors and the drive of the joint: laws, limits, faults, time.


NO_LOAD = math.pi  # 30 rpm at 12 V
STALL_N = 3.4 / RADIUS  # at 12 V


def _plant(slack_m: float = 0.0, rig: RigSpec = RIG, **given_too: object) -> JointPlant:
    plant = JointPlant(rig, slack_m=[slack_m] * rig.tendons.count, **given_too)  # type: ignore[arg-type]
    plant.set_supply(12.0)
    plant.set_law(rig.tendons.count, Law("position", 0.0, RIG.drive.position_gain.value))
    return plant


def _towards(wound_m: float, **limits: float) -> Law:
    return Law("position", wound_m / RADIUS, GAIN, **limits)


def _by_tension(tension_n: float) -> Law:
    return Law("current", tension_n * NEWTON)


def _run(plant: JointPlant, seconds: float, laws: list[Law] | Law | None = None) -> JointPlant:
    if laws is not None:
        for tendon, law in enumerate(laws if isinstance(laws, list) else [laws] * plant.count):
            plant.set_law(tendon, law)
    plant.advance(plant.motion().time + seconds)
    return plant


def test_a_current_limit_bounds_the_tension_of_a_position_goal() -> None:
    plant = _run(_plant(), 4.0, _towards(15e-3, current_limit=30 * NEWTON))
    assert plant.tension == pytest.approx([30.0] * 4)


def test_duty_pulls_with_its_share_of_the_stall_torque() -> None:
    assert _run(_plant(3e-3), 15.0, Law("pwm", 0.08)).tension == pytest.approx([0.08 * STALL_N] * 4, rel=1e-3)


def test_a_speed_is_kept_until_the_current_limit_holds_it_up() -> None:
    plant = _run(_plant(), 4.0, Law("velocity", 1.0, current_limit=25 * NEWTON))
    assert plant.tension == pytest.approx([25.0] * 4, rel=1e-3)


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


def test_a_stuck_tendon_keeps_its_horn_whatever_it_is_told() -> None:
    plant = _run(_plant(), 3.0, _by_tension(20.0))
    plant.stick(1, True)
    before = plant.motion().tendons[1].angle
    _run(plant, 1.0, [_by_tension(40.0), _towards(0.02), _by_tension(40.0), Law("off")])
    assert plant.motion().tendons[1].angle == before


def test_a_slip_lowers_the_tension_by_the_stiffness_of_cable_and_servo() -> None:
    plant = _run(_plant(), 4.0, _towards(8e-3))
    before = plant.tension
    plant.slip(2, 0.1e-3)
    assert before[2] - plant.tension[2] == pytest.approx(SERIES * 0.1e-3)


def test_a_slip_is_missing_from_the_pretension() -> None:
    plant = _run(_plant(), 4.0, _towards(8e-3))
    before = plant.pretension
    for tendon in range(4):
        plant.slip(tendon, 0.3e-3)
    assert before - _run(plant, 4.0).pretension == pytest.approx(0.3e-3, rel=1e-6)


LAWS = st.sampled_from(
    [
        Law("off"),
        *(Law("current", ampere) for ampere in (-0.1, 0.0, 0.05, 0.4)),
        *(_towards(wound) for wound in (-5e-3, 0.0, 4e-3, 9e-3)),
        _towards(12e-3, current_limit=0.1),
        _towards(12e-3, duty_limit=0.1, speed_limit=0.3),
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


def test_a_joint_of_stiff_cables_and_light_head_needs_no_smaller_tick() -> None:
    values = {"tendons.cable_stiffness": 1e6, "tendons.servo_stiffness": 5e5, "inertia.head_mass": 0.3}
    guides = {"tendons.head_radius": 0.045, "tendons.base_radius": 0.045}
    plant = _run(_plant(rig=RIG.with_values(values | guides)), 12.0, _towards(5e-3))
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


def test_the_drives_goal_is_approached_at_its_speed_limit() -> None:
    plant = _run(_plant(), 3.0, _by_tension(30.0))
    plant.set_law(4, Law("position", 3.0, 40.0, speed_limit=0.6))
    first = _run(plant, 2.0).motion().drive.angle
    assert _run(plant, 1.0).motion().drive.angle - first == pytest.approx(0.6, rel=0.02)


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
