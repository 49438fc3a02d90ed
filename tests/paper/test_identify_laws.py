"""Is the damping law found when the data can tell it, and is it admitted when they cannot?

The oscillations are made by scipy's integrator (`campaigns.laws`); what can be told is decided on records
without noise. `python -m campaigns.laws --seeds 20` is the same with more of them.
"""

from functools import cache

import pytest
from campaigns.laws import EXCITATIONS, LAWS, Outcome, run_trial

pytestmark = [pytest.mark.slow, pytest.mark.long]


@cache
def outcomes() -> tuple[Outcome, ...]:
    """Return every law under every excitation, with a linear and a cubic spring in turn."""
    return tuple(
        run_trial(law, kind, cubic=bool((i + j) % 2), seed=0)
        for i, law in enumerate(LAWS)
        for j, kind in enumerate(EXCITATIONS)
    )


def test_the_law_is_picked_in_nine_of_ten_records_that_can_tell_it() -> None:
    told = [one for one in outcomes() if one.margin == "can tell"]
    assert len(told) >= 6
    assert sum(one.verdict == "picked" for one in told) >= 0.9 * len(told)


def test_a_record_that_cannot_tell_the_law_leads_to_no_wrong_verdict() -> None:
    unsure = [one for one in outcomes() if one.margin != "can tell"]
    assert [one for one in unsure if one.verdict == "wrong"] == []


def test_the_generating_law_leaves_less_than_a_tenth_of_the_noise_of_a_record_without_noise() -> None:
    # Two independent simulations agree; the loss factor is a constant of another Prony series.
    exact = [one for one in outcomes() if one.truth.law != "loss-factor"]
    assert max(one.own_misfit for one in exact) < 0.1
