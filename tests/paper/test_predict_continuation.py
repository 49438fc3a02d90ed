"""Curves of rigs that were drawn anywhere inside their bounds; more of them: `python -m campaigns.continuation`."""

from functools import cache

import numpy as np
import pytest
from campaigns.continuation import Trial, run_trials

pytestmark = [pytest.mark.slow, pytest.mark.long]


@cache
def trials() -> tuple[Trial, ...]:
    return tuple(run_trials(range(14)))


def test_no_rig_within_its_bounds_ends_the_computation() -> None:
    assert [t.reason for t in trials() if t.outcome == "crash"] == []


def test_a_curve_that_is_not_whole_says_why() -> None:
    assert all(t.reason for t in trials() if t.outcome != "whole")


def test_all_curves_but_one_reach_the_end_of_the_band() -> None:
    assert sum(t.outcome in ("whole", "with a remark") for t in trials()) >= len(trials()) - 1


def test_the_twin_swings_as_most_whole_curves_say() -> None:
    whole = [t for t in trials() if t.outcome == "whole" and np.isfinite(t.off)]
    near = [abs(t.off) < 5e-3 and abs(t.off_deg) < 0.5 for t in whole]
    assert len(whole) >= 5
    assert np.mean(near) >= 0.8
