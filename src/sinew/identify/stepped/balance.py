"""This is where a steady oscillation is balanced harmonic by harmonic, with derivatives by its mechanical numbers.

In the normal form of `sinew.identify.oscillator.track`, driven by g Re(a exp(jΩt)), the motion is r = r₀ + Re Σ r_h
exp(jhΩt), and

    [S(hΩ) - (hΩ)² + jhΩ D] r_h + N_h(r) = g a (h = 1), 0 (other h),

N_h being the harmonics of the terms that are not linear: they are taken of N(r(t)) on a grid of the period (alternating
frequency and time). S(Ω) is K, or the Prony series' K_r G*(Ω) of a constant loss factor. Linear laws have one harmonic,
and one step of Newton solves them in closed form. Dry friction is c sign(r'), whose mean over each interval of the grid
is exact for a rate that is straight there; a motion that rests for a part of its period is beyond it.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from sinew.mechanics.laws import Law, LossFactor, Pendulum, share_table

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

NUMBERS = ("stiffness", "damping", "loss_factor", "coulomb", "quadratic", "cubic", "gain")
"""The numbers that a steady oscillation depends on: stiffness to gain."""

_HARMONICS = 7
_GRID, _DRY_GRID = 64, 256
_STEPS, _HALVINGS = 40, 6
_TOLERANCE = 1e-10
_NUDGE = 1e-6


class Laws(NamedTuple):
    """What kind of joint it is. terms: whether any stiffness beyond the linear one takes part. relaxation: of the Prony
    branches in 1/ω_r, shape (b,). amplitude: A where a pendulum's sin(r A) needs it [rad]."""

    law: Law
    terms: bool
    relaxation: Array
    amplitude: float

    @property
    def linear(self) -> bool:
        """Return whether the steady oscillation follows in closed form."""
        return not (self.law.sticks or self.law.has(Pendulum) or self.terms)


class Balance(NamedTuple):
    """Steady oscillations of n lanes. harmonics: r₀, Re r₁, Im r₁, Re r₂, ..., shape (n, m). slopes: their derivatives
    by `NUMBERS`, shape (n, m, 7). found: whether the balance was reached, shape (n,)."""

    harmonics: Array
    slopes: Array
    found: NDArray[np.bool_]

    @property
    def fundamental(self) -> Complexes:
        """Return r₁, shape (n,)."""
        return np.asarray(self.harmonics[:, 1] + 1j * self.harmonics[:, 2])


@cache
def _share_table() -> CubicHermiteSpline:
    table = share_table()
    factors = np.linspace(0.0, LossFactor.LARGEST, table.shape[0])
    return CubicHermiteSpline(factors, table, np.gradient(table, factors, axis=0))


def dynamic_stiffness(numbers: Array, omega: Array, laws: Laws) -> Complexes:
    """Return S at the frequencies omega (n, h), shape (n, h)."""
    k, factor = numbers[:, 0, None], numbers[:, 2, None]
    if not laws.law.has(LossFactor):
        return np.asarray(k + 0j * omega)
    size = np.clip(np.abs(factor), 0.0, LossFactor.LARGEST)
    shares = np.sign(factor)[..., None] * _share_table()(size)

    def series(at: Array) -> Complexes:
        turn = 1j * at[..., None] * laws.relaxation
        return np.asarray(1.0 + np.sum(shares * turn / (1.0 + turn), axis=-1))

    return np.asarray(k * series(omega) / series(np.sqrt(np.maximum(k, 1e-6))).real)


class _Waves(NamedTuple):
    """Basis of the harmonics on the grid (t, m), its derivative by the phase, and the projections (m, t) of what is
    given at the grid's points and at the middles between them."""

    basis: Array
    rate: Array
    project: Array
    project_middle: Array


