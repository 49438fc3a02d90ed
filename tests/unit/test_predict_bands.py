"""Bands of curves: quantiles of a known distribution, sweeps up and down, marked points with intervals."""

import numpy as np
import pytest
from scipy.stats import norm

from sinew.predict.band import band_of, crest
from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
from sinew.solve.branch import Branch, sweep
from sinew.solve.curves import predict
from sinew.solve.programs import configure

configure()
INERTIA, NATURAL_HZ, DAMPING, TORQUE, CUBIC = 12.74e-3, 3.0, 0.05, 0.45, 6.0
BAND_HZ = (1.5, 5.5)
STD_HZ, DRAWS = 0.05, 200
AT_HZ = np.array([2.0, 2.6, 3.5, 4.5])


def oscillator(**changed: float) -> Oscillator:
    values = {"inertia": INERTIA, "frequency_hz": NATURAL_HZ, "damping_ratio": DAMPING, "torque": TORQUE}
    return Oscillator(**(values | changed))


def curves(oscillators: list[Oscillator]) -> tuple[Branch, ...]:
    return predict(oscillator_problem(oscillators, BAND_HZ), BAND_HZ, resolution_of(oscillators)).branches


def linear_amplitude(frequency_hz: np.ndarray, natural_hz: np.ndarray) -> np.ndarray:
    """Return M/|k - I Ω² + j d Ω| of the oscillator with a damping ratio that stays."""
    omega, natural = 2 * np.pi * frequency_hz, 2 * np.pi * natural_hz
    return TORQUE / INERTIA / np.abs(natural**2 - omega**2 + 2j * DAMPING * natural * omega)


@pytest.fixture(scope="module")
def linear() -> tuple[Branch, list[Branch]]:
    """The nominal curve, and curves whose natural frequency is normal: evenly spread quantiles, nothing random."""
    natural = norm.ppf((np.arange(DRAWS) + 0.5) / DRAWS, NATURAL_HZ, STD_HZ)
    nominal, *drawn = curves([oscillator(), *(oscillator(frequency_hz=float(f)) for f in natural)])
    return nominal, drawn


@pytest.fixture(scope="module")
def hardening() -> Branch:
    return curves([oscillator(cubic=CUBIC)])[0]


def test_a_band_of_a_linear_oscillator_has_the_quantiles_of_the_closed_form(
    linear: tuple[Branch, list[Branch]],
) -> None:
    band = band_of(linear[0], linear[0], linear[1], AT_HZ)
    # The amplitude at these frequencies rises or falls with the natural frequency all through the draws.
    ends = linear_amplitude(AT_HZ, np.asarray(norm.ppf([[0.05], [0.95]], NATURAL_HZ, STD_HZ)))
    amplitude = band.up[0]
    assert amplitude.low == pytest.approx(ends.min(axis=0), rel=2e-3)
    assert amplitude.high == pytest.approx(ends.max(axis=0), rel=2e-3)
    assert amplitude.median == pytest.approx(linear_amplitude(AT_HZ, np.array(NATURAL_HZ)), rel=2e-3)
    phase = band.up[1]
    natural = norm.ppf([[0.95], [0.05]], NATURAL_HZ, STD_HZ)
    lag = np.arctan2(2 * DAMPING * natural * AT_HZ, natural**2 - AT_HZ**2)
    assert phase.low == pytest.approx(lag[0], abs=1e-3)
    assert phase.high == pytest.approx(lag[1], abs=1e-3)


def test_the_intervals_of_the_90_degree_point_and_of_the_peak_are_those_of_the_closed_form(
    linear: tuple[Branch, list[Branch]],
) -> None:
    band = band_of(linear[0], linear[0], linear[1])
    found = band.phase_90
    assert found is not None
    assert found.draws == DRAWS
    assert found.frequency_hz.value == pytest.approx(NATURAL_HZ, rel=1e-9)
    assert found.frequency_hz.low == pytest.approx(NATURAL_HZ - 1.645 * STD_HZ, abs=0.01 * STD_HZ)
    assert found.frequency_hz.std == pytest.approx(STD_HZ, rel=0.01)
    found = band.peak
    assert found is not None
    share = np.sqrt(1 - 2 * DAMPING**2)
    assert found.frequency_hz.high == pytest.approx(share * (NATURAL_HZ + 1.645 * STD_HZ), abs=0.02 * STD_HZ)
    high = TORQUE / INERTIA / (2 * np.pi * (NATURAL_HZ - 1.645 * STD_HZ)) ** 2 / (2 * DAMPING * np.sqrt(1 - DAMPING**2))
    assert found.amplitude.high == pytest.approx(high, rel=1e-3)


