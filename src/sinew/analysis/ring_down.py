"""This is where a ring-down becomes frequency, damping and a verdict, with intervals."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import integrate

from sinew.analysis.decay_fit import DecayFit
from sinew.analysis.decay_shape import (
    SIGNIFICANCE,
    AmplitudeDependence,
    DecayShape,
    amplitude_dependence,
    bend_p_value,
    fit_bent,
    judge_shape,
    mean_poles,
)
from sinew.analysis.envelope import Envelope, fit_envelope, large_peaks
from sinew.analysis.free_decay import block_means, checked_record, evenly, free_decay
from sinew.analysis.peaks import Peaks, find_peaks
from sinew.measure.doors import as_dataset
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate
from sinew.measure.recording import Segment, iterate_segments
from sinew.measure.results import RESULT_VARIABLES, result_axis

__all__ = [
    "DECAY_FROM_PERIODS",
    "DECAY_WINDOWS",
    "RingDown",
    "analyse_ring_down",
    "analyse_ring_downs",
    "read_windows",
    "ring_down_json",
]

Array = NDArray[np.float64]

DECAY_FROM_PERIODS = 1.0
"""Drive periods after the stop from which a planned ring-down is taken for free. The paper does not say where its fit
begins, and its words fit a start at the stop as well; what other starts give stands in `DECAY_WINDOWS`."""

DECAY_WINDOWS = (0.0, 0.1, 0.5, 1.0, 1.5, 2.0)
"""Starts after the stop, in drive periods, from which the paper's method reads a planned ring-down beside."""


@dataclass(frozen=True)
class RingDown:
    """One analysed ring-down.

    frequency_hz: damped frequency ω_d/2π [Hz]; natural_frequency_hz: undamped, sqrt(ω_d² + λ²)/2π [Hz].
    damping_ratio: λ/sqrt(ω_d² + λ²); decay_rate_per_s: λ [1/s]; quality: 1/(2·damping_ratio).
    All by the direct time-domain fit. Of a decay that is not exponential, whose one sinusoid would fall out of step and
    take that for damping, the fit is the bent one (rate and frequency change linearly with time), λ and ω_d are its
    means over the window weighted by the amplitude, ∫ λ A dt / ∫ A dt, and the rest follows from these two. Where the
    same means of the peaks differ from them by more than noise, the difference is in the intervals.
    rest_drift: change of the rest position from start_s to stop_s, unit of the response (a rate's: of its bias).
    paper: the paper's method, Eq. 7-10 with the damped frequency as printed.
    shape: exponential or not; dependence: frequency and damping against amplitude.
    start_s, stop_s: the free decay that was used, in the time of the record.
    fit: the direct fit, bent where the decay is not exponential, for its curve.
    peak_time_s, peak_value: shape (h,), both-sided peaks about the rest position.
    unit: of the response; peak_unit: of peaks and amplitudes (of the angle where the response is a rate).
    """

    frequency_hz: Estimate
    natural_frequency_hz: Estimate
    damping_ratio: Estimate
    decay_rate_per_s: Estimate
    quality: Estimate
    rest_drift: Estimate
    paper: Envelope
    shape: DecayShape
    dependence: AmplitudeDependence
    start_s: float
    stop_s: float
    fit: DecayFit
    peak_time_s: Array
    peak_value: Array
    unit: str
    peak_unit: str


