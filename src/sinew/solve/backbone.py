"""Backbones: where a joint resonates, in frequency and amplitude, over the drive.

Resonance is phase resonance: the response's fundamental lags 90° behind what drives it, the torque, the base's motion
or the lever. A viscous damper then takes up just what the drive puts in, and what is left is the free motion of the
joint without losses. The curve begins at a small share of the drive, where the joint is linear, and ends at the whole.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.solve.balance import QUICK_COMPILE, Equations, Lane, Size, balance, embedded, orders, size_of, unknowns
from sinew.solve.branch import Branch
from sinew.solve.curves import Problem, Resolution, at_rest
from sinew.solve.examination import (
    drive_phasor,
    half_map,
    half_range,
    in_blocks,
    lag_product,
    largest_multiplier,
    means_of,
    phasors,
    rows_of,
    solved,
)
from sinew.solve.programs import program

# The balance is extended by two unknowns' worth of conditions: phase resonance, followed over the drive.
#
# Unknowns y = (x, s): a motion x = (q / scale, Ω / omega) and the share s of the drive that acts. Equations: balance
# F(x, s) = 0, and the fundamental of the response 90° behind that of what drives it, Re(drive · conj(response)) = 0.
# They leave a curve, the backbone; one row more, a plane or a share, picks a point of it.


_STEPS = 8


class Extended(NamedTuple):
    """Of each point (k,): what is left over (k, m + 1), its slope (k, m + 1, m + 2), map of disturbances (k, s, s)."""

    left: Array
    slope: Array
    maps: Array


class Corrected(NamedTuple):
    """Points (k, m + 2), the size of their last correction (k,), and their evaluation before it."""

    points: Array
    error: Array
    seen: Extended


@program(static=("equations", "size", "weakened"), options=QUICK_COMPILE)
def _block(y: jax.Array, lane: Lane, *, equations: Equations, size: Size, weakened: object) -> tuple[jax.Array, ...]:
    def one(y: jax.Array, lane: Lane) -> tuple[jax.Array, ...]:
        x, share = y[:-1], y[-1]

        def lane_at(share: jax.Array) -> Lane:
            return lane._replace(p=weakened(lane.p, share))  # type: ignore[operator]

        left, slope, local = balance(x, lane_at(share), equations, size)
        by_share = jax.jacfwd(lambda s: balance(x, lane_at(s), equations, size).left)(share)
        return left, jnp.concatenate([slope, by_share[:, None]], axis=1), means_of(local, equations)

    return jax.vmap(one)(y, lane)


def evaluate_extended(y: Array, lanes: NDArray[np.intp], problem: Problem, size: Size) -> Extended:
    """Return the evaluation of k points y (k, m + 2); lanes: of the problem, one for each, (k,)."""
    equations = problem.equations
    if not len(y):
        m, states = y.shape[1] - 1, size_of(equations)
        return Extended(np.zeros((0, m)), np.zeros((0, m, m + 1)), np.zeros((0, states, states)))
    each = partial(_block, weakened=problem.weakened)
    left, slope, mean = in_blocks(each, y, rows_of(problem.lane, lanes), equations, size)
    maps = half_map(mean, y[:, -2] * np.asarray(problem.lane.omega)[lanes], equations)
    product, by_motion = lag_product(y[:, :-1], equations, size.harmonics)
    scale = np.maximum(np.abs(product), 1e-300)[:, None]
    row = np.concatenate([by_motion, np.zeros((len(y), 1))], axis=1) / scale
    left = np.concatenate([left, product.real[:, None] / scale], axis=1)
    return Extended(left, np.concatenate([slope, row[:, None, :]], axis=1), maps)


def corrected(
    y: Array, normal: Array, lanes: NDArray[np.intp], problem: Problem, size: Size, enough: float, steps: int = _STEPS
) -> Corrected:
    """Return the points of the backbone on the planes through guesses, by Newton's method.

    y: (k, m + 2). normal: of the planes, (k, m + 2). enough: size of the correction at which a point is taken.
    """
    there, error = y.copy(), np.full(len(y), np.inf)
    left: NDArray[np.intp] = np.arange(len(y))
    at_start = seen = evaluate_extended(there, lanes, problem, size)
    for step in range(steps if len(y) else 0):
        if step:
            seen = evaluate_extended(there[left], lanes[left], problem, size)
            for row, leaf in zip(at_start, seen, strict=True):
                row[left] = leaf
        matrix = np.concatenate([seen.slope, normal[left, None, :]], axis=1)
        off = np.sum(normal[left] * (y[left] - there[left]), axis=1)
        right = np.concatenate([-seen.left, off[:, None]], axis=1)
        change = _solved(matrix, right)
        there[left] += change
        error[left] = np.linalg.norm(change, axis=1)
        left = left[np.isfinite(error[left]) & (error[left] > enough)]
        if not left.size:
            break
    return Corrected(there, error, at_start)


def _solved(matrix: Array, right: Array) -> Array:
    """Return the solutions of systems (k, n, n); not a number where there is none."""
    try:
        return solved(matrix, right)
    except np.linalg.LinAlgError:
        return np.full_like(right, np.nan)


FIRST_SHARES = (0.02, 0.002, 0.0002)
"""Shares of the drive at which a backbone begins: the first at which the response is nearly linear."""

_POINTS, _FIRST, _LEAST, _MOST = 200, 0.01, 1e-5, 0.08
_GRID, _SECANTS, _NEWTON = 48, 4, 2
_ALIGNED, _STRAIGHT = 0.9, 0.99
_REFINEMENTS = 4
_WHOLE = "the backbone was followed up to the whole drive"


class Backbone(NamedTuple):
    """curve: points of phase resonance in the order of growing drive, without folds or peak of their own; multiplier is
    at constant drive. share: of the drive's amplitude, (n,)."""

    curve: Branch
    share: Array


