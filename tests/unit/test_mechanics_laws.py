"""Laws of one degree of freedom: how terms add up, and that what each says of itself goes together."""

import jax
import numpy as np
import pytest

from sinew.identify.oscillator.comparison import laws_to_try
from sinew.measure.errors import SpecError
from sinew.mechanics import laws

SPRINGS = [term for term in laws.TERMS if not term.lost]
SIZES = {number.name: 0.3 for term in laws.TERMS for number in term.numbers} | {"amplitude": 1.0}
each_spring = pytest.mark.parametrize("spring", SPRINGS, ids=lambda term: type(term).__name__)


def test_a_sum_does_not_depend_on_the_order_in_which_its_terms_were_added() -> None:
    assert hash(laws.Cubic() + (laws.Viscous() + laws.Linear())) == hash(laws.Linear() + laws.Viscous() + laws.Cubic())
    assert laws.Cubic() + (laws.Viscous() + laws.Linear()) == laws.Linear() + laws.Viscous() + laws.Cubic()


@pytest.mark.parametrize(
    ("law", "term"),
    [(laws.Linear() + laws.Viscous(), laws.Viscous()), (laws.Linear() + laws.Viscous(), laws.Pendulum())],
)
def test_a_term_twice_and_a_second_linear_spring_are_refused(law: laws.Law, term: laws.Term) -> None:
    with pytest.raises(SpecError, match="twice"):
        law + term


@each_spring
def test_a_springs_force_is_the_slope_of_what_it_stores(spring: laws.Term) -> None:
    r, step = np.linspace(-1, 1, 9), 1e-5
    slope = (spring.stored(SIZES, r + step) - spring.stored(SIZES, r - step)) / (2 * step)
    assert np.asarray(spring.force(SIZES, r, 0.0, ())) == pytest.approx(slope, abs=1e-7)


def swing(amplitude: float, omega: float) -> laws.Cycle:
    """Return a harmonic swing."""
    u = ((np.arange(2000) + 0.5) / 2000 - 0.5) * np.pi
    cos = amplitude * np.cos(u)[None]
    return laws.Cycle(np.array([amplitude]), amplitude * np.sin(u)[None], omega * cos, cos * np.pi / 2000)


@pytest.mark.parametrize(
    ("term", "lost"),
    [
        (laws.Viscous(), np.pi * 0.3 * 2.0 * 0.5**2),
        (laws.DryFriction(), 4 * 0.3 * 0.5),
        (laws.LossFactor(), np.pi * 0.3 * 0.3 * 0.5**2),
        (laws.Drag(), 8 / 3 * 0.3 * 2.0**2 * 0.5**3),
    ],
    ids=["viscous", "dry friction", "loss factor", "drag"],
)
def test_a_harmonic_swing_loses_what_textbooks_say(term: laws.Term, lost: float) -> None:
    assert term.dissipated(SIZES, swing(0.5, 2.0)) == pytest.approx(lost, rel=1e-5)


@pytest.mark.parametrize("amplitude", [0.2, 1.0])
def test_a_steady_swing_loses_the_area_of_the_bouc_wen_loop(amplitude: float) -> None:
    term, moved = laws.BoucWen(), np.diff(amplitude * np.sin(np.linspace(0, 20 * np.pi, 20001)))

    def step(w: jax.Array, dr: jax.Array) -> tuple[jax.Array, jax.Array]:
        first = term.rate(SIZES, 0.0, dr, w)
        after = w + 0.5 * (first + term.rate(SIZES, 0.0, dr, w + first))
        return after, SIZES["hysteresis"] * 0.5 * (w + after) * dr

    area = float(np.sum(jax.lax.scan(step, 0.0, moved)[1][-2000:]))
    assert term.dissipated(SIZES, swing(amplitude, 1.0)) == pytest.approx(area, rel=1e-3)


def test_springs_of_all_powers_share_one_compiled_program_with_each_damping_law() -> None:
    assert len({model.law.compiled for model in laws_to_try()}) == 5  # three, and a pendulum's with friction or not


@pytest.mark.parametrize(
    ("name", "over", "full"),
    [
        ("stiffness", "stiffness_per_s2", "stiffness_n_m_per_rad"),
        ("damping", "damping_per_s", "damping_n_m_s_per_rad"),
        ("coulomb", "coulomb_rad_per_s2", "coulomb_n_m"),
        ("cubic", "cubic_per_s2_rad2", "cubic_n_m_per_rad3"),
    ],
)
def test_a_numbers_name_carries_its_unit(name: str, over: str, full: str) -> None:
    number = next(number for term in laws.TERMS for number in term.numbers if number.name == name)
    assert (number.over_inertia("rad"), number.in_full("n_m", "rad")) == (over, full)


def test_a_search_takes_hysteresis_for_dry_friction_first() -> None:
    speed = np.array([-3.0, 2.0])
    (one, order), (other, same) = (term.regressor(0 * speed, speed) for term in (laws.BoucWen(), laws.DryFriction()))
    assert (order, one.tolist()) == (same, pytest.approx(other.tolist()))
