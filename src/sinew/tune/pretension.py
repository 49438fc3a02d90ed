"""The pretension at which a rig resonates at a wanted frequency, and how sure that is.

Resonance is 90° of lag behind the lever (`sinew.tune.pretension`). The interval comes from rigs drawn from what the
calibration knows: each draw's frequency at the pretension that is right for the rig, over the slope of frequency over
pretension. It holds what is not known of the calibrated parameters and nothing else.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate, finite, number
from sinew.measure.result import Detail, Field, Result, Rows, plain
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import glassy_factor
from sinew.mechanics.tendons import total_tension
from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.band import COARSE, Draws, draw_rigs, drawn_branches, estimate_of_deviations
from sinew.predict.joint import joint_problem
from sinew.predict.validity import loads_of
from sinew.solve.branch import Branch
from sinew.solve.curves import Problem, predict
from sinew.solve.programs import configure, program
from sinew.solve.rest import torsional_stiffness
from sinew.tune.candidate import drive_load
from sinew.twin.simulate import lane_parameters

# ---- resonance of a rig at a pretension: where the torsion lags behind the lever by 90°
#
# That is the frequency which a joint is tuned to: the joint's own stiffness and inertia are in balance there, whatever
# drives it, and a phase-locked loop holds it. The peak of the gain over the command lies some per cent beside it where
# the servo gives way, and is told too. As the frequency depends on how far the joint swings, a resonance is of a
# `Swing`: a command of the drive, or a torsion that the command has to bring about.


_BELOW, _ABOVE = 0.8, 1.2
_ROUNDS, _TORSION_CLOSE = 6, 2e-3
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


@program()
def _stiffness(shortening: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
    def one(shortening: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
        guides = p.guides.stiffness(total_tension(jnp.zeros(()), shortening, p))
        relaxed = torsional_stiffness(shortening, p)
        return relaxed, relaxed * glassy_factor(p) + guides

    return jax.vmap(one)(shortening, p)


def linear_band(rig: RigSpec, pretension_mm: Sequence[float], mode: TendonMode = "position") -> tuple[float, float]:
    """Return frequencies [Hz] between which the joint's resonances lie at some pretensions [mm], with room.

    From below by the relaxed stiffness alone, from above by the silicone unrelaxed and the guides holding.
    """
    groups = [Group("steady", float(mm), 1.0, 1.0, 0, 1.0, 1.0) for mm in pretension_mm]
    p, shortening = lane_parameters(groups, rig, mode=mode)
    soft, stiff = (np.asarray(leaf) for leaf in _stiffness(shortening, p))
    inertia = rig.inertia.head.value + rig.inertia.lever.value
    low, high = (np.sqrt(np.maximum(k, 1e-12) / inertia) / (2 * np.pi) for k in (soft, stiff))
    return _BELOW * float(low.min()), _ABOVE * float(high.max())


def resonances_at(
    rig: RigSpec,
    pretension_mm: Array,
    command_deg: Array,
    band_hz: tuple[float, float],
    mode: TendonMode = "position",
) -> list[Resonance | None]:
    """Return the resonance of each lane, (k,): pretension [mm] and amplitude of the command [deg]; None where the
    torsion passes no 90° of lag in the band [Hz]."""
    problem = joint_problem(rig, pretension_mm, command_deg, band_hz, mode=mode)
    branches = predict(problem, band_hz, COARSE).branches
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
) -> tuple[Resonance | None, ...]:
    """Return the resonance at each pretension [mm]; None where the torsion passes no 90° of lag in the band.

    By harmonic balance with seven harmonics on the joint's equations; with nineteen it moves by less than 1e-4.
    band_hz: where it is sought, else `linear_band`. commands_deg: first guesses of the command for a yaw, one each.
    With a yaw the command is changed by secants until the torsion is within 0.2 % of it, six times at most, and not
    beyond twice the rig's limit: a drive that cannot leaves a smaller torsion, which `Resonance.torsion` tells.
    """
    where = np.asarray(pretension_mm, dtype=float)
    band = band_hz or linear_band(rig, list(where), mode)
    if swing.command_deg is not None:
        return tuple(resonances_at(rig, where, np.full(where.shape, swing.command_deg), band, mode))
    assert swing.yaw_deg is not None
    wanted = math.radians(swing.yaw_deg)
    commands = np.full(where.shape, _FIRST_COMMAND_DEG) if commands_deg is None else np.array(commands_deg, dtype=float)
    most = 2 * rig.limits.drive_amplitude_deg
    found: list[Resonance | None] = [None] * where.size
    left, before = np.arange(where.size), np.zeros((2, where.size))
    for _ in range(_ROUNDS):
        for i, one in zip(left, resonances_at(rig, where[left], commands[left], band, mode), strict=True):
            found[i] = one
        lost = np.array([one is None for one in found])
        torsion = np.array([wanted if one is None else one.torsion for one in found])
        far = (np.abs(torsion / wanted - 1) > _TORSION_CLOSE) & ~((commands >= most) & (torsion < wanted))
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


# It is found between which frequencies a rig's pretension can move its resonance, and what ends it.


# ---- the pretension


_GRID, _FINE = 5, 401
_JUST = 1e-6


_IN_WORDS = {
    "tension_n": "a tendon's tension",
    "tendon_current_a": "a tendon motor's current",
    "torsion_deg": "the torsion",
    "drive_amplitude_deg": "the drive's amplitude",
    "drive_current_a": "the drive's current",
}


class Stress(NamedTuple):
    """One limit of a rig at one resonance. share: of the limit that is used, 1 at the limit. sentence: with both."""

    name: str
    share: float
    sentence: str


@dataclass(frozen=True, repr=False)
class Reachable(Result):
    """Where a rig can resonate.

    resonances: at pretensions across the rig's window, in their order, also where a limit is broken.
    pretension_mm: from where to where no limit is broken; None where that is so nowhere. frequency_hz: there.
    why: what ends it below and above, or why there is nothing, one sentence each.
    """

    resonances: tuple[Resonance, ...]
    pretension_mm: tuple[float, float] | None
    frequency_hz: tuple[float, float] | None
    why: tuple[str, str]

    def curve(self) -> PchipInterpolator:
        """Return frequency [Hz] over pretension [mm], monotone between the resonances."""
        return PchipInterpolator(
            [one.pretension_mm for one in self.resonances], [one.frequency_hz for one in self.resonances]
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON holds it, the curve by columns."""
        found = self.resonances
        return {
            "pretension_mm": plain(self.pretension_mm),
            "frequency_hz": plain(self.frequency_hz),
            "why": plain(self.why),
            "curve": {
                "pretension_mm": [one.pretension_mm for one in found],
                "frequency_hz": [one.frequency_hz for one in found],
                "torsion_deg": [math.degrees(one.torsion) for one in found],
                "command_deg": [math.degrees(one.command) for one in found],
                "tension_n": [one.tension for one in found],
            },
        }