@cache
def _waves(harmonics: int, grid: int) -> _Waves:
    phase = 2 * np.pi * np.arange(grid) / grid
    h = np.arange(1, harmonics + 1)

    def columns(at: Array) -> tuple[Array, Array]:
        cos, sin = np.cos(at[:, None] * h), np.sin(at[:, None] * h)
        values = np.stack([cos, -sin], axis=2).reshape(grid, -1)
        slopes = np.stack([-h * sin, -h * cos], axis=2).reshape(grid, -1)
        return np.concatenate([np.ones((grid, 1)), values], axis=1), np.concatenate(
            [np.zeros((grid, 1)), slopes], axis=1
        )

    def projection(values: Array) -> Array:
        weight = np.full(2 * harmonics + 1, 2.0 / grid)
        weight[0] = 1.0 / grid
        return np.asarray(weight[:, None] * values.T)

    basis, rate = columns(phase)
    middle, _ = columns(phase + np.pi / grid)
    return _Waves(basis, rate, projection(basis), projection(middle))


def _sign(v: Array) -> tuple[Array, Array, Array]:
    """Return the mean of sign over each interval of a grid, (n, t), and its slopes by the values at both ends."""
    after = np.roll(v, -1, axis=1)
    step = after - v
    turns = v * after < 0
    safe = np.where(turns, step, 1.0)
    mean = np.where(turns, (np.abs(after) - np.abs(v)) / safe, np.sign(v + after))
    return (
        mean,
        np.where(turns, (mean - np.sign(v)) / safe, 0.0),
        np.where(turns, (np.sign(after) - mean) / safe, 0.0),
    )


class System:
    """The balance of n lanes: residual and Jacobian in the real unknowns q, shape (n, m)."""

    def __init__(self, numbers: Array, omega: Array, push: Complexes, laws: Laws) -> None:
        self.laws, self.numbers, self.omega, self.push = laws, numbers, omega, push
        self.count = 1 if laws.linear else _HARMONICS
        self.waves = _waves(self.count, _DRY_GRID if laws.law.sticks else _GRID)
        self.at = omega[:, None] * np.arange(self.count + 1)
        self.complex_stiffness = dynamic_stiffness(numbers, self.at, laws)
        self.blocks = self.complex_stiffness - self.at**2 + 1j * self.at * numbers[:, 1, None]

    def rows(self, chosen: NDArray[np.intp]) -> "System":
        return System(self.numbers[chosen], self.omega[chosen], self.push[chosen], self.laws)

    def _powers(self, r: Array) -> tuple[Array, Array]:
        """Return the terms beyond the linear stiffness and their slope by r, (n, t)."""
        quadratic, cubic = self.numbers[:, 4, None], self.numbers[:, 5, None]
        force, slope = r * r * (quadratic + cubic * r), r * (2 * quadratic + 3 * cubic * r)
        if self.laws.law.has(Pendulum):
            relaxed, a = self.complex_stiffness[:, 0].real[:, None], self.laws.amplitude
            force = force + relaxed * (np.sin(r * a) / a - r)
            slope = slope + relaxed * (np.cos(r * a) - 1.0)
        return force, slope

    def residual(self, q: Array) -> Array:
        out = _real(self.blocks * _complex(q))
        out[:, 1] -= self.numbers[:, 6] * self.push.real
        out[:, 2] -= self.numbers[:, 6] * self.push.imag
        if not self.laws.linear:
            out = out + self._powers(q @ self.waves.basis.T)[0] @ self.waves.project.T
        if self.laws.law.sticks:
            mean = _sign(q @ self.waves.rate.T)[0]
            out = out + self.numbers[:, 3, None] * (mean @ self.waves.project_middle.T)
        return out

    def jacobian(self, q: Array) -> Array:
        out = _block_matrix(self.blocks)
        if not self.laws.linear:
            slope = self._powers(q @ self.waves.basis.T)[1]
            out = out + self.waves.project @ (slope[:, :, None] * self.waves.basis)
        if self.laws.law.sticks:
            _, begin, end = _sign(q @ self.waves.rate.T)
            ahead = np.roll(self.waves.rate, -1, axis=0)
            moved = begin[:, :, None] * self.waves.rate + end[:, :, None] * ahead
            out = out + self.numbers[:, 3, None, None] * (self.waves.project_middle @ moved)
        return np.asarray(out)

    def by_numbers(self, q: Array) -> Array:
        """Return the derivatives of the residual by `NUMBERS`, (n, m, 7)."""
        motion, r = _complex(q), q @ self.waves.basis.T
        out = np.zeros((*q.shape, len(NUMBERS)))
        for place in (0, 2) if self.laws.law.has(LossFactor) else (0,):
            moved = np.zeros(len(NUMBERS))
            moved[place] = _NUDGE
            pair = [dynamic_stiffness(self.numbers + s * moved, self.at, self.laws) for s in (1, -1)]
            change = (pair[0] - pair[1]) / (2 * _NUDGE)
            out[:, :, place] = _real(change * motion)
            if self.laws.law.has(Pendulum):
                a = self.laws.amplitude
                bent = (np.sin(r * a) / a - r) @ self.waves.project.T
                out[:, :, place] += change[:, 0].real[:, None] * bent
        out[:, :, 1] = _real(1j * self.at * motion)
        if self.laws.law.sticks:
            out[:, :, 3] = _sign(q @ self.waves.rate.T)[0] @ self.waves.project_middle.T
        if self.laws.terms:
            out[:, :, 4], out[:, :, 5] = r**2 @ self.waves.project.T, r**3 @ self.waves.project.T
        out[:, 1, 6], out[:, 2, 6] = -self.push.real, -self.push.imag
        return out


