"""Harmonic balance of a steady motion: its waves, what the equations leave over of them, and the derivatives of that.

A coordinate y of the phase τ = Ωt is y = Σ a_h cos hτ + b_h sin hτ. What the equations need of it are channels: its
derivatives by time, and copies that lag behind it with a relaxation time T, each a linear filter of its harmonics,

    (jhΩ)^d        and        1 / (1 + jhΩT).

Where the equations do not change when all odd coordinates change sign and the phase moves by π, the odd ones have odd
harmonics only and the even ones even harmonics only, and half a period is enough.
"""

from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array

Parity = Literal["odd", "even", "all"]
Rates = Callable[[Any, jax.Array, jax.Array, Any], jax.Array]


_XLA = tuple(int(part) for part in version("jaxlib").split(".")[:3] if part.isdigit())
QUICK_COMPILE: dict[str, str | bool] = {"xla_cpu_use_fusion_emitters": False} if _XLA < (0, 11, 1) else {}
"""Options of XLA for what takes it long: without them it compiles for a third to a half longer, and runs no faster.
An XLA that came later has no other way any more, and refuses the option."""


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
    apart: whether u may be a tuple of k numbers too, and of the channels few but the coordinates themselves reach what
    costs most.
    """

    coordinates: tuple[Coordinate, ...]
    rates: Rates
    response: int = 0
    drive: int | None = None
    apart: bool = False


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
    """values u (k, n); slopes ∂u/∂Ω (k, n); and the same of the highest derivatives: top (c, n), top_slopes (c, n)."""

    values: jax.Array
    slopes: jax.Array
    top: jax.Array
    top_slopes: jax.Array


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
    parts, kinds = slices(equations, harmonics), _kinds(equations, harmonics)
    found: dict[int, tuple[jax.Array, jax.Array]] = {}
    for kind in kinds:  # whose waves are summed at once
        h, rows = kind.orders.astype(float), []
        for i in kind.members:
            real, imaginary, real_slope, imaginary_slope = _filters(equations.coordinates[i], h, omega)
            a, b = q[parts[i]][: h.size], q[parts[i]][h.size :]
            if h[0] == 0:
                b = jnp.concatenate([jnp.zeros(1), b])
            for r_th, i_th in ((real, imaginary), (real_slope, imaginary_slope)):
                rows.append(jnp.concatenate([r_th * a + i_th * b, r_th * b - i_th * a], axis=1))
        first = kind.members[0]
        summed = jnp.concatenate(rows) @ np.concatenate([at.cos[first], at.sin[first]], axis=1).T
        each = jnp.split(summed, np.cumsum([len(row) for row in rows])[:-1])
        found |= dict(zip(kind.members, zip(each[::2], each[1::2], strict=True), strict=True))
    values, slopes = zip(*(found[i] for i in range(len(parts))), strict=True)
    lower, lower_slopes = (jnp.concatenate([row[:-1] for row in rows]) for rows in (values, slopes))
    top, top_slopes = (jnp.stack([row[-1] for row in rows]) for rows in (values, slopes))
    return Channels(lower, lower_slopes, top, top_slopes)


# Alternating frequency and time: the harmonics give the channels on a grid of the period, the equations of motion are
# evaluated there as they stand, and what they differ by from the waves' highest derivatives is projected on the
# harmonics again. Derivatives at the samples come from automatic differentiation of the same equations.
#
# The unknowns are scaled: x = (q / scale, Ω / omega), so that all are near one.


class Lane(NamedTuple):
    """One curve to be computed. p: the equations' numbers. scale: size of each coordinate, (c,), in its unit.
    omega: frequency that is taken for one [rad/s]."""

    p: Any
    scale: jax.Array
    omega: jax.Array


class Balance(NamedTuple):
    """left: harmonics of what is left over, (m,). slope: their derivatives by the scaled unknowns, (m, m + 1).
    local: derivatives of the equations' rates by the channels at the samples, (c, k, n)."""

    left: jax.Array
    slope: jax.Array
    local: jax.Array


def scales(lane: Lane, equations: Equations, harmonics: int) -> jax.Array:
    """Return the scale of each unknown amplitude, (m,)."""
    parts = slices(equations, harmonics)
    return jnp.concatenate([jnp.full(part.stop - part.start, lane.scale[c]) for c, part in enumerate(parts)])


def motion(x: jax.Array, lane: Lane, equations: Equations, harmonics: int) -> tuple[jax.Array, jax.Array]:
    """Return (amplitudes q (m,) in the coordinates' units, Ω [rad/s]) of scaled unknowns x (m + 1,)."""
    return x[:-1] * scales(lane, equations, harmonics), x[-1] * lane.omega


