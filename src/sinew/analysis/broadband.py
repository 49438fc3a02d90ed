"""A broadband recording: its frequency response, the band in which drive and response cohere, and the modes there."""

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sinew.analysis.decay.free_decay import evenly
from sinew.analysis.poles import PoleFit, fit_poles
from sinew.analysis.results import BroadbandResult, Line, SpectrumResult
from sinew.analysis.signal.signals import drive_channel, response_channel
from sinew.measure.arrays import Array, Complexes, Mask, wrapped_lag
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate, finite
from sinew.measure.recording import segment_slices
from sinew.measure.result import Rows

# Averaged power and cross spectra of two long records, in one pass over memory, and the frequency response in them.

_BATCH = 16  # segments transformed at once
_SHORT_LAG = 0.3  # of a segment
_ROUND_OFF = 1e-14  # of a mean: what a constant leaves behind when it is taken off


@dataclass(frozen=True)
class Segmentation:
    """How a record is cut: `length` samples a segment, a new one every `hop` samples, under a window.

    window: a name that `scipy.signal.get_window` knows. The mean of each segment is taken off first.
    Raises ValueError where length < 8 or not 1 <= hop <= length.
    """

    length: int
    hop: int
    window: str = "hann"

    def __post_init__(self) -> None:
        if self.length < 8 or not 1 <= self.hop <= self.length:
            raise ValueError(
                f"segments of {self.length} samples every {self.hop}: expected at least 8, and a hop of 1 to the length"
            )

    def weights(self) -> Array:
        """Return the window, shape (length,)."""
        return np.asarray(scipy.signal.get_window(self.window, self.length), dtype=float)

    def count(self, size: int) -> int:
        """Return how many whole segments `size` samples hold."""
        return 0 if size < self.length else (size - self.length) // self.hop + 1

    def independent(self, segments: int) -> float:
        """Return the number of independent averages that so many overlapping segments are worth (Welch, 1967).

        n / (1 + 2 Σ (1 - k/n) ρ²(k)), ρ(k) the correlation of the window with itself moved by k hops.
        """
        return segments / float(self._lags(segments)[:, 0].sum())

    def neighbours(self, segments: int) -> Array:
        """Return how the random errors of bins 0, 1, 2, ... apart are correlated, starting with 1, shape (k,).

        The window smears noise over neighbouring bins: 4/9 and 1/36 for one Hann window. Bins below 1e-4 are left out.
        """
        lags = self._lags(segments).sum(axis=0)
        correlation = lags / lags[0]
        far = np.flatnonzero(correlation > 1e-4)
        return np.asarray(correlation[: int(far[-1]) + 1])

    def lag_window(self, sample_hz: float) -> Array:
        """Return α of A(τ) = Σ α_k τᵏ, k = 0 to 4, the autocorrelation of the window at short lags [s], shape (5,).

        A segment sees the impulse response h(τ) as h(τ) A(τ) in the mean, exactly so where the input is white.
        """
        w = self.weights()
        lags = np.fft.irfft(np.abs(np.fft.rfft(w, 2 * w.size)) ** 2)[: max(8, round(_SHORT_LAG * w.size))]
        tau = np.arange(lags.size) / w.size
        powers = np.linalg.lstsq(np.vander(tau, 5, increasing=True)[:, 1:], lags / lags[0] - 1.0, rcond=None)[0]
        return np.asarray(np.append(1.0, powers) * (sample_hz / w.size) ** np.arange(5), dtype=float)

    def _lags(self, segments: int) -> Array:
        """Return the share of each pair of segments in the variance, (hops both ways, bins apart 0 to 15)."""
        w = self.weights()
        rows = []
        for k in range(min((self.length - 1) // self.hop, segments - 1) + 1):
            product = w[k * self.hop :] * w[: w.size - k * self.hop]
            spread = np.abs(np.fft.rfft(product, self.length)[:16] / float(w @ w)) ** 2
            rows.append((1.0 if k == 0 else 2.0) * (1.0 - k / segments) * spread)
        return np.stack(rows)


@dataclass(frozen=True)
class Spectra:
    """Averaged one-sided spectral densities of an input and an output, shape (f,) each.

    input_power, output_power: [unit²/Hz]; cross_power: conj(input)·output, so that cross/input is the response.
    A record that never moves has exactly no power.
    segments: how many were averaged, overlapping as `cut` says.
    """

    frequency_hz: Array
    input_power: Array
    output_power: Array
    cross_power: Complexes
    segments: int
    cut: Segmentation


def average_pieces(pieces: Iterable[tuple[ArrayLike, ArrayLike]], sample_hz: float, cut: Segmentation) -> Spectra:
    """Return the averaged spectra of a record in memory (or mapped into it) with gaps; no segment reaches across one.

    pieces: (input, output) between gaps, equal shapes (n,); what is shorter than a segment does not count. Any may be
    float32; transforms and sums are in double precision. A few segments are held at a time, so memory beyond the
    records stays below some megabytes at 4096 samples a segment.
    Raises RecordingError where shapes differ, a value is not finite or fewer than two segments fit.
    """
    window, count, bins = cut.weights(), 0, cut.length // 2 + 1
    squares, cross, level = np.zeros((2, 2 * bins)), np.zeros(bins, dtype=complex), np.zeros(2)
    for piece in pieces:
        pair = [_column(one) for one in piece]
        if pair[0].shape != pair[1].shape:
            raise RecordingError(
                f"input has shape {pair[0].shape} and output {pair[1].shape}; expected one column of equal length each"
            )
        if pair[0].size < cut.length:
            continue
        views = [np.lib.stride_tricks.sliding_window_view(one, cut.length)[:: cut.hop] for one in pair]
        for first in range(0, len(views[0]), _BATCH):
            waves: list[Complexes] = []
            for which, view in enumerate(views):
                segments = np.asarray(view[first : first + _BATCH], dtype=float)
                mean = np.einsum("ij->i", segments)[:, None] / cut.length
                level[which] = max(level[which], float(np.abs(mean).max()))
                waves.append(scipy.fft.rfft((segments - mean) * window, axis=1))
                both = waves[which].view(float)  # real and imaginary parts in turn
                squares[which] += np.einsum("ij,ij->j", both, both)
            cross += (waves[0].conj() * waves[1]).sum(axis=0)
            count += len(waves[0])
    if count < 2:
        raise RecordingError(
            f"the record holds {count} segments of {cut.length} samples; an average and its error need at least 2: "
            "choose shorter segments or record longer"
        )
    powers = squares[:, 0::2] + squares[:, 1::2]
    if not np.isfinite(powers).all():
        name = "input" if not np.isfinite(powers[0]).all() else "output"
        raise RecordingError(f"the {name} holds NaN or infinity; cut the record or mend it")
    powers[powers.max(axis=1) <= (_ROUND_OFF * level * cut.length) ** 2 * count] = 0.0  # a constant
    scale: Array = np.full(cross.size, 2.0 / (sample_hz * float(window @ window) * count))
    scale[0] *= 0.5
    if cut.length % 2 == 0:
        scale[-1] *= 0.5
    frequency = np.asarray(np.fft.rfftfreq(cut.length, 1.0 / sample_hz))
    return Spectra(frequency, powers[0] * scale, powers[1] * scale, np.asarray(cross * scale), count, cut)


def _column(values: ArrayLike) -> NDArray[Any]:
    column = np.asarray(values)
    if column.ndim != 1:
        raise RecordingError(f"a record has shape {column.shape}; expected one column")
    return column


# A broadband record becomes a frequency response with its random errors.

_STILL = 1e-24  # of the largest power: an input bin below it has no excitation


@dataclass(frozen=True)
class FrequencyResponse:
    """Output by input over frequency, shape (f,), with e^{+jωt}: a late output has a negative angle.

    h1: Sxy/Sxx, right where noise is in the output; h2: Syy/Syx, right where it is in the input. |h1| <= |h2|.
    coherence: γ² = |Sxy|²/(Sxx Syy). Bins without excitation are NaN.
    relative_std: of |H|, and of its angle [rad] (see `response_of_spectra`).
    coherence_std: of γ², likewise.
    averages: independent averages that the segments are worth; bin_correlation: of the random errors of bins 0, 1,
    2, ... apart, and lag_window: what segments do to the impulse response; a fit through many bins has to know both.
    spectra: what all this was computed from.
    """

    frequency_hz: Array
    h1: Complexes
    h2: Complexes
    coherence: Array
    relative_std: Array
    coherence_std: Array
    averages: float
    bin_correlation: Array
    lag_window: Array
    spectra: Spectra

    def between(self, low_hz: float, high_hz: float) -> Mask:
        """Return which bins lie in a band and were excited, shape (f,)."""
        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        return np.asarray(inside & np.isfinite(self.h1) & np.isfinite(self.relative_std))


def response_of_spectra(spectra: Spectra) -> FrequencyResponse:
    """Return H1, H2 and coherence of averaged spectra with their standard deviations.

    Bendat and Piersol (Random Data, 4th ed., 9.2): of |H| relative and of its angle in rad sqrt((1 - γ²)/(2 γ² n)), of
    γ² sqrt(2) (1 - γ²) γ/sqrt(n), with n the independent averages (`Segmentation.independent`) and γ² the true
    coherence. We divide by n - 1 in the first, for 1 - γ² is estimated from the same n segments and comes out (n - 1)/n
    too small. The bias of a resonance some bins wide is not in these errors; `sinew.analysis.poles` knows it.
    Raises RecordingError where the input is constant.
    """
    sxx, syy, sxy = spectra.input_power, spectra.output_power, spectra.cross_power
    strongest = float(sxx.max())
    if not strongest > 0:
        raise RecordingError(
            "the input is constant; a frequency response needs one that moves (is it the right column?)"
        )
    averages = spectra.cut.independent(spectra.segments)
    still = sxx <= _STILL * strongest
    with np.errstate(divide="ignore", invalid="ignore"):
        h1 = np.where(still, np.nan, sxy / sxx)
        h2 = np.where(still, np.nan, syy / np.conj(sxy))
        coherence = np.where(still, np.nan, np.minimum(np.abs(sxy) ** 2 / (sxx * syy), 1.0))
        std = np.sqrt((1.0 - coherence) / (2.0 * coherence * max(averages - 1.0, 0.5)))
    return FrequencyResponse(
        spectra.frequency_hz,
        h1,
        h2,
        coherence,
        std,
        np.sqrt(2.0 * coherence / averages) * (1.0 - coherence),
        averages,
        spectra.cut.neighbours(spectra.segments),
        spectra.cut.lag_window(2.0 * float(spectra.frequency_hz[1]) * (spectra.cut.length / 2)),
        spectra,
    )


# The record is cut into segments, periods or pieces, and its modes are sought where drive and response cohere.

MOST_MODES = 8
"""Modes that may be asked for at once."""

_SEGMENTS, _FEWEST = 16, 4  # of the record, without overlap; half as many as long as a mode is not resolved
_LONG = 4096  # samples of a segment, with which a longer record begins
_OVERLAP = 0.75  # squares of moved Hann windows add up to a constant, so that a chirp counts evenly at all frequencies
_FIRST_BIN = 2  # below, a segment's missing mean is seen through its window
_EXCITED = 1e-4  # of the largest power of the drive
_COHERENT = 0.5
_WIDTH = 3.0  # times the strongest frequency, up and down, if no band is named
_HOLE = 3  # incoherent bins that do not end the band: an antiresonance
_TRIED = 4  # modes, where no number is named
_STRONG = 10.0  # fall of Bayes' criterion that lets one more mode in
_EVEN = 0.02  # of a step: stamps so close to a straight line are even
_REPEATS = 0.95  # correlation of a drive with itself one period later, and any number of periods


def analyse_broadband(
    recording: xr.Dataset,
    *,
    band_hz: tuple[float, float] | None = None,
    modes: int | None = None,
    segment_s: float | None = None,
) -> BroadbandResult:
    """Return frequency response and modes of a recording whose drive holds many frequencies: chirp, noise, multisine.

    band_hz: where modes are sought; None for a third to three times the frequency of the largest coherent gain.
    modes: how many; None for as many as Bayes' criterion asks for, up to four, that stand apart from each other.
    segment_s: length of a segment [s]; None for a sixteenth of the record (of a long one less), up to a quarter where
    a mode is narrower than four lines. A drive that repeats itself is cut at its periods instead, and the first of them
    is left out: the response settles in it.

    Raises RecordingError where there is no drive, it stands still, or nothing coheres with it; SpecError for a band, a
    segment or a number of modes that cannot be.
    """
    check_options(band_hz, modes, segment_s)
    pieces, sample_hz, units, notes = even_pieces(recording)
    period = None if segment_s is not None or len(pieces) > 1 else repeats_every(pieces[0][0])
    if period is not None:
        every = period / sample_hz
        notes.append(f"the drive repeats itself every {every:.4g} s: averaged over its periods, without the first")
    share = _SEGMENTS
    while segment_s is None and sum(x.size for _, x in pieces) > 2 * share * _LONG:
        share *= 2
    while True:
        response = _estimate(pieces, sample_hz, segment_s, share, period)
        band = band_of_modes(response, _coherent(response)) if band_hz is None else band_hz
        fit, said = _fit(response, band, modes)
        enough = fit is not None and "bins wide" not in fit.message and (share <= _SEGMENTS or not fit.message)
        if enough or share <= _FEWEST or segment_s is not None or period is not None:
            break
        share //= 2
    refuse_empty(response, band)
    found = spectrum_result(recording, (*notes, *said), response, band, fit, units)
    return BroadbandResult(**vars(found), period_s=None if period is None else period / sample_hz)


def check_options(band_hz: tuple[float, float] | None, modes: int | None, segment_s: float | None) -> None:
    """Do nothing where band, number of modes and length of a segment can be; else raise SpecError."""
    if modes is not None:
        checked_count(modes)
    if band_hz is not None and not 0 < band_hz[0] < band_hz[1] < math.inf:
        raise SpecError(f"found a band from {band_hz[0]:g} to {band_hz[1]:g} Hz, expected 0 < its begin < its end")
    if segment_s is not None and not 0 < segment_s < math.inf:
        raise SpecError(f"found segments of {segment_s:g} s, expected a time above 0 s")


def checked_count(modes: int) -> int:
    """Return a number of modes unchanged. Raises SpecError where nobody can mean it."""
    if not 1 <= modes <= MOST_MODES:
        raise SpecError(f"found {modes} modes asked for, expected 1 to {MOST_MODES}")
    return modes


def spectrum_result(
    recording: xr.Dataset,
    notes: tuple[str, ...],
    response: FrequencyResponse,
    band: tuple[float, float],
    fit: PoleFit | None,
    units: tuple[str, str],
    last_hz: float = math.inf,
) -> SpectrumResult:
    """Return the answer of a record of many frequencies or of hammer blows, with the lines at which the drive has
    power, up to a frequency. units: of response and drive."""
    shown = np.flatnonzero(_excited(response) & (response.frequency_hz <= last_hz))
    f, h1 = response.frequency_hz[shown], response.h1[shown]
    inside = (f >= band[0]) & (f <= band[1])
    fitted = np.full(f.size, np.nan + 0j) if fit is None else np.where(inside, fit.response(f), np.nan)
    size, lag, fitted_lag = np.abs(h1), np.degrees(wrapped_lag(h1)), np.degrees(wrapped_lag(fitted))
    gain_std, lag_std = size * response.relative_std[shown], np.degrees(response.relative_std[shown])
    return SpectrumResult(
        recording=recording,
        notes=notes,
        response_unit=units[0],
        drive_unit=units[1],
        segment_s=1.0 / float(response.frequency_hz[1]),
        averages=response.averages,
        band_hz=band,
        modes=Rows(() if fit is None else fit.modes),
        covariance=np.zeros((0, 0)) if fit is None else fit.covariance,
        misfit=None if fit is None else finite(fit.misfit),
        frequency_response=Rows(
            Line(
                frequency_hz=float(f[k]),
                gain=Estimate.normal(size[k], gain_std[k]),
                phase_lag_deg=Estimate.normal(lag[k], lag_std[k]),
                gain_h2=finite(abs(response.h2[shown[k]])),
                coherence=finite(response.coherence[shown[k]]),
                fitted_gain=finite(abs(fitted[k])),
                fitted_phase_lag_deg=finite(fitted_lag[k]),
            )
            for k in range(f.size)
        ),
        fit=fit,
    )


def even_pieces(recording: xr.Dataset) -> tuple[list[tuple[Array, Array]], float, tuple[str, str], list[str]]:
    """Return (drive, response) between gaps on an even clock, its rate [Hz], their units, and what was done."""
    response, drive = response_channel(recording), drive_channel(recording)
    if drive is None:
        raise RecordingError("a broadband record needs the drive beside the response; name its column (drive)")
    slices, time = segment_slices(recording), np.asarray(recording["time_s"].values, dtype=float)
    steps = sum(where.stop - where.start - 1 for where in slices)
    step = sum(float(time[where.stop - 1] - time[where.start]) for where in slices) / steps
    pieces, straightened, interpolated = [], 0, 0
    for where in slices:
        t, x, u = time[where], response.values[where], drive.values[where]
        off = t - t[0] - step * np.arange(t.size)
        if np.ptp(off) > _EVEN * step:
            if evenly(t, x, None)[1] is x and np.ptp(off) < step:
                straightened += t.size
            else:
                even = np.arange(t[0], t[-1], step)
                x, u = (np.asarray(scipy.interpolate.CubicSpline(t, values)(even), dtype=float) for values in (x, u))
                interpolated += t.size
        pieces.append((u, x))
    notes = []
    if straightened:
        notes.append(f"{straightened} time stamps jitter where the sampling does not: taken as even")
    if interpolated:
        notes.append(f"{interpolated} samples at uneven times are interpolated by cubic splines")
    return pieces, 1.0 / step, (response.unit, drive.unit), notes


def repeats_every(drive: Array) -> int | None:
    """Return after how many samples a drive repeats itself, at least three times; None where it does not."""
    x = drive - drive.mean()
    size = x.size
    sums = np.cumsum(x**2)
    if not sums[-1] > 0:
        return None
    lags = scipy.fft.irfft(np.abs(scipy.fft.rfft(x, 2 * size)) ** 2)[:size]
    head, tail = sums[::-1], sums[-1] - np.concatenate([[0.0], sums[:-1]])
    with np.errstate(divide="ignore", invalid="ignore"):
        likeness = lags / np.sqrt(head * tail)
    fallen = np.flatnonzero(likeness < 0.5)
    low, high = (max(8, int(fallen[0])), size // 3) if fallen.size else (1, 0)
    for lag in np.flatnonzero(likeness[low : high + 1] >= _REPEATS) + low:
        multiples = np.arange(lag, size - lag // 2, lag)
        if likeness[multiples].min() >= _REPEATS and likeness[lag] >= likeness[max(1, lag - 1) : lag + 2].max():
            return int(lag)
    return None


def _estimate(
    pieces: list[tuple[Array, Array]], sample_hz: float, segment_s: float | None, share: int, period: int | None
) -> FrequencyResponse:
    total = sum(x.size for _, x in pieces)
    if period is not None:
        cut = Segmentation(period, period, "boxcar")
        settled = [(u[period:], x[period:]) for u, x in pieces]
        response = response_of_spectra(average_pieces(settled, sample_hz, cut))
        return replace(response, lag_window=np.eye(5)[0])  # a settled response is not smeared by its window
    length = min(total // share, max(x.size for _, x in pieces) // 2)
    length = length if segment_s is None else round(segment_s * sample_hz)
    if length < 8:
        raise RecordingError(
            f"{total} samples and segments of {length} are too short; expected segments of at least 8: record longer, "
            "or choose longer segments"
        )
    cut = Segmentation(length, max(1, round(length * (1.0 - _OVERLAP))))
    return response_of_spectra(average_pieces(pieces, sample_hz, cut))


def _excited(response: FrequencyResponse) -> Mask:
    """Return at which lines the drive has power and the response is known, shape (f,)."""
    power = response.spectra.input_power
    excited = power >= _EXCITED * power[_FIRST_BIN:].max()
    excited[:_FIRST_BIN] = False
    return np.asarray(excited & np.isfinite(response.h1) & np.isfinite(response.relative_std))


def lines_in(response: FrequencyResponse, band: tuple[float, float]) -> Mask:
    """Return which lines of a band the drive excites, shape (f,)."""
    f = response.frequency_hz
    return np.asarray(_excited(response) & (f >= band[0]) & (f <= band[1]))


def refuse_empty(response: FrequencyResponse, band: tuple[float, float]) -> None:
    """Raise RecordingError where the drive excites no line of a band, or nothing answers it at any."""
    if not lines_in(response, band).any():
        f = response.frequency_hz[_excited(response)]
        if not f.size:
            raise RecordingError(
                "the response answers the drive at no frequency; does it move, and are these the right columns?"
            )
        raise RecordingError(
            f"the drive excites nothing from {band[0]:g} to {band[1]:g} Hz; choose a band between {f[0]:.4g} and "
            f"{f[-1]:.4g} Hz"
        )


def _coherent(response: FrequencyResponse) -> Mask:
    """Return at which lines the response is due to the drive, shape (f,)."""
    chance = 1.0 - 0.01 ** (1.0 / max(response.averages - 1.0, 1.0))
    return np.asarray(response.coherence >= max(_COHERENT, chance))


def band_of_modes(response: FrequencyResponse, heard: Mask, hole: int = _HOLE) -> tuple[float, float]:
    """Return the band about the largest gain of a line that is heard, as its neighbours are.

    heard: shape (f,), where the response is due to the drive and not to noise. hole: lines in a row that may be unheard
    inside the band.
    Raises RecordingError where nothing is heard.
    """
    f, excited = response.frequency_hz, _excited(response)
    lines = np.flatnonzero(excited)
    coherent = heard[lines]
    if coherent.sum() < 3:
        raise RecordingError(
            "nothing in the response coheres with the drive; are these the right columns, and is the drive strong "
            "enough against the noise?"
        )
    sure = np.convolve(coherent, np.ones(3), "same") >= 2
    top = int(np.argmax(np.where(coherent & sure, np.abs(response.h1[lines]), 0.0)))
    ends = []
    for step in (-1, 1):
        end = k = top
        while 0 <= k < lines.size and abs(k - end) <= hole and 1 / _WIDTH <= f[lines[k]] / f[lines[top]] <= _WIDTH:
            end = k if coherent[k] else end
            k += step
        ends.append(float(f[lines[end]]))
    return ends[0], ends[1]


def fit_poles_of(response: FrequencyResponse, low_hz: float, high_hz: float, *, modes: int = 1) -> PoleFit:
    """Return the modes of H1 of a broadband record in a band, with its random errors; raises as `fit_poles`."""
    inside = response.between(low_hz, high_hz)
    return fit_poles(
        response.frequency_hz[inside],
        response.h1[inside],
        response.relative_std[inside],
        modes=modes,
        bin_correlation=response.bin_correlation,
        lag_window=response.lag_window,
    )


def _fit(
    response: FrequencyResponse, band: tuple[float, float], modes: int | None
) -> tuple[PoleFit | None, tuple[str, ...]]:
    """Return the modes of H1 in a band and what to beware of; none and the reason where there are none."""
    retained = lines_in(response, band)
    known = replace(response, h1=np.where(retained, response.h1, np.nan))
    alike = 1.0 + 2.0 * float(np.sum(response.bin_correlation[1:] ** 2))
    return choose_modes(
        lambda count: fit_poles_of(known, *band, modes=count), band, modes, int(np.count_nonzero(retained)), alike
    )


def choose_modes(
    fit_of: Callable[[int], PoleFit],
    band: tuple[float, float],
    modes: int | None,
    lines: int,
    alike: float,
    *,
    is_sure: bool = True,
) -> tuple[PoleFit | None, tuple[str, ...]]:
    """Return the fit of as many modes as Bayes' criterion asks for, and what to beware of; or none and the reason.

    fit_of: from a number of modes to their fit. modes: how many are asked for, None for up to four.
    lines: that are fitted; alike: how many of them share one error.
    is_sure: the stated errors are taken at their word; else they are what the best of the fits leaves, if that is more.
    """
    tried: list[PoleFit] = []
    reason = ""
    for count in range(1, _TRIED + 1) if modes is None else [modes]:
        try:
            tried.append(fit_of(count))
        except RecordingError as error:
            reason = reason or f"no modes: {error}"
    if not tried:
        return None, (reason,)
    scale = 1.0 if is_sure else max(1.0, min(fit.misfit for fit in tried))
    chosen = tried[0]
    for fit in tried[1:]:
        if len(fit.modes) > len(chosen.modes) + 2:
            break
        better = _criterion(fit, lines, alike, scale) < _criterion(chosen, lines, alike, scale) - _STRONG
        if better and _apart(fit, band):
            chosen = fit
    said = [chosen.message] if chosen.message else []
    if modes is not None and not _apart(chosen, band):
        said.append("a mode is not told from noise, or from another; ask for fewer modes, or another band")
    return chosen, tuple(said)


def _criterion(fit: PoleFit, lines: int, alike: float, scale: float) -> float:
    """Return Bayes' criterion of a fit, with the lines' errors as stated times a scale, counted for what they are."""
    count, free = 2.0 * lines, fit.parameters.size
    return ((fit.misfit / scale) ** 2 * (count - free) + free * math.log(count / alike) * alike) / alike


def _apart(fit: PoleFit, band: tuple[float, float]) -> bool:
    """Return whether all modes lie in the band, are sure of their damping, and no two are within their widths."""
    found = [(mode.natural_frequency_hz.value, mode.damping_ratio.value) for mode in fit.modes]
    sure = all(mode.damping_ratio.std < 0.25 * mode.damping_ratio.value for mode in fit.modes)
    inside = all(band[0] <= f <= band[1] for f, _ in found)
    wide = any(high - low < d * low + e * high for (low, d), (high, e) in itertools.pairwise(found))
    return sure and inside and not wide
