"""Whether the joint hardens: a cubic and a quadratic term of its stiffness.

At each pretension and repeat I r'' + losses + k r + k₂ r² + k₃ r³ = -I_l θ'' is fitted to the steady segments
under the lever's measured angle θ. A cubic term shifts the natural frequency at the amplitude A by 3 k₃ A²/(8 k) of
itself (Duffing, first order), which is the number that tells large from small. Dry friction with presliding is a
spring that gives way as the amplitude grows: it makes k₃ smaller, and a fit cannot tell it from a softening spring.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr

from sinew.analysis.signal.repeats import Pooled, pool_repeats
from sinew.analysis.signal.signals import Channel, Signals, read_signals, torsion_chain, torsion_delay
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.model import Fit
from sinew.identify.oscillator.record import FEWEST, Record, make_record
from sinew.measure.errors import SinewError
from sinew.measure.estimate import Estimate
from sinew.measure.recording import Segment
from sinew.paper.answer import CANNOT_TELL, Answer, Cell, cannot_tell, in_words
from sinew.plan.rig import RigSpec

# A rig's recording is cut into the records of one pretension and one repeat, ready for a fit.

CAPPED = 10
"""Most steady segments of one fit: what more of them tell is not worth their time."""
_SETTLED_HZ = 3.0  # of a decay that does not say its frequency, for the sensors' delay


def records_by_repeat(recording: xr.Dataset, rig: RigSpec | None = None) -> dict[float, dict[int, list[Record]]]:
    """Return the records of a recording by pretension [mm] and repeat.

    Steady segments under the measured lever, evenly thinned to `CAPPED`, those with the largest motion among them;
    where a pretension has none, its ring-downs, under the measured lever too (it recoils), or free where no drive was
    recorded. The sensors' delay and what they take off the amplitude are undone, by the rig's delay budget.
    Nothing is returned of a pretension whose segments cannot be used: a drive that is no angle, a steady segment
    without a drive.
    """
    signals = read_signals(recording, rig)
    found: dict[float, dict[int, list[Record]]] = {}
    for pretension in sorted({segment.pretension_mm for segment, _ in signals.segments}):
        mine = [row for row in signals.segments if row[0].pretension_mm == pretension]
        steady = [row for row in mine if row[0].kind == "steady" and np.isfinite(row[0].frequency_hz)]
        lever = signals.drive is not None and signals.drive.unit == "rad"
        taken = steady if lever and steady else [row for row in mine if row[0].kind == "ring-down"]
        for repeat in sorted({segment.repeat for segment, _ in taken}):
            chosen = _thinned(signals.response, [row for row in taken if row[0].repeat == repeat])
            records = [_record(signals, segment, where, lever=lever) for segment, where in chosen]
            if records:
                found.setdefault(float(pretension), {})[repeat] = records
    return found


def _thinned(response: Channel, rows: list[tuple[Segment, slice]]) -> list[tuple[Segment, slice]]:
    """Return at most `CAPPED` rows: every second one down from the largest motion, the rest spread over the others."""
    rows = [row for row in rows if row[1].stop - row[1].start >= FEWEST]
    if len(rows) <= CAPPED:
        return rows
    size = [
        float(np.ptp(response.values[where])) / (segment.frequency_hz if response.is_rate else 1.0)
        for segment, where in rows
    ]
    largest = list(np.argsort(size)[::-1][: CAPPED // 2])
    others = [i for i in range(len(rows)) if i not in largest]
    spread = np.linspace(0, len(others) - 1, CAPPED - len(largest)).round().astype(int)
    return [rows[i] for i in sorted({*map(int, largest), *(others[k] for k in spread)})]


def _record(signals: Signals, segment: Segment, where: slice, *, lever: bool) -> Record:
    response, drive, budget = signals.response, signals.drive, signals.budget
    frequency = segment.frequency_hz if segment.frequency_hz > 0 else _SETTLED_HZ
    driven = lever and drive is not None
    return make_record(
        signals.time_s[where],
        response.values[where] / float(abs(torsion_chain(budget, frequency))),
        drive.values[where] if driven and drive is not None else None,
        excitation="lever" if driven else "none",
        output_unit=response.unit,
        input_unit="rad" if driven else "1",
        output_delay_s=torsion_delay(budget, frequency) - budget.drive_delay_s,
        group=f"{segment.pretension_mm:g} mm",
    )


MODELS = ("loss-factor-cubic-quadratic", "cubic-quadratic")

Progress = Callable[[float, float], None]


class _Fits(NamedTuple):
    """The fits of one pretension, one for each repeat, and the first repeat's with the other damping law."""

    pretension_mm: float
    fits: list[Fit]
    other: Fit

    def numbers(self, term: str) -> tuple[list[float], list[float]]:
        """Return values and standard deviations of a term over the repeats."""
        found = [_number(one, term) for one in self.fits]
        return [one.value for one in found], [one.std for one in found]

    def moved(self, term: str) -> float:
        """Return how far the damping law moves a term."""
        return abs(_number(self.other, term).value - _number(self.fits[0], term).value)

    @property
    def swing(self) -> float:
        """Return the largest amplitude of the motion, in its unit."""
        return max(part.scales.amplitude for one in self.fits for part in one.layout.parts)

    @property
    def stiffness(self) -> float:
        """Return k/I [1/s²]."""
        return float(np.mean(self.numbers("stiffness")[0]))


