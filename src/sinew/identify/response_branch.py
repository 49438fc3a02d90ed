"""This is where steady oscillations are followed: by their lag through the peak, by their amplitude along the backbone.

Against frequency a hardening joint's response folds back; against the lag of the motion behind the force it does not.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.identify.response_balance import Balance, Laws, System, balance, dynamic_stiffness, solved

__all__ = ["Drive", "free_frequency", "lagging", "top_of_sweep"]

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_STEPS = 40
_TOLERANCE = 1e-9
_NUDGE = 1e-6
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
        for _ in range(_STEPS):
            scale = numbers[:, 0] * np.abs(size) + 1e-300
            if (np.linalg.norm(now, axis=1) <= _TOLERANCE * scale).all():
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
        found = np.linalg.norm(now, axis=1) <= 1e3 * _TOLERANCE * numbers[:, 0] * np.abs(size)
    return at, q, found & (at > 0) & (size > 0)


def free_frequency(numbers: Array, amplitude: Array, laws: Laws) -> Array:
    """Return the frequency, in ω_r, at which the joint swings freely without losses at given amplitudes, shape (n,).

    numbers: shape (n, 7). amplitude: |r₁|, in A, shape (n,). NaN where there is no such oscillation. The stiffness of a
    loss factor is its storage part at the frequency that is found.
    """
    lossless = laws._replace(damping="viscous", terms=True)
    bare = numbers.copy()
    bare[:, [1, 2, 3, 6]] = 0.0
    omega = np.sqrt(np.maximum(bare[:, 0], 1e-12))
    for _ in range(4 if laws.damping == "loss-factor" else 1):
        if laws.damping == "loss-factor":
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
        for _ in range(_STEPS):
            system = System(numbers, omega, nothing, laws)
            residual = system.residual(q)[:, cosines]
            done = np.linalg.norm(residual, axis=1) <= _TOLERANCE * amplitude * numbers[:, 0]
            if done.all():
                break
            matrix = system.jacobian(q)[:, cosines][:, :, cosines]
            matrix[:, :, 1] = -2 * omega[:, None] * order**2 * q[:, cosines]
            step = np.nan_to_num(solved(matrix, residual[:, :, None])[:, :, 0])
            omega = omega - np.clip(step[:, 1], -0.3 * omega, 0.3 * omega)
            step[:, 1] = 0.0
            q[:, cosines] -= step
    return np.where(done & (omega > 0), omega, np.nan)