def _driven(q: Array, frequency: Array, share: float, lanes: NDArray[np.intp], problem: Problem, size: Size) -> Array:
    """Return points (k, m + 2) at given scaled frequencies and a small share of the drive, near rest q (k, m)."""
    y = np.concatenate([q, frequency[:, None], np.full((len(q), 1), share)], axis=1)
    for _ in range(_NEWTON):
        seen = evaluate_extended(y, lanes, problem, size)
        m = q.shape[1]
        y[:, :m] -= solved(seen.slope[:, :m, :m], seen.left[:, :m])
    return y


def _ratio(y: Array, problem: Problem, size: Size) -> Array:
    """Return the real part of drive over response: smooth through a resonance, however sharp; zero at 90°."""
    equations, harmonics = problem.equations, size.harmonics
    first = orders(equations.coordinates[equations.response], harmonics) == 1
    response = phasors(y[:, :-1], equations, harmonics, equations.response)[:, first][:, 0]
    return np.asarray((drive_phasor(y[:, :-1], equations, harmonics) / response).real)


def _starts(problem: Problem, window: Array, share: float, size: Size) -> list[Array | None]:
    """Return a point (m + 2,) near the begin of each lane's backbone: where a weak drive's response passes 90°, of
    several crossings the one with the largest response. None where there is none in the window."""
    rest = at_rest(problem, size, 0.0)[:, :-1]
    grid, count = np.linspace(window[0], window[1], _GRID), len(rest)
    each = np.repeat(np.arange(count), _GRID)
    y = _driven(rest[each], np.tile(grid, count), share, each, problem, size)
    ratio = _ratio(y, problem, size).reshape(count, _GRID)
    lag = lag_product(y[:, :-1], problem.equations, size.harmonics)[0].imag.reshape(count, _GRID)
    height = half_range(y[:, :-1], problem.equations, size.harmonics).value.reshape(count, _GRID)
    passed = (ratio[:, :-1] > 0) & (ratio[:, 1:] <= 0) & ((lag[:, :-1] > 0) | (lag[:, 1:] > 0))
    best = np.argmax(np.where(passed, np.maximum(height[:, :-1], height[:, 1:]), -1.0), axis=1)
    lanes = np.flatnonzero(passed.any(axis=1))
    starts: list[Array | None] = [None] * count
    if not lanes.size:
        return starts
    i = best[lanes]
    low, high, below, above = grid[i], grid[i + 1], ratio[lanes, i], ratio[lanes, i + 1]
    for _ in range(_SECANTS):
        middle = low + (high - low) * below / (below - above)
        y = _driven(rest[lanes], middle, share, lanes, problem, size)
        here = _ratio(y, problem, size)
        up = here > 0
        low, below, above = np.where(up, middle, low), np.where(up, here, below), np.where(up, 0.5 * above, above)
        high, above, below = np.where(up, high, middle), np.where(up, above, here), np.where(up, below, 0.5 * below)
    for lane, row in zip(lanes, y, strict=True):
        starts[int(lane)] = row
    return starts


