"""What the report says of the threshold is what the gain does."""

import numpy as np
import pytest
import xarray as xr
from tests.unit.figures_sample import SMALL, sample_results

from sinew.paper.report import describe_threshold

PRETENSION_MM = tuple(float(p) for p in range(17))


def campaign(gain: np.ndarray, by_measured: np.ndarray, resonance: np.ndarray) -> xr.Dataset:
    results = sample_results(PRETENSION_MM, SMALL[1], repeats=1)
    for name, values in {
        "paper_gain_peak": gain,
        "gain_peak_measured_drive": by_measured,
        "paper_resonance_hz": resonance,
        "drive_amplitude_at_resonance_rad": gain / by_measured * np.deg2rad(20.0),
    }.items():
        results[name].values[:] = values
    return results


def level(kink_mm: float) -> np.ndarray:
    return 2.8 - 0.14 * np.minimum(PRETENSION_MM, kink_mm)


RISING = np.linspace(3.0, 4.8, 17)


def described(results: xr.Dataset, beyond: xr.Dataset | None = None) -> str:
    return " ".join(describe_threshold(results, beyond, about_paper=True))


def test_the_kink_of_the_gain_is_told() -> None:
    assert "a kink at 11.3 mm" in described(campaign(level(11.3), level(11.3), RISING))


def test_a_kink_far_from_the_papers_threshold_is_said_to_be_another() -> None:
    assert "12 mm, lies outside that interval" in described(campaign(level(5.0), level(5.0), RISING))


def test_a_kink_at_the_papers_threshold_is_said_to_be_there() -> None:
    gain = level(12.0) + 0.01 * np.random.default_rng(3).standard_normal(17)
    assert "12 mm, lies inside that interval" in described(campaign(gain, gain, RISING))


def test_data_that_are_not_the_papers_are_not_held_against_its_threshold() -> None:
    assert "paper" not in " ".join(describe_threshold(campaign(level(5.0), level(5.0), RISING)))


def test_a_sweep_beyond_the_campaign_moves_the_kink_that_is_found() -> None:
    whole = campaign(level(11.3), level(11.3), RISING)
    parts = whole.isel(pretension_mm=slice(0, 12)), whole.isel(pretension_mm=slice(12, None))
    assert described(*parts) == described(whole) != described(parts[0])


@pytest.mark.parametrize(
    ("by_measured", "verdict"),
    [
        (np.full(17, 4.0), "because the drive does, not the joint"),
        (np.linspace(6.0, 4.5, 17), "mostly because the drive does"),
        (2.0 * np.linspace(2.8, 1.2, 17), "the joint itself still changes"),
    ],
)
def test_the_fall_of_the_gain_is_given_to_drive_or_joint(by_measured: np.ndarray, verdict: str) -> None:
    assert verdict in described(campaign(np.linspace(2.8, 1.2, 17), by_measured, RISING))


def test_steps_at_which_the_resonance_does_not_rise_are_counted() -> None:
    resonance = RISING.copy()
    resonance[[4, 5]] = resonance[[5, 4]]
    assert "fails to rise at 1 of 16 steps" in described(campaign(level(5.0), level(5.0), resonance))


def test_four_pretensions_are_too_few_to_speak_of_a_threshold() -> None:
    assert describe_threshold(sample_results(*SMALL)) == []