def analyse_ring_down(
    time_s: ArrayLike,
    response: ArrayLike,
    *,
    drive: ArrayLike | None = None,
    is_rate: bool = False,
    unit: str = "rad",
    inertia_kg_m2: float | None = None,
    free_from_s: float | None = None,
) -> RingDown:
    """Return what a record of a free decay says; the start of the decay is found, unless it is known.

    time_s: shape (n,), increasing [s]; response: shape (n,), in `unit`; drive: shape (n,), any unit, if measured.
    is_rate: the response is the rate of an angle or displacement (gyroscope). Its decay has the same poles and is
        fitted as it is; peaks and amplitudes are those of its integral.
    inertia_kg_m2: I, for the paper's d and k. free_from_s: time from which the decay is known to be free [s].

    The drive tells when it stopped; without it, the start is sought in the response. Window: six time constants. The
    direct fit's standard deviations hold for coloured noise; intervals are Student's with effective degrees of freedom.
    Raises RecordingError (TimeError for time stamps) where the record holds no ring-down that can be analysed.
    """
    t, x, lever, clock = evenly(*checked_record(time_s, response, drive))
    fit, t, x, peaks = free_decay(t, x, lever, free_from_s)
    if is_rate:
        peaks = find_peaks(t, _angle(t, x, fit))
    times, heights = _heights(peaks, fit, is_rate)
    bent = fit_bent(t, x, fit, times, np.abs(heights))
    rest = bent if bend_p_value(bent) < SIGNIFICANCE else fit
    times, heights = _heights(peaks, rest, is_rate)
    table = amplitude_dependence(times, heights, peaks.value_std)
    peak_unit = _integrated(unit) if is_rate else unit
    shape = judge_shape(bent, table, peak_unit)
    poles = np.array([fit.decay_rate_per_s, fit.omega_rad_s]), fit.pole_covariance()
    if not shape.exponential:
        fit, poles = bent, mean_poles(bent, times, np.abs(heights), peaks.value_std)
    return RingDown(
        **_estimates(*poles, fit.degrees_of_freedom, clock),
        rest_drift=Estimate.student(*rest.drift(), rest.degrees_of_freedom),
        paper=fit_envelope(times, np.abs(heights), inertia_kg_m2),
        shape=shape,
        dependence=table,
        start_s=fit.start_s,
        stop_s=fit.stop_s,
        fit=fit,
        peak_time_s=times,
        peak_value=heights,
        unit=unit,
        peak_unit=peak_unit,
    )


def _angle(t: Array, rate: Array, fit: DecayFit) -> Array:
    """Return the angle about its rest position, shape (n,): the rate less its bias, integrated, less its drift.

    The drift is that behind the start of the fit, where the record holds more.
    """
    angle = integrate.cumulative_trapezoid(rate - fit.rest(t), t, initial=0)
    wave = np.exp((1j * fit.omega_rad_s - fit.decay_rate_per_s) * (t - fit.start_s))
    basis = np.stack([wave.real, wave.imag, np.ones_like(t), t - fit.start_s], axis=1)
    free = t >= fit.start_s - 1e-9
    drift = np.linalg.lstsq(basis[free], angle[free], rcond=None)[0][2:]
    return np.asarray(angle - basis[:, 2:] @ drift, dtype=float)


def _heights(peaks: Peaks, fit: DecayFit, is_rate: bool) -> tuple[Array, Array]:
    """Return (times, heights about the rest position) of the peaks of the free decay."""
    rest = np.zeros(peaks.time_s.size) if is_rate else fit.rest(peaks.time_s)
    times, heights = large_peaks(peaks, rest)
    if times.size < 3:
        raise RecordingError(
            f"ring-down too short: {times.size} peaks of the free decay stand out of the noise, at least 3 are needed; "
            "start from a larger amplitude or record longer"
        )
    return times, heights


def _estimates(poles: Array, covariance: Array, freedom: float, clock_std: float) -> dict[str, Estimate]:
    """Return the estimates that follow from (λ, ω); clock_std: relative, of the time scale, which D does not feel."""
    rate, omega = (float(pole) for pole in poles)
    covariance = covariance + clock_std**2 * np.outer(poles, poles)
    natural = float(np.hypot(rate, omega))
    damping = rate / natural

    def estimate(value: float, by_rate: float, by_omega: float) -> Estimate:
        gradient = np.array([by_rate, by_omega])
        variance = max(float(gradient @ covariance @ gradient), 0.0)  # D of a perfect fit: round-off around zero
        return Estimate.student(value, float(np.sqrt(variance)), freedom)

    turn = 1.0 / (2.0 * np.pi)
    ratio = estimate(damping, omega**2 / natural**3, -rate * omega / natural**3)
    quality = Estimate(
        0.5 / damping, 0.5 * ratio.std / damping**2, 0.5 / ratio.high, 0.5 / ratio.low if ratio.low > 0 else np.inf
    )
    return {
        "frequency_hz": estimate(omega * turn, 0.0, turn),
        "natural_frequency_hz": estimate(natural * turn, rate / natural * turn, omega / natural * turn),
        "damping_ratio": ratio,
        "decay_rate_per_s": estimate(rate, 1.0, 0.0),
        "quality": quality,
    }


def _integrated(unit: str) -> str:
    return unit.removesuffix("/s") if unit.endswith("/s") else f"{unit} s"


