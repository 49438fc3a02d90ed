import pytest
from campaigns.recovery import covered, run_trials, table

pytestmark = pytest.mark.slow


def test_hidden_rigs_lie_inside_their_intervals_as_often_as_they_should() -> None:
    trials = list(run_trials(range(20), workers=2))
    assert all(trial.converged for trial in trials)
    assert 0.85 <= covered(trials) <= 0.95, table(trials)
