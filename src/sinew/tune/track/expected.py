"""This is where it is said beforehand what tracking should find on a rig: resonance, damping, amplitudes.

It is the backbone by prediction: the steady motions at which the torsion's fundamental lags the lever's by 90°, over
the amplitude of the drive. The loop's gains, its first frequency and what the pretension is worth follow from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.measure.errors import SpecError
from sinew.plan.plan import Held, TendonMode
from sinew.plan.rig import RigSpec
from sinew.predict.curves.backbone import follow_backbones
from sinew.predict.describing import equivalent_of_rig
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.tune.track.tracker import Mode
from sinew.twin.cache import configure

__all__ = ["ExpectedBackbone", "expect_backbones", "resonance_slope"]

Floats = NDArray[np.float64]

_BAND_HZ = (1.0, 6.0)


@dataclass(frozen=True)
class ExpectedBackbone:
    """The predicted backbone at one pretension [mm], over growing drive, each (n,): frequency_hz, damping_ratio of the
    equivalent linear joint, amplitudes of the fundamentals of command, lever and torsion [rad]."""

    pretension_mm: float
    frequency_hz: Floats
    damping_ratio: Floats
    command: Floats
    lever: Floats
    torsion: Floats

    def mode(self, held: Held, amplitude: float) -> Mode:
        """Return the mode where an amplitude of command, lever or torsion is held [rad]; at the curve's end beyond."""
        along = getattr(self, held)
        return Mode(
            float(np.interp(amplitude, along, self.frequency_hz)),
            float(np.interp(amplitude, along, self.damping_ratio)),
        )

    def torsion_at(self, held: Held, amplitude: float) -> float:
        """Return the amplitude of the torsion [rad] where one of command, lever or torsion is held [rad]."""
        return float(np.interp(amplitude, getattr(self, held), self.torsion))

    def frequency_at(self, torsion: float) -> float:
        """Return the predicted resonance [Hz] at an amplitude of the torsion [rad]; NaN beyond the curve."""
        inside = self.torsion[0] <= torsion <= self.torsion[-1] * 1.02
        return float(np.interp(torsion, self.torsion, self.frequency_hz)) if inside else float("nan")


def expect_backbones(
    rig: RigSpec,
    pretension_mm: Sequence[float],
    largest_deg: float,
    *,
    mode: TendonMode = "position",
    band_hz: tuple[float, float] = _BAND_HZ,
) -> tuple[ExpectedBackbone, ...]:
    """Return the predicted backbone at each pretension, up to an amplitude of the command [deg].

    band_hz: where resonances are sought. Raises SpecError where the rig resonates nowhere in it.
    """
    configure()
    problem = joint_problem(rig, list(pretension_mm), largest_deg, band_hz, mode=mode)
    found = []
    for mm, backbone in zip(pretension_mm, follow_backbones(problem, band_hz, RESOLUTION), strict=True):
        curve = backbone.curve
        if curve.frequency_hz.size < 2:
            raise SpecError(f"no resonance of rig {rig.name} is predicted at {mm:g} mm: {curve.message}")
        command = backbone.share * np.radians(largest_deg)
        damping = equivalent_of_rig(curve, curve.drive, rig).damping_ratio
        found.append(ExpectedBackbone(mm, curve.frequency_hz, damping, command, np.abs(curve.drive), curve.fundamental))
    return tuple(found)


def resonance_slope(backbones: Sequence[ExpectedBackbone], held: Held, amplitude: float) -> float:
    """Return the mean slope of the resonance over pretension [Hz/mm], with an amplitude held [rad]; 0 of one alone."""
    if len(backbones) < 2:
        return 0.0
    ends = [one.mode(held, amplitude).frequency_hz for one in (backbones[0], backbones[-1])]
    return (ends[1] - ends[0]) / (backbones[-1].pretension_mm - backbones[0].pretension_mm)
