"""The joint behind its motors, against the twin and against closed forms."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from sinew.emulator.joint import TICK_S
from sinew.emulator.joint_plant import JointPlant
from sinew.emulator.plant import Law
from sinew.mechanics.joint import State
from sinew.mechanics.silicone import silicone_energy, viscoelastic_energy
from sinew.mechanics.tendons import head_pose, span_lengths
from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.solve.march import Track
from sinew.solve.programs import configure
from sinew.twin.parameters import from_rig
from sinew.twin.simulate import lane_parameters, simulate_tracks

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


def test_equal_tendons_keep_a_straight_joint_level_while_it_swings() -> None:
    plant = _pulled(_twin(6.0, "position")[0])
    _swing(plant, 3.6, 0.5)
    assert plant.tilt_angle < 1e-9


def _stored(plant: JointPlant) -> float:
    """Return kinetic and elastic energy of a joint on motors that hold their position [J]."""
    (state, tilt), p = plant.state, from_rig(RIG)
    motion = State(*(tuple(map(jnp.asarray, x)) if isinstance(x, tuple) else jnp.asarray(x) for x in state))  # type: ignore[arg-type]
    lever = state.torsion_rate + state.lever_rate
    inertia = RIG.inertia
    kinetic = inertia.head.value * state.torsion_rate**2 + inertia.lever.value * lever**2
    kinetic += RIG.drive.armature.value * state.lever_rate**2 + inertia.head_mass.value * state.shortening_rate**2
    elastic = silicone_energy(motion.torsion, motion.shortening, p)
    elastic += viscoelastic_energy(motion.torsion, motion.shortening, motion.memory, motion.axial_memory, p)
    tendons = sum(tension**2 for tension in plant.tension) / SERIES
    return float(elastic) + 0.5 * float(kinetic + tendons + BENDING * (tilt[0] ** 2 + tilt[1] ** 2))


@pytest.mark.slow
def test_a_joint_that_nothing_drives_only_loses_energy() -> None:
    rig = RIG.with_values({"tendons.guide_friction": 0.0})  # bristles would give back what they took
    plant = _pulled([_by_position(wound) for wound in (6e-3, 7e-3, 8e-3, 6.5e-3)], rig)
    _swing(plant, 3.4, 1.5)
    plant.set_law(4, Law("off"))
    start = plant.motion().time
    energies = []
    for tick in range(1600):
        plant.advance(start + tick * TICK_S)
        energies.append(_stored(plant))
    assert np.diff(energies).max() < 1e-6 * energies[0]


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


def test_tilt_takes_five_milliseconds_to_come_on_locked_tendons() -> None:
    plant = _pulled([_by_position(7e-3)] * 4)
    for tendon, wound in enumerate((7.02e-3, 7e-3, 6.98e-3, 7e-3)):  # 0.02 mm: half a millisecond of winding
        plant.set_law(tendon, _by_position(wound))
    plant.advance(SETTLED_S + 6e-3)
    early = plant.tilt_angle
    plant.advance(SETTLED_S + 0.2)
    assert 0.55 < early / plant.tilt_angle < 0.8


def test_a_tilted_head_stands_at_the_end_of_an_arc() -> None:
    p, tilt = from_rig(RIG), (0.12, -0.2)
    zero = jnp.zeros(())
    lengths = span_lengths(zero, zero, p, (jnp.asarray(tilt[0]), jnp.asarray(tilt[1])))
    bend = math.hypot(*tilt)
    span = RIG.tendons.free_span.value
    # a tendon at (y, z) is the chord of an arc whose radius is shorter by how far it lies on the inside of the bend
    inside = [(tilt[1] * y - tilt[0] * z) * GUIDE / bend for y, z in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    np.testing.assert_allclose(lengths, [2 * (span / bend - r) * math.sin(bend / 2) for r in inside], rtol=1e-6)


def test_the_pose_of_a_twisted_and_tilted_head_is_a_rotation() -> None:
    rows, _ = head_pose(jnp.asarray(0.9), jnp.zeros(()), jnp.asarray(0.095), (jnp.asarray(0.3), jnp.asarray(-0.4)))
    rotation = np.array(rows)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-7)


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
