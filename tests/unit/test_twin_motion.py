"""Motion of the twin: energy balance, step size, damping and hardening, switches."""

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import find_peaks

from sinew.mechanics.joint import State, dissipation, mechanical_energy, rate, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.solve.march import Track
from sinew.solve.programs import configure
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, simulate_tracks

configure()
SAMPLE_HZ = 200.0


@pytest.fixture(scope="module")
def rig() -> RigSpec:
    return load_rig("paper")


def _steady(pretension_mm: float, frequency_hz: float, record_s: float = 1.5) -> Group:
    return Group("steady", pretension_mm, frequency_hz, 20.0, 0, 3.0, record_s)


def _ring_down(pretension_mm: float, frequency_hz: float, amplitude_deg: float = 20.0) -> Group:
    return Group("ring-down", pretension_mm, frequency_hz, amplitude_deg, 0, 9 / frequency_hz, 8.0)


def _one_lane(group: Group, rig: RigSpec, effects: Effects | None = None) -> tuple[Parameters, State]:
    p, x = lane_parameters([group], rig, effects=effects)
    p = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), p)
    return p, state_at_rest(jnp.asarray(x[0]), p)


def _solve(group: Group, rig: RigSpec, duration_s: float):  # type: ignore[no-untyped-def]
    """Return (solution, unravel, p) of scipy's DOP853 with the two work integrals appended to the state."""
    p, start = _one_lane(group, rig)
    flat, unravel = jax.flatten_util.ravel_pytree(start)

    @jax.jit
    def slope(t: jax.Array, y: jax.Array) -> jax.Array:
        state = unravel(y[:-2])
        derivative, _ = jax.flatten_util.ravel_pytree(rate(t, state, p))
        return jnp.concatenate([derivative, jnp.stack(dissipation(t, state, p))])

    y0 = np.concatenate([flat, [0.0, 0.0]])
    solution = solve_ivp(
        lambda t, y: np.asarray(slope(t, y)),
        (0, duration_s),
        y0,
        "DOP853",
        rtol=1e-9,
        atol=1e-11,
        max_step=0.005,
        dense_output=True,
    )
    return solution, unravel, p


def test_energy_balance_closes_to_a_millionth_of_the_work(rig: RigSpec) -> None:
    solution, unravel, p = _solve(_steady(6.0, 3.6), rig, 2.0)
    first, last = (unravel(jnp.asarray(solution.y[:-2, i])) for i in (0, -1))
    lost, delivered = solution.y[-2:, -1]
    gained = float(mechanical_energy(last, p) - mechanical_energy(first, p))
    assert delivered > 1.0
    assert abs(gained - (delivered - lost)) < 1e-6 * delivered


def test_fixed_step_tracks_agree_with_scipys_adaptive_integrator(rig: RigSpec) -> None:
    group = Group("steady", 6.0, 3.6, 20.0, 0, 0.0, 2.0)
    solution, _, _ = _solve(group, rig, 2.0)
    track = simulate_tracks(lane_parameters([group], rig), [group], SAMPLE_HZ)[0]
    time_s = np.arange(track.torsion.size) / SAMPLE_HZ
    reference = solution.sol(time_s)
    assert np.max(np.abs(track.torsion - reference[0])) < 1e-3 * np.max(np.abs(reference[0]))
    assert np.max(np.abs(track.lever - reference[4])) < 1e-3 * np.max(np.abs(reference[4]))


@pytest.mark.slow
def test_halving_the_step_moves_amplitudes_by_less_than_a_thousandth(rig: RigSpec) -> None:
    groups = [_steady(p, f) for p in (0.0, 6.0, 12.0) for f in (1.5, 3.0, 3.6, 4.3, 6.0)]
    lanes = lane_parameters(groups, rig)
    coarse, fine = (simulate_tracks(lanes, groups, SAMPLE_HZ, steps=steps) for steps in (4, 8))
    for a, b in zip(coarse, fine, strict=True):
        assert np.ptp(a.torsion[600:]) == pytest.approx(np.ptp(b.torsion[600:]), rel=1e-3)


def _lehr(track: Track, group: Group) -> float:
    """Return the damping ratio from the logarithmic decrement of the half-cycle peaks between 2° and 20°."""
    torsion = track.torsion[group.sample_counts(SAMPLE_HZ)[0] :]
    at, _ = find_peaks(np.abs(torsion), height=np.radians((2, 20)))
    slope = np.polyfit(np.arange(at.size), np.log(np.abs(torsion[at])), 1)[0]
    return float(-slope / np.pi)


