"""Energy, stiffness and statics of the twin against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from tests.unit.prony import complex_stiffness

from sinew.mechanics.joint import potential
from sinew.mechanics.parameters import CURRENT, POSITION, POSITION_LIMITED, Parameters
from sinew.mechanics.silicone import prony_shares, silicone_energy
from sinew.mechanics.tendons import (
    cos_sin,
    guide_directions,
    guide_points,
    tendon_energy,
    tendon_lengths,
    tendon_stretch,
    tendon_tension,
    total_tension,
)
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.solve.programs import configure
from sinew.solve.rest import axial_force, rest_shortening, set_pretension, torsional_stiffness
from sinew.twin.parameters import from_rig

configure()


@pytest.fixture(scope="module")
def rig() -> RigSpec:
    return load_rig("paper")


_set_pretension = jax.jit(set_pretension)
_stiffness = jax.jit(torsional_stiffness)


def _held(rig: RigSpec, pretension_m: float, mode: float) -> tuple[Parameters, jax.Array]:
    contact = rig.tendons.first_contact_tension.value
    return _set_pretension(from_rig(rig), pretension_m, contact, mode, 5.0)


@pytest.mark.parametrize("mode", [POSITION, POSITION_LIMITED, CURRENT])
@pytest.mark.parametrize("pretension_m", [0.0, 0.005, 0.012])
def test_small_angle_stiffness_is_silicone_plus_geometric_stiffness(
    rig: RigSpec, mode: float, pretension_m: float
) -> None:
    p, x = _held(rig, pretension_m, mode)
    stretch = tendon_stretch(jnp.zeros(()), x, p)[0]
    tension = float(tendon_tension(stretch, p))
    span = float(stretch + p.cable_end)
    silicone = float(p.torsional_rigidity / (p.length - x))
    geometric = 4 * tension * float(p.base_radius * p.head_radius) / span
    assert float(_stiffness(x, p)) == pytest.approx(silicone + geometric, rel=1e-9)


@pytest.mark.parametrize(("stretch", "twist_rad"), [(1.0, 0.5), (0.9, 1.0), (0.85, -0.7), (1.05, 0.3)])
def test_torque_and_axial_force_equal_rivlins_stress_field(rig: RigSpec, stretch: float, twist_rad: float) -> None:
    p = from_rig(rig)
    length, radius0 = float(p.length), rig.silicone.diameter.value / 2
    shear = float(p.torsional_rigidity) / (np.pi * radius0**4 / 2)
    twist = twist_rad / length
    radius = radius0 / np.sqrt(stretch)

    # Cauchy stress of the incompressible neo-Hookean cylinder, pressure from radial equilibrium and a free surface
    def axial(r: float) -> float:
        radial = -shear * twist**2 * (radius**2 - r**2) / 2
        return shear * (stretch**2 - 1 / stretch) + radial

    force = quad(lambda r: axial(r) * 2 * np.pi * r, 0, radius)[0]
    torque = quad(lambda r: r * (shear * r * twist * stretch) * 2 * np.pi * r, 0, radius)[0]

    shortening = jnp.asarray((1 - stretch) * length)
    found_torque = jax.grad(silicone_energy)(jnp.asarray(twist_rad), shortening, p)
    assert float(found_torque) == pytest.approx(torque, rel=1e-9)
    assert -float(axial_force(shortening, jnp.asarray(twist_rad), p)) == pytest.approx(force, rel=1e-9, abs=1e-9)


def test_tension_is_the_derivative_of_tendon_energy_in_every_mode(rig: RigSpec) -> None:
    p = from_rig(rig)._replace(held_tension=jnp.asarray(30.0))
    for mode in (POSITION, POSITION_LIMITED, CURRENT):
        held = p._replace(mode=jnp.asarray(mode))
        for stretch in (-1e-3, 1e-4, 4e-4, 1e-3):
            slope = jax.grad(tendon_energy)(jnp.asarray(stretch), held)
            assert float(slope) == pytest.approx(float(tendon_tension(jnp.asarray(stretch), held)), abs=1e-9)


def test_first_contact_carries_the_set_tension_and_balances_the_silicone(rig: RigSpec) -> None:
    p, x = _held(rig, 0.0, POSITION)
    tension = float(total_tension(jnp.zeros(()), x, p))
    contact = rig.tendons.first_contact_tension.value
    assert tension == pytest.approx(4 * contact, rel=1e-9)
    assert float(axial_force(x, jnp.zeros(()), p)) == pytest.approx(4 * contact, rel=1e-9)


def _secant_stiffness(p: Parameters, angle: float) -> float:
    """Return torque over angle with the head free to sink."""
    slope = jax.jit(jax.grad(potential, argnums=(0, 1)))
    curvature = jax.jit(jax.grad(lambda y, p: slope(jnp.asarray(angle), y, p)[1]))
    x = float(rest_shortening(p))
    for _ in range(30):
        x -= float(slope(jnp.asarray(angle), jnp.asarray(x), p)[1] / curvature(jnp.asarray(x), p))
    return float(slope(jnp.asarray(angle), jnp.asarray(x), p)[0]) / angle


@pytest.mark.slow
def test_locked_length_hardens_the_joint_and_held_current_does_not(rig: RigSpec) -> None:
    locked, _ = _held(rig, 0.006, POSITION)
    current, _ = _held(rig, 0.006, CURRENT)
    small, large = np.radians(1.0), np.radians(50.0)
    assert _secant_stiffness(locked, large) > 1.02 * _secant_stiffness(locked, small)
    # held tension follows the chord, whose torque grows less than the angle
    assert _secant_stiffness(current, large) < _secant_stiffness(current, small)


def _scalars(matrix: list[list[float]]) -> tuple[tuple[jax.Array, ...], ...]:
    return tuple(tuple(jnp.asarray(float(entry)) for entry in row) for row in matrix)


def test_lengths_of_straight_tendons_follow_the_chord_formula() -> None:
    directions = _scalars(guide_directions(4))
    base, head = guide_points(jnp.asarray(0.03), directions), guide_points(jnp.asarray(0.02), directions)
    angle, height = 0.8, 0.09
    rotation = _scalars([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    lengths = tendon_lengths(base, head, (rotation, _scalars([[height, 0, 0]])[0]))
    chord = np.sqrt(height**2 + 0.03**2 + 0.02**2 - 2 * 0.03 * 0.02 * np.cos(angle))
    np.testing.assert_allclose(lengths, chord, rtol=1e-14)


@pytest.mark.parametrize("loss_factor", [0.02, 0.1, 0.2])
def test_prony_series_holds_the_loss_factor_constant_over_two_decades(loss_factor: float) -> None:
    ratio = complex_stiffness(prony_shares(loss_factor), np.geomspace(0.3, 30, 50))
    np.testing.assert_allclose(ratio.imag / ratio.real, loss_factor, rtol=0.03)


def test_cosine_and_sine_are_exact_at_any_angle_and_so_is_their_derivative() -> None:
    angle = np.concatenate([np.linspace(-50, 50, 2001), np.pi * np.arange(-9, 10)])
    c, s = jax.vmap(cos_sin)(jnp.asarray(angle))
    np.testing.assert_allclose(c, np.cos(angle), atol=1e-14)
    np.testing.assert_allclose(s, np.sin(angle), atol=1e-14)
    slope = jax.vmap(jax.grad(lambda a: cos_sin(a)[0]))(jnp.asarray(angle))
    np.testing.assert_allclose(slope, -np.sin(angle), atol=1e-14)
