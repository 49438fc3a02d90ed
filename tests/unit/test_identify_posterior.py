"""The posterior of a well-determined fit, which is what its covariance says, and the diagnosis of its chains."""

import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from tests.unit.identify_signals import motion, noisy, viscous

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.least_squares import covariance
from sinew.identify.oscillator.model import Fit
from sinew.identify.oscillator.posterior import (
    Posterior,
    density_of,
    effective_number,
    log_density,
    sample_posterior,
    split_r_hat,
)
from sinew.identify.oscillator.record import make_record
from sinew.measure.errors import SpecError

TIME = np.arange(0, 1.2, 0.0075)


@cache
def decay(correlation: float = 0.0) -> Fit:
    """Return the fit to a well-determined decay, with noise whose neighbours are correlated."""
    x = motion(viscous(0.1), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    noise = np.random.default_rng(21).normal(0, 0.005, TIME.size + 100)
    for i in range(1, noise.size):
        noise[i] += correlation * noise[i - 1]
    return fit(make_record(TIME, x + noise[100:], output_unit="rad"), "linear")


@cache
def sampled(correlation: float = 0.0) -> Posterior:
    return sample_posterior(decay(correlation), seed=4, draws=500, warmup=150, chains=4)


def told(found: Fit):
    return found.parameters | {
        "natural_frequency_hz": found.natural_frequency_hz,
        "damping_ratio": found.damping_ratio,
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stiffness_per_s2", "damping_per_s", "natural_frequency_hz", "damping_ratio"])
def test_of_a_well_determined_decay_the_posterior_is_the_normal_one_of_the_covariance(name: str) -> None:
    found, known = sampled().estimates[name], told(decay())[name]
    off = [(found.low - known.low) / known.std, (found.high - known.high) / known.std]
    assert [*off, found.std / known.std - 1] == pytest.approx([0, 0, 0], abs=0.15)


@pytest.mark.slow
def test_correlated_noise_widens_the_posterior_as_it_widens_the_robust_covariance() -> None:
    found, known = sampled(0.8).estimates["damping_ratio"], decay(0.8).damping_ratio
    classical = covariance(decay(0.8).solution.jacobian, decay(0.8).solution.residual).std
    k = [entry.local for entry in decay(0.8).layout.entries].index("damping")
    assert decay(0.8).covariance.std[k] > 1.3 * classical[k]
    assert found.std == pytest.approx(known.std, rel=0.15)


@pytest.mark.slow
def test_the_gradient_of_the_density_is_its_difference() -> None:
    import jax

    laws, density = density_of(decay(0.8))
    u = np.array([0.7, -0.4, 1.1, 0.3, -0.9])

    def value(at: np.ndarray) -> float:
        return float(log_density(at, density, laws))

    steps = 1e-5 * np.eye(5)
    expected = [(value(u + step) - value(u - step)) / 2e-5 for step in steps]
    assert np.asarray(jax.grad(log_density)(u, density, laws)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.slow
def test_records_that_are_fitted_together_have_the_density_of_all_their_residuals() -> None:
    x = motion(viscous(0.1), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    records = [make_record(TIME, noisy(x, 0.005, seed), output_unit="rad") for seed in (31, 32)]
    records.append(make_record(TIME[:120], noisy(x[:120], 0.005, 33), output_unit="rad"))
    together = fit(records, "linear")
    laws, density = density_of(together)
    u = np.full(together.solution.values.size, 0.5)
    x_there = density.optimum + density.root @ u
    risen = np.sum(together.layout.problem(together.selected).residual(x_there) ** 2) - density.least
    y = density.turned @ (x_there - density.optimum)
    q = (y @ density.robust @ y) / (y @ y)
    half = 0.5 * (density.freedom + u.size)
    expected = -half * np.log1p(q * risen / (density.variance * density.freedom))
    expected -= 0.5 * np.sum((x_there / density.widths) ** 2)
    assert float(log_density(u, density, laws)) == pytest.approx(expected, rel=1e-8)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_draws_and_progress_is_told_up_to_the_last() -> None:
    seen: list[tuple[float, float]] = []
    note = lambda *now: seen.append(now)  # noqa: E731
    again = [sample_posterior(decay(), seed=4, draws=20, warmup=150, chains=4, progress=note).draws for _ in range(2)]
    assert np.array_equal(again[0], again[1])
    assert (seen[-1], len(seen)) == ((170, 170), 8)


@pytest.mark.slow
def test_draws_are_those_of_the_named_numbers_and_the_message_tells_how_the_chains_went() -> None:
    found = sampled()
    assert found.message.startswith("2000 draws of 4 chains, R-hat at most 1.0")
    column = {name: found.draws[:, i] for i, name in enumerate(found.names)}
    expected = column["damping_per_s"] / (2 * np.sqrt(column["stiffness_per_s2"]))
    assert column["damping_ratio"] == pytest.approx(expected, rel=1e-12)


def test_too_few_draws_are_refused() -> None:
    with pytest.raises(SpecError, match="expected at least 1 of 20"):
        sample_posterior(decay(), draws=5)


def test_without_numpyro_the_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numpyro", None)
    monkeypatch.setitem(sys.modules, "numpyro.infer.hmc", None)
    with pytest.raises(SpecError, match=r'install it: .* pip install -e "\.\[posterior\]"'):
        sample_posterior(decay())


@pytest.mark.slow
def test_importing_the_module_does_not_load_numpyro() -> None:
    code = "import sys, sinew.identify.oscillator.posterior; print('numpyro' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_independent_draws_are_worth_their_number() -> None:
    draws = np.random.default_rng(1).normal(size=(4, 1000))
    assert effective_number(draws) == pytest.approx(4000, rel=0.1)


def test_correlated_draws_are_worth_what_theory_says() -> None:
    draws = np.random.default_rng(2).normal(size=(4, 4000))
    for i in range(1, draws.shape[1]):
        draws[:, i] += 0.6 * draws[:, i - 1]
    assert effective_number(draws) == pytest.approx(16000 * (1 - 0.6) / (1 + 0.6), rel=0.15)


def test_chains_at_the_same_place_have_an_r_hat_of_one() -> None:
    assert split_r_hat(np.random.default_rng(3).normal(size=(4, 1000))) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("change", [lambda x: x + np.arange(4)[:, None], lambda x: x * 3.0 ** np.arange(4)[:, None]])
def test_chains_at_other_places_or_of_other_widths_have_a_larger_r_hat(change) -> None:
    assert split_r_hat(change(np.random.default_rng(3).normal(size=(4, 1000)))) > 1.1
