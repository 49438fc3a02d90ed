"""Harmonics of a periodic motion: which unknowns there are, and their samples over a period.

A coordinate y of the phase τ = Ωt is y = Σ a_h cos hτ + b_h sin hτ. What the equations need of it are channels: its
derivatives by time, and copies that lag behind it with a relaxation time T, each a linear filter of its harmonics,

    (jhΩ)^d        and        1 / (1 + jhΩT).

Where the equations do not change when all odd coordinates change sign and the phase moves by π, the odd ones have odd
harmonics only and the even ones even harmonics only, and half a period is enough.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array

Parity = Literal["odd", "even", "all"]
Rates = Callable[[jax.Array, jax.Array, jax.Array, Any], jax.Array]


class Coordinate(NamedTuple):
    """One coordinate. parity: its harmonics. order: of its highest derivative in the equations, 1 or 2.
    relaxed: relaxation times T of the copies that lag behind it [s]."""

    name: str
    parity: Parity
    order: int
    relaxed: tuple[float, ...] = ()


class Equations(NamedTuple):
    """Equations of motion of c coordinates, solved for their highest derivatives.

    rates(u, τ, Ω, p) returns those, (c,): u are the channels (k,) at the phase τ, coordinate by coordinate its lower
    derivatives from 0 on and then its lagging copies; p is any tree of numbers.
    response: index of the coordinate that is looked at. drive: index of the coordinate that drives, None for sin τ.
    """

    coordinates: tuple[Coordinate, ...]
    rates: Rates
    response: int = 0
    drive: int | None = None


class Size(NamedTuple):
    """How finely a motion is resolved. harmonics: the highest. samples: over the period, or over its half where the
    equations are symmetric."""

    harmonics: int
    samples: int


class Grid(NamedTuple):
    """Samples of the harmonics. phase (n,); for each coordinate orders (h,), cos and sin (n, h), and project (m, n):
    from samples of its equation to the m balances."""

    phase: Array
    orders: tuple[NDArray[np.int64], ...]
    cos: tuple[Array, ...]
    sin: tuple[Array, ...]
    project: tuple[Array, ...]


class Channels(NamedTuple):
    """values u (k, n); slopes ∂u/∂Ω (k, n); maps of each coordinate: ∂u/∂q, (k_c, n, m_c); and the same of the highest
    derivatives: top (c, n), top_slopes (c, n), top_maps (n, m_c)."""

    values: jax.Array
    slopes: jax.Array
    maps: tuple[jax.Array, ...]
    top: jax.Array
    top_slopes: jax.Array
    top_maps: tuple[jax.Array, ...]


def orders(coordinate: Coordinate, harmonics: int) -> NDArray[np.int64]:
    """Return the orders h of a coordinate's harmonics, shape (h,)."""
    match coordinate.parity:
        case "odd":
            return np.arange(1, harmonics + 1, 2)
        case "even":
            return np.arange(0, harmonics + 1, 2)
        case _:
            return np.arange(harmonics + 1)


def is_symmetric(equations: Equations) -> bool:
    """Return whether half a period tells the other half."""
    return all(coordinate.parity != "all" for coordinate in equations.coordinates)


def slices(equations: Equations, harmonics: int) -> tuple[slice, ...]:
    """Return where each coordinate's unknowns stand: a_h of all its orders, then b_h of those above zero."""
    sizes = [int(np.sum(1 + (orders(c, harmonics) > 0))) for c in equations.coordinates]
    ends = np.cumsum(sizes)
    return tuple(slice(int(end - size), int(end)) for size, end in zip(sizes, ends, strict=True))


def size_of(equations: Equations) -> int:
    """Return the number of states of the first-order form."""
    return sum(c.order + len(c.relaxed) for c in equations.coordinates)


def unknowns(equations: Equations, harmonics: int) -> int:
    """Return the number m of unknown amplitudes."""
    return int(slices(equations, harmonics)[-1].stop)