def _complex(q: Array) -> Complexes:
    return np.asarray(np.concatenate([q[:, :1] + 0j, q[:, 1::2] + 1j * q[:, 2::2]], axis=1))


def _real(z: Complexes) -> Array:
    pairs = np.stack([z[:, 1:].real, z[:, 1:].imag], axis=2).reshape(z.shape[0], -1)
    return np.concatenate([z[:, :1].real, pairs], axis=1)


def _block_matrix(blocks: Complexes) -> Array:
    n, m = blocks.shape[0], 2 * blocks.shape[1] - 1
    out = np.zeros((n, m, m))
    out[:, 0, 0] = blocks[:, 0].real
    odd, even = np.arange(1, m, 2), np.arange(2, m, 2)
    out[:, odd, odd] = out[:, even, even] = blocks[:, 1:].real
    out[:, even, odd], out[:, odd, even] = blocks[:, 1:].imag, -blocks[:, 1:].imag
    return out


def balance(numbers: Array, omega: Array, push: Complexes, laws: Laws, start: Complexes | Array) -> Balance:
    """Return the steady oscillations nearest to a start, by Newton's method with halved steps.

    numbers: of `NUMBERS`, shape (n, 7), or (7,) for all lanes. omega: drive frequency in ω_r, shape (n,).
    push: a, shape (n,). start: r₁ as measured, shape (n,), or the harmonics of a neighbour, shape (n, m): where several
    oscillations are possible it says which is meant.
    """
    numbers = np.broadcast_to(numbers, (omega.size, len(NUMBERS)))
    system = System(numbers, omega, push, laws)
    q = np.zeros((omega.size, 2 * system.count + 1))
    if start.ndim == 2:
        q[:] = start[:, : q.shape[1]].real
    else:
        q[:, 1], q[:, 2] = start.real, start.imag
    with np.errstate(all="ignore"):
        q, found = _newton(system, q)
        slopes = -solved(system.jacobian(q), system.by_numbers(q))
    return Balance(q, slopes, found)


def _size(system: System, q: Array) -> Array:
    size = np.linalg.norm(system.residual(q), axis=1)
    return np.where(np.isfinite(size), size, np.inf)


def _newton(system: System, q: Array) -> tuple[Array, NDArray[np.bool_]]:
    q, found = q.copy(), np.zeros(q.shape[0], dtype=bool)
    active = np.arange(q.shape[0])
    part, size = system, _size(system, q)
    for _ in range(_STEPS):
        scale = np.abs(part.numbers[:, 6] * part.push) + np.abs(part.numbers[:, 0] * q[active, 1]) + 1e-300
        done = size <= _TOLERANCE * scale
        if done.any():
            found[active[done]] = True
            active = active[~done]
            if not active.size:
                break
            part, size = system.rows(active), size[~done]
        here = q[active]
        step = solved(part.jacobian(here), part.residual(here)[:, :, None])[:, :, 0]
        step = np.where(np.isfinite(step), step, 0.0)
        share = np.ones(active.size)
        for _ in range(_HALVINGS):
            worse = _size(part, here - share[:, None] * step) > size
            if not worse.any():
                break
            share[worse] *= 0.5
        q[active] = here - share[:, None] * step
        size = _size(part, q[active])
    return q, found


