"""Resonance, crossing and width against closed forms, and their intervals against chance."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.unit.analysis_sweep import QUIET, Joint, Sensing, rig_with, sweep

from sinew.analysis.signal.repeats import combine_repeats
from sinew.analysis.sweep.resonance import Peak, estimate_resonance, find_crossings, find_peaks
from sinew.analysis.sweep.response import estimate_response

FREQUENCY_HZ = np.unique(np.round(np.r_[np.linspace(1.53, 5.97, 15), np.linspace(2.61, 3.91, 14)], 6))
TRIALS = 200


def peak_of(response, frequency_hz=FREQUENCY_HZ) -> Peak:
    std = np.full(frequency_hz.size, 1e-4)
    return find_peaks(frequency_hz, response[None], std[None], std[None])[0]


def covered(results, stem: str, suffix: str, truth: float) -> float:
    low, high = results[f"{stem}_low{suffix}"].values, results[f"{stem}_high{suffix}"].values
    return float(np.mean((low <= truth) & (truth <= high)))


@cache
def trials(damping: float, repeats: int, delay_std_s: float = 0.0):
    """One joint measured anew in each of 200 campaigns, laid side by side on the pretension axis."""
    late = delay_std_s * np.random.default_rng(7).normal(size=TRIALS)
    joints = [Joint(damping=damping)] * TRIALS
    recording = sweep(joints, FREQUENCY_HZ[4:-3], repeats=repeats, sensing=Sensing(), late_s=late, seed=3)
    return estimate_resonance(estimate_response(recording, rig_with(Sensing(), delay_std_s)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damping", "repeats", "stem", "suffix", "most"),
    [
        (0.08, 3, "resonance", "_hz", 0.95),
        (0.08, 3, "resonance_measured_drive", "_hz", 0.95),
        (0.08, 3, "phase_90", "_hz", 0.95),
        (0.08, 3, "gain_peak", "", 0.95),
        (0.12, 1, "resonance", "_hz", 0.96),
        (0.12, 1, "phase_90", "_hz", 0.95),
    ],
)
def test_a_mark_of_the_resonance_lies_in_its_interval_85_to_95_times_in_100(
    damping, repeats, stem, suffix, most
) -> None:
    joint = Joint(damping=damping)
    truth = {"phase_90": 3.2, "gain_peak": abs(joint.transfer(joint.resonance_hz))}.get(stem, joint.resonance_hz)
    assert 0.85 <= covered(trials(damping, repeats), stem, suffix, truth) <= most


@pytest.mark.slow
def test_the_crossings_interval_holds_the_delays_uncertainty() -> None:
    assert 0.85 <= covered(trials(0.12, 1, delay_std_s=0.5e-3), "phase_90", "_hz", 3.2) <= 0.95


@pytest.mark.parametrize("damping", [0.03, 0.08, 0.15, 0.25])
def test_peak_and_crossing_of_the_linear_joint_are_where_the_formulas_put_them(damping: float) -> None:
    joint = Joint(damping=damping)
    peak = peak_of(joint.transfer(FREQUENCY_HZ))
    assert (peak.frequency_hz[0], peak.crossing_hz[0]) == pytest.approx((joint.resonance_hz, 3.2), rel=1e-6)


@pytest.mark.parametrize("damping", [0.03, 0.08, 0.15])
def test_the_half_power_width_is_the_distance_of_the_half_power_points(damping: float) -> None:
    joint = Joint(damping=damping)
    level = abs(joint.transfer(joint.resonance_hz)) / np.sqrt(2)

    def above(frequency_hz: float) -> float:
        return abs(joint.transfer(frequency_hz)) - level

    width = brentq(above, joint.resonance_hz, 6.0) - brentq(above, 1.0, joint.resonance_hz)
    assert peak_of(joint.transfer(FREQUENCY_HZ)).width_hz[0] == pytest.approx(width, rel=1e-4)


def test_hysteretic_damping_is_fitted_as_well_as_viscous() -> None:
    ratio = FREQUENCY_HZ / 3.2
    peak = peak_of(0.65 * ratio**2 / (1 + 0.16j - ratio**2))
    # |H|² = r⁴/((1 - r²)² + η²) is largest at r² = 1 + η²
    assert peak.frequency_hz[0] == pytest.approx(3.2 * np.sqrt(1 + 0.16**2), rel=1e-4)


def hardening(frequency_hz, share=0.02):
    """First harmonic balance of a joint whose stiffness grows by `share` at the linear resonance's amplitude."""
    joint = Joint(damping=0.1)
    largest = abs(joint.transfer(joint.resonance_hz))
    response = []
    for f in frequency_hz:
        ratio, size = f / joint.natural_hz, abs(joint.transfer(f))
        for _ in range(60):
            stiff = 1 + share * (size / largest) ** 2
            value = joint.share * ratio**2 / (stiff - ratio**2 + 2j * joint.damping * ratio)
            size = 0.5 * size + 0.5 * abs(value)
        response.append(value)
    return np.array(response)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.1, 0.2])
