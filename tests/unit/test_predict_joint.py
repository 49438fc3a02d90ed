"""The joint's steady motions: the twin's own equations, its linear response, its refusals."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.unit.prony import complex_stiffness

from sinew.mechanics.joint import State, potential, rate
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import BRANCHES
from sinew.plan.toml import load_rig
from sinew.predict.joint import RESOLUTION, free_lever, joint_problem, prescribed_lever
from sinew.solve.balance import Size, channels, grid, unknowns
from sinew.solve.curves import predict
from sinew.twin.parameters import Effects

BAND_HZ = (1.0, 6.0)


def one_lane(problem) -> Parameters:  # type: ignore[no-untyped-def]
    return jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), problem.lane.p)


@pytest.mark.slow
def test_the_lagging_copies_obey_the_twins_equation_of_the_silicones_memory() -> None:
    problem = joint_problem(load_rig("paper"), [6.0], 20.0, BAND_HZ)
    p, omega, size = one_lane(problem), 2 * np.pi * 3.3, Size(5, 16)
    q = jnp.asarray(np.random.default_rng(7).normal(size=unknowns(free_lever(1), 5))) * 1e-2
    at = grid(free_lever(1), size)
    u = channels(q, jnp.asarray(omega), free_lever(1), at, 5).values
    torsion, memory, zero = u[0], u[2 : 2 + BRANCHES], jnp.zeros(())

    @jax.jit
    @partial(jax.vmap, in_axes=(0, 1))
    def rates_of_memory(angle: jax.Array, copies: jax.Array) -> tuple[jax.Array, ...]:
        return rate(zero, State(angle, *[zero] * 5, tuple(copies), (zero,) * BRANCHES, zero, zero, (zero,)), p).memory

    for i in range(BRANCHES):
        # The twin's rate of the memory, against the change of the copy from sample to sample (half a period, odd).
        copy = np.asarray(memory[i])
        rates = np.asarray(rates_of_memory(torsion, memory)[i])
        odd = np.concatenate([copy, -copy])
        orders = np.fft.fftfreq(odd.size, 1 / odd.size)
        slope = np.fft.ifft(1j * orders * omega * np.fft.fft(odd)).real[: at.phase.size]
        assert rates == pytest.approx(slope, rel=1e-9, abs=1e-9 * np.abs(slope).max())


@pytest.mark.slow
def test_a_small_motion_without_friction_is_the_linear_response_of_the_joint() -> None:
    effects = Effects().without("guide_friction", "drive_dynamics")
    problem = joint_problem(load_rig("paper"), [6.0], 0.05, BAND_HZ, effects=effects)
    branch = predict(problem, BAND_HZ, RESOLUTION).branches[0]
    p = one_lane(problem)
    shortening = jnp.asarray(problem.rest[0, 1])
    relaxed = float(jax.grad(jax.grad(potential))(jnp.zeros(()), shortening, p))
    silicone = float(p.torsional_rigidity / (p.length - shortening))
    omega = 2 * np.pi * branch.frequency_hz
    prony = silicone * (complex_stiffness(np.array(p.prony_shares), branch.frequency_hz) - 1)
    stiffness = relaxed + prony - float(p.head + p.lever) * omega**2
    gain = float(p.lever) * omega**2 / stiffness
    assert branch.amplitude == pytest.approx(np.radians(0.05) * np.abs(gain), rel=2e-4)
    assert branch.phase == pytest.approx(-np.angle(gain), abs=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize("amplitude_deg", [8.0, 20.0, 40.0])
def test_a_curve_read_on_straight_lines_is_that_of_many_more_points(amplitude_deg: float) -> None:
    problem = joint_problem(load_rig("paper"), [0.0, 5.0, 12.0], amplitude_deg, BAND_HZ)
    fine = RESOLUTION._replace(stride=RESOLUTION.stride._replace(most=0.03, correction=2e-3), stability=False)
    for few, many in zip(*(predict(problem, BAND_HZ, each).branches for each in (RESOLUTION, fine)), strict=True):
        assert many.frequency_hz.size > 3 * few.frequency_hz.size
        read = np.interp(many.frequency_hz, few.frequency_hz, few.amplitude)
        assert read == pytest.approx(many.amplitude, abs=2.5e-3 * many.amplitude.max())
        assert (few.complete, len(few.folds)) == (True, 0) == (many.complete, len(many.folds))
        assert np.all(np.diff(few.frequency_hz) > 0)
        assert few.peak is not None
        assert many.peak is not None
        assert few.phase_90 is not None
        assert many.phase_90 is not None
        assert few.peak.frequency_hz == pytest.approx(many.peak.frequency_hz, rel=2e-3)
        assert few.peak.amplitude == pytest.approx(many.peak.amplitude, rel=2e-3)
        assert few.phase_90.frequency_hz == pytest.approx(many.phase_90.frequency_hz, rel=1e-4)


def test_a_prescribed_lever_leaves_three_coordinates() -> None:
    problem = joint_problem(load_rig("paper"), [0.0], 5.0, BAND_HZ, effects=Effects().without("drive_dynamics"))
    assert problem.equations is prescribed_lever(1)
    assert problem.rest.shape == (1, 3)
