"""The prediction against a published reference curve and against scipy's integrator.

I = 12.74e-3 kg m², 3 Hz, D = 0.05, k₃ = 6 N m/rad³, 0.45 N m: the folds are known from numerical continuation with
AUTO-07p. The peak that goes with them, 0.793727 rad, falls short by 2.2e-6 rad of the largest rotation that shooting
finds, as the largest value on a mesh of the period would.
"""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from sinew.measure.arrays import Array
from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
from sinew.solve.branch import Branch
from sinew.solve.continuation import Stride
from sinew.solve.curves import Prediction, predict
from sinew.solve.programs import configure

configure()
ONE = Oscillator(12.74e-3, 3.0, 0.05, cubic=6.0, torque=0.45)
BAND_HZ = (1.0, 6.0)
UPPER_FOLD_HZ, LOWER_FOLD_HZ, PEAK_RAD = 3.818697, 3.521591, 0.793727
STIFFNESS = 12.74e-3 * (6 * np.pi) ** 2
VISCOUS = 2 * 0.05 * np.sqrt(STIFFNESS * 12.74e-3)


@cache
def prediction() -> Prediction:
    # Steps are small, so that amplitudes at any frequency may be read off between two points.
    close = resolution_of([ONE])._replace(stride=Stride(most=0.01))
    return predict(oscillator_problem([ONE], BAND_HZ), BAND_HZ, close)


def branch() -> Branch:
    return prediction().branches[0]


def rates(t: float, y: Array, omega: float) -> list[float]:
    """Return the motion's rates and, where asked for, those of disturbances (φ, φ̇, then the matrix by rows)."""
    acceleration = (0.45 * np.sin(omega * t) - VISCOUS * y[1] - STIFFNESS * y[0] - 6.0 * y[0] ** 3) / 12.74e-3
    if y.size == 2:
        return [y[1], acceleration]
    by_angle, by_rate = -(STIFFNESS + 18.0 * y[0] ** 2) / 12.74e-3, -VISCOUS / 12.74e-3
    a, b, c, d = y[2:]
    return [y[1], acceleration, c, d, by_angle * a + by_rate * c, by_angle * b + by_rate * d]


def integrated(y: Array, frequency_hz: float, periods: float, **options: object):  # type: ignore[no-untyped-def]
    omega = 2 * np.pi * frequency_hz
    return solve_ivp(
        rates, (0, periods / frequency_hz), y, "DOP853", args=(omega,), **({"rtol": 1e-11, "atol": 1e-12} | options)
    )


def start_of(index: int) -> Array:
    """Return angle and rate at t = 0 of a point of the predicted curve."""
    one = branch()
    c, omega = one.harmonics[index], 2 * np.pi * one.frequency_hz[index]
    return np.array([c.sum().real, (1j * one.orders * omega * c).sum().real])


def periodic(frequency_hz: float, start: Array) -> Array:
    """Return the start of the periodic motion nearest to a start."""
    found = fsolve(lambda y: integrated(y, frequency_hz, 1).y[:, -1] - y, start, xtol=1e-12)
    return np.asarray(found)


def test_both_folds_are_those_of_the_reference() -> None:
    upper, lower = branch().folds
    assert upper.frequency_hz == pytest.approx(UPPER_FOLD_HZ, abs=1e-6)
    assert lower.frequency_hz == pytest.approx(LOWER_FOLD_HZ, abs=1e-6)


def test_the_peak_is_that_of_shooting_with_scipy() -> None:
    peak = branch().peak
    assert peak is not None
    start = periodic(peak.frequency_hz, start_of(int(np.argmax(branch().amplitude))))
    path = integrated(start, peak.frequency_hz, 1, events=lambda t, y, omega: y[1])
    assert peak.amplitude == pytest.approx(np.abs(path.y_events[0][:, 0]).max(), abs=1e-8)


def test_the_peak_is_that_of_the_reference_within_its_mesh() -> None:
    peak = branch().peak
    assert peak is not None
    assert 0 <= peak.amplitude - PEAK_RAD < 3e-6


def test_every_point_is_periodic_for_scipy_too() -> None:
    for index in range(0, branch().amplitude.size, 24):
        start, frequency = start_of(index), float(branch().frequency_hz[index])
        assert integrated(start, frequency, 1).y[:, -1] == pytest.approx(start, abs=2e-7 * np.abs(start).max())


def test_multipliers_are_those_of_the_monodromy_matrix_of_the_time_integration() -> None:
    for index in range(0, branch().amplitude.size, 24):
        frequency = float(branch().frequency_hz[index])
        path = integrated(np.append(start_of(index), [1.0, 0.0, 0.0, 1.0]), frequency, 1)
        monodromy = path.y[2:, -1].reshape(2, 2)
        assert branch().multiplier[index] == pytest.approx(np.abs(np.linalg.eigvals(monodromy)).max(), rel=2e-3)


def settled(index: int, disturbance: float) -> float:
    """Return the amplitude that is left 60 periods after a disturbance of a point of the curve."""
    frequency = float(branch().frequency_hz[index])
    path = integrated(start_of(index) * (1 + disturbance), frequency, 60, rtol=1e-8, atol=1e-9, dense_output=True)
    last = np.linspace(59, 60, 200) / frequency
    return float(np.ptp(path.sol(last)[0]) / 2)


def test_an_unstable_motion_departs_to_the_stable_one_on_either_side() -> None:
    back = np.flatnonzero(~branch().stable)
    middle = int(back[back.size // 2])
    frequency = branch().frequency_hz
    stable = np.flatnonzero(branch().stable)
    before, after = stable[stable < middle], stable[stable > middle]
    upper = np.interp(frequency[middle], frequency[before], branch().amplitude[before])
    lower = np.interp(frequency[middle], frequency[after], branch().amplitude[after])
    ends = sorted(settled(middle, disturbance) for disturbance in (-0.02, 0.02))
    assert ends == pytest.approx([lower, upper], rel=2e-3)
