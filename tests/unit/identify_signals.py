"""Oscillations with known mechanics, made by scipy's integrator: nothing of Sinew's own simulation is in them."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

OMEGA = 2 * np.pi * 3.0
Force = Callable[[float, float], float]
"""Restoring and damping force over the inertia, of motion and rate."""


def viscous(damping_ratio: float, cubic: float = 0.0, quadratic: float = 0.0, omega: float = OMEGA) -> Force:
    return lambda r, v: 2 * damping_ratio * omega * v + omega**2 * r + quadratic * r**2 + cubic * r**3


def motion(force: Force, push: Callable[[float], float], time: np.ndarray, start: tuple[float, float] = (0.0, 0.0)):
    """Return position and rate at the times, shape (2, n)."""
    done = solve_ivp(
        lambda t, y: [y[1], push(t) - force(y[0], y[1])],
        (time[0], time[-1]),
        start,
        t_eval=time,
        rtol=1e-9,
        atol=1e-11,
        max_step=0.02,
    )
    return done.y


def dry_decay(time: np.ndarray, start: float, rate: float, friction: float, damping_ratio: float = 0.0) -> np.ndarray:
    """Return a decay under viscous and Coulomb friction: half cycles about ±friction/ω², joined exactly.

    friction: over the inertia; `rate` is the rate at the start.
    """
    omega_d = OMEGA * np.sqrt(1 - damping_ratio**2)
    decay = damping_ratio * OMEGA
    x = np.empty_like(time)
    t0, x0, v0 = float(time[0]), start, rate
    done = 0
    while done < time.size:
        side = np.sign(v0) if v0 else -np.sign(x0)
        centre = -side * friction / OMEGA**2
        if v0 == 0 and abs(x0) <= friction / OMEGA**2:
            x[done:] = x0
            break
        a, b = x0 - centre, (v0 + decay * (x0 - centre)) / omega_d
        # v = e^{-λt}[(bω - λa) cos ωt - (aω + λb) sin ωt] is zero at:
        turn = np.arctan2(b * omega_d - decay * a, a * omega_d + decay * b) % np.pi
        turn = (turn if turn > 1e-9 else np.pi) / omega_d
        upto = int(np.searchsorted(time, t0 + turn, "right"))
        s = time[done:upto] - t0
        x[done:upto] = centre + np.exp(-decay * s) * (a * np.cos(omega_d * s) + b * np.sin(omega_d * s))
        x0 = centre + np.exp(-decay * turn) * (a * np.cos(omega_d * turn) + b * np.sin(omega_d * turn))
        t0, v0, done = t0 + turn, 0.0, upto
    return x


def chirp(start_hz: float, stop_hz: float, duration_s: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the phase of a linear sweep [rad] as a function of time."""
    return lambda t: 2 * np.pi * (start_hz * t + 0.5 * (stop_hz - start_hz) / duration_s * t**2)


def noisy(values: np.ndarray, std: float, seed: int) -> np.ndarray:
    return np.asarray(values + np.random.default_rng(seed).normal(0, std, values.size))
