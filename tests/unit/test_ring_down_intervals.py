"""Intervals of a ring-down mean what they say: seeded trials with a known answer."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from scipy.signal import find_peaks
from tests.unit.ring_down_signals import Decay, coloured, lever, times

from sinew.analysis.decay.ring_down import RingDown, analyse_ring_down

DAMPINGS = (0.03, 0.08, 0.17, 0.25)
TRIALS = 80
NOISE_DEG = 0.3


@dataclass(frozen=True)
class Trials:
    """What repeated measurements of one damping ratio gave, one entry each."""

    damping: float
    results: list[RingDown]

    @property
    def values(self) -> NDArray[np.float64]:
        return np.array([result.damping_ratio.value for result in self.results])

    @property
    def inside(self) -> NDArray[np.bool_]:
        return np.array([r.damping_ratio.low <= self.damping <= r.damping_ratio.high for r in self.results])


def trial(damping: float, seed: int) -> RingDown:
    """Return one of five situations in turn: bare, drifting, driven before, drive given, coloured noise at 200 Hz."""
    rng = np.random.default_rng([seed, int(1000 * damping)])
    situation = seed % 5
    t = times(sample_hz=200.0 if situation == 4 else 100.0, before_s=2.0 if situation in (2, 3) else 0.0)
    decay = Decay(damping, phase=rng.uniform(0, 2 * np.pi))
    response = decay.driven_until_zero(t) if situation in (2, 3) else decay.angle(t)
    noise = coloured(rng, t.size) if situation == 4 else rng.standard_normal(t.size)
    drift = 1.0 * t if situation == 1 else 0.0
    drive = lever(t) if situation == 3 else None
    return analyse_ring_down(t, response + NOISE_DEG * noise + drift + 4.0, drive=drive, unit="deg")


@pytest.fixture(scope="module")
def all_trials() -> dict[float, Trials]:
    return {damping: Trials(damping, [trial(damping, seed) for seed in range(TRIALS)]) for damping in DAMPINGS}


@pytest.mark.slow
def test_the_90_percent_interval_of_the_damping_covers_it_85_to_95_times_in_100(all_trials) -> None:
    assert 0.85 <= np.mean([trials.inside for trials in all_trials.values()]) <= 0.95


@pytest.mark.slow
@pytest.mark.parametrize("damping", DAMPINGS)
def test_the_bias_of_the_damping_is_below_a_quarter_of_its_standard_deviation(all_trials, damping: float) -> None:
    values = all_trials[damping].values
    assert abs(values.mean() - damping) < 0.25 * values.std()


@pytest.mark.slow
def test_the_90_percent_interval_of_the_frequency_covers_it(all_trials) -> None:
    found = [
        result.frequency_hz.low <= 3.0 * np.sqrt(1 - damping**2) <= result.frequency_hz.high
        for damping, trials in all_trials.items()
        for result in trials.results
    ]
    assert 0.85 <= np.mean(found) <= 0.95


@pytest.mark.slow
def test_a_linear_decay_is_called_not_exponential_at_most_3_times_in_100(all_trials) -> None:
    verdicts = [result.shape.exponential for trials in all_trials.values() for result in trials.results]
    assert np.mean(verdicts) >= 0.97


def peaks_of_raw_samples(t: NDArray[np.float64], response: NDArray[np.float64]) -> float:
    """Return λ/⟨ω⟩ as the paper's text reads, with scipy alone: peaks of the samples, exponential through them."""
    y = response - response[2 * t.size // 3 :].mean()
    index = np.sort(np.r_[find_peaks(y, prominence=2.0)[0], find_peaks(-y, prominence=2.0)[0]])
    rate = curve_fit(lambda s, a, b: a * np.exp(-b * s), t[index], np.abs(y[index]), p0=(y.max(), 3.0))[0][1]
    return float(rate * np.ptp(t[index]) / (np.pi * (index.size - 1)))


@pytest.fixture(scope="module")
def three_methods() -> NDArray[np.float64]:
    """Return direct fit, Sinew's paper method and the same on raw samples at D = 0.17, shape (trials, 3)."""
    rows = []
    for seed in range(100):
        rng = np.random.default_rng([11, seed])
        t = times()
        response = Decay(0.17, phase=rng.uniform(0, 2 * np.pi)).angle(t) + NOISE_DEG * rng.standard_normal(t.size)
        result = analyse_ring_down(t, response, unit="deg")
        rows.append([result.damping_ratio.value, result.paper.lehr_damping, peaks_of_raw_samples(t, response)])
    return np.array(rows)


def test_the_direct_fit_scatters_four_times_less_than_peaks_of_raw_samples_and_twice_less_than_filtered_ones(
    three_methods,
) -> None:
    direct, filtered, raw = three_methods.std(axis=0)
    assert direct < raw / 4
    assert direct < filtered / 2
