"""This is where a fit is laid out for drawing: measured and fitted output of each stretch, and what was held out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sinew.figures.style import Floats
from sinew.identify.fitted import Fit
from sinew.identify.held_out import HeldOut, Split
from sinew.identify.joint_fitted import JointFit
from sinew.identify.record import Record
from sinew.identify.start import dominant_omega

__all__ = ["Trace", "traces_of", "traces_of_joint"]


@dataclass(frozen=True)
class Trace:
    """One stretch of an experiment and what a fit makes of it.

    time_s, measured, fitted: shape (n,), the latter two in `unit`. held: which samples were held out, shape (n,).
    unit: of the output, SI. title: its condition, empty where there is one stretch only.
    """

    time_s: Floats
    measured: Floats
    fitted: Floats
    held: NDArray[np.bool_]
    unit: str
    title: str = ""

    @property
    def residual(self) -> Floats:
        """Return measured less fitted, shape (n,)."""
        return self.measured - self.fitted


def traces_of(fit: Fit, split: Split | None = None, held_out: HeldOut | None = None) -> list[Trace]:
    """Return the stretches of a fit, in order of time.

    split, held_out: of a fit to one record, what was held out and how it was predicted. Where blocks were held out to
    compare models and then fitted too, they count as held out, and the prediction is that of the fit without them.
    """
    many = len(fit.records) > 1
    found = [
        Trace(record.time_s, record.output, fitted, ~kept, record.output_unit, _title(record) if many else "")
        for record, fitted, kept in zip(fit.records, fit.predicted, fit.kept, strict=True)
    ]
    if split is None or held_out is None:
        return found
    if split.interleaved:
        without = held_out.fit.predicted[0]
        return [replace(found[0], fitted=np.where(split.tested, without, found[0].fitted), held=split.tested)]
    if split.apart is not None:
        apart = split.apart
        every = np.ones(apart.size, dtype=bool)
        found.insert(0, Trace(apart.time_s, apart.output, apart.output - held_out.residual, every, apart.output_unit))
    return _joined(found)


def _title(record: Record) -> str:
    """Return the group of a record and, where the group does not tell it, how fast it swings."""
    if record.group.endswith("Hz"):
        return record.group
    leading = record if record.input is None else replace(record, output=record.input)
    return f"{record.group}, {dominant_omega(leading) / (2 * np.pi):.2f} Hz".removeprefix(", ")


def _joined(traces: Sequence[Trace]) -> list[Trace]:
    return sorted(traces, key=lambda trace: float(trace.time_s[0]))


def traces_of_joint(joint: JointFit) -> list[Trace]:
    """Return the segments of a fit of the tendon joint, without the samples at their ends that were not fitted."""
    found = []
    for one in joint.segments:
        kept = one.kept
        drive = f", {one.frequency_hz:.3g} Hz" if np.isfinite(one.frequency_hz) else ""
        title = f"{one.pretension_mm:g} mm{drive}"
        held = np.zeros(int(kept.sum()), dtype=bool)
        found.append(Trace(one.time_s[kept], one.measured[kept], one.predicted[kept], held, "rad/s", title))
    return found
