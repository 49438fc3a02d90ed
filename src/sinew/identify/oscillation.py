"""Steady oscillations of one degree of freedom in normal form: at given frequencies, lags, and free without losses.

In the normal form of `sinew.identify.oscillator.track`, driven by g Re(a exp(jΩt)), the motion is balanced by
`sinew.solve`. Linear laws have one harmonic, which one step of Newton's method finds. Dry friction turns round over
`DryFriction.SLIDING_SHARE` of the largest speed; a motion that rests for a part of its period creeps instead.

Time is counted so that the relaxation times of a loss factor are the twin's own, whatever the oscillator's frequency:
what is compiled depends on the laws alone.
"""

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array, Complexes, Mask
from sinew.mechanics.laws import DryFriction, Law, LossFactor, Pendulum, Quadratic
from sinew.mechanics.silicone import relaxation_times
from sinew.solve.balance import Coordinate, Equations, Lane, Size, orders
from sinew.solve.curves import Problem, Resolution, first_curves
from sinew.solve.examination import evaluate, half_range, phasors
from sinew.solve.programs import configure
from sinew.solve.steady import at_frequency, steady

_TIMES = tuple(float(tau) for tau in relaxation_times())
_FREE_STEPS = 40
_LONGEST_STEP, _CLOSE, _SETTLED = 0.3, 1e-4, 1e-9  # of a motion's size: steps of Newton's method, longest and last


class Laws(NamedTuple):
    """What kind of joint it is. natural: ω_r in the time whose relaxation times are the twin's. amplitude: A where a
    pendulum's sin(r A) needs it [rad]."""

    law: Law
    natural: float = 1.0
    amplitude: float = 1.0

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the numbers that its steady oscillation depends on, l of them; the last is the gain."""
        return number_names(self.law)

    @property
    def linear(self) -> bool:
        """Return whether the steady oscillation has one harmonic: no number of such a force counts in amplitudes."""
        return not self.law.has(Pendulum) and all(number.scale[1] == 0 for number in self.law.numbers)

    @property
    def equations(self) -> Equations:
        """Return the equations of motion, for `_Numbers`."""
        return _equations(self.law.compiled, self.law.has(Quadratic))

    @property
    def size(self) -> Size:
        """Return how finely the motion is resolved."""
        whole = 2 if self.law.has(Quadratic) else 1
        if self.linear:
            return Size(1, 4)
        return Size(9, 512 * whole) if self.law.sticks else Size(7, 32 * whole)

    @property
    def orders(self) -> NDArray[np.int64]:
        """Return the orders h of the motion's harmonics."""
        return orders(self.equations.coordinates[0], self.size.harmonics)

    @property
    def first(self) -> tuple[int, int]:
        """Return where Re r₁ and -Im r₁ stand among the unknowns."""
        h = self.orders
        return int(np.flatnonzero(h == 1)[0]), h.size + int(np.flatnonzero(h[h > 0] == 1)[0])


def number_names(law: Law) -> tuple[str, ...]:
    """Return the names of the numbers that a law's steady oscillation depends on; the last is the gain."""
    return (*(number.name for number in law.compiled.numbers), "gain")


class Drive(NamedTuple):
    """A drive in normal form: a = size·(jΩ)^power, as of a force (0) or a moved base or lever (2). size: one number, or
    one for each lane."""

    size: float | Array
    power: int


class Oscillations(NamedTuple):
    """Steady oscillations of n lanes. fundamental: r₁, shape (n,). slopes: its derivatives by the numbers, shape
    (n, l). found: whether the balance was reached, shape (n,)."""

    fundamental: Complexes
    slopes: Complexes
    found: Mask


class _Numbers(NamedTuple):
    """numbers: those of the law. push: real and imaginary part of a / Ω^power. speed: over which dry friction turns."""

    numbers: Any
    push: Any
    power: Any
    natural: Any
    speed: Any
    amplitude: Any


