import pytest
from campaigns.options import spread_trials
from campaigns.recovery import covered, run_trial, table

from sinew.measure.tasks import Spread

pytestmark = [pytest.mark.slow, pytest.mark.long]


def test_hidden_rigs_lie_inside_their_intervals_as_often_as_they_should() -> None:
    trials = list(spread_trials(run_trial, range(20), spread=Spread(workers=2)))
    assert all(trial.converged for trial in trials)
    assert 0.85 <= covered(trials) <= 0.95, table(trials)
