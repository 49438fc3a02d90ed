"""Does D stay constant: asked of ring-downs whose damping law is known beforehand."""

import numpy as np
import xarray as xr
from tests.unit.identify_campaigns import PRETENSIONS

from sinew.identify.answer import CANNOT_TELL
from sinew.identify.answer_constancy import answer_constancy


def decays(law: float, noise: float, seed: int, repeats: int = 3) -> xr.Dataset:
    """Return ring-down results at 3 to 4.3 Hz with D = 0.08 times (3 Hz/f)^law and relative noise."""
    frequency = np.linspace(3.0, 4.3, PRETENSIONS.size)
    rng = np.random.default_rng(seed)
    true = (0.08 * (3.0 / frequency) ** law)[:, None]
    damping = true * (1 + noise * rng.standard_normal((PRETENSIONS.size, repeats)))
    dims = ("pretension_mm", "repeat")
    return xr.Dataset(
        {
            "pretension_mm": ("pretension_mm", PRETENSIONS),
            "damping_ratio": (dims, damping),
            "damping_ratio_std": (dims, np.full_like(damping, 0.08 * noise)),
            "decay_frequency_hz": (dims, np.broadcast_to(frequency[:, None], damping.shape).copy()),
            "paper_lehr_damping": (dims, 1.003 * damping),
        }
    )


def test_a_constant_d_is_called_constant_and_both_laws_are_ruled_out() -> None:
    answer = answer_constancy(decays(0.0, 0.03, seed=1))
    assert answer.verdict == "constant within chance"
    change = answer.numbers["relative_change"]
    assert change.low < 0 < change.high
    assert answer.numbers["change_by_silicone_alone"].value < answer.numbers["change_by_constant_d"].value < change.low


def test_a_constant_damping_constant_makes_d_fall_by_what_it_should() -> None:
    answer = answer_constancy(decays(1.0, 0.02, seed=2))
    assert answer.verdict == "falls"
    change = answer.numbers["relative_change"]
    assert change.low <= answer.numbers["change_by_constant_d"].value <= change.high


def test_repeats_that_scatter_too_much_leave_it_open_whether_d_is_constant() -> None:
    answer = answer_constancy(decays(0.0, 0.6, seed=3))
    assert answer.verdict == CANNOT_TELL
    assert answer.numbers["detectable_change"].value > abs(answer.numbers["change_by_constant_d"].value)


def test_the_trend_of_a_constant_d_is_called_beyond_chance_in_at_most_a_tenth_of_the_recordings() -> None:
    verdicts = [answer_constancy(decays(0.0, 0.03, seed=100 + i)).verdict for i in range(200)]
    assert sum(verdict in ("rises", "falls") for verdict in verdicts) <= 26


def test_one_pretension_cannot_tell_a_trend_of_d() -> None:
    answer = answer_constancy(decays(0.0, 0.03, seed=4).isel(pretension_mm=[0]))
    assert answer.verdict == CANNOT_TELL
    assert "at 1 pretension" in answer.sentences[0]
