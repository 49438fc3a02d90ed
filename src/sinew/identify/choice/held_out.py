"""The held-out part of a record, predicted by what the other part taught.

Three ways: a test range after the training range is reached by simulating on; one before it, or in another record, is
predicted with the mechanics and rest position known and only its start sought, from its first two periods; and where no
ranges are named, blocks all over the record are left out of the sum of squares while the simulation runs through them.
"""

from dataclasses import dataclass

import numpy as np

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.fitted import Fit
from sinew.identify.oscillator.least_squares import restricted, solve
from sinew.identify.oscillator.model import Model, make_layout, make_part
from sinew.identify.oscillator.record import FEWEST, Record
from sinew.identify.oscillator.start import dominant_omega
from sinew.identify.oscillator.track import PLACE
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError, SpecError

_BLOCKS = 40
_EVERY = 4  # block of them is held out
_SEEN_PERIODS = 2.0


@dataclass(frozen=True)
class Split:
    """A record and which of its samples teach and which test.

    record: from the first sample that is used on. kept, tested: shape (n,). apart: the record of a test range that
    comes before the training range, else None (then `tested` is empty). interleaved: whether blocks were chosen here.
    whole: of those the record as all samples tell it, for the fit to all of them, where it is not `record`; else None.
    """

    record: Record
    kept: Mask
    tested: Mask
    apart: Record | None = None
    interleaved: bool = False
    whole: Record | None = None


@dataclass(frozen=True)
class HeldOut:
    """A fit and how it predicts what it has not seen: measured less predicted, unit of the output, shape (t,)."""

    fit: Fit
    residual: Array

    @property
    def rmse(self) -> float:
        """Return the root mean square over the held-out samples."""
        return float(np.sqrt(np.mean(self.residual**2)))


def split_record(record: Record, train: tuple[int, int] | None, test: tuple[int, int] | None) -> Split:
    """Return how a record is divided. train, test: sample indices, half open, or None.

    Without a test range, what lies behind the training range is the test if it is a tenth of it or longer, else blocks
    of the training range. Raises SpecError for ranges that are not in the record.
    """
    train = _checked("train", train or (0, record.size), record.size)
    if test is None and record.size - train[1] >= 0.1 * (train[1] - train[0]) and train[1] < record.size - FEWEST:
        test = (train[1], record.size)
    if test is None:
        part = record.cut(*train)
        tested = _blocks(part)
        return Split(part, ~tested, tested, interleaved=True)
    test = _checked("test", test, record.size)
    if test[0] < train[0]:
        part = record.cut(*train)
        everything = np.ones(part.size, dtype=bool)
        return Split(part, everything, ~everything, record.cut(*test))
    part = record.cut(train[0], max(train[1], test[1]))
    index = np.arange(part.size) + train[0]
    return Split(part, index < train[1], (index >= test[0]) & (index < test[1]))


def _checked(name: str, found: tuple[int, int], size: int) -> tuple[int, int]:
    low, high = found
    if not 0 <= low < high <= size:
        raise SpecError(f"--{name} is {low}:{high}, expected A:B with 0 <= A < B <= {size}, the number of samples")
    if high - low < FEWEST:
        raise RecordingError(f"--{name} holds {high - low} samples, expected at least {FEWEST}; widen it")
    return low, high


def _blocks(record: Record) -> Mask:
    period = 2 * np.pi / dominant_omega(record) / record.step_s
    length = max(1, min(round(max(0.5 * period, record.size / _BLOCKS)), record.size // (2 * _EVERY)))
    block = np.arange(record.size) // length
    return np.asarray(block % _EVERY == _EVERY - 1)


def fit_and_predict(split: Split, model: Model | str, smaller: Fit | None = None) -> HeldOut:
    """Return the fit to the training samples, and what it leaves of the held-out ones.

    smaller: a fit of a smaller model to the same samples, at which the search begins.
    """
    found = fit(split.record, model, kept=[split.kept], smaller=smaller)
    if split.apart is not None:
        return HeldOut(found, split.apart.output - predict(found, split.apart))
    return HeldOut(found, found.residuals()[0][split.tested])


def predict(fitted: Fit, record: Record) -> Array:
    """Return the output of another record by a fit's mechanics and rest position, shape (n,), in its unit.

    Of several groups the record's own is taken, of several records in it the median rest position. Only where the
    record starts is not known; it is sought in the record's first two periods. A drift is not carried over.
    Raises SpecError where the fit has no record of the record's group.
    """
    mine = [i for i, part in enumerate(fitted.layout.parts) if part.record.group == record.group]
    if not mine and any(entry.group for entry in fitted.layout.entries):
        raise SpecError(f"the fit knows nothing of {record.group!r}; fit a record of it, too")
    mine = mine or list(range(len(fitted.layout.parts)))
    scales = fitted.layout.parts[mine[0]].scales
    part = make_part(record, fitted.model.resting("offset"), scales, fitted.frame, np.ones(record.size, dtype=bool))
    each = [fitted.layout.local(fitted.solution.values, i) for i in mine]
    known = each[0].copy()
    offset = PLACE["offset"]
    sizes = [one[offset] * fitted.layout.parts[i].unit_size for one, i in zip(each, mine, strict=True)]
    known[offset] = float(np.median(sizes)) / part.unit_size
    layout = make_layout(fitted.model.resting("offset"), [part])
    x = known[layout.column[0]].copy()
    free = np.array([k for k, entry in enumerate(layout.entries) if entry.local in ("start", "start_rate")])
    x[free] = 0.0
    seen = np.arange(record.size) < max(FEWEST, int(_SEEN_PERIODS * 2 * np.pi / scales.omega / record.step_s))
    x[free] = solve(restricted(layout.problem([seen]), x, free), x[free], tolerance=1e-8, max_evaluations=60).values
    return np.asarray(layout.outputs(x)[0] * part.unit_size)
