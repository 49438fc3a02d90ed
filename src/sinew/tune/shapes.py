"""This is where cross-sections are closed formulas of two sizes, so that a search can follow their slopes.

The same formulas as in `sinew.predict.sections`, which a proposal is computed with in the end; the rectangle's torsion
is Saint-Venant's series here and finite elements there (Timoshenko and Goodier, Theory of Elasticity, chapter 10).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from sinew.predict.sections.section import (
    Section,
    annulus_section,
    circle_section,
    ellipse_section,
    rectangle_section,
)

__all__ = ["SHAPES", "Form", "Shape"]

_ODD = (1.0, 3.0, 5.0, 7.0, 9.0)


class Form(NamedTuple):
    """diameter of the circle around it [m], area [m²], perimeter [m], torsion_constant, polar and least moment [m⁴],
    warping_constant [m⁶], shear_arm [m]: as in `sinew.predict.sections.section.Section`."""

    diameter: jax.Array
    area: jax.Array
    perimeter: jax.Array
    torsion_constant: jax.Array
    polar: jax.Array
    least: jax.Array
    warping_constant: jax.Array
    shear_arm: jax.Array


class Shape(NamedTuple):
    """form: from the larger size [m] and the ratio of the smaller to it. ratio: its least and greatest value; equal
    where there is none. section: the exact one of the same sizes."""

    name: str
    form: Callable[[jax.Array, jax.Array], Form]
    ratio: tuple[float, float]
    section: Callable[[float, float], Section]


def _circle(size: jax.Array, _: jax.Array) -> Form:
    return _annulus(size, jnp.zeros_like(size))


def _annulus(size: jax.Array, ratio: jax.Array) -> Form:
    inner = ratio * size
    polar = jnp.pi * (size**4 - inner**4) / 32
    area = jnp.pi * (size**2 - inner**2) / 4
    return Form(size, area, jnp.pi * (size + inner), polar, polar, polar / 2, jnp.zeros_like(size), size / 2)


def _ellipse(size: jax.Array, ratio: jax.Array) -> Form:
    a, b = size / 2, ratio * size / 2
    squares = a**2 + b**2
    h = ((a - b) / (a + b)) ** 2
    perimeter = jnp.pi * (a + b) * (1 + 3 * h / (10 + jnp.sqrt(4 - 3 * h)))  # Ramanujan, within 5e-5 here
    return Form(
        size,
        jnp.pi * a * b,
        perimeter,
        jnp.pi * (a * b) ** 3 / squares,
        jnp.pi * a * b * squares / 4,
        jnp.pi * a * b**3 / 4,
        ((a**2 - b**2) / squares) ** 2 * jnp.pi * (a * b) ** 3 / 24,
        2 * a**2 * b / squares,
    )


def _rectangle(size: jax.Array, ratio: jax.Array) -> Form:
    a, b = size, ratio * size
    turns = [jnp.pi * n * a / (2 * b) for n in _ODD]
    series = sum(jnp.tanh(turn) / n**5 for n, turn in zip(_ODD, turns, strict=True))
    peak = sum(1 / (n**2 * jnp.cosh(turn)) for n, turn in zip(_ODD, turns, strict=True))
    return Form(
        size * jnp.sqrt(1 + ratio**2),
        a * b,
        2 * (a + b),
        a * b**3 * (1 / 3 - 64 / jnp.pi**5 * (b / a) * series),
        a * b * (a**2 + b**2) / 12,
        a * b**3 / 12,
        (a * b) ** 3 / 144 * (1 - ratio**2) ** 2,  # of a thin one; a square warps hardly
        b * (1 - 8 / jnp.pi**2 * peak),
    )


def _in_half_mm(length: float) -> float:
    return round(2000 * length) / 2000


SHAPES = {
    shape.name: shape
    for shape in (
        Shape("circle", _circle, (1.0, 1.0), lambda d, _: circle_section(_in_half_mm(d))),
        Shape("annulus", _annulus, (0.2, 0.85), lambda d, q: annulus_section(_in_half_mm(d), _in_half_mm(q * d))),
        Shape("ellipse", _ellipse, (0.35, 0.9), lambda d, q: ellipse_section(_in_half_mm(d), _in_half_mm(q * d))),
        Shape("rectangle", _rectangle, (0.35, 1.0), lambda d, q: rectangle_section(_in_half_mm(d), _in_half_mm(q * d))),
    )
}
"""Shapes that a design is searched among; sizes of the exact section are rounded to half a millimetre."""
