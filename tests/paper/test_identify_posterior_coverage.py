"""Intervals of the posterior: how often they hold the truth, and what they say where a record tells little."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import binom
from tests.unit.identify_signals import OMEGA, dry_decay, motion, noisy, viscous

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.posterior import Posterior, sample_posterior
from sinew.identify.oscillator.record import make_record

pytestmark = [pytest.mark.slow, pytest.mark.long]

TIME = np.arange(0, 1.2, 0.0075)
CUBIC = "cubic_per_s2_rad2"
TRUTH = {CUBIC: 1.5 * OMEGA**2, "stiffness_per_s2": OMEGA**2}
TRIALS = 30


@cache
def springs() -> list[Posterior]:
    """Return the posteriors of a cubic spring in 2 s of a decay, under noise of an eighth of its amplitude."""
    t = np.arange(0, 2.0, 1 / 130)
    clean = motion(viscous(0.1, cubic=TRUTH[CUBIC]), lambda _: 0.0, t, (0.5, 0.0))[0]
    fits = [fit(make_record(t, noisy(clean, 0.06, seed), output_unit="rad"), "cubic") for seed in range(TRIALS)]
    return [sample_posterior(one, seed=seed, draws=50, warmup=100, chains=4) for seed, one in enumerate(fits)]


@pytest.mark.parametrize("name", list(TRUTH))
def test_of_a_short_noisy_decay_nine_of_ten_intervals_hold_the_spring(name: str) -> None:
    low, high = binom.interval(0.99, TRIALS, 0.9)
    intervals = [one.estimates[name] for one in springs()]
    assert low <= sum(one.low <= TRUTH[name] <= one.high for one in intervals) <= high


def test_what_the_record_does_not_tell_is_said_beside_the_draws() -> None:
    x = motion(viscous(0.1, cubic=3 * OMEGA**2), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    found = fit(make_record(TIME, noisy(x, 0.15, 1), output_unit="rad"), "cubic")
    posterior = sample_posterior(found, seed=4, draws=500, warmup=150, chains=4)
    assert found.unidentifiable
    assert f"{found.unidentifiable[0]}: there the prior speaks" in posterior.message


def test_draws_of_dry_friction_are_never_negative() -> None:
    record = make_record(TIME, noisy(dry_decay(TIME, 0.5, 0.0, 0.3, 0.1), 0.02, 3), output_unit="rad")
    found = sample_posterior(fit(record, "coulomb"), draws=50, warmup=50)
    assert found.draws[:, found.names.index("coulomb_rad_per_s2")].min() >= 0
