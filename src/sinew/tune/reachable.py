"""This is where it is found between which frequencies a rig's pretension can move its resonance, and what ends it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.tune.drive_load import drive_load
from sinew.tune.resonance import Resonance, Swing, find_resonances

__all__ = ["Reachable", "Stress", "find_reachable", "stresses_of"]

Array = NDArray[np.float64]

_GRID, _FINE = 5, 401
_JUST = 1e-6


class Stress(NamedTuple):
    """One limit of a rig at one resonance. share: of the limit that is used, 1 at the limit. sentence: with both."""

    name: str
    share: float
    sentence: str


@dataclass(frozen=True)
class Reachable:
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


def stresses_of(rig: RigSpec, one: Resonance, swing: Swing) -> list[Stress]:
    """Return how far a rig's limits are used where it resonates: tension, currents, torsion, drive."""
    limits, tendons = rig.limits, rig.tendons
    load = drive_load(rig, one.frequency_hz, one.lever, one.torsion)
    pull = one.tension * tendons.pulley_radius.value / tendons.torque_constant.value
    command, torsion = math.degrees(one.command), math.degrees(one.torsion)
    where = f"at {one.pretension_mm:.3g} mm"
    found = [
        Stress(
            "tension_n",
            one.tension / limits.tension_n,
            f"{where} a tendon pulls {one.tension:.0f} N, the rig allows {limits.tension_n:g} N",
        ),
        Stress(
            "tendon_current_a",
            pull / limits.tendon_current_a,
            f"{where} a tendon motor draws {pull:.2f} A, the rig allows {limits.tendon_current_a:g} A",
        ),
        Stress(
            "torsion_deg",
            torsion / limits.torsion_deg,
            f"{where} the head twists by {torsion:.1f}°, the rig allows {limits.torsion_deg:g}°",
        ),
        Stress(
            "drive_amplitude_deg",
            command / limits.drive_amplitude_deg,
            f"{where} the drive needs a command of {command:.0f}°, the rig allows {limits.drive_amplitude_deg:g}°",
        ),
        Stress(
            "drive_current_a",
            load.current / limits.drive_current_a,
            f"{where} the drive draws {load.current:.2f} A, the rig allows {limits.drive_current_a:g} A",
        ),
    ]
    if swing.yaw_deg is not None:
        short = swing.yaw_deg / torsion
        sentence = f"{where} the drive twists the head by {torsion:.2f}° at most, {swing.yaw_deg:g}° were asked for"
        found.append(Stress("yaw_deg", short / 1.005, sentence))
    return found


def find_reachable(rig: RigSpec, swing: Swing, *, mode: TendonMode = "position", count: int = _GRID) -> Reachable:
    """Return the frequencies that pretension alone can make a rig resonate at, within every limit of the rig.

    count: of pretensions across the rig's window at which the resonance is computed.
    """
    low, high = rig.limits.pretension_mm
    low, high = max(0.0, low), min(high, rig.limits.tendon_travel_mm[1])
    grid = np.linspace(low, high, count)
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
        f"{low:g} mm is the rig's lowest pretension" if ends[0] == grid[0] else _told(worst, found, ends[0], -1),
        f"{high:g} mm is the rig's highest pretension" if ends[1] == grid[-1] else _told(worst, found, ends[1], 1),
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


def _told(worst: Sequence[Stress], found: Sequence[Resonance], edge: float, way: int) -> str:
    beyond = [s for s, one in zip(worst, found, strict=True) if way * (one.pretension_mm - edge) > 0]
    if not beyond:
        side = "above" if way > 0 else "below"
        return f"{side} {edge:.3g} mm the torsion does not settle to 90° of lag within the band that was searched"
    return beyond[0 if way > 0 else -1].sentence
