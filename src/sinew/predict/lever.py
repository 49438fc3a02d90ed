"""This is where the joint is driven by a measured lever: its waveform is taken over frequency as it was measured.

The lever turns by θ = a (sin Ωt + Re Σ s_h exp(jhΩt)); between the measured frequencies a and s_h are linear, outside
them constant. The servo has no part in that, so what is predicted is the joint alone. The twin's equations with a pure
sine give φ̈; as nothing but the lever's inertia I_l couples, its harmonics change that by -I_l/(I_h + I_l) times their
acceleration.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.analysis.lever import LeverMotion
from sinew.measure.errors import RecordingError
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.predict.joint import PRESCRIBED_LEVER, joint_problem
from sinew.predict.prediction import Problem
from sinew.predict.waves import Equations
from sinew.twin.effects import Effects
from sinew.twin.parameters import Parameters

__all__ = ["MEASURED_LEVER", "lever_problem"]

Array = NDArray[np.float64]


class _Measured(NamedTuple):
    """p: of the joint. omega: of the measured points [rad/s], (k,); amplitude of the lever there [rad], (k,), and its
    harmonics' shares, real and imaginary part, each (h, k), of the orders (h,)."""

    p: Parameters
    omega: jax.Array
    amplitude: jax.Array
    real: jax.Array
    imaginary: jax.Array
    orders: jax.Array


def _rates(u: jax.Array, phase: jax.Array, omega: jax.Array, p: _Measured) -> jax.Array:
    def at(values: jax.Array) -> jax.Array:
        return jnp.interp(omega, p.omega, values)

    amplitude = at(p.amplitude)
    sine = PRESCRIBED_LEVER.rates(u, phase, omega, p.p._replace(amplitude=amplitude))
    real, imaginary = jax.vmap(at)(p.real), jax.vmap(at)(p.imaginary)
    wave = real * jnp.cos(p.orders * phase) - imaginary * jnp.sin(p.orders * phase)
    acceleration = -amplitude * omega**2 * jnp.sum(p.orders**2 * wave)
    return sine.at[0].add(-p.p.lever / (p.p.head + p.p.lever) * acceleration)


MEASURED_LEVER = Equations(PRESCRIBED_LEVER.coordinates, _rates)
"""The lever moves as it was measured."""


def _weakened(p: _Measured, share: float) -> _Measured:
    return p._replace(amplitude=p.amplitude * share)


def lever_problem(
    rig: RigSpec,
    lever: LeverMotion,
    band_hz: tuple[float, float],
    *,
    mode: TendonMode = "position",
    effects: Effects | None = None,
) -> Problem:
    """Return the problem of a rig's joint under a measured lever, one lane for each of its pretensions.

    Raises RecordingError for a pretension at which the lever was not measured.
    """
    effects = (effects or Effects()).without("drive_dynamics")
    lanes, count = lever.amplitude.shape
    amplitude, shares = np.empty((lanes, count)), np.zeros((lanes, lever.orders.size, count), dtype=complex)
    for row, pretension in enumerate(lever.pretension_mm):
        known = np.isfinite(lever.amplitude[row])
        if not known.any():
            raise RecordingError(f"at {pretension:g} mm the recording has no motion of the lever; leave that out")
        there = lever.frequency_hz[known]
        amplitude[row] = np.interp(lever.frequency_hz, there, lever.amplitude[row, known])
        for i in range(lever.orders.size):
            shares[row, i] = np.interp(lever.frequency_hz, there, lever.shares[row, known, i])
    largest = np.degrees(amplitude.max(axis=1))
    problem = joint_problem(rig, lever.pretension_mm, largest, band_hz, mode=mode, effects=effects)
    omega = np.broadcast_to(2 * np.pi * lever.frequency_hz, amplitude.shape).copy()
    orders = np.broadcast_to(lever.orders.astype(float), (lanes, lever.orders.size)).copy()
    measured = _Measured(problem.lane.p, omega, amplitude, shares.real.copy(), shares.imag.copy(), orders)  # type: ignore[arg-type]
    return Problem(MEASURED_LEVER, problem.lane._replace(p=measured), problem.rest, _weakened)