def stresses_of(rig: RigSpec, one: Resonance, swing: Swing) -> list[Stress]:
    """Return how far a rig's limits are used where it resonates: tension, currents, torsion, drive."""
    load = drive_load(rig, one.frequency_hz, one.lever, one.torsion)
    torsion, command = math.degrees(one.torsion), math.degrees(one.command)
    where = f"at {one.pretension_mm:.3g} mm"
    used = (
        ("tension_n", one.tension, "a tendon pulls {:.0f} N, the rig allows {:g} N"),
        ("tendon_current_a", rig.tendons.current(one.tension), "a tendon motor draws {:.2f} A, the rig allows {:g} A"),
        ("torsion_deg", torsion, "the head twists by {:.1f}°, the rig allows {:g}°"),
        ("drive_amplitude_deg", command, "the drive needs a command of {:.0f}°, the rig allows {:g}°"),
        ("drive_current_a", load.current, "the drive draws {:.2f} A, the rig allows {:g} A"),
    )
    found = []
    for name, value, text in used:
        limit = float(getattr(rig.limits, name))
        found.append(Stress(name, value / limit, f"{where} {text.format(value, limit)}"))
    if swing.yaw_deg is not None:
        short = swing.yaw_deg / torsion
        sentence = f"{where} the drive twists the head by {torsion:.2f}° at most, {swing.yaw_deg:g}° were asked for"
        found.append(Stress("yaw_deg", short / 1.005, sentence))
    return found


