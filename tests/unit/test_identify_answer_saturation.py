"""Whose is the saturation: asked of sweeps in which it is the drive's, the joint's, or both's."""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from tests.unit.identify_campaigns import PRETENSIONS

from sinew.paper.answer import CANNOT_TELL
from sinew.paper.sweeps import answer_saturation


def peaks(joint: float, drive: float, seed: int = 1) -> xr.Dataset:
    """Return sweep results in which gain by measured drive and drive amplitude change by so much per mm above 5 mm."""
    rng = np.random.default_rng(seed)
    above = np.maximum(PRETENSIONS - 5.0, 0.0)
    below = np.minimum(PRETENSIONS, 5.0) - 5.0
    noise = rng.normal(0.0, 0.004, (2, PRETENSIONS.size))
    measured = 4.0 * np.exp(joint * above - 0.02 * below + noise[0])
    reached = 0.5 * np.exp(drive * above - 0.15 * below + noise[1])
    columns = {
        "gain_peak": measured * reached,
        "gain_peak_measured_drive": measured,
        "drive_amplitude_at_resonance_rad": np.radians(20.0) * reached,
        "resonance_hz": 3.0 + 0.1 * PRETENSIONS + 0.02 * noise[0],
    }
    names = {
        "gain_peak": "gain_peak_std",
        "gain_peak_measured_drive": "gain_peak_measured_drive_std",
        "drive_amplitude_at_resonance_rad": "drive_amplitude_at_resonance_std_rad",
        "resonance_hz": "resonance_std_hz",
    }
    data: dict[str, tuple[Any, np.ndarray]] = {name: ("pretension_mm", values) for name, values in columns.items()}
    data |= {names[name]: ("pretension_mm", 0.004 * np.abs(values)) for name, values in columns.items()}
    data["saturated_share"] = (("pretension_mm", "frequency_hz", "repeat"), np.full((PRETENSIONS.size, 2, 1), 0.4))
    return xr.Dataset(
        data, {"pretension_mm": ("pretension_mm", PRETENSIONS), "frequency_hz": ("frequency_hz", [3.0, 4.0])}
    )


@pytest.mark.parametrize(
    ("joint", "drive", "verdict", "share"),
    [(0.0, -0.04, "the drive's", 1.0), (-0.04, 0.0, "the joint's", 0.0), (-0.01, -0.03, "the drive's", 0.75)],
)
def test_the_fall_of_the_gain_is_given_to_whom_it_belongs(
    joint: float, drive: float, verdict: str, share: float
) -> None:
    answer = answer_saturation(peaks(joint, drive))
    found = answer.numbers["drives_share_of_the_fall"]
    assert answer.verdict == verdict
    assert found.low <= share <= found.high


def test_a_gain_that_does_not_fall_leaves_nothing_to_share_out() -> None:
    answer = answer_saturation(peaks(0.0, 0.0))
    assert answer.verdict == CANNOT_TELL
    assert "does not fall" in answer.sentences[0]


def test_without_a_measured_drive_it_cannot_be_told_whose_the_saturation_is() -> None:
    results = peaks(0.0, -0.04)
    results["gain_peak_measured_drive"] = np.nan * results["gain_peak_measured_drive"]
    answer = answer_saturation(results)
    assert answer.verdict == CANNOT_TELL
    assert "drive was not measured" in answer.sentences[0]