def _tangents(slope: Array, forward: Array) -> Array:
    """Return unit tangents (k, m + 2) that go the way of `forward`, from the slopes of the extended balance."""
    matrix = np.concatenate([slope, forward[:, None, :]], axis=1)
    last = np.zeros_like(forward)
    last[:, -1] = 1.0
    tangent = solved(matrix, last)
    return np.asarray(tangent / np.linalg.norm(tangent, axis=1, keepdims=True))


class _Walk:
    """Lanes on their way, each with a step of its own; one call evaluates the next point of all."""

    def __init__(self, problem: Problem, window: Array, size: Size, enough: float) -> None:
        self.problem, self.window, self.size, self.enough = problem, window, size, enough
        lanes, width = problem.rest.shape[0], unknowns(problem.equations, size.harmonics) + 2
        self.points: list[list[Array]] = [[] for _ in range(lanes)]
        self.tangents: list[list[Array]] = [[] for _ in range(lanes)]
        self.across: list[list[Array]] = [[] for _ in range(lanes)]
        self.message = [""] * lanes
        self.step = np.full(lanes, _FIRST)
        self.level = np.eye(width)[-1]

    def _take(self, lane: int, point: Array, tangent: Array, across: Array) -> None:
        self.points[lane].append(point)
        self.tangents[lane].append(tangent)
        self.across[lane].append(across)

    def table(self, rows: list[list[Array]]) -> Array:
        """Return the rows of all lanes, one after the other, (k, m + 2)."""
        return np.array([row for own in rows for row in own]).reshape(-1, self.level.size)

    def begin(self, share: float) -> list[int]:
        """Put every lane that is on none on its first point, at a share of the drive; return those that have one."""
        starts = _starts(self.problem, self.window, share, self.size)
        lanes = [i for i, start in enumerate(starts) if start is not None and not self.points[i]]
        for lane, start in enumerate(starts):
            if start is None:
                self.message[lane] = "a weak drive's response does not pass 90° in the band; widen it"
        if not lanes:
            return []
        y = np.stack([start for i, start in enumerate(starts) if start is not None and i in lanes])
        level = np.tile(self.level, (len(y), 1))
        first = corrected(y, level, np.array(lanes), self.problem, self.size, self.enough)
        begun = []
        for i, lane in enumerate(lanes):
            if first.error[i] <= self.enough:
                self._take(lane, first.points[i], _tangents(first.seen.slope[i : i + 1], level[:1])[0], self.level)
                self.message[lane] = f"the backbone was not finished after {_POINTS} points"
                begun.append(lane)
            else:
                self.message[lane] = "no phase resonance was found at a weak drive; widen the band"
        return begun

    def advance(self, lanes: list[int]) -> list[int]:
        """Move every lane by a step, or shorten its step; return those that are still on their way."""
        base, tangent = (np.stack([rows[i][-1] for i in lanes]) for rows in (self.points, self.tangents))
        share = base[:, -1] + self.step[lanes] * tangent[:, -1]
        landing = share >= 1
        length = np.where(landing, (1 - base[:, -1]) / np.where(landing, tangent[:, -1], 1.0), self.step[lanes])
        normal = np.where(landing[:, None], self.level, tangent)
        guess = base + length[:, None] * tangent
        done = corrected(guess, normal, np.array(lanes), self.problem, self.size, self.enough)
        found = done.error <= self.enough
        ahead = -tangent.copy()
        ahead[found] = _tangents(done.seen.slope[found], tangent[found])
        straight = np.sum(ahead * tangent, axis=1)
        left = []
        for i, lane in enumerate(lanes):
            if straight[i] < _ALIGNED:
                self.step[lane] *= 0.5
                if self.step[lane] >= _LEAST:
                    left.append(lane)
                else:
                    self.message[lane] = "the backbone was lost where even the smallest step found no phase resonance"
            elif not self.window[0] <= done.points[i, -2] <= self.window[1]:
                self.message[lane] = "the backbone left the band; widen it"
            else:
                self._take(lane, done.points[i], ahead[i], normal[i])
                if landing[i]:
                    self.message[lane] = _WHOLE
                elif len(self.points[lane]) < _POINTS:
                    left.append(lane)
                if straight[i] > _STRAIGHT:
                    self.step[lane] = min(_MOST, 1.5 * self.step[lane])
        return left


