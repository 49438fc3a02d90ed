"""The resonance fit on a real stepped sine: a softening beam, lock-in readings with their noise."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sinew.analysis.sweep.resonance import find_peaks

FILE = Path(__file__).resolve().parents[3] / "shared" / "data" / "beam_stepped_sine" / "stepped_sine.csv"
pytestmark = pytest.mark.skipif(
    not FILE.is_file(), reason="real recordings are not beside this repository (../shared/data)"
)


def peaks():
    table = pd.read_csv(FILE)
    found = {}
    for level, rows in table.groupby("exc_V"):
        response = (rows["X1_V"] + 1j * rows["Y1_V"]).to_numpy() / level
        relative = np.hypot(rows["X1_std_V"], rows["Y1_std_V"]).to_numpy() / np.abs(response * level)
        found[level] = find_peaks(rows["f_Hz"].to_numpy(), response[None], *[relative[None]] * 2)[0], rows, response
    return found


def test_the_peak_falls_from_42_78_to_42_74_hz_as_its_source_says_and_its_gain_with_it() -> None:
    found = list(peaks().values())
    frequency, gain = (np.array([getattr(peak, name)[0] for peak, _, _ in found]) for name in ("frequency_hz", "gain"))
    assert (np.diff(frequency) < 0).all()
    assert (np.diff(gain) < 0).all()
    assert (frequency[0], frequency[-1]) == pytest.approx((42.78, 42.74), abs=0.006)


def test_each_peak_is_within_one_step_of_the_largest_reading() -> None:
    step = 3.29e-3
    off = [peak.frequency_hz[0] - rows["f_Hz"].to_numpy()[np.argmax(np.abs(h))] for peak, rows, h in peaks().values()]
    assert np.abs(off).max() < 1.5 * step
