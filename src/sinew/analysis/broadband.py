"""This is where a broadband record becomes a frequency response with its random errors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sinew.analysis.spectra import Segmentation, Spectra, average_spectra
from sinew.measure.errors import RecordingError

__all__ = ["FrequencyResponse", "estimate_frequency_response", "response_of_spectra"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_SEGMENTS = 16  # without overlap, where the caller names no length
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

    frequency_hz: Floats
    h1: Complexes
    h2: Complexes
    coherence: Floats
    relative_std: Floats
    phase_std_rad: Floats
    coherence_std: Floats
    averages: float
    bin_correlation: Floats
    lag_window: Floats
    spectra: Spectra

    def between(self, low_hz: float, high_hz: float) -> NDArray[np.bool_]:
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
        std.copy(),
        np.sqrt(2.0 * coherence / averages) * (1.0 - coherence),
        averages,
        spectra.cut.neighbours(spectra.segments),
        spectra.cut.lag_window(2.0 * float(spectra.frequency_hz[1]) * (spectra.cut.length / 2)),
        spectra,
    )


def estimate_frequency_response(
    input_values: ArrayLike,
    output_values: ArrayLike,
    sample_hz: float,
    *,
    segment_s: float | None = None,
    overlap: float = 0.5,
    window: str = "hann",
) -> FrequencyResponse:
    """Return the frequency response between two records of shape (n,), evenly sampled at sample_hz.

    segment_s: length of a segment [s], the resolution is its inverse; a sixteenth of the record where None.
    overlap: share of a segment that the next one repeats, 0 <= overlap < 1. window: as in `scipy.signal.get_window`.
    Raises RecordingError as `average_spectra` does, ValueError for an overlap or a segment that cannot be.
    """
    if not 0 <= overlap < 1:
        raise ValueError(f"overlap is {overlap:g}; expected 0 <= overlap < 1")
    size = np.shape(input_values)[0] if np.ndim(input_values) else 0
    length = size // _SEGMENTS if segment_s is None else round(segment_s * sample_hz)
    if length < 8:
        raise RecordingError(f"{size} samples and segments of {length} are too short; expected segments of at least 8")
    cut = Segmentation(length, max(1, round(length * (1.0 - overlap))), window)
    return response_of_spectra(average_spectra(input_values, output_values, sample_hz, cut))
