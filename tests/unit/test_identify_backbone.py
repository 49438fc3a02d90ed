"""Frequency and damping against amplitude: a Duffing oscillator with dry friction, and pendulums others measured."""

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk
from tests.unit.ring_down_signals import Decay, times

from sinew.identify.oscillator.backbone import Backbone, fit_backbone
from sinew.measure.errors import RecordingError

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
real = pytest.mark.skipif(not DATA.is_dir(), reason="real recordings are not beside this repository (../shared/data)")

# x'' + 2 ζ ω₀ x' + ω₀² (x + α x³ + f sign x') = 0, released from 30 degrees.
OMEGA, ZETA, CUBIC, FRICTION, START = 2 * np.pi * 3.0, 0.01, 0.1 / 30.0**2, 0.06, 30.0
T = times(duration_s=4.0)


@cache
def swing():
    def slope(_, y):
        force = y[0] + CUBIC * y[0] ** 3 + FRICTION * np.tanh(y[1] / 0.3)
        return [y[1], -2 * ZETA * OMEGA * y[1] - OMEGA**2 * force]

    return solve_ivp(slope, (0, T[-1]), [START, 0.0], t_eval=T, rtol=1e-9, atol=1e-9, max_step=2e-3).y[0]


def slow_flow(amplitude):
    """Return (frequency [Hz], damping ratio) of the slow flow: energy lost in a cycle by energy per amplitude.

    ω(A) = ω₀ (1 + 3e/8 - 21e²/256), e = αA² (Lindstedt); dA/dt = -(ζω²A/ω₀ + 2fω/π)/(1 + e) from
    E = ω₀²(A²/2 + αA⁴/4), of which a cycle loses 2π ζ ω₀ ω A² to viscosity and 4 f ω₀² A to friction.
    """
    e = CUBIC * amplitude**2
    omega = OMEGA * (1 + 3 / 8 * e - 21 / 256 * e**2)
    rate = (ZETA * omega**2 / OMEGA + 2 * FRICTION * omega / (np.pi * amplitude)) / (1 + e)
    return np.sqrt(omega**2 - rate**2) / (2 * np.pi), rate / omega


def trial(seed: int, noise: float = 0.3) -> Backbone:
    return fit_backbone(T, swing() + noise * np.random.default_rng(seed).standard_normal(T.size), free_from_s=0.0)


def test_the_backbone_of_a_duffing_oscillator_is_the_slow_flow_to_a_thousandth() -> None:
    found = trial(0, noise=0.01)
    middle = slice(8, 33)
    assert np.abs(found.frequency_hz / slow_flow(found.amplitude)[0] - 1)[middle].max() < 1e-3


def test_the_damping_of_dry_friction_rises_as_the_amplitude_falls_as_the_slow_flow_says() -> None:
    found = trial(0, noise=0.01)
    middle = slice(8, 33)
    assert found.damping_ratio[middle] == pytest.approx(slow_flow(found.amplitude)[1][middle], rel=0.05)


@pytest.mark.slow
def test_the_pointwise_bands_cover_the_slow_flow_nine_times_of_ten() -> None:
    inside = []
    for found in map(trial, range(100)):
        frequency, damping = slow_flow(found.amplitude)
        inside.append((found.frequency_low_hz <= frequency) & (frequency <= found.frequency_high_hz))
        inside.append((found.damping_ratio_low <= damping) & (damping <= found.damping_ratio_high))
    assert 0.86 <= np.mean(inside) <= 0.94


def test_a_linear_decay_has_a_flat_backbone_within_its_band() -> None:
    t = times(duration_s=6.0)
    noise = 0.3 * np.random.default_rng(1).standard_normal(t.size)
    found = fit_backbone(t, Decay(0.02).angle(t) + noise)
    inside = (found.damping_ratio_low <= 0.02) & (found.damping_ratio_high >= 0.02)
    assert inside.mean() > 0.7


def test_the_amplitudes_run_from_large_to_small() -> None:
    assert (np.diff(trial(2).amplitude) < 0).all()


def test_a_drifting_rest_position_leaves_the_backbone_where_it_is() -> None:
    noise = 0.01 * np.random.default_rng(3).standard_normal(T.size)
    found = fit_backbone(T, swing() + noise + 2.0 * T + 5.0, free_from_s=0.0)
    assert np.abs(found.frequency_hz / slow_flow(found.amplitude)[0] - 1)[8:33].max() < 1e-3


def test_a_decay_of_four_half_cycles_is_refused() -> None:
    with pytest.raises(RecordingError, match="half cycles"):
        fit_backbone(times(duration_s=0.7), Decay(0.1).angle(times(duration_s=0.7)), free_from_s=0.0)


@pytest.mark.slow
@real
@pytest.mark.parametrize("name", ["60", "80P", "100"])
def test_the_damping_of_a_pendulum_with_dry_friction_rises_as_it_comes_to_rest(name: str) -> None:
    table = pd.read_csv(DATA / "torsion_spring_pendulum" / f"{name}.csv")
    index = np.arange(len(table))
    step = np.polyfit(index, table["host_time_s"], 1)[0]
    found = fit_backbone(step * index, table["angle_deg"].to_numpy())
    large, small = np.interp([-20.0, -3.0], -found.amplitude, found.damping_ratio)
    assert small > 1.15 * large


@real
def test_a_gravity_pendulum_below_60_degrees_softens_as_the_elliptic_integral_says() -> None:
    angle = np.loadtxt(DATA / "rotary_pendulum_swing" / "pendulum_free_swing_data_01.txt", skiprows=2)
    found = fit_backbone(np.arange(angle.size) / 1000, angle)
    ratio = found.frequency_hz * ellipk(np.sin(np.deg2rad(found.amplitude) / 2) ** 2) / (np.pi / 2)
    here = (found.amplitude < 60) & (found.amplitude > 12)
    assert np.ptp(ratio[here]) < 0.02 * ratio[here].mean()
