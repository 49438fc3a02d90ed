"""Points of a stepped sine from its steady stretches in time, one stretch a point."""

from collections.abc import Sequence

import numpy as np

from sinew.analysis.signal.harmonics import fit_harmonics, refine_frequency, relative_noise
from sinew.identify.oscillator.record import Record
from sinew.identify.stepped.points import ResponsePoints, make_points, turned
from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import RecordingError, SpecError

_PADDING = 8
_FEWEST_PERIODS = 2.0
_PLAIN, _PER_PAIR = 24.0, 4.0  # degrees of freedom of a scatter read off twelve lines; of each pair of sidebands


def response_points(
    records: Sequence[Record], frequency_hz: Sequence[float] | None = None
) -> tuple[ResponsePoints, ...]:
    """Return the points that steady stretches hold, one stretch a point, those of one group together.

    records: each driven by one frequency, its transient gone. frequency_hz: of each; found in the input where it is
    None. Fundamental and harmonics 2 to 5 of input and output are fitted by least squares to the samples; the scatter
    is what the residual holds near the fundamental (`sinew.analysis.signal.harmonics`), so slow drift, colour and a
    rest of the transient are in it. The records' `output_delay_s` is undone.
    Raises RecordingError for a stretch without a steady input or shorter than two periods.
    """
    if not records:
        raise SpecError("no record to take a response from")
    if frequency_hz is not None and len(frequency_hz) != len(records):
        raise SpecError(f"found {len(frequency_hz)} frequencies for {len(records)} records, expected one each")
    known = [_dominant(record) for record in records] if frequency_hz is None else [float(f) for f in frequency_hz]
    for record, frequency in zip(records, known, strict=True):
        _check_span(record, frequency)
    sizes = np.array([record.size for record in records])
    h, scatter = np.empty(sizes.size, dtype=complex), np.empty((sizes.size, 2, 2))
    amplitude, freedom = np.empty(sizes.size), np.empty(sizes.size)
    for size in np.unique(sizes):
        rows = [i for i, record in enumerate(records) if record.size == size]
        batch = _batch([records[i] for i in rows], np.array([known[i] for i in rows]))
        h[rows], scatter[rows], amplitude[rows], freedom[rows] = batch
    found = []
    for group in dict.fromkeys(record.group for record in records):
        mine = [i for i, record in enumerate(records) if record.group == group]
        first = records[mine[0]]
        made = make_points(
            np.array(known)[mine],
            h[mine],
            scatter[mine],
            amplitude[mine],
            excitation=first.excitation,
            output_unit=first.output_unit,
            input_unit=first.input_unit,
            group=group,
            scatter_freedom=float(freedom[mine].min()),
        )
        found.append(made)
    return tuple(found)


def _check_span(record: Record, frequency: float) -> None:
    periods = (record.time_s[-1] - record.time_s[0]) * record.size / (record.size - 1) * frequency
    if periods < _FEWEST_PERIODS * 0.99:
        raise RecordingError(f"a steady stretch holds {periods:.2g} periods of its input; record at least two")


def _batch(records: Sequence[Record], frequency: Array) -> tuple[Complexes, Array, Array, Array]:
    """Return response, its covariance (s, 2, 2), input amplitude and degrees of freedom of records of one length."""
    time = np.stack([record.time_s for record in records])
    signals = np.stack([np.stack([record.output, _driven(record)]) for record in records])
    try:
        fitted = fit_harmonics(time, signals, frequency)
    except ValueError as error:
        raise RecordingError(f"{error}; record faster or longer") from error
    late = np.exp(2j * np.pi * frequency * np.array([record.output_delay_s for record in records]))
    response = fitted.coefficient[:, 0, 0] / fitted.coefficient[:, 1, 0] * late
    relative = np.stack(relative_noise(fitted, 0, 1), axis=1)
    pairs = np.isfinite(fitted.sidebands[:, 0, :, 0]).sum(axis=1)
    freedom = np.where(pairs < 3, _PLAIN, _PER_PAIR * pairs)
    return response, turned(response, relative), np.abs(fitted.coefficient[:, 1, 0]), freedom


def _driven(record: Record) -> Array:
    if record.input is None:
        raise SpecError("a response needs a measured input; this record is a free decay")
    driven = record.input - record.input.mean()
    if not np.abs(driven).max() > 0:
        raise RecordingError("the input is constant; a stepped sine needs one frequency in each stretch")
    return np.asarray(driven)


def _dominant(record: Record) -> float:
    """Return the frequency of the input [Hz]."""
    driven, span = _driven(record), float(record.time_s[-1] - record.time_s[0])
    even = np.linspace(record.time_s[0], record.time_s[-1], driven.size)
    windowed = np.interp(even, record.time_s, driven) * np.hanning(driven.size)
    size = _PADDING * driven.size
    first = float(np.fft.rfftfreq(size, span / (driven.size - 1))[np.argmax(np.abs(np.fft.rfft(windowed, size)))])
    _check_span(record, first * 1.1)
    return refine_frequency(record.time_s, driven, first)