@cache
def _equations(law: Law, lopsided: bool) -> Equations:
    times = _TIMES if law.has(LossFactor) else ()

    def rates(u: jax.Array, phase: jax.Array, omega: jax.Array, p: _Numbers) -> jax.Array:
        speed = u[1] / p.natural
        given = {"relaxation": p.natural * jnp.asarray(_TIMES), "amplitude": p.amplitude, "speed": p.speed}
        values = law.prepared(dict(zip(number_names(law), p.numbers, strict=True)) | given)
        own = tuple(u[2:] if isinstance(term, LossFactor) else () for term in law.terms)
        force = law.force(values, u[0], speed, own)
        wave = p.push[0] * jnp.cos(phase) - p.push[1] * jnp.sin(phase)
        push = p.numbers[-1] * wave * (omega / p.natural) ** p.power
        return jnp.stack([p.natural**2 * (push - force)])

    return Equations((Coordinate("motion", "all" if lopsided else "odd", 2, times),), rates)


def _lane(numbers: Array, drive: Drive, laws: Laws, speed: Array) -> Lane:
    """Return n lanes. numbers: shape (n, l), speed: the largest of each motion, shape (n,)."""
    one = np.ones(len(numbers))
    push = drive.size * one * 1j**drive.power
    p = _Numbers(
        np.asarray(numbers, dtype=float),
        np.stack([push.real, push.imag], axis=1),
        drive.power * one,
        laws.natural * one,
        DryFriction.SLIDING_SHARE * np.maximum(speed, 1e-12),
        laws.amplitude * one,
    )
    return Lane(p, one[:, None], laws.natural * one)  # type: ignore[arg-type]


def _written(waves: Complexes, omega: Array, laws: Laws) -> Array:
    """Return scaled unknowns (n, m + 1) of harmonics (n, h), as `sinew.solve.examination.phasors` reads them."""
    h = laws.orders
    return np.concatenate([waves.real, -waves.imag[:, h > 0], omega[:, None]], axis=1)


def oscillate(numbers: Array, omega: Array, drive: Drive, laws: Laws, start: Complexes) -> Oscillations:
    """Return the steady oscillations nearest to a start.

    numbers: those of `Laws.names`, shape (l,). omega: drive frequency in ω_r, shape (n,). start: r₁ as measured, shape
    (n,): where several oscillations are possible it says which is meant.
    """
    configure()
    lane = _lane(np.broadcast_to(numbers, (omega.size, numbers.size)), drive, laws, omega * np.abs(start))
    h = laws.orders
    found = at_frequency(_written(start[:, None] * (h == 1), omega, laws), lane, laws.equations, laws.size)
    cosine, sine = laws.first
    slopes = found.slopes[:, cosine, : numbers.size] - 1j * found.slopes[:, sine, : numbers.size]
    return Oscillations(fundamentals(found.x, laws), slopes, found.found)


def _weakened(p: _Numbers, share: float) -> _Numbers:
    return p._replace(push=p.push * share)


def driven(numbers: Array, push: Array, power: int, laws: Laws, scale: Array) -> Problem:
    """Return the problem of n lanes over frequency, each under push (Ω/ω_r)^power sin Ωt.

    numbers: shape (n, l). push: in normal form, shape (n,). scale: about how far each of them swings, in A, shape (n,).
    """
    lane = _lane(numbers, Drive(0.0, power), laws, scale)
    sine = np.stack([np.zeros_like(push), -push], axis=1)
    lane = lane._replace(p=lane.p._replace(push=sine), scale=scale[:, None])  # type: ignore[arg-type]
    return Problem(laws.equations, lane, np.zeros((len(numbers), 1)), _weakened)