@pytest.mark.parametrize("step_hz", [0.05, 0.1, 0.15])
def test_the_peak_of_a_hardening_joint_lies_in_its_interval_on_every_grid(share: float, step_hz: float) -> None:
    fine = np.linspace(3.2, 3.8, 2401)
    truth = fine[np.argmax(np.abs(hardening(fine, share)))]
    off = []
    for first in 1.5 + step_hz * np.arange(0.0, 1.0, 0.25):
        grid = np.arange(first, 6.0, step_hz)
        value, std, _ = peak_of(hardening(grid, share), grid).frequency_hz
        off.append(abs(value - truth) / (1.645 * std))
    assert max(off) < 1.0


class Hardening(Joint):
    def transfer(self, frequency_hz):
        return hardening([float(frequency_hz)], 0.15)[0]


def test_the_misfit_of_a_hardening_joint_does_not_shrink_with_repeats() -> None:
    misfit = peak_of(hardening(FREQUENCY_HZ, 0.15)).frequency_misfit_hz
    found = estimate_resonance(estimate_response(sweep([Hardening()], FREQUENCY_HZ, repeats=4), rig_with(QUIET)))
    half_width = (found["resonance_high_hz"] - found["resonance_low_hz"]).item() / 2
    assert half_width == pytest.approx(1.644854 * misfit, rel=0.1)


@pytest.mark.parametrize(
    ("frequency_hz", "said"),
    [
        (np.linspace(1.0, 2.8, 19), "highest frequency"),
        (np.linspace(3.5, 6.0, 19), "lowest frequency"),
        (FREQUENCY_HZ[:5], "too few"),
    ],
)
def test_a_curve_without_a_peak_says_why(frequency_hz: np.ndarray, said: str) -> None:
    peak = peak_of(Joint().transfer(frequency_hz), frequency_hz)
    assert np.isnan(peak.frequency_hz[0])
    assert said in peak.reason


@pytest.mark.parametrize("find", [find_peaks, find_crossings])
def test_each_of_many_curves_is_read_as_it_would_be_alone(find) -> None:
    rng = np.random.default_rng(11)
    damped = [Joint(damping=damping).transfer(FREQUENCY_HZ) for damping in (0.03, 0.25)]
    rising, still = np.where(FREQUENCY_HZ < 3.0, damped[0], np.nan), np.where(FREQUENCY_HZ < 3.2, damped[0], 0.0)
    missing, few = (np.where(rng.random(FREQUENCY_HZ.size) < share, damped[1], np.nan) for share in (0.7, 0.2))
    too_few = np.where(np.arange(FREQUENCY_HZ.size) < 5, damped[1], np.nan)
    chance = rng.standard_normal(FREQUENCY_HZ.size) + 1j * rng.standard_normal(FREQUENCY_HZ.size)
    curves = np.array([*damped, missing, few, too_few, rising, still, chance, hardening(FREQUENCY_HZ, 0.1)])
    noise = 1e-3 * rng.standard_normal((2, *curves.shape))
    curves, std = curves * (1.0 + noise[0] + 1j * noise[1]), np.full(curves.shape, 1e-3)
    together = find(FREQUENCY_HZ, curves, std, std)
    alone = [find(FREQUENCY_HZ, curves[[i]], std[[i]], std[[i]])[0] for i in range(len(curves))]
    assert [one.reason for one in together] == [one.reason for one in alone]
    for name in ("frequency_hz", "gain", "width_hz", "crossing_hz", "crossing_slope", "frequency_misfit_hz"):
        found, expected = ([getattr(one, name) for one in peaks] for peaks in (together, alone))
        np.testing.assert_allclose(found, expected, rtol=1e-6, err_msg=name)


