"""The paper's open questions, asked of recordings that lack what some of them need."""

import pytest
from tests.unit.identify_campaigns import DECAYS, RIG

from sinew.analysis.analysed import analyse_recording
from sinew.paper.answer import CANNOT_TELL
from sinew.paper.hardening import answer_hardening
from sinew.paper.losses import answer_losses
from sinew.paper.sweeps import answer_constancy, answer_delay, answer_saturation
from sinew.plan.plan import Plan, Pretension, Sweep
from sinew.twin.simulate import simulate


@pytest.mark.slow
def test_ring_downs_alone_tell_neither_saturation_nor_delay() -> None:
    recording = simulate(DECAYS, RIG, seed=34)
    results = analyse_recording(recording, RIG)
    for answer in (answer_saturation(results), answer_delay(results, recording, RIG)):
        assert answer.verdict == CANNOT_TELL
        assert "no sweep" in answer.sentences[0]
    assert answer_hardening(recording, RIG).rows


def test_a_sweep_alone_tells_nothing_of_damping() -> None:
    plan = Plan(name="sweep", pretension=Pretension(pretension_mm=(4.0,)), sweep=Sweep(frequency_hz=(2.5, 3.2), repeats=1))  # fmt: skip  # noqa: E501
    recording = simulate(plan, RIG, seed=35)
    results = analyse_recording(recording, RIG)
    for answer in (answer_constancy(results), answer_losses(results, recording, None)):
        assert answer.verdict == CANNOT_TELL
        assert "no ring-downs" in answer.sentences[0]
    assert "too few" in str(results.attrs["resonance_notes"])
    assert answer_delay(results, recording, RIG).verdict == CANNOT_TELL