def find_reachable(rig: RigSpec, swing: Swing, *, mode: TendonMode = "position") -> Reachable:
    """Return the frequencies that pretension alone can make a rig resonate at, within every limit of the rig."""
    low, high = rig.limits.pretension_mm
    low, high = max(0.0, low), min(high, rig.limits.tendon_travel_mm[1])
    grid = np.linspace(low, high, _GRID)
    every = find_resonances(rig, grid.tolist(), swing, mode=mode)
    found = tuple(one for one in every if one is not None)
    if len(found) < 2:
        nothing = "the torsion passes no 90° of lag behind the lever: it is damped too strongly to resonate"
        return Reachable(found, None, None, (nothing, nothing))
    whole = Reachable(found, None, None, ("", ""))
    table = [stresses_of(rig, one, swing) for one in found]
    worst = [max(stresses, key=lambda stress: stress.share) for stresses in table]
    ends = _allowed(np.array([one.pretension_mm for one in found]), table)
    if ends is None:
        least = min(worst, key=lambda stress: stress.share)
        return Reachable(found, None, None, (least.sentence, least.sentence))
    why = (
        f"{low:g} mm is the rig's lowest pretension" if ends[0] == grid[0] else _worst_words(worst, found, ends[0], -1),
        f"{high:g} mm is the rig's highest pretension"
        if ends[1] == grid[-1]
        else _worst_words(worst, found, ends[1], 1),
    )
    at = whole.curve()(np.array(ends))
    return Reachable(found, ends, (float(at[0]), float(at[1])), why)


def _allowed(pretension_mm: Array, table: Sequence[Sequence[Stress]]) -> tuple[float, float] | None:
    """Return the longest stretch of pretensions [mm] in which no share exceeds one, each share interpolated."""
    shares = PchipInterpolator(pretension_mm, np.array([[stress.share for stress in row] for row in table]))
    fine = np.unique(np.concatenate([np.linspace(pretension_mm[0], pretension_mm[-1], _FINE), pretension_mm]))
    good = np.flatnonzero(shares(fine).max(axis=1) <= 1)
    if not good.size:
        return None
    run = max(np.split(good, np.flatnonzero(np.diff(good) > 1) + 1), key=len)

    def edge(inside: int, outside: int) -> float:
        if not 0 <= outside < fine.size:
            return float(fine[inside])
        return float(brentq(lambda x: float(shares(x).max()) - 1, fine[inside], fine[outside], xtol=_JUST))

    return edge(int(run[0]), int(run[0]) - 1), edge(int(run[-1]), int(run[-1]) + 1)


def _worst_words(worst: Sequence[Stress], found: Sequence[Resonance], edge: float, direction: int) -> str:
    beyond = [s for s, one in zip(worst, found, strict=True) if direction * (one.pretension_mm - edge) > 0]
    if not beyond:
        side = "above" if direction > 0 else "below"
        return f"{side} {edge:.3g} mm the torsion does not settle to 90° of lag within the band that was searched"
    return beyond[0 if direction > 0 else -1].sentence


_STEPS, _CLOSE = 4, 2e-5
_ROOM = 0.3


