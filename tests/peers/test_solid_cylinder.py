"""The silicone's energy against scikit-fem's finite elements: where theory is exact, and where the ends are bonded.

Sliding ends make the exact solutions: uniaxial compression, G A (λ - 1/λ²), and Rivlin's torsion of a compressed
cylinder. Torsion of a bonded cylinder that is not compressed is exact too, whatever its length: its ends stay plane.
"""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.cylinder_mesh import ANGLE, Cylinder, axisymmetric_cylinder, eighth_of_cylinder
from benchmarks.solid import balance, settled
from benchmarks.solid_cylinder import beam, deviation, lost_length, stiffness

from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import silicone_energy
from sinew.plan.plan import Group
from sinew.plan.toml import load_rig
from sinew.predict.joints.validity import bonded_axial_factor
from sinew.twin.simulate import lane_parameters

LENGTH = 3.4


@cache
def plane() -> Cylinder:
    return axisymmetric_cylinder(1.0, LENGTH, 5, 10)


@cache
def eighth() -> Cylinder:
    return eighth_of_cylinder(1.0, LENGTH, 2, 3)


@cache
def parameters() -> Parameters:
    p, _ = lane_parameters([Group("steady", 0.0, 1.0, 1.0, 0, 1.0, 1.0)], load_rig("paper"))
    first: Parameters = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[0]), p)
    return first


def silicone(radius: float, length: float) -> Parameters:
    """Return the twin's parameters of a cylinder with a shear modulus of one."""
    area, polar = np.pi * radius**2, np.pi * radius**4 / 2
    return parameters()._replace(
        length=jnp.asarray(length), torsional_rigidity=jnp.asarray(polar), axial_rigidity=jnp.asarray(area)
    )


@pytest.mark.parametrize("stretch", [0.8, 0.9, 1.1])
def test_between_sliding_ends_the_solid_is_the_beam_in_force_and_both_stiffnesses(stretch: float) -> None:
    assert stiffness(plane(), stretch, bonded=False) == pytest.approx(beam(1.0, LENGTH, stretch), rel=1e-9)


@pytest.mark.slow
def test_the_beam_of_the_comparison_is_the_twins_silicone() -> None:
    p, stretch = silicone(0.9, 2.7), 0.92
    x = jnp.asarray((1 - stretch) * 2.7)
    hessian = jax.hessian(silicone_energy, argnums=(0, 1))(jnp.zeros(()), x, p)
    force = -float(jax.grad(silicone_energy, argnums=1)(jnp.zeros(()), x, p))
    told = force, float(hessian[1][1]), float(hessian[0][0])
    assert told == pytest.approx(beam(0.9, 2.7, stretch), rel=1e-12)


def test_a_bonded_cylinder_that_is_not_compressed_twists_as_saint_venant_says() -> None:
    assert stiffness(plane(), 1.0).torsional == pytest.approx(np.pi / 2 / LENGTH, rel=1e-9)


@pytest.mark.slow
def test_three_dimensions_come_to_the_same_as_closed_form_and_axisymmetry() -> None:
    # 5e-4 is what the rim of so few elements, made of parabolas, is from a circle, and the edge of a bonded end.
    exact = beam(1.0, LENGTH, 0.9)
    assert stiffness(eighth(), 0.9, bonded=False, steps=1) == pytest.approx(exact, rel=5e-4)
    found, plain = (deviation(stiffness(c, 0.9, steps=1), 1.0, LENGTH, 0.9) for c in (eighth(), plane()))
    assert found.torsional == pytest.approx(plain.torsional, abs=5e-4)
    assert found.axial == pytest.approx(plain.axial, abs=8e-3)


def test_a_finite_torsion_pulls_the_sliding_end_as_the_twins_energy_says() -> None:
    cylinder, stretch, torsion = plane(), 0.93, 1.0
    at, end = cylinder.at, 0.5 * LENGTH
    middle = np.concatenate([at(0, 0, 0.0), at(2, 2, 0.0), at(ANGLE, 2, 0.0)])
    pulled, turned = at(2, 2, end), at(ANGLE, 2, end)
    held = np.concatenate([middle, pulled, turned])
    # Rivlin's cylinder stays one where its ends stay plane; what is left to find is its radius and the pressure.
    d = np.zeros(cylinder.solid.total)
    for share in (0.5, 1.0):
        shift = 0.5 * share * (stretch - 1) * LENGTH
        goal = [np.zeros(middle.size), np.full(pulled.size, shift), np.full(turned.size, 0.5 * share * torsion)]
        d = settled(cylinder.solid, d, held, np.concatenate(goal))
    forces = balance(cylinder.solid, d).forces
    p, x = silicone(1.0, LENGTH), jnp.asarray((1 - stretch) * LENGTH)
    torque, axial = jax.grad(silicone_energy, argnums=(0, 1))(jnp.asarray(torsion), x, p)
    assert forces[turned].sum() == pytest.approx(float(torque), rel=1e-6)
    assert forces[pulled].sum() == pytest.approx(-float(axial), rel=1e-6)


def test_bonded_ends_take_the_same_length_from_any_slender_cylinder() -> None:
    lost = []
    for slenderness in (3.0, 5.0):
        cylinder = axisymmetric_cylinder(1.0, 2 * slenderness, 8, 24)
        lost.append(lost_length(deviation(stiffness(cylinder, 1.0), 1.0, 2 * slenderness, 1.0).axial, slenderness))
    assert lost[0] == pytest.approx(lost[1], rel=5e-3)
    assert lost[0] > 0.1


@pytest.mark.parametrize("slenderness", [1.0, 1.7, 3.0])
def test_the_factor_that_a_prediction_is_checked_with_is_that_of_the_solid(slenderness: float) -> None:
    length = 2 * slenderness
    found = deviation(stiffness(axisymmetric_cylinder(1.0, length, 8, 24), 1.0), 1.0, length, 1.0).axial
    assert bonded_axial_factor(np.pi, 2 * np.pi, length) - 1 == pytest.approx(found, rel=0.02)


@pytest.mark.slow
def test_finer_meshes_come_nearer_to_each_other() -> None:
    axial = [stiffness(axisymmetric_cylinder(1.0, LENGTH, n, 2 * n), 1.0).axial for n in (4, 8, 16)]
    assert 0 < axial[1] - axial[2] < 0.6 * (axial[0] - axial[1])
