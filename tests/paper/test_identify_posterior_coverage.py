"""Intervals of profile, posterior and bootstrap: how often they hold the truth, and where they leave the symmetric one.

A larger count, and all scenarios: `python -m campaigns.intervals`.
"""

from functools import cache

import numpy as np
import pytest
from campaigns.intervals import Row, coverage, repeat_trial, run_trial
from scipy.stats import binom
from tests.unit.identify_signals import OMEGA, dry_decay, motion, noisy, viscous

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.fitted import Fit
from sinew.identify.oscillator.posterior import Posterior, sample_posterior
from sinew.identify.oscillator.profile import interval90
from sinew.identify.oscillator.record import make_record
from sinew.measure.estimate import Estimate

pytestmark = [pytest.mark.slow, pytest.mark.long]

TIME = np.arange(0, 1.2, 0.0075)
CUBIC = "cubic_per_s2_rad2"


@cache
def springs() -> list[Row]:
    return [row for seed in range(30) for row in run_trial("cubic", seed, 200)]


@cache
def frictions() -> list[Row]:
    return [row for seed in range(60) for row in run_trial("friction", seed, methods=("covariance", "profile"))]


@cache
def repeats() -> list[Row]:
    return [row for seed in range(40) for row in repeat_trial(seed)]


def chance_of(count: int) -> tuple[float, float]:
    """Return the shares between which a fair 90 % interval stays in 99 of 100 such tests, by the binomial law."""
    low, high = binom.interval(0.99, count, 0.9)
    return low / count, high / count


@pytest.mark.parametrize("method", ["profile", "posterior"])
@pytest.mark.parametrize("name", [CUBIC, "stiffness_per_s2"])
def test_of_a_short_noisy_decay_nine_of_ten_intervals_hold_the_spring(name: str, method: str) -> None:
    share, count = coverage(springs(), "cubic", name, method)
    low, high = chance_of(count)
    assert low <= share <= high


@pytest.mark.parametrize("name", ["coulomb_rad_per_s2", "damping_per_s"])
def test_nine_of_ten_profiles_hold_the_dry_and_the_viscous_friction(name: str) -> None:
    share, count = coverage(frictions(), "friction", name, "profile")
    low, high = chance_of(count)
    assert low <= share <= high


def test_nine_of_ten_bootstraps_of_three_repeats_hold_the_frequency_they_share() -> None:
    share, count = coverage(repeats(), "3 repeats", "natural_frequency_hz", "bootstrap")
    low, high = chance_of(count)
    assert low <= share <= high


def test_the_covariance_of_three_repeats_that_differ_holds_it_in_less_than_two_of_three() -> None:
    assert coverage(repeats(), "3 repeats", "natural_frequency_hz", "covariance")[0] < 2 / 3


@cache
def hardly_told() -> tuple[Fit, Posterior]:
    """Return fit and posterior of a cubic spring in 1.2 s of a decay under noise of a third of its amplitude."""
    x = motion(viscous(0.1, cubic=3 * OMEGA**2), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    found = fit(make_record(TIME, noisy(x, 0.15, 1), output_unit="rad"), "cubic")
    return found, sample_posterior(found, seed=4, draws=500, warmup=150, chains=4)


def test_of_a_spring_that_is_hardly_told_posterior_and_profile_agree_better_than_with_the_covariance() -> None:
    found, posterior = hardly_told()
    drawn, profiled = posterior.estimates[CUBIC], interval90(found, CUBIC)
    assert profiled is not None

    def apart(other: Estimate) -> float:
        return abs(drawn.low - other.low) + abs(drawn.high - other.high)

    assert apart(profiled) < 0.75 * apart(found.parameters[CUBIC])


def test_what_the_record_does_not_tell_is_said_beside_the_draws() -> None:
    found, posterior = hardly_told()
    assert found.unidentifiable
    assert f"{found.unidentifiable[0]}: there the prior speaks" in posterior.message


def test_draws_of_dry_friction_are_never_negative() -> None:
    record = make_record(TIME, noisy(dry_decay(TIME, 0.5, 0.0, 0.3, 0.1), 0.02, 3), output_unit="rad")
    found = sample_posterior(fit(record, "coulomb"), draws=50, warmup=50)
    assert found.draws[:, found.names.index("coulomb_rad_per_s2")].min() >= 0