@dataclass(frozen=True, repr=False)
class Setting(Result):
    """The pretension for one wanted frequency.

    feasible: whether there is one within the rig's limits; without one the rest is None. pretension_mm, frequency_hz:
    what to set, and where the joint resonates then; their intervals are NaN where nothing is known of the rig's
    uncertainty. slope_hz_mm: of frequency over pretension. peak_hz: where the torsion is largest. torsion, command,
    lever: amplitudes there. rest_tension_n, tension_n: of a tendon at rest, and the largest. draws: that had a
    resonance. sentence: in words.
    """

    wanted_hz: Annotated[float, Field("wanted")]
    feasible: Annotated[bool, Field("", "detail")]
    sentence: Annotated[str, Field("", "detail")]
    pretension_mm: Annotated[Estimate | None, Field("pretension", "interval")] = None
    frequency_hz: Annotated[Estimate | None, Field("resonance", "interval")] = None
    slope_hz_mm: Detail = None
    peak_hz: Detail = None
    torsion_deg: Annotated[float | None, Field("torsion")] = None
    command_deg: Annotated[float | None, Field("command")] = None
    lever_deg: Detail = None
    rest_tension_n: Detail = None
    tension_n: Annotated[float | None, Field("tension")] = None
    draws: Annotated[int | None, Field("", "detail")] = None
    resonance: Resonance | None = None


_MEANT = "where the torsion lags behind the lever by 90°"


@dataclass(frozen=True, repr=False)
class Tuning(Result):
    """All settings of a rig, the range they can lie in, and what to know of their intervals.

    rig: its name. resonance: what is meant by it. command_deg or yaw_deg, mode: that it was tuned for. draws: count,
    seed and parameters of the draws, if there were.
    """

    settings: Annotated[Rows[Setting], Field("resonance where the torsion lags behind the lever by 90°")]
    range: Annotated[Reachable, Field("", "detail")]
    remarks: Annotated[tuple[str, ...], Field("", "detail")]
    rig: Annotated[str, Field("", "detail")]
    command_deg: Annotated[float | None, Field("", "detail")]
    yaw_deg: Annotated[float | None, Field("", "detail")]
    mode: Annotated[TendonMode, Field("", "detail")]
    draws: Annotated[Mapping[str, Any] | None, Field("", "detail")]
    resonance: Annotated[str, Field("", "detail")] = _MEANT

    def closing(self) -> list[str]:
        """Return the range that can be reached, and what to know of the settings."""
        said = [f"- {sentence}" for sentence in (*(one.sentence for one in self.settings), *self.remarks)]
        if self.range.frequency_hz is None or self.range.pretension_mm is None:
            return said
        ends = zip(self.range.frequency_hz, self.range.pretension_mm, strict=True)
        return ["range: " + " to ".join(f"{number(hz, unit='Hz')} at {number(mm, 3, 'mm')}" for hz, mm in ends), *said]


_DRAWS = 100


def tune(
    rig: RigSpec | str | Path,
    resonance_hz: float | Sequence[float],
    *,
    amplitude_deg: float | None = None,
    yaw_deg: float | None = None,
    mode: TendonMode = "position",
    bands: int | None = None,
    seed: int = 0,
    progress: Callable[[float, float], None] | None = None,
) -> Tuning:
    """Return the pretension at which a rig resonates at each wanted frequency, and the range that it can reach.

    rig: as such, its file or its name. resonance_hz: where it is to resonate: 90° of lag [Hz]. amplitude_deg: of the
    drive's command, else 20; or yaw_deg: of the torsion, whose command is found. mode: of the tendon motors.
    bands: draws for 90 % intervals, of a rig that knows how far it can be off; else 100, and 0 for none; seed: of them.
    progress: called with (done, total) draws.
    A frequency out of reach is no error: its setting says why. Raises SpecError where a number cannot be meant.

    >>> import sinew as sn
    >>> setting = sn.tune("paper", 3.5, bands=0).settings[0]
    >>> setting.feasible, 3 < setting.pretension_mm.value < 8
    (True, True)
    """
    if amplitude_deg is not None and yaw_deg is not None:
        raise SpecError("found an amplitude of the command and one of the torsion; expected one of them")
    swing = Swing(20.0 if amplitude_deg is None and yaw_deg is None else amplitude_deg, yaw_deg)
    made = rig if isinstance(rig, RigSpec) else load_rig(rig)
    configure()
    draws, remark = _draws(made, bands, seed)
    wanted = [float(hertz) for hertz in np.atleast_1d(resonance_hz)]
    found = tune_pretension(made, wanted, swing, draws=draws, mode=mode, progress=progress)
    drawn = None if draws is None else {"count": len(draws.rigs), "seed": seed, "parameters": list(draws.names)}
    return replace(found, draws=drawn, remarks=(*found.remarks, *([remark] if remark else [])))


