"""Decays of several modes: known poles, close modes, how many there are, repeated trials."""

import numpy as np
import pytest
from tests.unit.ring_down_signals import times

from sinew.analysis.decay.modes import ModalDecay, fit_modes
from sinew.measure.errors import RecordingError

# natural frequency [Hz], damping ratio, amplitude, phase
Row = tuple[float, float, float, float]
ONE: list[Row] = [(3.0, 0.05, 10.0, 0.3)]
CLOSE: list[Row] = [(3.0, 0.04, 10.0, 0.0), (3.15, 0.04, 8.0, 2.0)]  # 0.6 half-power widths apart
THREE: list[Row] = [(3.0, 0.05, 10.0, 0.3), (7.7, 0.03, 3.0, 1.0), (12.0, 0.02, 1.5, 0.0)]
T = times(duration_s=4.0)


def decay(rows: list[Row], seed: int, noise: float = 0.1):
    x = 4 + 0.5 * T + noise * np.random.default_rng(seed).standard_normal(T.size)
    for frequency, damping, amplitude, phase in rows:
        omega = 2 * np.pi * frequency
        x = x + amplitude * np.exp(-damping * omega * T) * np.cos(omega * np.sqrt(1 - damping**2) * T + phase)
    return x


def fit(rows: list[Row], seed: int = 0, noise: float = 0.1, **kwargs) -> ModalDecay:
    return fit_modes(T, decay(rows, seed, noise), free_from_s=0.0, **kwargs)


@pytest.mark.parametrize("modes", [ONE, CLOSE, THREE], ids=["one", "close", "three"])
def test_the_modes_of_a_nearly_exact_decay_are_found(modes: list[Row]) -> None:
    found = sorted(fit(modes, noise=1e-4).modes, key=lambda mode: mode.frequency_hz.value)
    values = [(m.natural_frequency_hz.value, m.damping_ratio.value, m.amplitude.value) for m in found]
    assert values == [pytest.approx(row[:3], rel=2e-3) for row in modes]


@pytest.mark.slow
@pytest.mark.parametrize(("modes", "least"), [(ONE, 19), (CLOSE, 19), (THREE, 17)], ids=["one", "close", "three"])
def test_the_number_of_modes_is_found(modes: list[Row], least: int) -> None:
    counts = [len(fit(modes, seed).modes) for seed in range(20)]
    assert counts.count(len(modes)) >= least


def test_a_close_mode_that_is_left_out_biases_the_damping() -> None:
    # 0.04 for both; the beat looks like a faster decay.
    assert fit(CLOSE, modes=1).modes[0].damping_ratio.value > 0.05


def test_a_creeping_rest_position_is_no_mode() -> None:
    x = decay(ONE, 3) + 3.0 * np.exp(-T / 0.5)
    assert len(fit_modes(T, x, free_from_s=0.0, creeps=True).modes) == 1


def test_more_modes_than_there_are_come_with_a_warning() -> None:
    assert "ask for fewer modes" in fit(ONE, modes=3).message


@pytest.mark.slow
@pytest.mark.parametrize("modes", [CLOSE, THREE], ids=["close", "three"])
def test_the_90_percent_intervals_of_all_modes_cover_their_poles(modes: list[Row]) -> None:
    inside = []
    for seed in range(150):
        found = sorted(fit(modes, seed, modes=len(modes)).modes, key=lambda mode: mode.frequency_hz.value)
        for mode, (frequency, damping, amplitude, _) in zip(found, modes, strict=True):
            for estimate, truth in (
                (mode.natural_frequency_hz, frequency),
                (mode.damping_ratio, damping),
                (mode.amplitude, amplitude),
            ):
                inside.append(estimate.low <= truth <= estimate.high)
    assert 0.86 <= np.mean(inside) <= 0.94


def test_noise_alone_has_no_modes() -> None:
    noise = np.random.default_rng(5).standard_normal(T.size)
    with pytest.raises(RecordingError):
        fit_modes(T, noise)
