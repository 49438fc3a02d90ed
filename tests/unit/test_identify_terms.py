"""Terms that are fitted where they are asked for by name, recovered from motions that scipy integrated."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.unit.identify_signals import OMEGA, motion, noisy

from sinew.identify.choice.comparison import laws_to_try
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.fitted import Fit, swing_of
from sinew.identify.oscillator.model import MODELS, get_model
from sinew.identify.oscillator.record import make_record
from sinew.identify.stepped.fit import fit_response
from sinew.identify.stepped.points import make_points
from sinew.measure.errors import SpecError

TIME = np.arange(0, 3, 0.01)
VISCOUS, DRAG = 0.02, 0.5  # D; 1/rad


@cache
def dragged(seed: int) -> Fit:
    """Return the fit to a decay under viscous damping and drag."""
    x = motion(lambda r, v: 2 * VISCOUS * OMEGA * v + DRAG * abs(v) * v + OMEGA**2 * r, lambda t: 0.0, TIME, (0.5, 0.0))
    return fit(make_record(TIME, noisy(x[0], 0.003, seed), output_unit="rad"), "drag")


def holds(found: Fit, name: str, truth: float) -> bool:
    return found.parameters[name].low <= truth <= found.parameters[name].high


def test_the_drag_of_a_decay_and_the_damping_beside_it_lie_in_their_intervals() -> None:
    assert holds(dragged(0), "drag_per_rad", DRAG)
    assert holds(dragged(0), "damping_per_s", 2 * VISCOUS * OMEGA)


def test_with_drag_the_damping_ratio_grows_with_the_amplitude_by_four_over_three_pi() -> None:
    swing = swing_of(dragged(0))
    assert swing is not None
    drag = dragged(0).parameters["drag_per_rad"].value
    grown = (swing.damping_ratio - dragged(0).damping_ratio.value) / (drag * swing.amplitude)
    assert grown == pytest.approx(4 / (3 * np.pi), rel=2e-3)


YIELDING = {"hysteresis_rad_per_s2": 12.0, "yield_rad": 0.06, "damping_per_s": 2 * VISCOUS * OMEGA}


@cache
def yielding(seed: int) -> Fit:
    """Return the fit to a decay under viscous damping and Bouc-Wen hysteresis, which begins half loaded."""
    level, motion_at_yield, damping = YIELDING.values()

    def rate(t: float, y: np.ndarray) -> list[float]:
        r, v, w = y
        held = w**2 if v * w > 0 else 0.0
        return [v, -(OMEGA**2) * r - damping * v - level * w, v / motion_at_yield * (1 - held)]

    x = solve_ivp(rate, (0, TIME[-1]), (0.5, 0.0, 0.4), t_eval=TIME, rtol=1e-8, atol=1e-10, max_step=0.01).y[0]
    return fit(make_record(TIME, noisy(x, 0.003, seed), output_unit="rad"), "bouc-wen")


@pytest.mark.parametrize("name", YIELDING)
def test_the_hysteresis_of_a_decay_and_where_it_yields_lie_in_their_intervals(name: str) -> None:
    assert holds(yielding(0), name, YIELDING[name])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("found", "name", "truth"), [(dragged, "drag_per_rad", DRAG), *((yielding, *one) for one in YIELDING.items())]
)
def test_the_intervals_of_both_terms_hold_nine_truths_in_ten(found, name: str, truth: float) -> None:
    assert sum(holds(found(seed), name, truth) for seed in range(10)) >= 7  # of a binomial law all but 1 %


def test_small_swings_under_hysteresis_are_those_of_its_spring_in_parallel() -> None:
    swing, found = swing_of(yielding(0), largest=0.02), yielding(0).parameters
    assert swing is not None
    spring = found["hysteresis_rad_per_s2"].value / found["yield_rad"].value
    stiff = np.sqrt(found["stiffness_per_s2"].value + spring) / (2 * np.pi)
    assert swing.frequency_hz[0] == pytest.approx(stiff, rel=2e-3)


@pytest.mark.parametrize("name", [name for name in MODELS if name.startswith(("drag", "bouc-wen"))])
def test_the_race_of_models_leaves_out_what_is_asked_for_by_name(name: str) -> None:
    assert get_model(name) not in laws_to_try()


def test_a_stepped_response_is_refused_with_a_term_that_its_balance_lacks() -> None:
    frequency = np.linspace(2, 4, 9)
    points = make_points(frequency, 1 / (9 - frequency**2 + 0.3j * frequency), 1e-3, 0.1, excitation="force")
    with pytest.raises(SpecError, match="quadratic drag"):
        fit_response(points, "drag")