def solved(matrix: Array, right: Array) -> Array:
    """Return the solutions of n systems; by the pseudo-inverse where one of them is exactly singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right), dtype=float)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(np.nan_to_num(matrix)) @ right)


# Steady oscillations are followed: by their lag through the peak, by their amplitude along the backbone.
#
# Against frequency a hardening joint's response folds back; against the lag of the motion behind the force it does not.

_BRANCH_STEPS = 40
_BRANCH_TOLERANCE = 1e-9
_SWEEP = 81


class Drive(NamedTuple):
    """A drive of one amplitude in normal form: a = size·(jΩ)^power, as of a force (0) or a moved base or lever (2)."""

    size: float
    power: int

    def push(self, omega: Array) -> Complexes:
        """Return a at the frequencies, shape (n,)."""
        return np.asarray(self.size * (1j * omega) ** self.power)


def top_of_sweep(numbers: Array, laws: Laws, drive: Drive, low: float, high: float) -> tuple[float, Array, bool]:
    """Return frequency and harmonics (m,) where the motion is largest between two frequencies, and whether that is
    inside. numbers: shape (7,). Swept up and down, so that the upper branch of a fold is found."""
    omega = np.linspace(low, high, _SWEEP)
    push = drive.push(omega)
    dynamic = dynamic_stiffness(np.tile(numbers, (omega.size, 1)), omega[:, None], laws)[:, 0]
    linear = numbers[6] * push / (dynamic - omega**2 + 1j * omega * numbers[1])
    swept = balance(numbers, omega, push, laws, np.asarray(linear))
    harmonics, found = swept.harmonics, swept.found
    if not laws.linear:
        harmonics, found = _followed(numbers, omega, push, laws, swept)
    size = np.where(found, np.hypot(harmonics[:, 1], harmonics[:, 2]), -1.0)
    top = int(np.argmax(size))
    return float(omega[top]), harmonics[top], 0 < top < omega.size - 1


def _followed(
    numbers: Array, omega: Array, push: Complexes, laws: Laws, alone: Balance
) -> tuple[Array, NDArray[np.bool_]]:
    """Return harmonics (n, m) and whether they were found, the larger of the ways up and down. alone: each frequency
    from the linear motion, where a way begins or was lost."""
    ways = np.zeros((2, omega.size, alone.harmonics.shape[1]))
    found = np.zeros((2, omega.size), dtype=bool)
    for i in range(omega.size):
        here = np.array([i, omega.size - 1 - i])
        start = alone.harmonics[here]
        if i:
            before = np.array([i - 1, omega.size - i])
            known = found[[0, 1], before]
            start = np.where(known[:, None], ways[[0, 1], before], start)
        step = balance(numbers, omega[here], push[here], laws, start)
        ways[[0, 1], here], found[[0, 1], here] = step.harmonics, step.found
    size = np.where(found, np.hypot(ways[:, :, 1], ways[:, :, 2]), -1.0)
    better = np.argmax(size, axis=0)
    return ways[better, np.arange(omega.size)], size.max(axis=0) >= 0


def lagging(
    numbers: Array, lag: Array, laws: Laws, drive: Drive, omega: float, harmonics: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return (frequency, harmonics, whether they were found) of the oscillations that lag the push by given angles.

    numbers: shape (n, 7). lag: of the fundamental behind j^power, shape (n,) [rad]. omega, harmonics: of a neighbour.
    Unknown are the frequency and the size of the fundamental instead of its real and imaginary part.
    """
    n = lag.size
    at, q = np.full(n, omega), np.tile(harmonics, (n, 1))
    ray = np.exp(-1j * lag) * 1j**drive.power * np.sign(drive.size)
    size = np.full(n, float(np.hypot(harmonics[1], harmonics[2])))
    # The neighbour's harmonics turn with its fundamental.
    turned = np.angle(ray / (harmonics[1] + 1j * harmonics[2]))
    for h in range(1, (q.shape[1] - 1) // 2 + 1):
        wave = (q[:, 2 * h - 1] + 1j * q[:, 2 * h]) * np.exp(1j * h * turned)
        q[:, 2 * h - 1], q[:, 2 * h] = wave.real, wave.imag

    def residual(w: Array, motion: Array) -> Array:
        return System(numbers, w, drive.push(w), laws).residual(motion)

    with np.errstate(all="ignore"):
        now = residual(at, q)
        for _ in range(_BRANCH_STEPS):
            scale = numbers[:, 0] * np.abs(size) + 1e-300
            if (np.linalg.norm(now, axis=1) <= _BRANCH_TOLERANCE * scale).all():
                break
            matrix = System(numbers, at, drive.push(at), laws).jacobian(q)
            along = matrix[:, :, 1] * ray.real[:, None] + matrix[:, :, 2] * ray.imag[:, None]
            faster = (residual(at * (1 + _NUDGE), q) - residual(at * (1 - _NUDGE), q)) / (2 * _NUDGE * at[:, None])
            matrix[:, :, 1], matrix[:, :, 2] = along, faster
            step = np.nan_to_num(solved(matrix, now[:, :, None])[:, :, 0])
            share = np.minimum(1.0, 0.2 * at / np.maximum(np.abs(step[:, 2]), 1e-300))
            at, size = at - share * step[:, 2], size - share * step[:, 1]
            step[:, 1:3] = 0.0
            q = q - share[:, None] * step
            q[:, 1], q[:, 2] = size * ray.real, size * ray.imag
            now = residual(at, q)
        found = np.linalg.norm(now, axis=1) <= 1e3 * _BRANCH_TOLERANCE * numbers[:, 0] * np.abs(size)
    return at, q, found & (at > 0) & (size > 0)


def free_frequency(numbers: Array, amplitude: Array, laws: Laws) -> Array:
    """Return the frequency, in ω_r, at which the joint swings freely without losses at given amplitudes, shape (n,).

    numbers: shape (n, 7). amplitude: |r₁|, in A, shape (n,). NaN where there is no such oscillation. The stiffness of a
    loss factor is its storage part at the frequency that is found.
    """
    lossless = laws._replace(law=laws.law.springs, terms=True)
    bare = numbers.copy()
    bare[:, [1, 2, 3, 6]] = 0.0
    omega = np.sqrt(np.maximum(bare[:, 0], 1e-12))
    for _ in range(4 if laws.law.has(LossFactor) else 1):
        if laws.law.has(LossFactor):
            at = np.where(np.isfinite(omega), omega, 1.0)
            bare[:, 0] = dynamic_stiffness(numbers, at[:, None], laws)[:, 0].real
        omega = _swing(bare, amplitude, omega, lossless)
    return omega


def _swing(numbers: Array, amplitude: Array, omega: Array, laws: Laws) -> Array:
    """Return the frequencies of lossless oscillations; unknown are mean, frequency and the higher cosines."""
    nothing = np.zeros(omega.size, dtype=complex)
    system = System(numbers, omega, nothing, laws)
    order = np.arange(system.count + 1)
    cosines = np.r_[0, 2 * order[1:] - 1]
    q = np.zeros((omega.size, 2 * system.count + 1))
    q[:, 1] = amplitude
    done = np.zeros(omega.size, dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(_BRANCH_STEPS):
            system = System(numbers, omega, nothing, laws)
            residual = system.residual(q)[:, cosines]
            done = np.linalg.norm(residual, axis=1) <= _BRANCH_TOLERANCE * amplitude * numbers[:, 0]
            if done.all():
                break
            matrix = system.jacobian(q)[:, cosines][:, :, cosines]
            matrix[:, :, 1] = -2 * omega[:, None] * order**2 * q[:, cosines]
            step = np.nan_to_num(solved(matrix, residual[:, :, None])[:, :, 0])
            omega = omega - np.clip(step[:, 1], -0.3 * omega, 0.3 * omega)
            step[:, 1] = 0.0
            q[:, cosines] -= step
    return np.where(done & (omega > 0), omega, np.nan)
