"""Sliders: a curve that is right, that never compiles anew, and sentences where a number cannot be meant."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest

import sinew as sn
from sinew.apps.dashboard.work.design import design_curves, rig_text, slope_damping
from sinew.measure.errors import SpecError
from sinew.plan.toml import parse_rig

BAND_HZ = (1.0, 6.0)


def joint(seed: int) -> tuple[dict[str, float | None], float, float]:
    """Changes, pretension [mm] and amplitude [deg] drawn at random from where the sliders go."""
    random = np.random.default_rng(seed)
    changes: dict[str, float | None] = {
        "length_mm": random.uniform(60, 150),
        "outer_mm": random.uniform(40, 80),
        "tendon_circle_mm": random.uniform(15, 60),
        "lever_inertia_kg_m2": random.uniform(0.004, 0.02),
    }
    return changes, random.uniform(0, 16), random.uniform(5, 30)


@pytest.mark.slow
def test_the_curve_of_the_sliders_is_the_one_that_is_predicted_of_their_rig() -> None:
    changes, pretension, amplitude = joint(1)
    found = design_curves("paper", changes, pretension, amplitude, BAND_HZ)
    rig = parse_rig(rig_text("paper", changes, "mine"))
    (curve,) = sn.predict(rig, pretension, amplitude_deg=amplitude, band_hz=BAND_HZ).branches
    assert curve.peak is not None
    assert found["peak"] == {"frequency_hz": curve.peak.frequency_hz, "gain": curve.peak.gain}
    assert found["gain"] == pytest.approx((curve.amplitude_deg / amplitude).tolist())


@pytest.mark.slow
def test_a_folded_curve_is_unstable_between_its_folds() -> None:
    slender = {"outer_mm": 40.2, "length_mm": 127.8, "tendon_circle_mm": 51.5, "lever_inertia_kg_m2": 0.0062}
    found = design_curves("paper", slender, 5.0, 20.0, BAND_HZ)
    assert len(found["folds"]) == 2
    low, high = sorted(fold["frequency_hz"] for fold in found["folds"])
    unstable = [f for f, stable in zip(found["frequency_hz"], found["stable"], strict=True) if not stable]
    assert unstable
    assert low * 0.99 < min(unstable) <= max(unstable) < high * 1.01


@pytest.mark.slow
def test_no_slider_compiles_anything_anew(caplog: pytest.LogCaptureFixture) -> None:
    design_curves("paper", {"length_mm": 90.0}, 4.0, 20.0, BAND_HZ)
    with jax.log_compiles(), caplog.at_level("WARNING"):
        for seed in range(3):
            changes, pretension, amplitude = joint(seed)
            design_curves("paper", changes, pretension, amplitude, (1.2, 5.5))
    assert [record.message for record in caplog.records if "ompil" in record.message] == []


@pytest.mark.parametrize("damping", [0.03, 0.1])
def test_the_slope_of_the_lag_gives_the_damping_of_an_oscillator(damping: float) -> None:
    hertz = np.linspace(2.0, 4.0, 30)
    lag = np.arctan2(2 * damping * hertz / 3.0, 1 - (hertz / 3.0) ** 2)
    curve = SimpleNamespace(frequency_hz=hertz, phase_deg=np.degrees(lag), phase_90=SimpleNamespace(frequency_hz=3.0))
    assert slope_damping(curve) == pytest.approx(damping, rel=0.05)  # type: ignore[arg-type]


def test_a_design_is_a_rig_of_its_own_name() -> None:
    made = parse_rig(rig_text("paper", {"length_mm": 110.0}, "mine"))
    assert (made.name, made.silicone.length.value) == ("mine", pytest.approx(0.110))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"colour": 1.0}, "found a change of colour, expected one of"),
        ({"length_mm": -1.0}, "length_mm is -1, expected a positive number"),
        ({"length_mm": float("nan")}, "length_mm is nan"),
    ],
)
def test_a_change_that_cannot_be_meant_is_refused(changes: dict[str, float | None], sentence: str) -> None:
    with pytest.raises(SpecError, match=sentence):
        design_curves("paper", changes, 4.0, 20.0, BAND_HZ)
