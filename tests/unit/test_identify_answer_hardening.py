"""Is the hardening real: asked of the twin with and without friction, whose static energy is known."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from tests.unit.identify_campaigns import RIG, SMALL, whole_campaign

from sinew.mechanics.joint import potential
from sinew.mechanics.parameters import Parameters
from sinew.paper.answer import Answer
from sinew.paper.hardening import answer_hardening
from sinew.plan.plan import Group, Plan, Sweep
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, simulate

ELASTIC = Effects().without("guide_friction", "silicone_loss")
VISCOUS = RIG.with_values({"silicone.viscous": 0.025})


@pytest.fixture(scope="module")
def elastic() -> xr.Dataset:
    """A campaign on a twin without friction and memory, damped by a dashpot: its force law is that of the energy."""
    sweep = Sweep(frequency_hz=(2.4, 2.7, 2.9, 3.0, 3.1, 3.3, 3.6, 4.2), amplitude_deg=8.0, repeats=3)
    return simulate(Plan(name="smooth", pretension=SMALL.pretension, sweep=sweep), VISCOUS, seed=21, effects=ELASTIC)


@pytest.fixture(scope="module")
def whole() -> xr.Dataset:
    """A campaign on the twin with all effects."""
    return whole_campaign()


@jax.jit
def static_torque(phi: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return ∂V/∂φ of the static energy [N m] at torsions (n,), the head sunk to where V is least over shortening."""
    slope = jax.grad(potential, 1)

    def at(angle: jax.Array) -> jax.Array:
        def newton(_: int, x: jax.Array) -> jax.Array:
            return jnp.asarray(x - slope(angle, x, p) / jax.grad(slope, 1)(angle, x, p))

        return jnp.asarray(jax.grad(potential, 0)(angle, jax.lax.fori_loop(0, 10, newton, shortening), p))

    return jax.vmap(at)(phi)


def static_cubic(pretension_mm: float, swing_rad: float) -> float:
    """Return k₃/I [1/(s² rad²)] of the static energy: the cubic law nearest to its torque up to a swing.

    Nearest in the sense of a sine of that amplitude: the torque's first harmonic is k A + ¾ k₃ A³, k A for a small one.
    """
    group = Group("idle", pretension_mm, math.nan, math.nan, 0, 0.0, 1.0)
    lanes, shortening = lane_parameters([group], RIG, effects=ELASTIC)
    p: Parameters = jax.tree.map(lambda leaf: jnp.asarray(leaf)[0], lanes)
    wave = np.sin(2 * np.pi * (np.arange(64) + 0.5) / 64)
    swings = np.array([1e-3, swing_rad])
    torque = np.asarray(static_torque(jnp.asarray(np.outer(swings, wave).ravel()), jnp.asarray(shortening[0]), p))
    small, large = 2 * (torque.reshape(2, -1) @ wave) / 64 / swings
    inertia = RIG.inertia.head.value + RIG.inertia.lever.value
    return float((large - small) / (0.75 * swing_rad**2) / inertia)


@pytest.fixture(scope="module")
def hardening(elastic: xr.Dataset) -> Answer:
    return answer_hardening(elastic, VISCOUS)


@pytest.mark.slow
def test_without_friction_the_cubic_term_is_that_of_the_static_energy(hardening: Answer) -> None:
    assert hardening.verdict == "hardens"
    value, low, high = hardening.column("cubic_per_s2_rad2")
    for i, pretension in enumerate((3.0, 10.0)):
        true = static_cubic(pretension, math.radians(hardening.column("swing_deg")[0][i]))
        assert low[i] <= true <= high[i]
        assert value[i] == pytest.approx(true, rel=0.1)


@pytest.mark.slow
def test_a_joint_that_is_the_same_to_both_sides_has_no_quadratic_term(hardening: Answer) -> None:
    _, low, high = hardening.column("quadratic_per_s2_rad")
    assert ((low < 0) & (high > 0)).all()


@pytest.mark.slow
def test_friction_in_the_guides_softens_what_the_tendons_harden(whole: xr.Dataset) -> None:
    answer = answer_hardening(whole, RIG)
    assert answer.verdict == "softens"
    assert any("gives way with amplitude" in sentence for sentence in answer.sentences)
