"""Terms that are fitted where they are asked for by name, recovered from motions that scipy integrated."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.unit.identify_signals import OMEGA, motion, noisy

import sinew as sn
from sinew.identify.oscillator.comparison import laws_to_try
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.model import MODELS, Fit, get_model
from sinew.identify.oscillator.record import make_record
from sinew.identify.points import ResponsePoints, make_points
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


@pytest.mark.parametrize("name", [name for name in MODELS if name.startswith("bouc-wen")])
def test_the_race_of_models_tries_hysteresis_only_beside_a_winner(name: str) -> None:
    assert get_model(name) not in laws_to_try()


def dragged_steps(levels: tuple[float, ...]) -> list[ResponsePoints]:
    """Return steady states under viscous damping and drag, a group for each level of the push [rad/s²].

    All are integrated at once over the phase of their drives, until exp(-2πnD Ω₀/Ω) = 1e-6 of the start is left.
    """
    hertz = np.tile(np.linspace(2.4, 3.6, 9), len(levels))
    push, omega, last = np.repeat(levels, 9), 2 * np.pi * hertz, 2 * np.pi * 140

    def rate(phase: float, y: np.ndarray) -> np.ndarray:
        r, v = y.reshape(2, -1)
        force = 2 * VISCOUS * OMEGA * v + DRAG * abs(v) * v + OMEGA**2 * r
        return np.concatenate([v, push * np.cos(phase) - force]) / np.tile(omega, 2)

    phase = last + 2 * np.pi * np.arange(256) / 256
    done = solve_ivp(rate, (0, phase[-1]), np.zeros(2 * hertz.size), "DOP853", phase, rtol=1e-9, atol=1e-11)
    wave = 2 * np.mean(done.y[: hertz.size] * np.exp(-1j * phase), axis=1) / push
    noise = 2e-4 * np.abs(wave).max() * np.random.default_rng(4).standard_normal((2, wave.size))
    wave, std = wave + noise[0] + 1j * noise[1], 2e-4 * np.abs(wave).max()
    rows = (slice(k, k + 9) for k in range(0, hertz.size, 9))
    return [make_points(hertz[k], wave[k], std, push[k], excitation="force", output_unit="rad") for k in rows]


@pytest.mark.slow
@pytest.mark.long
def test_the_drag_of_a_stepped_sine_and_the_damping_beside_it_are_told_by_two_levels_of_the_drive() -> None:
    found = sn.identify(dragged_steps((2.0, 20.0)), "drag").response
    assert found is not None
    assert (found.parameters["drag_per_rad"].value, found.parameters["damping_per_s"].value) == (
        pytest.approx(DRAG, rel=0.01),
        pytest.approx(2 * VISCOUS * OMEGA, rel=0.01),
    )


def test_a_stepped_response_is_refused_with_a_term_whose_inner_state_its_balance_does_not_follow() -> None:
    frequency = np.linspace(2, 4, 9)
    points = make_points(frequency, 1 / (9 - frequency**2 + 0.3j * frequency), 1e-3, 0.1, excitation="force")
    with pytest.raises(SpecError, match="Bouc-Wen hysteresis has an inner state"):
        sn.identify(points, "bouc-wen")


@pytest.mark.parametrize(("option", "value"), [("train", (0, 5)), ("posterior", True), ("pretension_mm", 4.0)])
def test_what_is_for_samples_over_time_is_refused_for_steady_states(option: str, value: object) -> None:
    with pytest.raises(SpecError, match=option):
        sn.identify(make_points([2.0, 3.0], [1.0, 1.0], 0.1, 0.1, excitation="force"), **{option: value})