def _refined(
    points: Array, across: Array, lanes: NDArray[np.intp], problem: Problem, sizes: tuple[Size, Size], enough: float
) -> Corrected:
    """Return the points (k, m + 2) with finer waves, (k, M + 2), moved in the planes `across` only."""
    size, fine = sizes
    inner = embedded(problem.equations, size.harmonics, fine.harmonics)
    columns = np.append(inner, inner[-1] + 1)
    wide, normal = np.zeros((2, len(points), columns[-1] + 1))
    wide[:, columns], normal[:, columns] = points, across
    return corrected(wide, normal, lanes, problem, fine, enough, _REFINEMENTS)


def _backbone(
    lane: int, points: Array, fine: Array, maps: Array, message: str, problem: Problem, sizes: tuple[Size, Size]
) -> Backbone:
    """Return the backbone of one lane from its points with coarse (n, m + 2) and fine (n, M + 2) waves."""
    equations, (size, finer) = problem.equations, sizes
    scale = np.asarray(problem.lane.scale)[lane]
    hertz = float(np.asarray(problem.lane.omega)[lane]) / (2 * np.pi)
    drive_scale = 1.0 if equations.drive is None else scale[equations.drive]
    x = fine[:, :-1]
    rough, well = (half_range(z, equations, s.harmonics).value for z, s in ((points[:, :-1], size), (x, finer)))
    change = np.abs(well - rough) / (np.max(well, initial=0.0) or 1.0)
    moved = np.abs(x[:, -1] / points[:, -2] - 1)
    curve = Branch(
        frequency_hz=x[:, -1] * hertz,
        amplitude=well * scale[equations.response],
        phase=np.angle(lag_product(x, equations, finer.harmonics)[0]),
        orders=orders(equations.coordinates[equations.response], finer.harmonics),
        harmonics=phasors(x, equations, finer.harmonics, equations.response) * scale[equations.response],
        drive=drive_phasor(x, equations, finer.harmonics) * drive_scale,
        multiplier=largest_multiplier(maps, equations) if len(maps) else np.zeros(0),
        folds=(),
        peak=None,
        phase_90=None,
        error=np.maximum(change, moved),
        complete=message == _WHOLE,
        message=message,
    )
    return Backbone(curve, fine[:, -1])


def follow_backbones(problem: Problem, band_hz: tuple[float, float], resolution: Resolution) -> tuple[Backbone, ...]:
    """Return the backbone of every lane, from a small share of its drive to the whole.

    band_hz: frequencies among which the first point is sought, and which the backbone may not leave. Sizes of waves are
    tried one after the other until the error estimate is below the resolution's tolerance.
    """
    window = 2 * np.pi * np.asarray(band_hz, dtype=float) / np.asarray(problem.lane.omega)[0]
    for size, fine in resolution.sizes:
        walk = _Walk(problem, window, size, resolution.stride.tolerance)
        left = []
        for share in FIRST_SHARES:
            left += walk.begin(share) if any(not rows for rows in walk.points) else []
        while left:
            left = walk.advance(left)
        counts = [len(rows) for rows in walk.points]
        lanes = np.repeat(np.arange(len(counts)), counts)
        points, across = (walk.table(rows) for rows in (walk.points, walk.across))
        done = _refined(points, across, lanes, problem, (size, fine), walk.enough)
        found = []
        for lane, message in enumerate(walk.message):
            own = lanes == lane
            refined = done.points[own], done.seen.maps[own]
            found.append(_backbone(lane, points[own], *refined, message, problem, (size, fine)))
        backbones = tuple(found)
        if max((float(np.max(b.curve.error, initial=0.0)) for b in backbones), default=0.0) <= resolution.tolerance:
            break
    return backbones
