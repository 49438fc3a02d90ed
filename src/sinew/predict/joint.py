"""This is where the joint's steady motions become a problem to solve: the twin's own equations, as they stand.

Coordinates are torsion, shortening, the lever's angle and the bristle of the guide friction; the silicone's memory are
copies that lag behind torsion and shortening by the relaxation times of its branches. Their equations are what
`sinew.twin.motion.rate` says about them; there is no second copy of the physics. The low-pass of
the gyroscope is left out, it acts on nothing.

Torsion, lever and bristle change sign together where the guides stand evenly on their circles, and the shortening does
not: half a period is enough.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.predict.balance import Lane
from sinew.predict.continuation import Stride
from sinew.predict.landmark import Search
from sinew.predict.prediction import Problem, Resolution
from sinew.predict.waves import Coordinate, Equations, Size
from sinew.twin.drive import commanded_angle
from sinew.twin.effects import Effects
from sinew.twin.motion import State, rate
from sinew.twin.parameters import Parameters
from sinew.twin.prony import BRANCHES, relaxation_times
from sinew.twin.simulate import lane_parameters

__all__ = ["FREE_LEVER", "PRESCRIBED_LEVER", "RESOLUTION", "joint_problem"]

RESOLUTION = Resolution(
    ((Size(7, 64), Size(19, 256)), (Size(19, 128), Size(39, 512))),
    5e-3,
    Stride(first=0.02, most=0.1, correction=1e-2, tolerance=1e-4),
    Search(nudge=2e-2, enough=5e-3),
)
"""Waves for a rig's joint; the tolerance is far below what a rig repeats to."""

_TIMES = tuple(float(tau) for tau in relaxation_times())
_TORSION = Coordinate("torsion", "odd", 2, _TIMES)
_SHORTENING = Coordinate("shortening", "even", 2, _TIMES)
_LEVER = Coordinate("lever", "odd", 2)
_BRISTLE = Coordinate("bristle", "odd", 1)

_PLACE = 2 * (2 + BRANCHES)


def _state(u: jax.Array, lever: jax.Array, lever_rate: jax.Array, bristle: jax.Array) -> State:
    n, zero = BRANCHES, jnp.zeros(())
    memory, axial = tuple(u[2 + i] for i in range(n)), tuple(u[4 + n + i] for i in range(n))
    return State(u[0], u[1], u[2 + n], u[3 + n], lever, lever_rate, bristle, memory, axial, zero, zero)


def _free(u: jax.Array, phase: jax.Array, omega: jax.Array, p: Parameters) -> jax.Array:
    now = rate(phase / omega, _state(u, u[_PLACE], u[_PLACE + 1], u[_PLACE + 2]), p._replace(omega=omega))
    return jnp.stack([now.torsion_rate, now.shortening_rate, now.lever_rate, now.bristle])


def _prescribed(u: jax.Array, phase: jax.Array, omega: jax.Array, p: Parameters) -> jax.Array:
    p = p._replace(omega=omega)
    goal, goal_rate, _ = commanded_angle(phase / omega, p)
    now = rate(phase / omega, _state(u, goal, goal_rate, u[_PLACE]), p)
    return jnp.stack([now.torsion_rate, now.shortening_rate, now.bristle])


FREE_LEVER = Equations((_TORSION, _SHORTENING, _LEVER, _BRISTLE), _free, drive=2)
"""The lever is moved by its servo."""

PRESCRIBED_LEVER = Equations((_TORSION, _SHORTENING, _BRISTLE), _prescribed)
"""The lever follows its command exactly."""


def _weakened(p: Parameters, share: float) -> Parameters:
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
    bristle = np.minimum(1.0, 1.5 * swing / p.presliding_angle)
    columns = [1.5 * swing, np.full_like(swing, 1e-3), swing, bristle]
    rest: list[Any] = [np.zeros_like(shortening), shortening, np.zeros_like(shortening), np.zeros_like(shortening)]
    equations = FREE_LEVER if effects.drive_dynamics else PRESCRIBED_LEVER
    if not effects.drive_dynamics:
        del columns[2], rest[2]
    width = np.full(pretension.shape, 2 * np.pi * (band_hz[1] - band_hz[0]))
    lane = Lane(p, np.stack(columns, axis=1), width)  # type: ignore[arg-type]
    return Problem(equations, lane, np.stack(rest, axis=1), _weakened)