@cache
def embedded(equations: Equations, small: int, large: int) -> NDArray[np.int64]:
    """Return where the scaled unknowns of a motion with few harmonics stand among those with many, shape (m + 1,)."""
    places = []
    for coordinate, part in zip(equations.coordinates, slices(equations, large), strict=True):
        few, many = orders(coordinate, small), orders(coordinate, large)
        cosines = part.start + np.arange(few.size)
        sines = part.start + many.size + np.arange(np.count_nonzero(few))
        places += [cosines, sines]
    places.append(np.array([unknowns(equations, large)]))
    return np.concatenate(places)


@cache
def grid(equations: Equations, size: Size) -> Grid:
    """Return the samples of the harmonics of a size."""
    whole = np.pi if is_symmetric(equations) else 2 * np.pi
    phase = whole * np.arange(size.samples) / size.samples
    rows, cosines, sines, projections = [], [], [], []
    for coordinate in equations.coordinates:
        h = orders(coordinate, size.harmonics)
        cos, sin = np.cos(np.outer(phase, h)), np.sin(np.outer(phase, h))
        weight = np.where(h > 0, 2.0, 1.0) / size.samples
        rows.append(h)
        cosines.append(cos)
        sines.append(sin)
        projections.append(np.concatenate([(cos * weight).T, (sin * weight).T[h > 0]]))
    return Grid(phase, tuple(rows), tuple(cosines), tuple(sines), tuple(projections))


def _filters(coordinate: Coordinate, h: Array, omega: jax.Array) -> tuple[jax.Array, ...]:
    """Return real and imaginary part of the coordinate's filters and of their derivatives by Ω, each (k_c + 1, h).

    The last row is that of the highest derivative.
    """
    at, none, one = h * omega, np.zeros_like(h), np.ones_like(h)
    rows: list[tuple[Any, Any, Any, Any]] = [(one, none, none, none), (none, at, none, h)]
    if coordinate.order == 2:
        rows.append((-at * at, none, -2 * h * at, none))
    top = rows.pop()
    for relaxation in coordinate.relaxed:
        lag = at * relaxation
        share = 1 / (1 + lag * lag)
        turn = h * relaxation
        rows.append((share, -lag * share, -2 * lag * share**2 * turn, (lag * lag - 1) * share**2 * turn))
    rows.append(top)
    real, imaginary, real_slope, imaginary_slope = (
        jnp.stack([jnp.asarray(x) for x in c]) for c in zip(*rows, strict=True)
    )
    return real, imaginary, real_slope, imaginary_slope


def channels(q: jax.Array, omega: jax.Array, equations: Equations, at: Grid, harmonics: int) -> Channels:
    """Return the channels of a motion q (m,) [in the coordinates' units] at Ω [rad/s] on the phases of a grid."""
    values: list[jax.Array] = []
    slopes: list[jax.Array] = []
    maps: list[jax.Array] = []
    parts = slices(equations, harmonics)
    for coordinate, part, h, cos, sin in zip(equations.coordinates, parts, at.orders, at.cos, at.sin, strict=True):
        real, imaginary, real_slope, imaginary_slope = _filters(coordinate, h.astype(float), omega)
        a, b = q[part][: h.size], q[part][h.size :]
        if h[0] == 0:
            b = jnp.concatenate([jnp.zeros(1), b])

        for rows, i_th, r_th in ((values, imaginary, real), (slopes, imaginary_slope, real_slope)):
            rows.append((r_th * a + i_th * b) @ cos.T + (r_th * b - i_th * a) @ sin.T)
        r, i = real[:, None, :], imaginary[:, None, :]
        by_sine = cos * i + sin * r
        maps.append(jnp.concatenate([cos * r - sin * i, by_sine[:, :, 1:] if h[0] == 0 else by_sine], axis=2))
    lower, lower_slopes = (jnp.concatenate([row[:-1] for row in rows]) for rows in (values, slopes))
    top, top_slopes = (jnp.stack([row[-1] for row in rows]) for rows in (values, slopes))
    highest = tuple(m[-1] for m in maps)
    return Channels(lower, lower_slopes, tuple(m[:-1] for m in maps), top, top_slopes, highest)
