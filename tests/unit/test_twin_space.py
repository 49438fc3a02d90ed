"""The twin in space: its motion against the torsional twin, its energy and its linear equations; its sensors."""

import os

import jax.numpy as jnp
import numpy as np
import pytest
from campaigns.space import (
    RIG,
    SAMPLE_HZ,
    bent,
    energy_residual,
    gains,
    head_of,
    modes_of,
    peak,
    steady,
    struck_frequencies,
    struck_lane,
)
from scipy import signal

import sinew as sn
from sinew.measure.attitude import head_axis
from sinew.measure.errors import SpecError
from sinew.mechanics.space import Motion, Pull, free_acceleration, space_at_rest, state_rate
from sinew.plan.plan import STRAIGHT
from sinew.solve.march import runge_kutta, runge_kutta_samples
from sinew.solve.programs import configure, use_all_cores
from sinew.twin.parameters import Effects, space_from_rig
from sinew.twin.simulate import lane_parameters, simulate_tracks
from sinew.twin.space import space_lanes, swing_lanes

configure()


@pytest.mark.parametrize("own", [None, "3"])
def test_plans_in_space_ask_for_all_cores_and_a_users_own_number_stays(
    own: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NPROC", "3")
    if own is None:
        monkeypatch.delenv("NPROC")
    use_all_cores()
    assert os.environ["NPROC"] == (own or str(os.cpu_count()))


def test_evaluations_in_a_loop_give_the_steps_of_runge_kutta() -> None:
    def slope(time_s: jnp.ndarray, y: jnp.ndarray) -> jnp.ndarray:
        return jnp.stack([y[1], -y[0] + jnp.sin(3 * time_s)])

    step, y = jnp.asarray(0.05), jnp.asarray([1.0, 0.2])
    expected = [y]
    for n in range(12):
        expected.append(runge_kutta(slope, n * step, expected[-1], step))
    end, seen = runge_kutta_samples(
        lambda t, y: (slope(t, y), y), jnp.zeros(()), y, 3 * step, jnp.asarray(4), jnp.asarray(3), 6
    )
    np.testing.assert_allclose(seen[:4], jnp.stack(expected[0:12:3]), rtol=0, atol=1e-14)
    np.testing.assert_allclose(end, expected[12], rtol=0, atol=1e-14)


def test_the_gyroscope_in_space_is_butterworths_low_pass() -> None:
    space = space_from_rig(RIG)
    state, zero = space_at_rest(jnp.zeros((6, 3)), space), jnp.zeros(())

    def rate(spin: float, gyro: float, gyro_rate: float) -> float:
        now = state._replace(gyro=jnp.full(3, gyro), gyro_rate=jnp.full(3, gyro_rate))
        moved = Motion(None, None, None, None, jnp.full(3, spin), None, None, None)
        felt = Pull(None, None, zero, None, None)
        return float(state_rate(now, jnp.zeros(18), zero, moved, felt, space).gyro_rate[1])

    gain, poles = signal.butter(2, float(space.rod.joint.low_pass_omega), analog=True)
    assert [rate(1, 0, 0), -rate(0, 1, 0), -rate(0, 0, 1)] == pytest.approx([gain[-1], poles[2], poles[1]])


@pytest.mark.parametrize("prescribed", [False, True])
def test_a_prescribed_lever_accelerates_as_it_is_told_and_another_by_its_servo(prescribed: bool) -> None:
    space, coupling = space_from_rig(RIG), 1e-6
    inertia = float(space.lever_tensor[0] + space.rod.joint.armature)
    row, mass, zero = jnp.eye(18)[0] * coupling, 1e-3 * jnp.eye(18), jnp.zeros(())
    moved = Motion(mass, row, None, zero, None, None, None, None)
    joint, lever = free_acceleration(
        jnp.zeros(18), jnp.asarray(0.1), moved, space._replace(added=0.0), 7.0, prescribed, jnp.linalg.solve
    )
    # m q̈ + c θ̈ = 0, c q̈ + I θ̈ = 0.1
    expected = 7.0 if prescribed else 0.1 / (inertia - coupling**2 / 1e-3)
    assert [float(lever), float(joint[0])] == pytest.approx([expected, -coupling * expected / 1e-3])


def test_tendons_that_hold_a_tension_are_not_driven() -> None:
    sweep = sn.Sweep(frequency_hz=(3.0,), drive="pitch", amplitude_mm=0.5, repeats=1)
    held = sn.Pretension(pretension_mm=(4.0,), mode="current")
    with pytest.raises(SpecError, match="expected motors that hold positions"):
        sn.simulate(sn.Plan(name="driven", pretension=held, sweep=sweep), RIG)


@pytest.mark.slow
def test_a_straight_joint_in_space_resonates_as_the_torsional_twin() -> None:
    hz = np.array([3.55, 3.6, 3.65])
    groups = [steady(f) for f in hz]
    flat = peak(
        hz, gains([t.torsion for t in simulate_tracks(lane_parameters(groups, RIG), groups, SAMPLE_HZ)], groups)
    )
    swings = swing_lanes(space_lanes(groups, RIG), groups, SAMPLE_HZ)
    top = peak(hz, gains([head_of(s, STRAIGHT).torsion for s in swings], groups))
    assert top[0] == pytest.approx(flat[0], rel=2e-3)
    assert top[1] == pytest.approx(flat[1], rel=5e-3)


@pytest.mark.slow
def test_a_struck_bent_joint_sings_at_its_linear_modes() -> None:
    lanes = struck_lane(bent(20), 6.0)
    found = modes_of(lanes)
    seen = struck_frequencies(lanes, found, bent(20))
    np.testing.assert_allclose(seen, [m.frequency_hz for m in found], rtol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("frequency_hz", [3.7, 5.5])
def test_energy_of_a_bent_run_is_kept(frequency_hz: float) -> None:
    assert energy_residual(space_lanes([steady(frequency_hz, 6.0, pose=bent(20))], RIG)) < 1e-6


@pytest.mark.slow
def test_a_bent_recording_says_how_the_head_stands_and_what_its_chip_feels() -> None:
    sweep = sn.Sweep(frequency_hz=(3.5,), settle_s=0.5, periods=1, repeats=1)
    plan = sn.Plan(name="bent", pose=bent(20), pretension=sn.Pretension(pretension_mm=(6.0,)), sweep=sweep)
    quiet = Effects().without("sensor_noise", "stamp_jitter", "repeatability")
    recording = sn.simulate(plan, RIG, effects=quiet)
    rest = recording.isel(sample=slice(0, 200))
    x, y, z = head_axis(rest["orientation"].values).T
    np.testing.assert_allclose(np.degrees([np.arctan2(-z, x), y]).T, [[-20.0, 0.0]] * 200, atol=1e-3)
    felt = 9.80665 * np.array([np.cos(np.radians(20)), 0.0, -np.sin(np.radians(20))])
    np.testing.assert_allclose(rest["acceleration_m_s2"].values[0], felt, atol=1e-3)
    assert recording.attrs["schema"] == "sinew-recording-2"
