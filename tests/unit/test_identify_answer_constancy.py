"""Does D stay constant: asked of ring-downs whose damping law is known beforehand."""

import numpy as np
import xarray as xr
from tests.unit.identify_campaigns import PRETENSIONS

from sinew.paper.answer import CANNOT_TELL
from sinew.paper.sweeps import NOT_DETERMINED, answer_constancy


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


def in_windows(results: xr.Dataset, changes: tuple[float, ...], noise: float = 0.005) -> xr.Dataset:
    """Return the results with a window for each relative change of D over the range, D by the paper's method."""
    rng = np.random.default_rng(9)
    shape = results["damping_ratio"].shape
    x = np.linspace(-0.5, 0.5, shape[0])[:, None, None]
    damping = 0.06 * (1 + np.array(changes) * x) * (1 + noise * rng.standard_normal((*shape, 1)))
    dims = ("pretension_mm", "repeat", "window_start_periods")
    rate = damping * 2 * np.pi * results["decay_frequency_hz"].values[:, :, None]
    return results.assign(
        window_start_periods=np.linspace(0.0, 2.0, len(changes)),
        window_lehr_damping=(dims, damping),
        window_decay_rate_per_s=(dims, rate),
    )


def test_a_d_that_rises_or_falls_with_the_start_of_the_decay_is_not_determined() -> None:
    answer = answer_constancy(in_windows(decays(0.0, 0.01, seed=5), (0.25, 0.1, 0.0, -0.22)))
    assert answer.verdict == NOT_DETERMINED
    assert "between a fall of 22 % and a rise of 25 %" in answer.sentences[0]
    ends = answer.numbers["relative_change_from_0_periods"], answer.numbers["relative_change_from_2_periods"]
    assert ends[0].low < 0.25 < ends[0].high
    assert ends[1].low < -0.22 < ends[1].high


def test_a_d_that_is_the_same_from_every_start_on_keeps_its_verdict() -> None:
    answer = answer_constancy(in_windows(decays(0.0, 0.03, seed=1), (0.0, 0.0, 0.0)))
    assert answer.verdict == "constant within chance"


def test_a_d_that_falls_from_every_start_on_falls() -> None:
    answer = answer_constancy(in_windows(decays(1.0, 0.02, seed=2), (-0.30, -0.36, -0.42)))
    assert answer.verdict == "falls"
    assert "Wherever the decay is taken to begin" in answer.sentences[1]
