"""Sections in space, without tendons and weight: how an oval sways, and what a rod that is cast bent couples."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from sinew.measure.arrays import Array
from sinew.mechanics.rod import rod_poses, straight
from sinew.mechanics.space import Space
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.design import Design, design_rig
from sinew.predict.section import ellipse_section
from sinew.solve.spatial import Mode, linear_equations, modes
from sinew.twin.parameters import space_from_rig

RIG = load_rig("paper")
WIDE, HIGH = 0.070, 0.040
LATERAL = 6e-3  # moment of head and of lever about any axis across [kg m²]


def bare(rig: RigSpec) -> Space:
    """Return a joint whose cables are slack, without weight and memory, its rod light and its head a round body."""
    space = space_from_rig(rig)
    shares = tuple(0 * np.asarray(one) for one in space.rod.joint.prony_shares)
    rod = space.rod._replace(
        joint=space.rod.joint._replace(prony_shares=shares),  # type: ignore[arg-type]
        line_mass=np.asarray(1e-8),  # type: ignore[arg-type]
        line_inertia=(np.asarray(1e-12),) * 3,  # type: ignore[arg-type]
    )
    heads = {"head_tensor": np.full(3, LATERAL), "lever_tensor": np.full(3, LATERAL)}
    return space._replace(rod=rod, weight=np.zeros(3), **heads)  # type: ignore[arg-type]


def sways(space: Space) -> tuple[Mode, Mode]:
    """Return the slowest mode that tilts the head about y, and the one that tilts it about z."""
    found = [one for one in modes(linear_equations(np.asarray(straight()), space), space, 60.0) if np.any(one.tilt)]
    about = [[one for one in found if abs(one.tilt[i]) > 0.99 * np.hypot(*one.tilt) > abs(one.torsion)] for i in (0, 1)]
    return about[0][0], about[1][0]


def cantilever_hz(space: Space, bending: float) -> float:
    """Return the slower frequency [Hz] of a body on a massless beam of Timoshenko that bends and shears."""
    length, rigidity, shear = float(space.rod.joint.length), 3 * bending, float(space.rod.shear)
    flexible = np.array(
        [
            [length**3 / (3 * rigidity) + length / shear, length**2 / (2 * rigidity)],
            [length**2 / (2 * rigidity), length / rigidity],
        ]
    )
    mass = np.zeros((2, 2))
    for m, h in ((space.head_mass, space.head_height), (space.lever_mass, space.lever_height)):
        mass += np.array([[m, m * h], [m * h, m * h**2 + LATERAL]], dtype=float)
    return float(np.sqrt(scipy.linalg.eigh(np.linalg.inv(flexible), mass)[0][0]) / (2 * np.pi))


def test_both_sways_of_an_oval_are_those_of_timoshenkos_beam() -> None:
    oval = bare(design_rig(RIG, Design(section=ellipse_section(WIDE, HIGH), name="ellipse")))
    found = [one.frequency_hz for one in sways(oval)]
    moments = np.pi / 64 * np.array([WIDE * HIGH**3, WIDE**3 * HIGH])
    modulus = float(oval.rod.joint.axial_rigidity) / (np.pi / 4 * WIDE * HIGH)
    assert found == pytest.approx([cantilever_hz(oval, modulus * one) for one in moments], rel=1e-3)


def turned_by_moments(space: Space) -> Array:
    """Return the small turn of the head by a moment on it, (3, 3), about its own axes [rad/(N m)]."""
    q = np.asarray(straight())

    def head(flat: jax.Array) -> jax.Array:
        return rod_poses(flat.reshape(q.shape), space.rod)[0][-1]

    flat = jnp.zeros(q.size)
    here, slope = np.asarray(head(flat)), np.asarray(jax.jacfwd(head)(flat))
    spun = np.einsum("ji,jkn->ikn", here, slope)
    turn = np.stack([spun[2, 1], spun[0, 2], spun[1, 0]])
    return np.asarray(turn @ np.linalg.solve(linear_equations(q, space).around.stiffness, turn.T))


def test_a_side_bend_twists_a_curved_head_as_an_arc_and_a_straight_one_not() -> None:
    curved, upright = bare(load_rig("curved")), bare(RIG)
    # Cast with a bend towards z. By Bernoulli, a moment about the head's z goes along the arc with cosine and sine.
    angle = np.radians(30.0)
    p = curved.rod.joint
    twist, rigidity = float(p.torsional_rigidity), 3 * float(curved.rod.bending[1])
    sine_square = (angle - np.sin(angle) * np.cos(angle)) / 2
    cosine_square = angle - sine_square
    per = float(p.length) / angle
    found = turned_by_moments(curved)
    assert found[2, 2] == pytest.approx(per * (cosine_square / rigidity + sine_square / twist), rel=1e-3)
    assert abs(found[0, 2]) == pytest.approx(per * np.sin(angle) ** 2 / 2 * (1 / twist - 1 / rigidity), rel=2e-3)
    assert turned_by_moments(upright)[0, 2] == pytest.approx(0, abs=1e-12)
