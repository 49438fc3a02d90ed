"""This is where stepped sines at several levels of the drive say how the resonance moves with amplitude."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.identify.response_curves import PhaseResonance, ResponseCurves, fit_response_curves
from sinew.identify.response_points import ResponsePoints
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate

__all__ = ["LevelDependence", "resonance_by_level"]

Array = NDArray[np.float64]

_NORMAL_90 = 1.6448536269514722


@dataclass(frozen=True)
class LevelDependence:
    """Resonance against the level of the drive.

    resonances: of each level, by its own points alone (`curves`), in order of level. joint: curves through all levels.
    bend_hz: of a straight line of the resonance frequency over the squared amplitude, its fall or rise from rest to the
    largest amplitude; negative where the joint softens. excess: scatter of the resonances about that line in their
    standard deviations; what is beyond 1 is in the interval of bend_hz.
    shift_hz: resonance at the highest level less that at the lowest. verdict: one sentence.
    """

    resonances: tuple[PhaseResonance, ...]
    curves: tuple[ResponseCurves, ...]
    joint: ResponseCurves
    bend_hz: Estimate
    excess: float
    shift_hz: Estimate
    verdict: str


def resonance_by_level(
    points: Sequence[ResponsePoints], *, terms: tuple[int, int] | None = None, turned: bool = False
) -> LevelDependence:
    """Return how the resonance of one joint moves with amplitude, from its response at two or more drive levels.

    points: one group for each level, its input amplitude the same at all frequencies. terms, turned: as in
    `sinew.identify.response_curves.fit_response_curves`.
    Raises SpecError for fewer than two levels, RecordingError as that does.
    """
    if len(points) < 2:
        raise SpecError(f"found {len(points)} level of the drive; an amplitude-dependent resonance needs at least two")
    levels = sorted(points, key=lambda one: float(np.median(one.input_amplitude)))
    curves = tuple(fit_response_curves(one, terms=terms, turned=turned) for one in levels)
    drives = [float(np.median(one.input_amplitude)) for one in levels]
    found = tuple(one.resonance(drive) for one, drive in zip(curves, drives, strict=True))
    joint = fit_response_curves(levels, terms=terms, turned=turned)
    bend, excess = _bend(found)
    shift = _difference(found[-1].frequency_hz, found[0].frequency_hz)
    return LevelDependence(found, curves, joint, bend, excess, shift, _verdict(bend, shift))


def _bend(found: Sequence[PhaseResonance]) -> tuple[Estimate, float]:
    """Return the slope of frequency over squared amplitude times the largest square, and the excess of the scatter."""
    frequency = np.array([one.frequency_hz.value for one in found])
    std = np.array([one.frequency_hz.std for one in found])
    square = np.array([one.amplitude.value for one in found]) ** 2
    if not (np.isfinite(frequency) & np.isfinite(std) & (std > 0)).all():
        return Estimate(np.nan, np.nan, np.nan, np.nan), np.nan
    design = np.stack([np.ones_like(square), square / square.max()], axis=1) / std[:, None]
    inverse = np.linalg.pinv(design)
    line = inverse @ (frequency / std)
    spare = len(found) - 2
    residual = frequency / std - design @ line
    excess = float(np.sqrt(residual @ residual / spare)) if spare else 1.0
    spread = float(np.linalg.norm(inverse[1])) * max(excess, 1.0)
    if excess > 1.0:
        return Estimate.student(float(line[1]), spread, spare), excess
    return Estimate.normal(float(line[1]), spread), excess


def _difference(one: Estimate, other: Estimate) -> Estimate:
    std = float(np.hypot(one.std, other.std))
    widest = max(((e.high - e.low) / (2 * e.std) for e in (one, other) if e.std > 0), default=_NORMAL_90)
    value = one.value - other.value
    return Estimate(value, std, value - widest * std, value + widest * std)


def _verdict(bend: Estimate, shift: Estimate) -> str:
    if not np.isfinite(bend.value):
        return "cannot tell: a level shows no resonance inside its sweep"
    moved = f"from the lowest level to the highest the resonance moves by {shift.value:.3g} Hz"
    band = f"({shift.low:.3g} to {shift.high:.3g}, 90 %)"
    if bend.high < 0 and shift.high < 0:
        return f"the joint softens: {moved} {band}"
    if bend.low > 0 and shift.low > 0:
        return f"the joint hardens: {moved} {band}"
    return f"no dependence on amplitude beyond chance: {moved} {band}"