def _rates(
    values: jax.Array, phase: jax.Array, omega: jax.Array, p: Any, equations: Equations
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return (rates (c, n), their slopes by the channels (c, k, n), by Ω (c, n)) at samples of channels (k, n)."""

    def rates(values: jax.Array, phase: jax.Array, omega: jax.Array) -> tuple[jax.Array, jax.Array]:
        here = equations.rates(values, phase, omega, p)
        return here, here

    at_once = jax.vmap(jax.jacfwd(rates, argnums=(0, 2), has_aux=True), in_axes=(1, 0, None), out_axes=-1)
    (local, by_omega), here = at_once(values, phase, omega)
    return here, local, by_omega


def _rates_apart(
    values: jax.Array, phase: jax.Array, omega: jax.Array, p: Any, equations: Equations
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return what `_rates` does: the slope by each coordinate by itself, by all other channels at once, and by Ω.

    The other channels do not reach what costs most, the geometry; JAX leaves out what a channel by itself, or these
    together, do not reach. All at once with the coordinates they took two thirds of a balance's time in it.
    """
    count, sizes = len(values), [c.order + len(c.relaxed) for c in equations.coordinates]
    alone = [int(k) for k in np.cumsum([0, *sizes[:-1]])]
    groups = [*([k] for k in alone), [k for k in range(count) if k not in alone], [count]]

    def at_once(u: tuple[jax.Array, ...], phase: jax.Array, omega: jax.Array) -> tuple[Any, Any]:
        here, linear = jax.linearize(lambda *given: tuple(equations.rates(given[:-1], phase, given[-1], p)), *u, omega)

        def along(group: list[int]) -> Any:
            def pushed(z: jax.Array) -> Any:
                return linear(*(z[group.index(k)] if k in group else jnp.zeros(()) for k in range(count + 1)))

            return jax.jacfwd(pushed)(jnp.zeros(len(group)))

        return here, [along(group) for group in groups]

    here, (*slopes, by_omega) = jax.vmap(at_once, in_axes=(0, 0, None), out_axes=-1)(tuple(values), phase, omega)
    slots = {k: (slope, i) for group, slope in zip(groups, slopes, strict=False) for i, k in enumerate(group)}
    found = [slots[k] for k in range(count)]
    local = jnp.stack([jnp.stack([slope[c][i] for slope, i in found]) for c in range(len(here))])
    return jnp.stack(here), local, jnp.concatenate(by_omega)


class _Kind(NamedTuple):
    """Coordinates with the same orders h of harmonics. members: which they are; channels: theirs, one's after
    another's; places: of their unknowns, (d, 2, h), one past the last for a sine of order zero."""

    orders: NDArray[np.int64]
    members: list[int]
    channels: NDArray[np.int64]
    places: NDArray[np.int64]


@cache
def _kinds(equations: Equations, harmonics: int) -> tuple[_Kind, ...]:
    parts, counts = slices(equations, harmonics), [c.order + len(c.relaxed) for c in equations.coordinates]
    begin = np.cumsum([0, *counts])
    found = []
    for parity in dict.fromkeys(c.parity for c in equations.coordinates):
        members = [i for i, c in enumerate(equations.coordinates) if c.parity == parity]
        h = orders(equations.coordinates[members[0]], harmonics)
        places = np.full((len(members), 2, h.size), parts[-1].stop)
        for row, i in zip(places, members, strict=True):
            row[0] = parts[i].start + np.arange(h.size)
            row[1, h > 0] = parts[i].start + h.size + np.arange(np.count_nonzero(h))
        own = np.concatenate([np.arange(begin[i], begin[i + 1]) for i in members])
        found.append(_Kind(h, members, own, places))
    return tuple(found)


def _hill(local: jax.Array, omega: jax.Array, equations: Equations, at: Grid, harmonics: int) -> jax.Array:
    """Return the derivatives of the balances by the amplitudes, (m, m), from those at the samples (c, k, n).

    A product of two harmonics is half of their sum and half of their difference; so all that is wanted of the samples
    is their spectrum, Hill's matrix of it. That is what projecting each product of a sample and a wave gives, to
    rounding, for a fifth of the work.
    """
    kinds, count = _kinds(equations, harmonics), unknowns(equations, harmonics)
    filters = [_filters(c, h.astype(float), omega) for c, h in zip(equations.coordinates, at.orders, strict=True)]
    whole = jnp.zeros((count + 1, count + 1))
    for rows in kinds:
        for columns in kinds:
            h, g = rows.orders[:, None], columns.orders
            across = np.unique(np.concatenate([np.abs(h - g), h + g]))
            apart, together = np.searchsorted(across, np.abs(h - g)), np.searchsorted(across, h + g)
            waves = np.outer(at.phase, across)
            spectrum = local[np.array(rows.members)[:, None], columns.channels] @ (
                np.concatenate([np.cos(waves), np.sin(waves)], axis=1) / at.phase.size
            )
            shares = [jnp.concatenate([part[:-1] for part in filters[i][:2]], axis=1) for i in columns.members]
            own = jnp.split(spectrum, np.cumsum([len(share) for share in shares])[:-1], axis=1)
            passed = jnp.stack([jnp.einsum("ckj,ke->cje", *pair) for pair in zip(own, shares, strict=True)], axis=1)
            (cr, ci), (sr, si) = (jnp.split(half, 2, axis=3) for half in jnp.split(passed, 2, axis=2))
            sign, each = np.sign(g - h), np.arange(g.size)
            sums = [z[:, :, together, each] for z in (cr - si, ci + sr)]
            differences = [
                a[:, :, apart, each] + s * sign * b[:, :, apart, each] for a, b, s in ((cr, si, -1), (ci, sr, 1))
            ]
            upper = jnp.stack([differences[0] + sums[0], differences[1] + sums[1]], axis=4)
            lower = jnp.stack([sums[1] - differences[1], differences[0] - sums[0]], axis=4)
            block = 0.5 * np.where(h > 0, 2.0, 1.0)[..., None] * jnp.stack([upper, lower], axis=2)
            # (member, cosine or sine, h; member, cosine or sine, g)
            block = block.transpose(0, 2, 3, 1, 5, 4).reshape(rows.places.size, columns.places.size)
            whole = whole.at[rows.places.ravel()[:, None], columns.places.ravel()].set(block)
    for kind in kinds:
        for slots, i in zip(kind.places, kind.members, strict=True):
            own_real, own_imaginary = (filters[i][part][-1] for part in (0, 1))
            whole = whole.at[slots, slots].add(-own_real)
            whole = whole.at[slots[0], slots[1]].add(-own_imaginary).at[slots[1], slots[0]].add(own_imaginary)
    return whole[:-1]


def balance(x: jax.Array, lane: Lane, equations: Equations, size: Size, *, often: bool = False) -> Balance:
    """Return the balance at scaled unknowns x (m + 1,).

    often: whether it is asked so often that slopes are worth twice the time to trace and compile, see `_rates_apart`.
    """
    at = grid(equations, size)
    q, omega = motion(x, lane, equations, size.harmonics)
    u = channels(q, omega, equations, at, size.harmonics)
    rates = _rates_apart if often and equations.apart else _rates
    here, local, by_omega = rates(u.values, jnp.asarray(at.phase), omega, lane.p, equations)
    over = here - u.top
    by_omega = by_omega + jnp.sum(local * u.slopes, axis=1) - u.top_slopes
    left, last = (
        jnp.concatenate([project @ row[c] for c, project in enumerate(at.project)]) for row in (over, by_omega)
    )
    slope = _hill(local, omega, equations, at, size.harmonics).at[:, -1].set(last)
    return Balance(left, slope * jnp.append(scales(lane, equations, size.harmonics), lane.omega), local)


# Small systems of linear equations are solved inside compiled loops.
#
# `jnp.linalg.solve` on a batch calls LAPACK through jaxlib, which spreads the batch over the very pool of threads
# that it waits in: two such calls at once on two cores wait for each other for ever (seen with jaxlib 0.10.2).
# Gauss-Jordan elimination with row pivoting needs neither; it costs three times the operations, on matrices of some
# ten rows.


def solve(matrix: jax.Array, right: jax.Array) -> jax.Array:
    """Return the solution of a system: matrix (m, m), right (m,) or (m, r). Not finite where there is none."""
    m = matrix.shape[0]
    columns = right[:, None] if right.ndim == 1 else right
    rows = jnp.arange(m)

    def eliminated(k: jax.Array, state: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[jax.Array, ...]:
        table, free, order = state
        column = jax.lax.dynamic_index_in_dim(table, k, axis=1, keepdims=False)
        pivot = jnp.argmax(jnp.where(free, jnp.abs(column), -1.0))
        row = jax.lax.dynamic_index_in_dim(table, pivot, axis=0, keepdims=False)
        row = row / jax.lax.dynamic_index_in_dim(row, k, keepdims=False)
        here = rows == pivot
        table = jnp.where(here[:, None], row, table - column[:, None] * row)
        return table, free & ~here, order.at[k].set(pivot)

    start = jnp.concatenate([matrix, columns], axis=1), jnp.ones(m, dtype=bool), jnp.zeros(m, dtype=int)
    table, _, order = jax.lax.fori_loop(0, m, eliminated, start)
    found = jnp.asarray(table)[order, m:]
    return found[:, 0] if right.ndim == 1 else found
