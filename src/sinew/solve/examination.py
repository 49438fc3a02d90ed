"""Examination of the points of a curve, refined: size, phase, harmonics, stability.

A point of the curve becomes a motion with finer waves, more harmonics and samples, by one step or a few of Newton's
method across the curve. What that changes in amplitude and frequency estimates what the coarser waves cost; what is
left after it is what the finer waves cut off, which is less.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array, Complexes, Mask
from sinew.measure.tasks import cores
from sinew.solve.balance import (
    QUICK_COMPILE,
    Equations,
    Lane,
    Size,
    balance,
    embedded,
    is_symmetric,
    orders,
    size_of,
    slices,
)
from sinew.solve.programs import program

# The size of steady motions is measured: half of peak to peak, fundamental, phase behind the drive.
#
# Motions are rows x of scaled unknowns, (k, m + 1); so are gradients by them.


_GRID = 96
_STEPS = 4


class HalfRange(NamedTuple):
    """Half of peak to peak of the response in its scale (k,), and its gradient (k, m + 1)."""

    value: Array
    gradient: Array


def _places(equations: Equations, harmonics: int, index: int) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Return a coordinate's orders and where its cosines and (for orders above zero) sines stand."""
    part, h = slices(equations, harmonics)[index], orders(equations.coordinates[index], harmonics)
    cosines = part.start + np.arange(h.size)
    return h.astype(float), cosines, np.arange(part.start + h.size, part.stop)


def phasors(x: Array, equations: Equations, harmonics: int, index: int) -> Complexes:
    """Return the complex amplitudes c_h of a coordinate in its scale, y = Re Σ c_h exp(jhτ), shape (k, h)."""
    h, cosines, sines = _places(equations, harmonics, index)
    c = x[:, cosines].astype(complex)
    c[:, h > 0] -= 1j * x[:, sines]
    return c


def _fundamental(equations: Equations, harmonics: int, index: int) -> tuple[int, int]:
    h, cosines, sines = _places(equations, harmonics, index)
    return int(cosines[h == 1][0]), int(sines[h[h > 0] == 1][0])


def drive_phasor(x: Array, equations: Equations, harmonics: int) -> Complexes:
    """Return the fundamental of what drives: of a coordinate in its scale, or -j where sin τ drives, (k,)."""
    if equations.drive is None:
        return np.full(len(x), -1j)
    cosine, sine = _fundamental(equations, harmonics, equations.drive)
    return np.asarray(x[:, cosine] - 1j * x[:, sine])


def lag_product(x: Array, equations: Equations, harmonics: int) -> tuple[Complexes, Array]:
    """Return (drive times conjugate response, the fundamentals in their scales, (k,); gradient of its real part,
    (k, m + 1)). Its argument is the lag; the real part is zero where the response lags by 90°."""
    cosine, sine = _fundamental(equations, harmonics, equations.response)
    drive = drive_phasor(x, equations, harmonics)
    gradient = np.zeros_like(x)
    gradient[:, cosine], gradient[:, sine] = drive.real, -drive.imag
    if equations.drive is not None:
        theirs = _fundamental(equations, harmonics, equations.drive)
        gradient[:, theirs] += x[:, (cosine, sine)]
    return drive * np.conj(x[:, cosine] - 1j * x[:, sine]), gradient


def _turning_point(c: Complexes, h: Array, sign: float) -> tuple[Array, Array]:
    """Return (largest value for sign 1, least for -1, (k,); its phase (k,)), refined from a grid by Newton's method."""
    phase = 2 * np.pi * np.arange(_GRID) / _GRID
    waves = np.exp(1j * np.outer(h, phase))
    at = phase[np.argmax(sign * (c @ waves).real, axis=1)]
    for _ in range(_STEPS):
        terms = c * np.exp(1j * at[:, None] * h)
        slope, curvature = (terms * 1j * h).real.sum(axis=1), -(terms * h**2).real.sum(axis=1)
        step = slope / np.where(curvature == 0, 1.0, curvature)
        at = at - np.clip(step, -2 * np.pi / _GRID, 2 * np.pi / _GRID)
    return (c * np.exp(1j * at[:, None] * h)).real.sum(axis=1), at


def half_range(x: Array, equations: Equations, harmonics: int) -> HalfRange:
    """Return half of peak to peak of the response over the period."""
    h, cosines, sines = _places(equations, harmonics, equations.response)
    c = phasors(x, equations, harmonics, equations.response)
    symmetric = equations.coordinates[equations.response].parity == "odd"
    value, gradient = np.zeros(len(x)), np.zeros_like(x)
    for sign in (1.0,) if symmetric else (1.0, -1.0):
        share = sign if symmetric else 0.5 * sign
        height, at = _turning_point(c, h, sign)
        value += share * height
        gradient[:, cosines] += share * np.cos(at[:, None] * h)
        gradient[:, sines] += share * np.sin(at[:, None] * h[h > 0])
    return HalfRange(value, gradient)


