"""The joint's steady motions as a problem to solve: the equations of `sinew.mechanics.joint`, as they stand.

Coordinates are torsion, shortening, the lever's angle and the bristles of the guides' friction; the silicone's memory
are copies that lag behind torsion and shortening by the relaxation times of its branches. Their equations are what
`sinew.mechanics.joint.rate` says about them; there is no second copy of the physics. The low-pass of the gyroscope is
left out, it acts on nothing.

Torsion, lever and bristles change sign together where the guides stand evenly on their circles, and the shortening does
not: half a period is enough.
"""

from functools import cache
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.analysis.signal.attitude import LeverMotion
from sinew.measure.errors import RecordingError
from sinew.mechanics.drive import commanded_angle
from sinew.mechanics.joint import State, rate
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import BRANCHES, relaxation_times
from sinew.mechanics.tendons import as_one_tendon
from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.solve.balance import Coordinate, Equations, Lane, Size
from sinew.solve.branch import Search
from sinew.solve.continuation import Stride
from sinew.solve.curves import Problem, Resolution
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters

RESOLUTION = Resolution(
    ((Size(7, 64), Size(19, 192)), (Size(19, 128), Size(39, 512))),
    5e-3,
    Stride(first=0.02, most=0.125, correction=2e-2, tolerance=1e-4),
    Search(nudge=2e-2, enough=5e-3),
)
"""Waves for a rig's joint; the tolerance is far below what a rig repeats to.

A curve of the paper's joint that is read between its points, on straight lines, is within 0.25 % of its peak of one
with seven times as many; steps up to 0.1 and corrections of 0.01 leave 0.2 % for a quarter more points.
On 128 samples no gain moves by 3e-4, but the multipliers of fast motions do by 7e-3; on these 192 by less than 1e-3.
"""

_TIMES = tuple(float(tau) for tau in relaxation_times())
_TORSION = Coordinate("torsion", "odd", 2, _TIMES)
_SHORTENING = Coordinate("shortening", "even", 2, _TIMES)
_LEVER = Coordinate("lever", "odd", 2)

_PLACE = 2 * (2 + BRANCHES)


def _state(u: Any, lever: jax.Array, lever_rate: jax.Array, bristles: Any) -> State:
    n, zero = BRANCHES, jnp.zeros(())
    memory, axial = tuple(u[2 + i] for i in range(n)), tuple(u[4 + n + i] for i in range(n))
    return State(u[0], u[1], u[2 + n], u[3 + n], lever, lever_rate, memory, axial, zero, zero, tuple(bristles))


def _free(u: Any, phase: jax.Array, omega: jax.Array, p: Parameters) -> jax.Array:
    p = as_one_tendon(p)._replace(omega=omega)
    now = rate(phase / omega, _state(u, u[_PLACE], u[_PLACE + 1], u[_PLACE + 2 :]), p)
    return jnp.stack([now.torsion_rate, now.shortening_rate, now.lever_rate, *now.bristles])


def _prescribed(u: Any, phase: jax.Array, omega: jax.Array, p: Parameters) -> jax.Array:
    p = as_one_tendon(p)._replace(omega=omega)
    goal, goal_rate, _ = commanded_angle(phase / omega, p)
    now = rate(phase / omega, _state(u, goal, goal_rate, u[_PLACE:]), p)
    return jnp.stack([now.torsion_rate, now.shortening_rate, *now.bristles])


@cache
def _bristles(count: int) -> tuple[Coordinate, ...]:
    return tuple(Coordinate(f"bristle {i + 1}", "odd", 1) for i in range(count))


@cache
def free_lever(bristles: int) -> Equations:
    """Return the equations of a joint whose lever is moved by its servo; bristles: of its guides' friction."""
    return Equations((_TORSION, _SHORTENING, _LEVER, *_bristles(bristles)), _free, drive=2, apart=True)


@cache
def prescribed_lever(bristles: int) -> Equations:
    """Return the equations of a joint whose lever follows its command exactly."""
    return Equations((_TORSION, _SHORTENING, *_bristles(bristles)), _prescribed, apart=True)


