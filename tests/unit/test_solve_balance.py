"""Derivatives of the harmonic balance, and the map of disturbances about a motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from sinew.solve.balance import Coordinate, Equations, Lane, Size, balance, size_of, unknowns
from sinew.solve.examination import half_map, means_of
from sinew.solve.programs import configure

configure()
LANE = Lane({"k": 40.0, "d": 0.3}, jnp.array([0.4, 0.02, 0.7]), jnp.asarray(5.0))


def _rates(u: jax.Array, phase: jax.Array, omega: jax.Array, p: dict[str, float]) -> jax.Array:
    twist, speed, lagging, rise, rise_speed, bristle = (u[k] for k in range(6))
    turning = jnp.sin(phase) * omega - p["k"] * twist - p["d"] * speed - 3 * (twist - lagging) - 9 * rise * twist
    rising = -90 * rise - rise_speed + twist**2
    return jnp.stack([turning - bristle, rising, (speed - jnp.abs(speed) * bristle) / 0.2])


MIXED = Equations(
    (Coordinate("twist", "odd", 2, (0.1,)), Coordinate("rise", "even", 2), Coordinate("bristle", "odd", 1)), _rates
)


@pytest.mark.parametrize("parities", ["as they are", "all"])
def test_the_slope_is_the_derivative_of_what_is_left_over(parities: str) -> None:
    coordinates = MIXED.coordinates
    if parities == "all":
        coordinates = tuple(one._replace(parity="all") for one in coordinates)
    equations, size = MIXED._replace(coordinates=coordinates), Size(5, 24)
    x = jnp.asarray(np.append(np.random.default_rng(1).normal(0, 0.3, unknowns(equations, 5)), 1.2))
    derived = jax.jit(jax.jacfwd(lambda x: balance(x, LANE, equations, size).left))(x)
    slope = jax.jit(lambda x: balance(x, LANE, equations, size).slope)(x)
    assert np.asarray(slope) == pytest.approx(np.asarray(derived), rel=1e-9, abs=1e-9)


def _generator(equations: Equations, slopes: np.ndarray) -> np.ndarray:
    """Return A of the first-order form, (s, s), whose rows of the highest derivatives are given, (c, s)."""
    out, own = np.zeros((size_of(equations),) * 2), 0
    for coordinate, row in zip(equations.coordinates, slopes, strict=True):
        if coordinate.order == 2:
            out[own, own + 1] = 1.0
        out[own + coordinate.order - 1] = row
        for k, relaxation in enumerate(coordinate.relaxed, own + coordinate.order):
            out[k, [own, k]] = 1.0 / relaxation, -1.0 / relaxation
        own += coordinate.order + len(coordinate.relaxed)
    return out


def _map_of(slopes: np.ndarray, equations: Equations) -> np.ndarray:
    return half_map(np.asarray(means_of(jnp.asarray(slopes), equations)), np.asarray(4.0), equations)


def test_the_map_of_equations_that_do_not_change_is_their_exponential() -> None:
    local = np.random.default_rng(2).normal(0, 3.0, (3, 6))
    turned = np.diag([-1.0, -1, -1, 1, 1, -1])
    found = _map_of(np.repeat(local[:, :, None], 256, axis=2), MIXED)
    expected = turned @ expm(_generator(MIXED, local) * np.pi / 4.0)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_the_map_of_equations_that_change_is_that_of_their_means_one_after_another() -> None:
    lagging = Coordinate("bristle", "all", 1, (0.2, 0.05))
    equations = MIXED._replace(coordinates=(*(one._replace(parity="all") for one in MIXED.coordinates[:2]), lagging))
    size, intervals = size_of(equations), 128
    local = np.random.default_rng(3).normal(0, 3.0, (3, size, 3 * intervals))
    expected = np.eye(size)
    for mean in np.moveaxis(local.reshape(3, size, intervals, 3).mean(axis=3), 2, 0):
        expected = expm(_generator(equations, mean) * 2 * np.pi / 4.0 / intervals) @ expected
    found = _map_of(local, equations)
    assert found == pytest.approx(expected, rel=1e-8, abs=1e-8 * np.abs(expected).max())
