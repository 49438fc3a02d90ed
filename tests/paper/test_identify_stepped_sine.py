"""A beam's stepped sine at four levels, measured by others: its resonance falls as it swings further.

The recording is no part of this repository; it has a SOURCE.txt.
"""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sinew.identify.points import ResponsePoints, make_points
from sinew.identify.steady_fit import LevelPeak, ResponseFit, fit_response, peak_of_response

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "beam_stepped_sine"
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason="real recordings are not beside this repository (../shared/data)"
)
STEP_HZ = 3.29e-3


def points_of(frequency: np.ndarray, level: np.ndarray, volts: np.ndarray, std: np.ndarray) -> list[ResponsePoints]:
    """Return one group a level. volts: complex, shape (n,); std: of real and imaginary part, shape (n, 2)."""
    return [
        make_points(
            frequency[level == one],
            volts[level == one] / one,
            std[level == one] / one,
            one,
            excitation="force",
            output_unit="V",
            input_unit="V",
            group=f"{one:g} V",
            scatter_freedom=8.0,
        )
        for one in np.unique(level)
    ]


def table() -> pd.DataFrame:
    return pd.read_csv(FOLDER / "stepped_sine.csv")


def fitted(points: list[ResponsePoints]) -> ResponseFit:
    """Return the law that suits the beam best; the reference of the lock-in turns the phase."""
    return fit_response(points, "drag-cubic", chain=("phase",))


def peaks(fit: ResponseFit) -> list[LevelPeak]:
    return [peak_of_response(fit, part=part) for part in range(len(fit.points))]


@cache
def points() -> list[ResponsePoints]:
    """Return the levels by the means that the source gives."""
    rows = table()
    volts = (rows["X1_V"] + 1j * rows["Y1_V"]).to_numpy()
    std = rows[["X1_std_V", "Y1_std_V"]].to_numpy() / np.sqrt(10)
    return points_of(rows["f_Hz"].to_numpy(), rows["exc_V"].to_numpy(), volts, std)


@cache
def whole() -> ResponseFit:
    return fitted(points())


def by_readings(first: int) -> ResponseFit:
    """Return the levels by five of the last ten of the fifty readings of each point."""
    raw = np.load(FOLDER / "raw_50_per_point.npz")
    pieces = {name: raw[name].reshape(-1, 50)[:, 40 + first :: 2] for name in raw}
    volts = pieces["X1_V"] + 1j * pieces["Y1_V"]
    std = np.stack([volts.real.std(axis=1, ddof=1), volts.imag.std(axis=1, ddof=1)], axis=1) / np.sqrt(5)
    return fitted(points_of(pieces["f_Hz"][:, 0], pieces["exc_V"][:, 0], volts.mean(axis=1), np.maximum(std, 1e-6)))


def test_the_resonance_falls_from_42_78_to_42_74_hz_as_its_source_says() -> None:
    found = [one.frequency_hz.value for one in peaks(whole())]
    assert (found[0], found[-1]) == (pytest.approx(42.78, abs=0.006), pytest.approx(42.74, abs=0.006))


def test_every_level_lowers_the_resonance_beyond_both_intervals() -> None:
    found = [one.frequency_hz for one in peaks(whole())]
    assert all(below.high < above.low for above, below in pairwise(found))


def test_the_resonance_of_each_level_is_within_a_step_and_a_half_of_its_largest_reading() -> None:
    rows = table()
    largest = [
        level["f_Hz"].to_numpy()[np.argmax(np.hypot(level["X1_V"], level["Y1_V"]))]
        for _, level in rows.groupby("exc_V")
    ]
    off = np.array([one.frequency_hz.value for one in peaks(whole())]) - largest
    assert np.abs(off).max() < 1.5 * STEP_HZ


def by_every_second_frequency(first: int) -> ResponseFit:
    return fitted([one.only(np.arange(first, one.size, 2)) for one in points()])


@pytest.mark.parametrize("half", [by_every_second_frequency, by_readings])
def test_both_halves_of_the_measurement_give_the_same_resonances_within_three_standard_deviations(
    half: Callable[[int], ResponseFit],
) -> None:
    for even, odd in zip(peaks(half(0)), peaks(half(1)), strict=True):
        one, other = even.frequency_hz, odd.frequency_hz
        assert abs(one.value - other.value) < 3 * np.hypot(one.std, other.std)


def test_the_temperature_moved_too_little_to_shift_the_resonance_so_far() -> None:
    # A metal's modulus changes by at most 5e-4 per kelvin, a frequency by half of that.
    largest = 0.5 * 5e-4 * np.ptp(table()["T1_C"]) * 42.8
    first, *_, last = (one.frequency_hz for one in peaks(whole()))
    assert first.low - last.high > 20 * largest


def test_the_damping_of_the_beam_grows_with_its_amplitude_beyond_the_band() -> None:
    # The gain at resonance falls to nearly half from the lowest to the highest level.
    (drag,) = (one for name, one in whole().parameters.items() if name.startswith("drag"))
    assert drag.low > 0