def answer_hardening(
    recording: xr.Dataset, rig: RigSpec | None = None, progress: Progress = lambda _done, _total: None
) -> Answer:
    """Return whether the joint hardens, softens or neither, at each pretension and over all of them.

    recording: steady segments that say their frequency, or ring-downs. rig: whose sensor delays are undone.
    progress: called with (done, total) fits.

    Rows: `cubic_per_s2_rad2` (k₃/I) and `quadratic_per_s2_rad` (k₂/I), with intervals from the scatter over repeats,
    pooled over pretensions. The damping law is, of a constant loss factor and viscous damping, the one that leaves less
    of the first repeat; what the other one would change is added to the intervals. `swing_deg`: largest amplitude in
    the fit. `frequency_shift`: 3 k₃ A²/(8 k) at that swing; `quadratic_share`: k₂ A/k. `misfit`: rmse over the scatter
    of the output.
    """
    records = records_by_repeat(recording, rig)
    if not records:
        return cannot_tell(
            "hardening", "The recording holds neither steady segments under a measured lever nor ring-downs."
        )
    found, failures = _fit_all(records, progress)
    if not found:
        return cannot_tell("hardening", *failures[:2])
    shift, lean = (_pooled(found, term, power) for term, power in (("cubic", 2), ("quadratic", 1)))
    rows = [_row(one, *pair) for one, *pair in zip(found, shift.estimates, lean.estimates, strict=True)]
    verdict, said = _judge(shift, len(rows))
    numbers = {"frequency_shift_at_smallest_pretension": shift.estimates[0]}
    if len(rows) > 1:
        numbers["frequency_shift_at_largest_pretension"] = shift.estimates[-1]
    limit = (
        "Friction in the guides that has not broken loose is a spring that gives way with amplitude: it softens, and "
        "this fit cannot tell it from the elastic force."
    )
    return Answer("hardening", verdict, (said, limit), numbers, tuple(rows), ("frequency_shift", "quadratic_share"))


def _fit_all(records: dict[float, dict[int, list[Record]]], progress: Progress) -> tuple[list[_Fits], list[str]]:
    found, failures = [], []
    done, total = 0, sum(len(repeats) + 1 for repeats in records.values())
    for pretension, repeats in records.items():
        fits: list[Fit] = []
        other: list[Fit] = []
        for some in repeats.values():
            try:
                if fits:
                    fits.append(fit(some, fits[0].model, guess=fits[0]))
                else:
                    best, *other = sorted((fit(some, model) for model in MODELS), key=lambda one: one.rmse)
                    fits.append(best)
                    done += 1
            except SinewError as error:
                failures.append(f"At {pretension:g} mm a repeat was left out: {error}.")
            done += 1
            progress(min(done, total), total)
        if fits:
            found.append(_Fits(pretension, fits, other[0]))
    return found, failures


def _number(fitted: Fit, term: str) -> Estimate:
    return next(value for name, value in fitted.parameters.items() if name.startswith(term))


def _factor(one: _Fits, power: int) -> float:
    """Return what a cubic term (power 2) or a quadratic one (power 1) is multiplied by to have no unit."""
    return one.swing**power / one.stiffness * (3.0 / 8.0 if power == 2 else 1.0)


def _pooled(found: list[_Fits], term: str, power: int) -> Pooled:
    factors = [_factor(one, power) for one in found]
    numbers = [one.numbers(term) for one in found]
    values, stds = ([[f * x for x in pair[k]] for f, pair in zip(factors, numbers, strict=True)] for k in (0, 1))
    return pool_repeats(values, stds, [f * one.moved(term) for f, one in zip(factors, found, strict=True)])


def _row(one: _Fits, shift: Estimate, lean: Estimate) -> dict[str, Cell]:
    first = one.fits[0].records[0]
    scatter = math.sqrt(np.mean([float(np.var(record.output)) for fitted in one.fits for record in fitted.records]))
    angle = first.motion_unit == "rad"
    return {
        "pretension_mm": one.pretension_mm,
        "repeats": float(len(one.fits)),
        "swing_deg" if angle else "swing": math.degrees(one.swing) if angle else one.swing,
        "stiffness_per_s2": one.stiffness,
        "cubic_per_s2_rad2" if angle else "cubic_per_s2": shift.times(1.0 / _factor(one, 2)),
        "quadratic_per_s2_rad" if angle else "quadratic_per_s2": lean.times(1.0 / _factor(one, 1)),
        "frequency_shift": shift,
        "quadratic_share": lean,
        "misfit": math.sqrt(np.mean([fitted.rmse**2 for fitted in one.fits])) / scatter,
    }


def _judge(shift: Pooled, count: int) -> tuple[str, str]:
    """Return the verdict and its sentence."""
    known = [one for one in shift.estimates if math.isfinite(one.std)]
    if not known:
        return CANNOT_TELL, "The cubic term has no interval; measure at least two repeats."
    up, down = shift.significant()
    if up and down:
        ends = [in_words(one, 100.0, "%") for one in (known[0], known[-1])]
        return "hardens at some pretensions, softens at others", (
            f"The joint hardens beyond chance at {up} and softens at {down} of {count} pretensions: at its largest "
            f"swing the cubic term moves the natural frequency by {ends[0]} at the smallest pretension and by "
            f"{ends[1]} at the largest."
        )
    values = np.array([one.value for one in known])
    if up or down:
        verdict, does = ("hardens", "raises") if up else ("softens", "lowers")
        size = float(np.median(np.abs(values[values > 0 if up else values < 0])))
        return verdict, (
            f"The joint {verdict} beyond chance at {up or down} of {count} pretensions: at the largest swing the cubic "
            f"term {does} the natural frequency by {_percent(size)} (median)."
        )
    widest = max(max(abs(one.low), abs(one.high)) for one in known)
    return "neither beyond chance", (
        f"No cubic term is beyond chance at any of {count} pretensions; one that shifts the natural frequency at the "
        f"largest swing by more than {_percent(widest)} would have shown."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