def _lehr_over_pretension(rig: RigSpec, *off: str) -> list[float]:
    groups = [_ring_down(p, 3.0 + 1.3 * p / 12, amplitude_deg=6.0) for p in (0.0, 6.0, 12.0)]
    lanes = lane_parameters(groups, rig, effects=Effects().without("drive_dynamics", *off))
    tracks = simulate_tracks(lanes, groups, SAMPLE_HZ)
    return [_lehr(track, group) for track, group in zip(tracks, groups, strict=True)]


@pytest.mark.slow
def test_damping_of_silicone_alone_falls_with_pretension_and_that_of_the_guides_grows(rig: RigSpec) -> None:
    """The argument for guide friction: geometric stiffness is lossless, so it dilutes the silicone's loss."""
    silicone, both = _lehr_over_pretension(rig, "guide_friction"), _lehr_over_pretension(rig)
    assert silicone[0] > silicone[1] > silicone[2]
    assert silicone[2] < 0.9 * silicone[0]
    added = [b - a for a, b in zip(silicone, both, strict=True)]
    assert 0 < added[0] < added[1] < added[2]


def test_without_any_loss_the_free_joint_keeps_its_amplitude(rig: RigSpec) -> None:
    effects = Effects().without("silicone_loss", "guide_friction", "drive_dynamics", "axial_motion")
    group = _ring_down(6.0, 3.4)
    track = simulate_tracks(lane_parameters([group], rig, effects=effects), [group], SAMPLE_HZ)[0]
    torsion = np.abs(track.torsion[group.sample_counts(SAMPLE_HZ)[0] + 20 :])
    peaks = torsion[find_peaks(torsion)[0]]
    assert peaks[-3:].mean() == pytest.approx(peaks[:3].mean(), rel=0.01)


def test_drive_cannot_follow_a_fast_sine_and_its_duty_saturates(rig: RigSpec) -> None:
    slow, fast = (_steady(0.0, f) for f in (0.5, 5.0))
    tracks = simulate_tracks(lane_parameters([slow, fast], rig), [slow, fast], SAMPLE_HZ)
    assert np.abs(tracks[0].lever).max() > 0.85 * np.radians(20)
    drive = rig.drive
    fastest = drive.no_load_speed.value * drive.supply_voltage.value / drive.nominal_voltage.value
    ceiling = fastest / (4 * 5.0)  # a triangle at no-load speed: a quarter period from zero to peak
    assert np.abs(tracks[1].lever[600:]).max() < ceiling < np.radians(20)
    assert np.abs(tracks[1].duty).max() == pytest.approx(rig.drive.duty_limit.value)


def test_prescribed_lever_follows_its_command_exactly(rig: RigSpec) -> None:
    group = _steady(0.0, 4.0)
    lanes = lane_parameters([group], rig, effects=Effects().without("drive_dynamics"))
    lever = simulate_tracks(lanes, [group], SAMPLE_HZ)[0].lever
    time_s = np.arange(lever.size) / SAMPLE_HZ
    np.testing.assert_allclose(lever, np.radians(20) * np.sin(2 * np.pi * 4.0 * time_s), atol=1e-5)


def test_progress_counts_up_to_the_whole_simulated_time(rig: RigSpec) -> None:
    seen: list[tuple[float, float]] = []
    groups = [_steady(0.0, 3.0)] * 3
    simulate_tracks(
        lane_parameters(groups, rig), groups, SAMPLE_HZ, progress=lambda done, total: seen.append((done, total))
    )
    assert seen[-1][0] == pytest.approx(seen[-1][1]) == pytest.approx(3 * 4.5)


def test_a_locked_lever_keeps_its_place_after_the_stop_and_a_servo_lets_it_recoil(rig: RigSpec) -> None:
    group = _ring_down(0.0, 3.0)
    after = group.sample_counts(SAMPLE_HZ)[0] + 2
    travel = {}
    for effects in (Effects(), Effects().without("drive_recoil")):
        track = simulate_tracks(lane_parameters([group], rig, effects=effects), [group], SAMPLE_HZ)[0]
        travel[effects.drive_recoil] = np.ptp(track.lever[after:])
    assert travel[False] < np.radians(0.01)
    assert travel[True] > np.radians(1)