def ring_down_json(result: RingDown) -> dict[str, Any]:
    """Return the document of `sinew analyse --kind ring-down`, of plain numbers, lists and texts.

    Amplitudes are in `peak_unit`, `rest_drift` in `unit`. `omega_rad_s` and `lehr_damping` of the paper's method use
    the damped frequency, as Eq. 7 does; `damping_ratio` is by the undamped one.
    """
    table = result.dependence
    return {
        "kind": "ring-down",
        "frequency_hz": result.frequency_hz.to_json(),
        "damping_ratio": result.damping_ratio.to_json(),
        "decay_rate_per_s": result.decay_rate_per_s.to_json(),
        "paper_method": {
            "decay_rate_per_s": result.paper.decay_rate_per_s,
            "omega_rad_s": result.paper.omega_rad_s,
            "lehr_damping": result.paper.lehr_damping,
        },
        "exponential": result.shape.exponential,
        "reason": result.shape.reason,
        "rest_drift": result.rest_drift.value,
        "amplitude_dependence": {
            "amplitude": table.amplitude.tolist(),
            "frequency_hz": table.frequency_hz.tolist(),
            "damping_ratio": table.damping_ratio.tolist(),
        },
    }


def analyse_ring_downs(recording: xr.Dataset, inertia_kg_m2: float | None = None) -> xr.Dataset:
    """Return the ring-down part of the results: the variables of the result schema over (pretension, repeat).

    inertia_kg_m2: I of head and lever, for the paper's d and k; NaN without it.

    The response is torsion_rad, else the x axis of the gyroscope (a rate), else response. Behind a settle segment of
    the same group the drive was told to stop where the ring-down begins, so nothing is sought: the first drive period,
    in which the lever settles on its servo, is left out. A start that depended on how far the lever recoils would jump
    with pretension and take Lehr's damping with it. A ring-down that cannot be analysed is NaN, and the attribute
    `ring_down_notes` says why.
    Raises RecordingError where there is no ring-down, or none can be analysed.
    """
    as_dataset(recording, "recording")
    found: list[tuple[Segment, RingDown, float]] = []
    windows: list[tuple[Segment, list[Envelope | None]]] = []
    notes: list[str] = []
    segments = list(iterate_segments(recording))
    asked = [segment for _, segment, _ in segments if segment.kind == "ring-down"]
    if not asked:
        raise RecordingError("recording has no ring-down segment; expected at least one")
    for index, segment, where in segments:
        if segment.kind != "ring-down":
            continue
        try:
            result, read = _analyse_segment(recording, segments, index, where, inertia_kg_m2)
            found.append((segment, result, float(recording["time_s"].values[where.start])))
            if read:
                windows.append((segment, read))
        except RecordingError as error:
            notes.append(f"ring-down {segment.repeat} at {segment.pretension_mm:g} mm: {error}")
    if not found:
        raise RecordingError(notes[0])
    pretension = np.unique([segment.pretension_mm for segment in asked])
    shape = pretension.size, max(segment.repeat for segment in asked) + 1
    columns = {name: np.full(shape, np.nan) for name in _numbers(*found[0][1:])}
    for segment, result, begins_s in found:
        place = int(np.searchsorted(pretension, segment.pretension_mm)), segment.repeat
        for name, value in _numbers(result, begins_s).items():
            columns[name][place] = value
    rows = {name: RESULT_VARIABLES[name] for name in columns}
    units = {name: found[0][1].unit if row.unit == "*" else row.unit for name, row in rows.items()}
    dataset = xr.Dataset(
        {
            name: (row.dims, columns[name], {"units": units[name], "long_name": row.meaning})
            for name, row in rows.items()
        },
        {
            "pretension_mm": result_axis("pretension_mm", pretension),
            "repeat": result_axis("repeat", np.arange(1, shape[1] + 1)),
        },
        attrs={"ring_down_notes": "; ".join(notes)},
    )
    return dataset.assign(_window_columns(windows, pretension, shape))


def _window_columns(
    windows: list[tuple[Segment, list[Envelope | None]]], pretension: Array, shape: tuple[int, int]
) -> dict[str, Any]:
    """Return the variables over (pretension, repeat, window) of the result schema; none without planned ring-downs."""
    if not windows:
        return {}
    columns = {name: np.full((*shape, len(DECAY_WINDOWS)), np.nan) for name in _WINDOW_NUMBERS}
    for segment, read in windows:
        place = int(np.searchsorted(pretension, segment.pretension_mm)), segment.repeat
        for name, number in _WINDOW_NUMBERS.items():
            columns[name][place] = [np.nan if one is None else number(one) for one in read]
    rows = {name: RESULT_VARIABLES[name] for name in columns}
    return {
        "window_start_periods": result_axis("window_start_periods", np.array(DECAY_WINDOWS)),
        **{
            name: (rows[name].dims, values, {"units": rows[name].unit, "long_name": rows[name].meaning})
            for name, values in columns.items()
        },
    }


