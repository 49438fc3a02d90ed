"""Averaged power and cross spectra of two long records, in one pass over memory, and the frequency response in them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sinew.measure.arrays import Array, Complexes, Mask
from sinew.measure.errors import RecordingError

Pair = tuple[NDArray[np.floating], NDArray[np.floating]]

_BATCH = 16  # segments transformed at once: at 4096 samples half a megabyte each way, which stays in the cache
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


class _Sum:
    """Running sums of |X|², |Y|² and conj(X)Y over segments, with the buffers they need."""

    def __init__(self, cut: Segmentation) -> None:
        bins = cut.length // 2 + 1
        self.cut, self.window, self.segments = cut, cut.weights(), 0
        self.powers = np.zeros((2, 2 * bins))  # squares of real and imaginary parts in turn
        self.cross = np.zeros(bins, dtype=complex)
        self.level = np.zeros(2)  # largest mean of a segment
        self._segment = np.empty((_BATCH, cut.length))
        self._product = np.empty((_BATCH, bins), dtype=complex)

    def add(self, pair: Pair) -> None:
        """Add every whole segment of two stretches of equal length."""
        views = [np.lib.stride_tricks.sliding_window_view(part, self.cut.length)[:: self.cut.hop] for part in pair]
        for first in range(0, len(views[0]), _BATCH):
            waves = [self._transform(view[first : first + _BATCH], which) for which, view in enumerate(views)]
            product = self._product[: len(waves[0])]
            np.conjugate(waves[0], out=product)
            np.multiply(product, waves[1], out=product)
            self.cross += product.sum(axis=0)
            self.segments += len(product)

    def _transform(self, segments: NDArray[np.floating], which: int) -> Complexes:
        level = np.einsum("ij->i", segments, dtype=float) / self.cut.length
        self.level[which] = max(self.level[which], float(np.abs(level).max()))
        windowed = self._segment[: len(segments)]
        np.subtract(segments, level[:, None], out=windowed)
        np.multiply(windowed, self.window, out=windowed)
        waves: Complexes = scipy.fft.rfft(windowed, axis=1)
        parts = waves.view(float)
        self.powers[which] += np.einsum("ij,ij->j", parts, parts)
        return waves

    def spectra(self, sample_hz: float) -> Spectra:
        """Return the averages; raises RecordingError where there were fewer than two segments, or NaN in them."""
        if self.segments < 2:
            raise RecordingError(
                f"the record holds {self.segments} segments of {self.cut.length} samples; an average and its error "
                "need at least 2: choose shorter segments or record longer"
            )
        powers = np.asarray(self.powers[:, 0::2] + self.powers[:, 1::2], dtype=float)
        if not np.isfinite(powers).all():
            name = "input" if not np.isfinite(powers[0]).all() else "output"
            raise RecordingError(f"the {name} holds NaN or infinity; cut the record or mend it")
        constant = powers.max(axis=1) <= (_ROUND_OFF * self.level * self.cut.length) ** 2 * self.segments
        powers[constant] = 0.0
        scale: Array = np.full(powers.shape[1], 2.0 / (sample_hz * float(self.window @ self.window) * self.segments))
        scale[0] *= 0.5
        if self.cut.length % 2 == 0:
            scale[-1] *= 0.5
        frequency = np.fft.rfftfreq(self.cut.length, 1.0 / sample_hz)
        density = np.asarray(powers * scale, dtype=float)
        cross = np.asarray(self.cross * scale, dtype=complex)
        return Spectra(np.asarray(frequency), density[0], density[1], cross, self.segments, self.cut)


def average_pieces(pieces: Iterable[tuple[ArrayLike, ArrayLike]], sample_hz: float, cut: Segmentation) -> Spectra:
    """Return the averaged spectra of a record in memory (or mapped into it) with gaps; no segment reaches across one.

    pieces: (input, output) between gaps, equal shapes (n,); what is shorter than a segment does not count. Any may be
    float32; transforms and sums are in double precision. A few segments are held at a time, so memory beyond the
    records stays below some megabytes at 4096 samples a segment.
    Raises RecordingError where shapes differ, a value is not finite or fewer than two segments fit.
    """
    running = _Sum(cut)
    for piece in pieces:
        pair = _columns(piece[0]), _columns(piece[1])
        if pair[0].shape != pair[1].shape:
            raise RecordingError(
                f"input has shape {pair[0].shape} and output {pair[1].shape}; expected one column of equal length each"
            )
        if pair[0].size >= cut.length:
            running.add(pair)
    return running.spectra(sample_hz)


def _columns(values: ArrayLike) -> NDArray[np.floating]:
    column = np.asarray(values)
    if column.ndim != 1:
        raise RecordingError(f"a record has shape {column.shape}; expected one column")
    return column if np.issubdtype(column.dtype, np.floating) else column.astype(float)


# A broadband record becomes a frequency response with its random errors.

_STILL = 1e-24  # of the largest power: an input bin below it has no excitation


@dataclass(frozen=True)
class FrequencyResponse:
    """Output by input over frequency, shape (f,), with e^{+jωt}: a late output has a negative angle.

    h1: Sxy/Sxx, right where noise is in the output; h2: Syy/Syx, right where it is in the input. |h1| <= |h2|.
    coherence: γ² = |Sxy|²/(Sxx Syy). Bins without excitation are NaN.
    relative_std: of |H|; phase_std_rad: of its angle (see `response_of_spectra`).
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
    phase_std_rad: Array
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
    too small. The bias of a resonance some bins wide is not in these errors; `sinew.analysis.broadband.poles`
    knows it.
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
        std.copy(),
        np.sqrt(2.0 * coherence / averages) * (1.0 - coherence),
        averages,
        spectra.cut.neighbours(spectra.segments),
        spectra.cut.lag_window(2.0 * float(spectra.frequency_hz[1]) * (spectra.cut.length / 2)),
        spectra,
    )
