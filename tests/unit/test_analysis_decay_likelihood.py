"""Ring-downs by maximum likelihood: trials with a known answer, beside the Cramér-Rao bound."""

import numpy as np
import pytest
from scipy.optimize import check_grad
from tests.unit.ring_down_signals import Decay, coloured, times

from sinew.analysis.decay.decay_fit import FreeOscillation, fit_likelihood, polynomials
from sinew.analysis.decay.modes import fit_modes

NOISE_DEG = 0.3
DAMPINGS = (0.05, 0.1, 0.17, 0.25)


def record(damping: float, seed: int, drift: str = "none", hz: float = 100.0):
    """Return (time, angle in degrees) of 3 s of free decay from 30 degrees about a rest position that may drift."""
    rng = np.random.default_rng([5, seed, int(1000 * damping)])
    t = times(sample_hz=hz)
    noise = rng.standard_normal(t.size) if hz == 100.0 else coloured(rng, t.size)
    rest = {"none": 0.0, "line": t, "creep": 2.0 * np.exp(-t / 0.8)}[drift]
    return t, Decay(damping, phase=rng.uniform(0, 2 * np.pi)).angle(t) + NOISE_DEG * noise + rest + 4.0


def bound(damping: float) -> float:
    """Return the Cramér-Rao bound of D for white noise, level and slope unknown, averaged over the phase."""
    t, decay = times(), Decay(damping)
    rate, omega = decay.decay_rate, decay.omega
    stds = []
    for phase in np.linspace(0, np.pi, 12, endpoint=False):
        wave = 30.0 * np.exp((1j * omega - rate) * t + 1j * phase)
        columns = [-t * wave.real, -t * wave.imag, wave.real / 30, wave.imag / 30, np.ones_like(t), t]
        jacobian = np.stack(columns, axis=1)
        covariance = NOISE_DEG**2 * np.linalg.inv(jacobian.T @ jacobian)
        natural = np.hypot(rate, omega)
        gradient = np.array([omega**2, -rate * omega]) / natural**3
        stds.append(np.sqrt(gradient @ covariance[:2, :2] @ gradient))
    return float(np.mean(stds))


def test_the_stated_deviation_of_the_damping_is_the_cramer_rao_bound() -> None:
    stated = [fit_modes(*record(0.17, seed), free_from_s=0.0, modes=1).modes[0].damping_ratio.std for seed in range(30)]
    assert np.mean(stated) == pytest.approx(bound(0.17), rel=0.05)


@pytest.mark.parametrize("harmonics", [False, True])
@pytest.mark.parametrize("relaxing", [False, True])
def test_the_derivatives_of_the_oscillation_are_those_of_differences(harmonics: bool, relaxing: bool) -> None:
    s = np.linspace(0, 1, 40)
    count = 1 if harmonics else 2
    model = FreeOscillation(s, (polynomials(s, 3),) * count, polynomials(s, 2), relaxing, harmonics)
    p = np.random.default_rng(2).uniform(0.1, 0.6, model.width)
    for i in range(s.size):
        off = check_grad(lambda q, i=i: model.values(q)[i], lambda q, i=i: model.jacobian(q)[i], p)
        assert off < 1e-5


def test_a_mean_under_known_coloured_noise_is_the_generalised_least_squares_mean() -> None:
    rng = np.random.default_rng(3)
    noise = np.zeros(4000)
    for i in range(1, noise.size):
        noise[i] = 0.9 * noise[i - 1] + rng.standard_normal()
    fit = fit_likelihood(lambda p: (np.full(4000, p[0]), lambda: np.ones((4000, 1))), np.zeros(1), noise + 5.0)
    # A long AR(1) mean has the deviation 1/(1 - a)/sqrt(n) of its innovations.
    assert np.sqrt(fit.covariance[0, 0]) == pytest.approx(10.0 / np.sqrt(4000), rel=0.15)


@pytest.mark.slow
def test_the_scatter_of_the_damping_is_within_a_tenth_of_the_bound() -> None:
    found = [fit_modes(*record(0.17, seed), free_from_s=0.0, modes=1).modes[0].damping_ratio for seed in range(200)]
    assert np.std([damping.value for damping in found]) < 1.1 * bound(0.17)


@pytest.mark.slow
@pytest.mark.parametrize(("drift", "hz"), [("creep", 100.0), ("none", 200.0)], ids=["creep", "gyroscope"])
def test_the_interval_of_one_mode_holds_under_a_creeping_rest_and_under_coloured_noise(drift: str, hz: float) -> None:
    inside = []
    for damping in DAMPINGS:
        for seed in range(50):
            fit = fit_modes(*record(damping, seed, drift, hz), free_from_s=0.0, modes=1, creeps=drift == "creep")
            inside.append(fit.modes[0].damping_ratio.low <= damping <= fit.modes[0].damping_ratio.high)
    assert 0.85 <= np.mean(inside) <= 0.95