def push_needed(numbers: Array, omega: float, amplitude: Array, laws: Laws) -> tuple[Array, Array, Lane]:
    """Return (push, unknowns (n, m + 1), lanes): how large a push holds motions of given sizes at a frequency.

    numbers: shape (n, l). omega: in ω_r. amplitude: half of peak to peak, in A, shape (n,). push: in normal form, shape
    (n,); NaN where no such motion was found.

    A push has a fundamental only. So the balance of all other harmonics says what the motion of that size is, and what
    the fundamental's balance then lacks is the push: one answer, where the amplitude to a push may have three.
    """
    configure()
    equations, size, fast = laws.equations, laws.size, laws.natural**2
    lane, h = _lane(numbers, Drive(0.0, 0), laws, omega * amplitude), laws.orders
    x = _written(amplitude[:, None] * (h == 1) + 0j, np.full(amplitude.size, omega), laws)
    both = np.array(laws.first)
    sought = np.delete(np.arange(x.shape[1] - 1), both[1])
    others = np.delete(np.arange(x.shape[1] - 1), both)
    off = np.full(amplitude.size, np.inf)
    for _ in range(_FREE_STEPS):
        seen, reach = evaluate(x, lane, equations, size), half_range(x, equations, size.harmonics)
        left = np.concatenate([seen.left[:, others] / fast, (reach.value - amplitude)[:, None]], axis=1)
        rows = [seen.slope[:, others][:, :, sought] / fast, reach.gradient[:, None, sought]]
        step = np.linalg.solve(np.concatenate(rows, axis=1), left[:, :, None])[:, :, 0]
        off = np.linalg.norm(step, axis=1) / amplitude
        x[:, sought] -= step * np.minimum(1.0, _LONGEST_STEP / np.maximum(off, 1e-300))[:, None]
        if np.all(off < _SETTLED):
            break
    lacking = np.linalg.norm(evaluate(x, lane, equations, size).left[:, both], axis=1) / fast
    return np.where(off < _CLOSE, lacking, np.nan), x, lane


def swept(numbers: Array, laws: Laws, drive: Drive, low: float, high: float) -> Array:
    """Return the unknowns x (n, m + 1), the last of them Ω in ω_r, along the curve between two frequencies, through its
    folds; numbers: shape (l,)."""
    configure()
    lane = _lane(numbers[None], drive, laws, np.ones(1))
    problem = Problem(laws.equations, lane, np.zeros((1, 1)), _weakened)
    curve = first_curves(problem, np.array([low, high]), Resolution((), 0.0), laws.size)
    return np.asarray(curve.points)[0, : int(curve.number[0])]


def fundamentals(x: Array, laws: Laws) -> Complexes:
    """Return r₁ of unknowns (n, m + 1), shape (n,)."""
    cosine, sine = laws.first
    return np.asarray(x[:, cosine] - 1j * x[:, sine])


def top_of_sweep(numbers: Array, laws: Laws, drive: Drive, low: float, high: float) -> tuple[Array, bool]:
    """Return the point of `swept` whose fundamental is largest, (m + 1,), and whether it is inside."""
    points = swept(numbers, laws, drive, low, high)
    if not len(points):
        return points, False
    top = int(np.argmax(np.abs(fundamentals(points, laws))))
    return points[top], 0 < top < len(points) - 1


def lag_of(x: Array, laws: Laws, drive: Drive) -> float:
    """Return how far the fundamental lags behind the push [rad], from 0 to 2π. x: unknowns (m + 1,)."""
    push = 1j**drive.power * np.sign(drive.size)
    return float(-np.angle(fundamentals(x[None], laws)[0] / push)) % (2 * np.pi)


def lagging(numbers: Array, lag: Array, laws: Laws, drive: Drive, near: Array) -> tuple[Array, Complexes, Mask]:
    """Return (frequency in ω_r, harmonics, whether they were found) of the oscillations that lag by given angles.

    numbers: shape (n, l). lag: of the fundamental behind j^power, shape (n,) [rad]. near: unknowns of a neighbour,
    (m + 1,). Against frequency a hardening joint's response folds back; against the lag it does not.
    """
    equations, size = laws.equations, laws.size
    h = laws.orders
    ray = np.exp(-1j * lag) * 1j**drive.power * np.sign(drive.size)
    waves = phasors(near[None], equations, size.harmonics, 0)
    first = complex(waves[0, h == 1][0])
    turned = np.angle(ray / first)
    start = _written(waves * np.exp(1j * turned[:, None] * h), np.full(lag.size, near[-1]), laws)
    row = np.zeros_like(start)
    cosine, sine = laws.first
    row[:, cosine], row[:, sine] = ray.imag, ray.real
    lane = _lane(numbers, drive, laws, np.full(lag.size, near[-1] * abs(first)))
    done = steady(start, row, np.zeros(lag.size), lane, equations, size)
    along = (fundamentals(done.x, laws) * np.conj(ray)).real
    return done.x[:, -1], phasors(done.x, equations, size.harmonics, 0), done.found & (along > 0) & (done.x[:, -1] > 0)