_WINDOW_NUMBERS: dict[str, Callable[[Envelope], float]] = {
    "window_decay_rate_per_s": lambda one: one.decay_rate_per_s,
    "window_omega_rad_s": lambda one: one.omega_rad_s,
    "window_lehr_damping": lambda one: one.lehr_damping,
}


def _analyse_segment(
    recording: xr.Dataset,
    segments: list[tuple[int, Segment, slice]],
    index: int,
    where: slice,
    inertia_kg_m2: float | None,
) -> tuple[RingDown, list[Envelope | None]]:
    """Return the ring-down, and beside it what each of `DECAY_WINDOWS` says where the stop of the drive is known."""
    name = next(name for name in ("torsion_rad", "gyro_rad_s", "response") if name in recording)
    lever = next((name for name in ("drive_rad", "drive") if name in recording), None)
    time = recording["time_s"].values
    free_from = None
    if index > 0:
        before, here = segments[index - 1], segments[index][1]
        same = (before[1].pretension_mm, before[1].frequency_hz, before[1].repeat) == (
            here.pretension_mm,
            here.frequency_hz,
            here.repeat,
        )
        if before[1].kind == "settle" and same:
            free_from = float(time[where.start]) + DECAY_FROM_PERIODS / here.frequency_hz
    values = recording[name].values[where]
    values = values[:, 0] if values.ndim == 2 else values
    unit = str(recording[name].attrs["units"])
    result = analyse_ring_down(
        time[where],
        values,
        drive=None if lever is None else recording[lever].values[where],
        is_rate=unit == "rad/s",
        unit=unit,
        inertia_kg_m2=inertia_kg_m2,
        free_from_s=free_from,
    )
    if free_from is None:
        return result, []
    return result, read_windows(time[where], values, result, 1.0 / segments[index][1].frequency_hz)


def read_windows(time_s: ArrayLike, response: ArrayLike, result: RingDown, period_s: float) -> list[Envelope | None]:
    """Return what the paper's method says of a planned ring-down from each of `DECAY_WINDOWS` on, None without peaks.

    time_s, response: shape (n,), from the stop of the drive on, as `analyse_ring_down` took them; result: of it.
    period_s: of the drive [s].

    The peaks are those of one record from the stop on, about the rest position that the result found behind its own
    start; a later start leaves the earlier peaks out and changes nothing else. At `DECAY_FROM_PERIODS` it is the
    result's own.
    """
    t, x, _, _ = evenly(*checked_record(time_s, response, None))
    stop = float(t[0])
    is_rate = result.unit != result.peak_unit
    t, x = block_means(t, x, np.pi / result.fit.omega_rad_s)
    t, x = t[t <= result.stop_s], x[t <= result.stop_s]
    peaks = find_peaks(t, _angle(t, x, result.fit) if is_rate else x)
    margin = 0.05 * np.pi / result.fit.omega_rad_s
    read: list[Envelope | None] = []
    for start in DECAY_WINDOWS:
        if start == DECAY_FROM_PERIODS:
            read.append(result.paper)
            continue
        late = peaks.between(stop + start * period_s - margin, float(t[-1]))
        try:
            times, heights = _heights(late, result.fit, is_rate)
        except RecordingError:
            read.append(None)
            continue
        read.append(fit_envelope(times, np.abs(heights)))
    return read


def _numbers(result: RingDown, begins_s: float) -> dict[str, float]:
    paper = result.paper
    return {
        "paper_decay_rate_per_s": paper.decay_rate_per_s,
        "paper_omega_rad_s": paper.omega_rad_s,
        "paper_lehr_damping": paper.lehr_damping,
        "paper_quality": paper.quality,
        "paper_damping_n_m_s_rad": paper.damping_n_m_s_rad,
        "paper_stiffness_n_m_rad": paper.stiffness_n_m_rad,
        "decay_start_s": result.start_s - begins_s,
        "decay_rate_per_s": result.decay_rate_per_s.value,
        "decay_rate_std_per_s": result.decay_rate_per_s.std,
        "decay_frequency_hz": result.frequency_hz.value,
        "decay_frequency_std_hz": result.frequency_hz.std,
        "damping_ratio": result.damping_ratio.value,
        "damping_ratio_std": result.damping_ratio.std,
        "rest_drift": result.rest_drift.value,
        "exponential": float(result.shape.exponential),
    }