# A steady motion is asked whether it stays: how a small disturbance grows over one period.
#
# The equations are linearised along the motion, δẏ = A(t) δy, in first-order form: coordinates, their rates, and the
# copies that lag behind. The mean of A over an interval holds for it, whose map is the (4, 4) Padé approximant of
# exp(A h): stable for whatever is fast, the axial motion of a head or a gear that sticks. With 64 intervals over half a
# period the largest multiplier is as exact as with one for each of 256 samples and the (2, 2) approximant.
#
# Where the equations are symmetric half a period is enough: with S the change of sign of the odd coordinates, the
# half map S Φ(T/2) has the square roots of the multipliers as eigenvalues. One at +1 belongs to a fold, one at -1 to
# a loss of symmetry.

_INTERVALS = 64


def means_of(local: jax.Array, equations: Equations) -> jax.Array:
    """Return the means over the intervals, (c, k, i), of the slopes of the rates by the channels at samples, (c, k, n).

    There are `_INTERVALS` or more over half a period, each with a whole number of samples.
    """
    samples = local.shape[2]
    wanted = _INTERVALS if is_symmetric(equations) else 2 * _INTERVALS
    together = max(d for d in range(1, samples + 1) if samples % d == 0 and samples // d >= min(wanted, samples))
    return jnp.stack([local[:, :, i::together] for i in range(together)]).mean(axis=0)


def half_map(mean: Array, omega: Array, equations: Equations) -> Array:
    """Return the maps (..., s, s) of disturbances over half a period, odd coordinates turned back; over a whole one
    where the equations are not symmetric.

    mean: of `means_of`, (..., c, s, i), whose channels stand in the order of the states: lower derivatives and lagging
    copies, coordinate by coordinate. omega: Ω [rad/s], (...).
    """
    symmetric, total, begin = is_symmetric(equations), size_of(equations), 0
    slopes, sign = np.zeros((*mean.shape[:-3], mean.shape[-1], total, total)), np.ones(total)
    for c, coordinate in enumerate(equations.coordinates):
        top = begin + coordinate.order - 1
        if coordinate.order == 2:
            slopes[..., begin, top] = 1.0
        slopes[..., top, :] = np.moveaxis(mean[..., c, :, :], -2, -1)
        for k, relaxation in enumerate(coordinate.relaxed, top + 1):
            slopes[..., k, begin], slopes[..., k, k] = 1 / relaxation, -1 / relaxation
        end = top + 1 + len(coordinate.relaxed)
        sign[begin:end] = -1.0 if symmetric and coordinate.parity == "odd" else 1.0
        begin = end
    step = (np.pi if symmetric else 2 * np.pi) / np.asarray(omega) / mean.shape[-1]
    slopes *= step[..., None, None, None]
    # Disturbances of what is not a motion may grow beyond all numbers: it is not stable, and nobody need be warned.
    with np.errstate(over="ignore", invalid="ignore"):
        square, one = slopes @ slopes, np.eye(total)
        even, odd = square @ square + 180 * square + 1680 * one, slopes @ (20 * square + 840 * one)
        maps = np.linalg.solve(even - odd, even + odd)
        whole = maps[..., 0, :, :]
        for i in range(1, mean.shape[-1]):
            whole = maps[..., i, :, :] @ whole
    return np.asarray(sign[:, None] * whole)


def largest_multiplier(maps: NDArray[np.float64], equations: Equations) -> NDArray[np.float64]:
    """Return the modulus of the largest Floquet multiplier of each map (..., s, s); a motion is stable below one."""
    largest = np.max(np.abs(np.linalg.eigvals(maps)), axis=-1)
    return np.asarray(largest**2 if is_symmetric(equations) else largest)


BLOCK = 16
"""Motions that are evaluated in one call; any number runs in blocks of this size, so that it is compiled once."""

_REFINEMENTS, _ENOUGH = 4, 3e-4
_SAME = 2e-4  # of the motion, for its map: moves the multipliers of the paper's joint by 4e-4, half of what samples do
_SETTLED, _NEAR = 0.03, 0.05


class Evaluation(NamedTuple):
    """Of each motion (k,): what is left over (k, m), and its slope (k, m, m + 1)."""

    left: Array
    slope: Array


class Examination(NamedTuple):
    """Of each point (k,), refined: motion, its scaled unknowns (k, m + 1); frequency scaled; half_range of the
    response; its phasors (k, h); the drive's fundamental; product, drive times conjugate response; all in the scales of
    their coordinates. Further what the refinement changed in half_range and in the frequency [1], the map of
    disturbances (k, s, s), and whether the refinement settled near the point."""

    motion: Array
    frequency: Array
    half_range: Array
    response: NDArray[np.complex128]
    drive: NDArray[np.complex128]
    product: NDArray[np.complex128]
    range_change: Array
    frequency_change: Array
    maps: Array
    settled: Mask


def rows_of(tree: Any, index: NDArray[np.intp]) -> Any:
    """Return the rows of every leaf of a tree."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[index], tree)


@cache
def pool() -> ThreadPoolExecutor:
    """Return the threads that blocks run in."""
    return ThreadPoolExecutor(max_workers=cores(), thread_name_prefix="sinew-solve")


@program(static=("equations", "size"), options=QUICK_COMPILE)
def _balances(x: jax.Array, lane: Lane, *, equations: Equations, size: Size) -> tuple[jax.Array, ...]:
    def one(x: jax.Array, lane: Lane) -> tuple[jax.Array, ...]:
        found = balance(x, lane, equations, size, often=True)
        return found.left, found.slope, means_of(found.local, equations)

    return jax.vmap(one)(x, lane)


def in_blocks(
    compiled: Any, x: Any, lane: Lane, equations: Equations, size: Size, width: int = BLOCK
) -> tuple[Array, ...]:
    """Return what a compiled function says of k motions x, a tree with a leading axis, which it takes in blocks."""
    count = len(jax.tree.leaves(x)[0])
    blocks = [np.minimum(np.arange(i, i + width), count - 1) for i in range(0, count, width)]

    def run(index: NDArray[np.intp]) -> list[Array]:
        rows, lanes = rows_of(x, index), rows_of(lane, index)
        return [np.asarray(leaf) for leaf in compiled(rows, lanes, equations=equations, size=size)]

    parts = [run(blocks[0])] if len(blocks) == 1 else list(pool().map(run, blocks))
    return tuple(np.concatenate(part)[:count] for part in zip(*parts, strict=True))


def solved(matrix: Array, right: Array) -> Array:
    """Return the solutions (k, n) of systems (k, n, n), right sides (k, n). Raises LinAlgError where one has none."""
    return np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0])


def evaluate(x: Array, lane: Lane, equations: Equations, size: Size) -> Evaluation:
    """Return the evaluation of k motions x (k, m + 1); lane: with a leading axis k."""
    if not len(x):
        m = x.shape[1] - 1
        return Evaluation(np.zeros((0, m)), np.zeros((0, m, m + 1)))
    return Evaluation(*in_blocks(_balances, x, lane, equations, size)[:2])


def maps_of(x: Array, lane: Lane, equations: Equations, size: Size) -> Array:
    """Return the map of disturbances (k, s, s) of k motions x (k, m + 1); lane: with a leading axis k."""
    if not len(x):
        return np.zeros((0, size_of(equations), size_of(equations)))
    mean = in_blocks(_balances, x, lane, equations, size)[2]
    return half_map(mean, x[:, -1] * np.asarray(lane.omega), equations)


def _corrected(
    x: Array, normals: Array, lane: Lane, equations: Equations, size: Size, *, mapped: bool
) -> tuple[Array, ...]:
    """Return the corrections of k motions across normals, (k, m + 1), and where wanted the maps there, (k, s, s).

    Systems are solved block by block: those of a whole curve at once are an array that no cache holds.
    """

    def compiled(given: tuple[Array, Array], lane: Lane, *, equations: Equations, size: Size) -> tuple[Array, ...]:
        left, slope, mean = _balances(given[0], lane, equations=equations, size=size)
        matrix = np.concatenate([np.asarray(slope), given[1][:, None, :]], axis=1)
        change = solved(matrix, np.concatenate([-np.asarray(left), np.zeros((len(left), 1))], axis=1))
        return change, *([half_map(np.asarray(mean), given[0][:, -1] * lane.omega, equations)] if mapped else [])

    return in_blocks(compiled, (x, normals), lane, equations, size)


def examine(
    points: Array, normals: Array, lane: Lane, equations: Equations, size: Size, fine: Size, *, stability: bool = True
) -> Examination:
    """Return the examination of k points.

    points: scaled unknowns (k, m + 1). normals: across which they are refined, (k, m + 1), the curve's tangents.
    lane: with a leading axis k. size, fine: of the waves as they are, and as they are to be. stability: whether the
    maps are wanted, which take a tenth of the time; else they have no rows and columns. They are those of the motion
    before its last correction, which is below `_SAME` where the refinement settles: they are hardly more exact.
    """
    columns = embedded(equations, size.harmonics, fine.harmonics)
    wide, normal = np.zeros((2, len(points), columns[-1] + 1))
    wide[:, columns], normal[:, columns] = points, normals
    there, states = wide.copy(), size_of(equations) if stability else 0
    left, last, maps = np.arange(len(points)), np.zeros(len(points)), np.zeros((len(points), states, states))
    enough = _SAME if stability else _ENOUGH

    for step in range(_REFINEMENTS):
        if not left.size:
            break
        mapped = stability and step > 0
        change, *seen = _corrected(there[left], normal[left], rows_of(lane, left), equations, fine, mapped=mapped)
        there[left] += change
        last[left] = np.linalg.norm(change, axis=1)
        if mapped:
            maps[left] = seen[0]
        left = left[(last[left] > enough) | (stability and not mapped)]
    moved = there[:, -1] / wide[:, -1] - 1
    before, after = (half_range(x, equations, fine.harmonics).value for x in (wide, there))
    return Examination(
        there,
        there[:, -1],
        after,
        phasors(there, equations, fine.harmonics, equations.response),
        drive_phasor(there, equations, fine.harmonics),
        lag_product(there, equations, fine.harmonics)[0],
        after - before,
        moved,
        maps,
        (last < _SETTLED) & (np.abs(moved) < _NEAR),
    )