def _draws(rig: RigSpec, bands: int | None, seed: int) -> tuple[Draws | None, str]:
    """Return (draws where something is known of the rig's uncertainty, the sentence why there are none)."""
    if bands == 0:
        return None, ""
    known = rig.calibration is not None or any(one.interval90 is not None for _, one in rig.parameters())
    if not known and bands is None:
        return None, (
            f"the rig {rig.name} holds no intervals, so nothing is known of how far the pretension can be off; "
            "sinew calibrate writes a rig that knows"
        )
    if bands == 1:
        raise SpecError("found 1 draw, expected 2 or more, or 0 for no intervals")
    return draw_rigs(rig, bands or _DRAWS, seed), ""


def tune_pretension(
    rig: RigSpec,
    wanted_hz: Sequence[float],
    swing: Swing,
    *,
    draws: Draws | None = None,
    mode: TendonMode = "position",
    progress: Callable[[float, float], None] | None = None,
) -> Tuning:
    """Return the pretension for each wanted frequency [Hz].

    swing: how far the joint swings there. draws: of the rig, for intervals; with a yaw they are driven as the rig is.
    progress: called with (done, total) draws.
    Raises SpecError where a frequency is not positive.
    """
    for hertz in wanted_hz:
        if not 0 < hertz < math.inf:
            raise SpecError(f"found a wanted resonance of {hertz:g} Hz, expected a positive frequency")
    reachable = find_reachable(rig, swing, mode=mode)
    guesses = [_guess(reachable, hertz) for hertz in wanted_hz]
    inside = [i for i, guess in enumerate(guesses) if guess is not None]
    found = _refined(rig, reachable, [(wanted_hz[i], guesses[i] or 0.0) for i in inside], swing, mode)
    settings = [Setting(hertz, False, _why_not(reachable, hertz)) for hertz in wanted_hz]
    slope = reachable.curve().derivative() if len(reachable.resonances) > 1 else None
    for i, one in zip(inside, found, strict=True):
        if one is None:
            settings[i] = Setting(wanted_hz[i], False, "its resonance was lost on the way; give a smaller drive")
            continue
        assert slope is not None
        settings[i] = _setting(rig, wanted_hz[i], one, float(slope(one.pretension_mm)), swing)
    if draws is not None:
        settings = _with_intervals(rig, settings, draws, mode, progress)
    remarks = () if draws is None else draws.remarks
    return Tuning(Rows(settings), reachable, remarks, rig.name, swing.command_deg, swing.yaw_deg, mode, None)


def _guess(reachable: Reachable, hertz: float) -> float | None:
    """Return the lowest pretension [mm] within the limits at which the interpolated curve passes a frequency."""
    if reachable.pretension_mm is None:
        return None
    low, high = reachable.pretension_mm
    passed = [mm for mm in reachable.curve().solve(hertz, extrapolate=False) if low <= mm <= high]
    return float(min(passed)) if passed else None


def _refined(
    rig: RigSpec,
    reachable: Reachable,
    requested: list[tuple[float, float]],
    swing: Swing,
    mode: TendonMode,
) -> list[Resonance | None]:
    """Return the resonance of each (wanted frequency [Hz], guess [mm]), by Newton's method with the curve's slope."""
    if not requested:
        return []
    slope = reachable.curve().derivative()
    wanted, where = (np.array(row) for row in zip(*requested, strict=True))
    found: list[Resonance | None] = []
    known = [one.pretension_mm for one in reachable.resonances]
    commands = np.interp(where, known, [math.degrees(one.command) for one in reachable.resonances])
    for _ in range(_STEPS):
        guess = commands.tolist()
        found = list(find_resonances(rig, where.tolist(), swing, mode=mode, commands_deg=guess))
        now = np.array([math.nan if one is None else one.frequency_hz for one in found])
        off = now / wanted - 1
        if not np.any(np.abs(off) > _CLOSE):
            break
        where = np.where(np.isfinite(off), np.clip(where - off * wanted / slope(where), 0.0, None), where)
    return found


