"""This is where the points of a stepped sine are held: frequency, complex response, scatter, size of the input."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sinew.analysis.signal.harmonics import fit_harmonics, refine_frequency, relative_noise
from sinew.analysis.sweep.response import Response
from sinew.identify.oscillator.record import Excitation, Record
from sinew.measure.errors import RecordingError, SpecError

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_PADDING = 8
_FEWEST_PERIODS = 2.0
_PLAIN, _PER_PAIR = 24.0, 4.0  # degrees of freedom of a scatter read off twelve lines; of each pair of sidebands
_FIVE_PERIODS = 12.0  # the same of a stretch of five periods, whose residual has three such pairs


@dataclass(frozen=True)
class ResponsePoints:
    """One stepped sine under one condition: n steady states, in order of frequency.

    frequency_hz: shape (n,). response: complex, fundamental of the output over that of the input, output_unit per
    input_unit, positive time convention exp(+jΩt), shape (n,). covariance: of its real and imaginary part,
    shape (n, 2, 2). input_amplitude: of the input's fundamental, shape (n,), in input_unit.
    excitation, output_unit, input_unit: as of a `Record`. group: name of the condition (a pretension, a level).
    scatter_freedom: degrees of freedom of each point's scatter, infinity where it is known.
    """

    frequency_hz: Array
    response: Complexes
    covariance: Array
    input_amplitude: Array
    excitation: Excitation
    output_unit: str = "1"
    input_unit: str = "1"
    group: str = ""
    scatter_freedom: float = np.inf
    notes: tuple[str, ...] = field(default=())

    @property
    def size(self) -> int:
        """Return the number of points."""
        return self.frequency_hz.size

    @property
    def signals(self) -> Record:
        """Return a record without samples that carries excitation, units and group, whose rules hold for points too."""
        nothing = np.empty(0)
        return Record(nothing, nothing, nothing, self.excitation, self.output_unit, self.input_unit, group=self.group)

    def at(self, frequency_hz: float, input_amplitude: float) -> "ResponsePoints":
        """Return one point of the same kind at a frequency and drive, its response unknown."""
        one, unknown = np.ones(1), np.full(1, np.nan + 0j)
        return replace(
            self,
            frequency_hz=frequency_hz * one,
            response=unknown,
            covariance=np.full((1, 2, 2), np.nan),
            input_amplitude=input_amplitude * one,
        )

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "ResponsePoints":
        """Return the chosen points: a mask of shape (n,) or indices."""
        return replace(
            self,
            frequency_hz=self.frequency_hz[chosen],
            response=self.response[chosen],
            covariance=self.covariance[chosen],
            input_amplitude=self.input_amplitude[chosen],
        )


def make_points(
    frequency_hz: ArrayLike,
    response: ArrayLike,
    scatter: ArrayLike,
    input_amplitude: ArrayLike,
    *,
    excitation: Excitation,
    output_unit: str = "1",
    input_unit: str = "1",
    group: str = "",
    scatter_freedom: float = np.inf,
) -> ResponsePoints:
    """Return points of a table, put in order of frequency; those that are not finite are left out.

    response: complex, output over input, shape (n,). scatter: its covariance, shape (n, 2, 2), or the standard
    deviations of real and imaginary part, shape (n, 2), or one for both, shape (n,) or a number; of the point itself.
    input_amplitude: shape (n,), or one number for all.
    Raises SpecError for an excitation without input, RecordingError for shapes that differ or points without scatter.
    """
    if excitation not in get_args(Excitation) or excitation == "none":
        raise SpecError(f"excitation is {excitation!r}; a response has an input: force, torque, base or lever")
    f, h = np.asarray(frequency_hz, dtype=float), np.asarray(response, dtype=complex)
    amplitude = np.broadcast_to(np.asarray(input_amplitude, dtype=float), f.shape)
    spread = np.asarray(scatter, dtype=float)
    if spread.ndim == 0:
        spread = np.broadcast_to(spread, f.shape)
    if spread.shape == f.shape:
        spread = np.repeat(spread[..., None], 2, axis=-1)
    if spread.ndim == 2:
        spread = spread[:, :, None] ** 2 * np.eye(2)
    if f.ndim != 1 or h.shape != f.shape or spread.shape != (f.size, 2, 2):
        raise RecordingError(
            f"frequency has shape {f.shape}, response {h.shape}, scatter {np.shape(scatter)}; expected one row a point"
        )
    known = np.isfinite(f) & np.isfinite(h) & np.isfinite(spread).all(axis=(1, 2)) & (amplitude > 0)
    good = known & (np.linalg.det(np.where(known[:, None, None], spread, 0.0)) > 0) & (f > 0)
    if known.any() and not good.any():
        raise RecordingError("no point has a scatter above zero; give the standard deviation of each point")
    order = np.flatnonzero(good)[np.argsort(f[good], kind="stable")]
    return ResponsePoints(
        f[order],
        h[order],
        spread[order],
        np.array(amplitude[order]),
        excitation,
        output_unit,
        input_unit,
        group,
        scatter_freedom,
    )


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
    return response, _turned(response, relative), np.abs(fitted.coefficient[:, 1, 0]), freedom


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


def _turned(response: Complexes, relative: Array) -> Array:
    """Return covariances of real and imaginary part, (n, 2, 2), from relative noise of size and angle, (n, 2)."""
    turn = np.moveaxis(np.array([[response.real, -response.imag], [response.imag, response.real]]), 2, 0)
    return np.asarray(turn @ (relative[:, :, None] ** 2 * np.eye(2)) @ np.swapaxes(turn, 1, 2))


def points_of_response(response: Response, *, excitation: Excitation = "lever") -> tuple[ResponsePoints, ...]:
    """Return the points of an analysed recording, one group for each pretension, all repeats together.

    Torsion over measured drive, sensor chain undone (`sinew.analysis.sweep.response`). Groups are called "4 mm"; where
    the recording knows no pretension there is one group without a name.
    Raises RecordingError where no point has a measured drive.
    """
    columns = response.columns
    found = []
    for p, pretension in enumerate(response.pretension_mm):
        transfer = response.transfer[p]
        gain, gain_std = columns["gain_measured_drive"][p], columns["gain_measured_drive_std"][p]
        amplitude, angle_std = columns["drive_amplitude_rad"][p], columns["phase_std_rad"][p]
        frequency = np.broadcast_to(response.frequency_hz[:, None], transfer.shape)
        seen = np.isfinite(transfer) & np.isfinite(gain_std) & np.isfinite(angle_std) & (amplitude > 0)
        if not seen.any():
            continue
        h = transfer[seen]
        scatter = _turned(h, np.stack([gain_std[seen] / gain[seen], angle_std[seen]], axis=1))
        name = f"{pretension:g} mm" if np.isfinite(pretension) else ""
        found.append(
            make_points(
                frequency[seen],
                h,
                scatter,
                amplitude[seen],
                excitation=excitation,
                output_unit="rad",
                input_unit="rad",
                group=name,
                scatter_freedom=_FIVE_PERIODS,
            )
        )
    if not found:
        raise RecordingError("no steady point has a measured drive; record the lever's angle, or fit in time instead")
    return tuple(found)
