"""Frequency responses of broadband records, against known transfer functions, scipy and repeated trials."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import signal
from tests.unit.broadband_signals import response_of

from sinew.analysis.broadband import (
    FrequencyResponse,
    Segmentation,
    average_pieces,
    response_of_spectra,
)
from sinew.measure.errors import RecordingError

SAMPLE_HZ = 200.0
RESONANCE = signal.iirpeak(20.0, 4.0, fs=SAMPLE_HZ)


def records(seed: int, size: int = 40_000, noise_in: float = 0.0, noise_out: float = 0.0):
    """Return (input, output) of a resonance at 20 Hz driven by white noise, measured with white noise."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(size + 1000)
    y = signal.lfilter(*RESONANCE, x)[1000:]
    x = x[1000:]
    return x + noise_in * rng.standard_normal(size), y + noise_out * rng.standard_normal(size)


def truth(frequency_hz):
    return signal.freqz(*RESONANCE, worN=frequency_hz, fs=SAMPLE_HZ)[1]


def near_resonance(response: FrequencyResponse):
    return response.between(14.0, 28.0)


@pytest.mark.parametrize("window", ["hann", "hamming", "blackman", "boxcar"])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.75])
@pytest.mark.parametrize("length", [500, 501])
def test_power_and_cross_spectra_are_those_of_scipy(window: str, share: float, length: int) -> None:
    x, y = records(0, size=5000, noise_out=0.1)
    overlap = int(length * share)
    kwargs = {"fs": SAMPLE_HZ, "nperseg": length, "noverlap": overlap, "window": window}
    ours = average_pieces([(x, y)], SAMPLE_HZ, Segmentation(length, length - overlap, window))
    np.testing.assert_allclose(ours.input_power, signal.welch(x, **kwargs)[1], rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(ours.cross_power, signal.csd(x, y, **kwargs)[1], rtol=1e-9, atol=1e-16)


def test_the_coherence_is_that_of_scipy() -> None:
    x, y = records(1, noise_out=0.3)
    ours = response_of(x, y, SAMPLE_HZ, segment_s=5.0)
    theirs = signal.coherence(x, y, fs=SAMPLE_HZ, nperseg=1000)[1]
    np.testing.assert_allclose(ours.coherence, theirs, rtol=1e-9)


def test_h1_is_the_known_transfer_function() -> None:
    ours = response_of(*records(3, size=400_000), SAMPLE_HZ, segment_s=20.0)
    here = near_resonance(ours)
    np.testing.assert_allclose(ours.h1[here], truth(ours.frequency_hz[here]), atol=0.01)


def test_an_output_that_is_late_has_a_falling_negative_angle() -> None:
    # pyFRF had this sign inverted for years.
    x = np.random.default_rng(4).standard_normal(20_000)
    ours = response_of(x[3:], x[:-3], SAMPLE_HZ, segment_s=5.0)
    low = (ours.frequency_hz > 1.0) & (ours.frequency_hz < 20.0)
    expected = -2.0 * np.pi * ours.frequency_hz[low] * 3 / SAMPLE_HZ
    np.testing.assert_allclose(np.angle(ours.h1[low]), expected, atol=0.02)


def test_noise_in_the_input_spoils_h1_and_spares_h2() -> None:
    ours = response_of(*records(5, size=400_000, noise_in=1.0), SAMPLE_HZ, segment_s=10.0)
    top = int(np.argmin(np.abs(ours.frequency_hz - 20.0)))
    assert (abs(ours.h1[top]), abs(ours.h2[top])) == pytest.approx((0.5, 1.0), abs=0.05)


def test_noise_in_the_output_spoils_h2_and_spares_h1() -> None:
    ours = response_of(*records(6, size=400_000, noise_out=1.0), SAMPLE_HZ, segment_s=10.0)
    top = int(np.argmin(np.abs(ours.frequency_hz - 20.0)))
    assert (abs(ours.h1[top]), abs(ours.h2[top])) == pytest.approx((1.0, 2.0), abs=0.15)


def test_no_segment_reaches_across_a_gap() -> None:
    # the response of a record with a gap is the mean over its pieces, each weighted by its segments
    x, y = records(7, size=9_000, noise_out=0.1)
    cut = Segmentation(512, 256)
    pieces = [(x[a:b], y[a:b]) for a, b in pairwise([0, 3000, 3100, 9000])]
    whole = average_pieces(pieces, SAMPLE_HZ, cut)
    first, last = (average_pieces([piece], SAMPLE_HZ, cut) for piece in (pieces[0], pieces[2]))
    mean = (first.segments * first.cross_power + last.segments * last.cross_power) / (first.segments + last.segments)
    assert whole.segments == first.segments + last.segments
    np.testing.assert_allclose(whole.cross_power, mean, rtol=1e-10)


def test_single_precision_records_give_the_response_of_double_precision() -> None:
    x, y = records(8, noise_out=0.1)
    double = response_of(x + 100.0, y, SAMPLE_HZ)
    single = response_of((x + 100.0).astype(np.float32), y.astype(np.float32), SAMPLE_HZ)
    assert np.abs(single.h1 / double.h1 - 1.0)[near_resonance(double)].max() < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(("overlap", "window"), [(0.0, "hann"), (0.5, "hann"), (0.75, "hann"), (0.5, "boxcar")])
def test_the_stated_errors_of_gain_and_phase_are_those_of_repeated_records(overlap: float, window: str) -> None:
    cut = {"segment_s": 4.0, "overlap": overlap, "window": window}
    results = [response_of(*records(s, 40_000, noise_out=0.5), SAMPLE_HZ, **cut) for s in range(200)]
    here = results[0].between(18.0, 22.0)
    h1 = np.array([result.h1[here] for result in results])
    off = h1 / h1.mean(axis=0) - 1.0
    stated = np.array([result.relative_std[here] for result in results])
    assert np.std(off.real) / np.sqrt(np.mean(stated**2)) == pytest.approx(1.0, abs=0.07)
    assert np.std(off.imag) / np.sqrt(np.mean(stated**2)) == pytest.approx(1.0, abs=0.07)


def test_the_stated_error_of_the_coherence_is_that_of_repeated_records() -> None:
    results = [response_of(*records(s, 20_000, noise_out=1.0), SAMPLE_HZ, segment_s=4.0) for s in range(150)]
    here = results[0].between(19.0, 21.0)
    scatter = np.array([result.coherence[here] for result in results]).std(axis=0)
    stated = np.array([result.coherence_std[here] for result in results]).mean(axis=0)
    assert np.mean(scatter / stated) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("share", [0.5, 0.75])
def test_errors_of_neighbouring_bins_are_correlated_as_stated(share: float) -> None:
    cut = Segmentation(400, 400 - int(400 * share))
    rng = np.random.default_rng(9)
    errors = []
    for _ in range(200):
        x, noise = rng.standard_normal((2, 8_000))
        errors.append(response_of_spectra(average_pieces([(x, noise)], SAMPLE_HZ, cut)).h1[20:180])
    e = np.array(errors)
    found = [np.mean(e[:, : e.shape[1] - k] * np.conj(e[:, k:])).real / np.mean(np.abs(e) ** 2) for k in range(3)]
    stated = cut.neighbours(cut.count(8_000))
    assert found == pytest.approx(stated[:3], abs=0.03)


def test_two_hann_segments_that_overlap_by_half_are_averages_with_a_correlation_of_1_36() -> None:
    # Welch (1967): ρ = 1/6 of the windows, ρ² of the powers; var = (1 + ρ²)/2
    assert Segmentation(4000, 2000).independent(2) == pytest.approx(2 / (1 + 1 / 36), rel=1e-6)


@pytest.mark.parametrize(("which", "name"), [(0, "input"), (1, "output")])
def test_a_value_that_is_not_finite_is_named(which: int, name: str) -> None:
    pair = records(10, size=4000)
    pair[which][1234] = np.nan
    with pytest.raises(RecordingError, match=f"the {name} holds NaN"):
        response_of(*pair, SAMPLE_HZ)


@pytest.mark.parametrize("level", [0.0, 2.5, 0.1, -1e6 / 3])
def test_a_constant_input_is_refused(level: float) -> None:
    with pytest.raises(RecordingError, match="input is constant"):
        response_of(np.full(4000, level), records(11, size=4000)[1], SAMPLE_HZ)


def test_an_input_without_power_in_a_band_leaves_its_bins_undefined() -> None:
    t = np.arange(4000) / SAMPLE_HZ
    x = np.sin(2 * np.pi * 10.0 * t)
    ours = response_of(x, x, SAMPLE_HZ, segment_s=5.0)
    assert np.isnan(ours.h1[np.abs(ours.frequency_hz - 60.0) < 1.0]).all()