def test_without_folds_a_sweep_down_meets_what_a_sweep_up_does(linear: tuple[Branch, list[Branch]]) -> None:
    up, down = (sweep(linear[0], AT_HZ, direction) for direction in ("up", "down"))
    assert up.amplitude == pytest.approx(down.amplitude, rel=1e-9)
    assert up.amplitude == pytest.approx(linear_amplitude(AT_HZ, np.array(NATURAL_HZ)), rel=1e-4)


def harmonic_roots(frequency_hz: float) -> np.ndarray:
    """Return the amplitudes of a Duffing oscillator with one harmonic: ((k - IΩ² + ¾ k₃ A²)² + (dΩ)²) A² = M²."""
    omega, k = 2 * np.pi * frequency_hz, INERTIA * (2 * np.pi * NATURAL_HZ) ** 2
    stiff, cubic, lossy = k - INERTIA * omega**2, 0.75 * CUBIC, 2 * DAMPING * np.sqrt(k * INERTIA) * omega
    squares = np.roots([cubic**2, 2 * cubic * stiff, stiff**2 + lossy**2, -(TORQUE**2)])
    return np.sort(np.sqrt(squares[np.abs(squares.imag) < 1e-9].real))


def test_between_the_folds_a_sweep_up_meets_the_large_and_a_sweep_down_the_small_motion(hardening: Branch) -> None:
    at = np.array([3.55, 3.65, 3.75])
    up, down = (sweep(hardening, at, direction).amplitude for direction in ("up", "down"))
    three = np.array([harmonic_roots(float(f)) for f in at])
    assert three.shape == (3, 3)
    # Half of peak to peak has the third harmonic in it, which is one per cent here.
    assert up == pytest.approx(three[:, 2], rel=0.02)
    assert down == pytest.approx(three[:, 0], rel=0.02)


def test_a_fold_has_an_interval_from_the_draws_that_have_as_many() -> None:
    cubics = np.linspace(5.5, 6.5, 9)
    nominal, soft, *drawn = curves([oscillator(cubic=float(c)) for c in (CUBIC, 0.1, *cubics)])
    band = band_of(nominal, nominal, [soft, *drawn])
    assert (band.draws, band.folded, len(band.folds)) == (10, 9, 2)
    for fold, index in zip(band.folds, (0, 1), strict=True):
        there = [branch.folds[index].frequency_hz for branch in drawn]
        assert fold.draws == 9
        assert fold.frequency_hz.value == nominal.folds[index].frequency_hz
        assert min(there) <= fold.frequency_hz.low < fold.frequency_hz.value < fold.frequency_hz.high <= max(there)


def test_where_some_draws_have_jumped_the_band_spans_both_motions() -> None:
    cubics = np.linspace(5.0, 7.0, 11)
    nominal, *drawn = curves([oscillator(cubic=float(c)) for c in (CUBIC, *cubics)])
    at = np.array([3.4, nominal.folds[0].frequency_hz])
    up = band_of(nominal, nominal, drawn, at).up[0]
    assert up.high[0] / up.low[0] < 1.2
    assert up.high[1] / up.low[1] > 2


def test_the_top_of_a_curve_is_read_off_where_the_closed_form_puts_it(linear: tuple[Branch, list[Branch]]) -> None:
    mark = crest(linear[0])
    assert mark is not None
    assert mark.frequency_hz == pytest.approx(NATURAL_HZ * np.sqrt(1 - 2 * DAMPING**2), rel=3e-5)
    largest = TORQUE / INERTIA / (2 * np.pi * NATURAL_HZ) ** 2 / (2 * DAMPING * np.sqrt(1 - DAMPING**2))
    assert mark.amplitude == pytest.approx(largest, rel=1e-4)
