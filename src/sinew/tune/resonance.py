"""Resonance of a rig at a pretension: where the torsion lags behind the lever by 90°.

That is the frequency which a joint is tuned to: the joint's own stiffness and inertia are in balance there, whatever
drives it, and a phase-locked loop holds it. The peak of the gain over the command lies some per cent beside it where
the servo gives way, and is told too. As the frequency depends on how far the joint swings, a resonance is of a
`Swing`: a command of the drive, or a torsion that the command has to bring about.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.mechanics.silicone import glassy_factor
from sinew.mechanics.tendons import total_tension
from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.predict.band import COARSE
from sinew.predict.joint import joint_problem
from sinew.predict.joints.validity import loads_of
from sinew.predict.sketch import sketch
from sinew.solve.branch import Branch
from sinew.solve.curves import Problem, predict
from sinew.solve.examination import rows_of
from sinew.solve.rest import torsional_stiffness
from sinew.twin.simulate import lane_parameters

_BELOW, _ABOVE = 0.8, 1.2
_ROUNDS, _CLOSE = 6, 2e-3
_FIRST_COMMAND_DEG, _WEAKER = 10.0, 0.4


@dataclass(frozen=True)
class Swing:
    """How far the joint swings at resonance: command_deg, amplitude of the drive's command, or yaw_deg, amplitude of
    the torsion (half of peak to peak) that a command has to be found for. Raises SpecError unless just one is given and
    positive."""

    command_deg: float | None = None
    yaw_deg: float | None = None

    def __post_init__(self) -> None:
        given = [value for value in (self.command_deg, self.yaw_deg) if value is not None]
        if len(given) != 1 or not 0 < given[0] < math.inf:
            raise SpecError(
                "expected one positive amplitude: of the drive's command (amplitude_deg) or of the torsion (yaw_deg)"
            )


@dataclass(frozen=True)
class Resonance:
    """One rig at one pretension. frequency_hz: 90° of lag. peak_hz: of the largest gain, NaN where none was found.

    torsion, command: amplitudes [rad]. lever: phasor of the lever's fundamental against that of the torsion, which is
    taken as real [rad]. rest_tension, tension: of one tendon at rest and where the joint is twisted most [N].
    """

    pretension_mm: float
    frequency_hz: float
    peak_hz: float
    torsion: float
    command: float
    lever: complex
    rest_tension: float
    tension: float


@cache
def _stiffness() -> Any:
    def of(shortening: jax.Array, p: Any) -> tuple[jax.Array, jax.Array]:
        guides = p.guides.stiffness(total_tension(jnp.zeros(()), shortening, p))
        relaxed = torsional_stiffness(shortening, p)
        return relaxed, relaxed * glassy_factor(p) + guides

    return jax.jit(jax.vmap(of))


def linear_band(rig: RigSpec, pretension_mm: Sequence[float], mode: TendonMode = "position") -> tuple[float, float]:
    """Return frequencies [Hz] between which the joint's resonances lie at some pretensions [mm], with room.

    From below by the relaxed stiffness alone, from above by the silicone unrelaxed and the guides holding.
    """
    groups = [Group("steady", float(mm), 1.0, 1.0, 0, 1.0, 1.0) for mm in pretension_mm]
    p, shortening = lane_parameters(groups, rig, mode=mode)
    soft, stiff = (np.asarray(leaf) for leaf in _stiffness()(shortening, p))
    inertia = rig.inertia.head.value + rig.inertia.lever.value
    low, high = (np.sqrt(np.maximum(k, 1e-12) / inertia) / (2 * np.pi) for k in (soft, stiff))
    return _BELOW * float(low.min()), _ABOVE * float(high.max())


Follow = Callable[[Problem, tuple[float, float]], tuple[Branch, ...]]
"""What follows the curves of all lanes of a problem over a band [Hz]."""


def coarse(problem: Problem, band_hz: tuple[float, float]) -> tuple[Branch, ...]:
    """Return the curves with seven harmonics, which is right to 1e-4 of a frequency."""
    return predict(problem, band_hz, COARSE).branches


def sketched(problem: Problem, band_hz: tuple[float, float]) -> tuple[Branch, ...]:
    """Return the curves as sliders sketch them, one after the other: right to 5e-4 of a frequency, and a process that
    has sketched one joint compiles nothing for it."""
    lanes = range(len(problem.rest))
    each = (problem._replace(lane=rows_of(problem.lane, np.array([i])), rest=problem.rest[[i]]) for i in lanes)
    return tuple(sketch(one, band_hz).branches[0] for one in each)


def resonances_at(
    rig: RigSpec,
    pretension_mm: Array,
    command_deg: Array,
    band_hz: tuple[float, float],
    mode: TendonMode = "position",
    follow: Follow = coarse,
) -> list[Resonance | None]:
    """Return the resonance of each lane, (k,): pretension [mm] and amplitude of the command [deg]; None where the
    torsion passes no 90° of lag in the band [Hz]."""
    problem = joint_problem(rig, pretension_mm, command_deg, band_hz, mode=mode)
    branches = follow(problem, band_hz)
    torsion = np.array([0.0 if b.phase_90 is None else b.phase_90.amplitude for b in branches])
    loads = loads_of(problem, torsion)
    found: list[Resonance | None] = []
    for i, branch in enumerate(branches):
        mark = branch.phase_90
        if mark is None:
            found.append(None)
            continue
        found.append(
            Resonance(
                pretension_mm=float(pretension_mm[i]),
                frequency_hz=mark.frequency_hz,
                peak_hz=math.nan if branch.peak is None else branch.peak.frequency_hz,
                torsion=mark.amplitude,
                command=math.radians(command_deg[i]),
                lever=_lever_at(branch, mark.frequency_hz),
                rest_tension=float(loads.rest_tension[i]),
                tension=float(loads.tension[i]),
            )
        )
    return found


def _lever_at(branch: Branch, frequency_hz: float) -> complex:
    """Return the lever's phasor where the lag is 90°, turned so that the torsion's is real."""
    gain = branch.drive / branch.phasor * branch.fundamental
    i = int(np.argmin(np.abs(branch.frequency_hz - frequency_hz) + np.abs(branch.phase - np.pi / 2)))
    near = slice(max(0, i - 1), i + 2)
    size = np.interp(np.pi / 2, branch.phase[near], np.abs(gain[near]))
    return complex(0.0, float(size))


def find_resonances(
    rig: RigSpec,
    pretension_mm: Sequence[float],
    swing: Swing,
    *,
    mode: TendonMode = "position",
    band_hz: tuple[float, float] | None = None,
    commands_deg: Sequence[float] | None = None,
    follow: Follow = coarse,
) -> tuple[Resonance | None, ...]:
    """Return the resonance at each pretension [mm]; None where the torsion passes no 90° of lag in the band.

    By harmonic balance with seven harmonics on the joint's equations; with nineteen it moves by less than 1e-4.
    band_hz: where it is sought, else `linear_band`. follow: how its curves are followed.
    commands_deg: first guesses of the command for a yaw, one each.
    With a yaw the command is changed by secants until the torsion is within 0.2 % of it, six times at most, and not
    beyond twice the rig's limit: a drive that cannot leaves a smaller torsion, which `Resonance.torsion` tells.
    """
    where = np.asarray(pretension_mm, dtype=float)
    band = band_hz or linear_band(rig, list(where), mode)
    if swing.command_deg is not None:
        return tuple(resonances_at(rig, where, np.full(where.shape, swing.command_deg), band, mode, follow))
    assert swing.yaw_deg is not None
    wanted = math.radians(swing.yaw_deg)
    commands = np.full(where.shape, _FIRST_COMMAND_DEG) if commands_deg is None else np.array(commands_deg, dtype=float)
    most = 2 * rig.limits.drive_amplitude_deg
    found: list[Resonance | None] = [None] * where.size
    left, before = np.arange(where.size), np.zeros((2, where.size))
    for _ in range(_ROUNDS):
        for i, one in zip(left, resonances_at(rig, where[left], commands[left], band, mode, follow), strict=True):
            found[i] = one
        lost = np.array([one is None for one in found])
        torsion = np.array([wanted if one is None else one.torsion for one in found])
        far = (np.abs(torsion / wanted - 1) > _CLOSE) & ~((commands >= most) & (torsion < wanted))
        left = np.flatnonzero(far | lost)
        if not left.size:
            break
        guess = _secant(before, np.stack([commands, torsion]), wanted)
        before = np.where(lost, 0.0, np.stack([commands, torsion]))
        guess = np.where(lost, _WEAKER * commands, guess)  # a strong drive may leave the band where a weak one does not
        commands[left] = np.clip(guess, 0.25 * commands, np.minimum(4 * commands, most))[left]
    return tuple(found)


def _secant(before: Array, now: Array, wanted: float) -> Array:
    """Return commands for a torsion, from the line through the last two (command, torsion), each (2, k); the first one
    is the origin."""
    slope = (now[1] - before[1]) / np.where(now[0] == before[0], np.inf, now[0] - before[0])
    safe = np.where(slope > 0, slope, now[1] / now[0])
    return np.asarray(now[0] + (wanted - now[1]) / safe)