_Driven = TypeVar("_Driven", Parameters, "_Measured")


def _weakened(p: _Driven, share: float) -> _Driven:
    return p._replace(amplitude=p.amplitude * share)


def joint_problem(
    rig: RigSpec,
    pretension_mm: NDArray[np.float64] | list[float],
    amplitude_deg: NDArray[np.float64] | list[float] | float,
    band_hz: tuple[float, float],
    *,
    mode: TendonMode = "position",
    effects: Effects | None = None,
) -> Problem:
    """Return the problem of a rig's joint at some pretensions [mm] and amplitudes of the drive's command [deg].

    pretension_mm, amplitude_deg: one for each lane; a single amplitude holds for all. band_hz: frequencies.
    """
    effects = effects or Effects()
    pretension = np.atleast_1d(np.asarray(pretension_mm, dtype=float))
    amplitude = np.broadcast_to(np.asarray(amplitude_deg, dtype=float), pretension.shape)
    groups = [
        Group("steady", float(p), float(band_hz[0]), float(a), 0, 1.0, 1.0)
        for p, a in zip(pretension, amplitude, strict=True)
    ]
    p, shortening = lane_parameters(groups, rig, mode=mode, effects=effects)
    p = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), p)
    swing = np.radians(amplitude)
    zero, count = np.zeros_like(shortening), len(p.guides.spread)
    columns = [1.5 * swing, np.full_like(swing, 1e-3), swing, *p.guides.first_guess(1.5 * swing)]
    rest: list[Any] = [zero, shortening, zero, *(zero,) * count]
    equations = free_lever(count) if effects.drive_dynamics else prescribed_lever(count)
    if not effects.drive_dynamics:
        del columns[2], rest[2]
    width = np.full(pretension.shape, 2 * np.pi * (band_hz[1] - band_hz[0]))
    lane = Lane(p, np.stack(columns, axis=1), width)  # type: ignore[arg-type]
    return Problem(equations, lane, np.stack(rest, axis=1), _weakened)


# The joint is driven by a measured lever: its waveform is taken over frequency as it was measured.
#
# The lever turns by θ = a (sin Ωt + Re Σ s_h exp(jhΩt)); between the measured frequencies a and s_h are linear,
# outside them constant. The servo has no part in that, so what is predicted is the joint alone. The twin's equations
# with a pure sine give φ̈; as nothing but the lever's inertia I_l couples, its harmonics change that by -I_l/(I_h +
# I_l) times their acceleration.


class _Measured(NamedTuple):
    """p: of the joint. omega: of the measured points [rad/s], (k,); amplitude of the lever there [rad], (k,), and its
    harmonics' shares, real and imaginary part, each (h, k), of the orders (h,)."""

    p: Parameters
    omega: jax.Array
    amplitude: jax.Array
    real: jax.Array
    imaginary: jax.Array
    orders: jax.Array


def _rates(u: Any, phase: jax.Array, omega: jax.Array, p: _Measured) -> jax.Array:
    def at(values: jax.Array) -> jax.Array:
        return jnp.interp(omega, p.omega, values)

    amplitude = at(p.amplitude)
    sine = _prescribed(u, phase, omega, p.p._replace(amplitude=amplitude))
    real, imaginary = jax.vmap(at)(p.real), jax.vmap(at)(p.imaginary)
    wave = real * jnp.cos(p.orders * phase) - imaginary * jnp.sin(p.orders * phase)
    acceleration = -amplitude * omega**2 * jnp.sum(p.orders**2 * wave)
    return sine.at[0].add(-p.p.lever / (p.p.head + p.p.lever) * acceleration)


@cache
def _measured_lever(bristles: int) -> Equations:
    """Return the equations of a joint whose lever moves as it was measured."""
    return Equations(prescribed_lever(bristles).coordinates, _rates, apart=True)


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
    equations = _measured_lever(len(problem.lane.p.guides.spread))
    return Problem(equations, problem.lane._replace(p=measured), problem.rest, _weakened)