def _setting(rig: RigSpec, hertz: float, one: Resonance, slope: float, swing: Swing) -> Setting:
    unknown = math.nan, math.nan, math.nan
    stresses = [stress for stress in stresses_of(rig, one, swing) if stress.name != "yaw_deg"]
    worst = max(stresses, key=lambda stress: stress.share)
    sentence = (
        f"{one.pretension_mm:.2f} mm makes it resonate at {one.frequency_hz:.4g} Hz with a torsion of ±"
        f"{math.degrees(one.torsion):.1f}°; of the rig's limits that of {_IN_WORDS[worst.name]} is used most, "
        f"{worst.share:.0%}"
    )
    return Setting(
        wanted_hz=hertz,
        feasible=True,
        sentence=sentence,
        pretension_mm=Estimate(one.pretension_mm, *unknown),
        frequency_hz=Estimate(one.frequency_hz, *unknown),
        slope_hz_mm=slope,
        peak_hz=finite(one.peak_hz),
        torsion_deg=math.degrees(one.torsion),
        command_deg=math.degrees(one.command),
        lever_deg=math.degrees(abs(one.lever)),
        rest_tension_n=one.rest_tension,
        tension_n=one.tension,
        draws=0,
        resonance=one,
    )


def _why_not(reachable: Reachable, hertz: float) -> str:
    if reachable.pretension_mm is None or reachable.frequency_hz is None:
        return f"no pretension lies within the rig's limits: {reachable.why[0]}"
    (low_mm, high_mm), (low, high) = reachable.pretension_mm, reachable.frequency_hz
    if hertz < min(low, high):
        return (
            f"{hertz:g} Hz is below the {low:.4g} Hz at {low_mm:.3g} mm, and {reachable.why[0]}; a softer or longer "
            "silicone, a smaller tendon circle or more inertia would go lower"
        )
    return (
        f"{hertz:g} Hz is above the {high:.4g} Hz at {high_mm:.3g} mm, and {reachable.why[1]}; a stiffer or shorter "
        "silicone, a larger tendon circle or less inertia would go higher"
    )


def _with_intervals(
    rig: RigSpec,
    settings: list[Setting],
    draws: Draws,
    mode: TendonMode,
    progress: Callable[[float, float], None] | None,
) -> list[Setting]:
    """Return the settings with the intervals that the draws give."""
    there = [i for i, one in enumerate(settings) if one.resonance is not None]
    marks = [one for i in there if (one := settings[i].resonance) is not None]
    if not marks:
        return settings
    hertz = [one.frequency_hz for one in marks]
    band = ((1 - _ROOM) * min(hertz), (1 + _ROOM) * max(hertz))

    def make(one: RigSpec) -> Problem:
        commands = np.degrees([mark.command for mark in marks])
        return joint_problem(one, [mark.pretension_mm for mark in marks], commands, band, mode=mode)

    own, *drawn = drawn_branches([rig, *draws.rigs], make, band, progress=progress)
    verdict = list(settings)
    for column, i in enumerate(there):
        centre = own[column].phase_90
        if centre is None:
            continue
        there_too = [one[column].phase_90 for one in drawn]
        off = np.array([one.frequency_hz - centre.frequency_hz for one in there_too if one is not None])
        setting = settings[i]
        assert setting.pretension_mm is not None
        assert setting.frequency_hz is not None
        assert setting.slope_hz_mm is not None
        verdict[i] = replace(
            setting,
            pretension_mm=estimate_of_deviations(setting.pretension_mm.value, -off / setting.slope_hz_mm),
            frequency_hz=estimate_of_deviations(setting.frequency_hz.value, off),
            draws=off.size,
        )
    return verdict