def test_a_crossing_far_from_the_peak_is_found_beside_it() -> None:
    # a second delay of 40 ms turns the lag by 46 degrees at 3.2 Hz, so that 90 degrees come early
    response = Joint(damping=0.03).transfer(FREQUENCY_HZ) * np.exp(-2j * np.pi * FREQUENCY_HZ * 0.04)

    def lag(frequency_hz: float) -> float:
        turned = Joint(damping=0.03).transfer(frequency_hz) * np.exp(-2j * np.pi * frequency_hz * 0.04)
        return -np.angle(turned) - np.pi / 2

    std = np.full((1, FREQUENCY_HZ.size), 1e-4)
    found = find_crossings(FREQUENCY_HZ, response[None], std, std)[0].crossing_hz[0]
    assert found == pytest.approx(brentq(lag, 2.5, 3.19), abs=0.02)


def test_the_drive_amplitude_at_resonance_is_read_off_the_measured_drive() -> None:
    response = estimate_response(
        sweep([Joint()], FREQUENCY_HZ, drive_amplitude=lambda f: 0.3 - 0.03 * f), rig_with(QUIET)
    )
    found = estimate_resonance(response)
    expected = 0.3 - 0.03 * found["resonance_hz"].item()
    assert found["drive_amplitude_at_resonance_rad"].item() == pytest.approx(expected, rel=1e-9)


def test_repeats_are_combined_by_students_t_and_a_single_one_keeps_its_fits_interval() -> None:
    combined = combine_repeats(np.array([1.0, 2.0, 3.0]), np.full(3, 9.0))
    # t(0.95, 2) = 2.91999
    assert (combined.value, combined.std) == (pytest.approx(2.0), pytest.approx(1.0))
    assert combined.high - combined.value == pytest.approx(2.91999 / np.sqrt(3), rel=1e-5)
    alone = combine_repeats(np.array([np.nan, 2.0]), np.array([9.0, 0.5]))
    assert alone.high == pytest.approx(2.0 + 1.644854 * 0.5)
    assert np.isnan(combine_repeats(np.array([np.nan, np.nan]), np.ones(2)).low)


def hardening_swept_up(frequency_hz, share: float):
    """Return the response of a joint of 3.2 Hz whose stiffness grows by a share for a swing as large as the drive's."""
    size, response = 0.05, []
    for f in frequency_hz:
        for _ in range(400):
            transfer = f**2 / (3.2**2 * (1.0 + share * size**2) - f**2 + 2j * 0.06 * 3.2 * f)
            size = 0.7 * size + 0.3 * abs(transfer)
        response.append(transfer)
    return np.array(response)


def test_a_curve_of_six_parameters_is_judged_by_the_errors_of_its_points() -> None:
    # Ten points of a joint that hardens until its swing jumps: one rational curve of eight parameters leaves them, and
    # one of six misses them by far more than 1e-4.
    frequency = np.linspace(2.4, 5.2, 10)
    peak = peak_of(hardening_swept_up(frequency, 0.0103), frequency)
    assert peak.gain_misfit > 0.1 * peak.gain[0]
