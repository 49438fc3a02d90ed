"""Predicted curves of oscillators whose response is known in closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sinew.measure.errors import SpecError
from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
from sinew.solve.branch import Branch
from sinew.solve.curves import predict
from sinew.solve.examination import largest_multiplier, maps_of, rows_of
from sinew.solve.programs import configure

configure()
INERTIA, NATURAL_HZ, DAMPING = 12.74e-3, 3.0, 0.05
BAND_HZ = (1.0, 6.0)


def oscillator(**changed: float) -> Oscillator:
    values = {"inertia": INERTIA, "frequency_hz": NATURAL_HZ, "damping_ratio": DAMPING, "torque": 0.45}
    return Oscillator(**(values | changed))


def curve(one: Oscillator, band_hz: tuple[float, float] = BAND_HZ) -> Branch:
    return predict(oscillator_problem([one], band_hz), band_hz, resolution_of([one])).branches[0]


@pytest.fixture(scope="module")
def linear() -> Branch:
    return curve(oscillator())


@pytest.fixture(scope="module")
def hardening() -> Branch:
    return curve(oscillator(cubic=6.0))


def transfer(frequency_hz: np.ndarray, damping: float = DAMPING) -> np.ndarray:
    """Return rotation over static rotation of the linear oscillator, complex."""
    ratio = frequency_hz / NATURAL_HZ
    return 1 / (1 - ratio**2 + 2j * damping * ratio)


def test_a_linear_oscillator_has_amplitude_lag_and_peak_of_its_transfer_function(linear: Branch) -> None:
    static = 0.45 / oscillator().stiffness
    assert linear.amplitude == pytest.approx(static * np.abs(transfer(linear.frequency_hz)), rel=1e-9)
    assert linear.phase == pytest.approx(-np.angle(transfer(linear.frequency_hz)), abs=1e-9)
    assert linear.peak is not None
    assert linear.peak.frequency_hz == pytest.approx(NATURAL_HZ * np.sqrt(1 - 2 * DAMPING**2), rel=1e-9)
    assert linear.peak.amplitude == pytest.approx(static / (2 * DAMPING * np.sqrt(1 - DAMPING**2)), rel=1e-9)


def test_a_linear_oscillator_has_no_fold_and_decays_with_its_damping(linear: Branch) -> None:
    decay = np.exp(-DAMPING * 2 * np.pi * NATURAL_HZ / linear.frequency_hz)
    assert linear.folds == ()
    assert linear.multiplier == pytest.approx(decay, rel=1e-3)


def test_a_turning_base_moves_a_linear_oscillator_as_the_closed_form_says() -> None:
    branch = curve(oscillator(torque=0.0, base=0.1))
    ratio = branch.frequency_hz / NATURAL_HZ
    assert branch.amplitude == pytest.approx(0.1 * ratio**2 * np.abs(transfer(branch.frequency_hz)), rel=1e-9)


def test_a_hardening_oscillator_is_unstable_between_its_folds_and_nowhere_else(hardening: Branch) -> None:
    back = np.diff(hardening.frequency_hz) < 0
    upper, lower = hardening.folds
    on_the_way_back = np.append(back, False) & np.append(False, back)
    assert upper.frequency_hz > lower.frequency_hz
    assert on_the_way_back.sum() > 5
    assert not hardening.stable[on_the_way_back].any()
    assert hardening.stable[~np.append(back, False) & ~np.append(False, back)].all()


def test_the_multipliers_of_a_curve_are_those_of_its_refined_motions(hardening: Branch) -> None:
    one = [oscillator(cubic=6.0)]
    problem = oscillator_problem(one, BAND_HZ)
    fine = next(fine for _, fine in resolution_of(one).sizes if fine.harmonics == hardening.waves)
    lane = rows_of(problem.lane, np.zeros(hardening.frequency_hz.size, dtype=int))
    omega = 2 * np.pi * hardening.frequency_hz / lane.omega
    x = np.column_stack([hardening.motion / lane.scale[:, :1], omega])
    there = largest_multiplier(maps_of(x, lane, problem.equations, fine), problem.equations)
    assert hardening.multiplier == pytest.approx(there, rel=2e-4)


def test_a_hardening_oscillator_scales_with_its_stiffness_and_its_amplitude(hardening: Branch) -> None:
    # φ = a y turns k₃ into k₃ a² and M into M/a: the same curve, a thousand times smaller.
    small = curve(oscillator(cubic=6.0e6, torque=0.45e-3))
    for one, other in zip((*small.folds, small.peak), (*hardening.folds, hardening.peak), strict=True):
        assert one is not None
        assert other is not None
        assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=1e-9)
        assert one.amplitude == pytest.approx(1e-3 * other.amplitude, rel=1e-9)


def test_a_softening_oscillator_leans_to_the_left_along_its_backbone() -> None:
    branch = curve(oscillator(cubic=-3.0, torque=0.2))
    assert branch.peak is not None
    backbone = NATURAL_HZ * np.sqrt(1 - 0.75 * 3.0 * branch.peak.amplitude**2 / oscillator().stiffness)
    assert backbone < 0.96 * NATURAL_HZ
    assert branch.peak.frequency_hz == pytest.approx(backbone, rel=1e-2)


@pytest.mark.parametrize("ratio", [1.25, 1.5])
def test_dry_friction_alone_gives_den_hartogs_amplitude(ratio: float) -> None:
    # J. P. Den Hartog 1931: forced motion without rest, A = (M/k) sqrt(V² - (M_c/M)² U²).
    one = oscillator(damping_ratio=1e-5, coulomb=0.09)
    branch = curve(one, (NATURAL_HZ * (ratio - 0.1), NATURAL_HZ * ratio))
    turn = np.pi / ratio
    v, u = 1 / (1 - ratio**2), np.sin(turn) / (ratio * (1 + np.cos(turn)))
    expected = 0.45 / one.stiffness * np.sqrt(v**2 - 0.2**2 * u**2)
    assert branch.amplitude[-1] == pytest.approx(expected, rel=5e-3)


def test_a_quadratic_spring_shifts_the_mean_against_its_force() -> None:
    branch = curve(oscillator(quadratic=1.0, torque=0.1), (1.0, 1.5))
    mean = branch.harmonics[:, 0].real
    # To second order in the amplitude k r₀ + k₂ A²/2 = 0.
    assert mean == pytest.approx(-0.5 * branch.fundamental**2 / oscillator().stiffness, rel=2e-2)


def test_oscillators_in_one_call_are_those_of_calls_of_their_own(hardening: Branch) -> None:
    others = [oscillator(cubic=6.0, frequency_hz=hertz) for hertz in (2.5, 3.0, 3.5, 4.0, 4.5)]
    together = predict(oscillator_problem(others, BAND_HZ), BAND_HZ, resolution_of(others)).branches
    assert together[1].peak is not None
    assert hardening.peak is not None
    assert together[1].peak.amplitude == pytest.approx(hardening.peak.amplitude, rel=1e-10)
    assert together[1].frequency_hz == pytest.approx(hardening.frequency_hz, rel=1e-6)


def test_friction_that_takes_up_most_of_the_torque_is_remarked_on() -> None:
    assert oscillator(coulomb=0.2).friction_remark() == ""
    assert "dry friction is 60% of the torque" in oscillator(coulomb=0.27).friction_remark()


def test_friction_that_takes_up_most_of_the_torque_leaves_a_curve_through_the_band() -> None:
    assert curve(oscillator(coulomb=0.85 * 0.45), (1.5, 5.0)).complete


REFUSED = {
    "no drive": ({"torque": 0.0}, "drives"),
    "negative inertia": ({"inertia": -1.0}, "inertia is -1"),
    "no damping": ({"damping_ratio": 0.0}, "damping_ratio is 0"),
    "sticking": ({"coulomb": 0.5}, "sticks"),
    "negative friction": ({"coulomb": -0.1}, "zero or more"),
    "drag that gives energy": ({"drag": -0.1}, r"drag is -0\.1"),
}


@pytest.mark.parametrize(("changed", "sentence"), REFUSED.values(), ids=REFUSED.keys())
def test_an_oscillator_that_cannot_be_meant_is_refused_with_a_sentence(
    changed: dict[str, float], sentence: str
) -> None:
    with pytest.raises(SpecError, match=sentence):
        oscillator(**changed).checked()


@pytest.mark.slow
def test_a_drag_that_takes_up_most_of_the_torque_lets_it_swing_as_time_integration_does() -> None:
    one = oscillator(drag=0.05)
    mark = curve(one).phase_90
    assert mark is not None
    omega, damping = 2 * np.pi * mark.frequency_hz, 2 * DAMPING * np.sqrt(one.stiffness * INERTIA)

    def rate(t: float, y: np.ndarray) -> list[float]:
        lost = damping * y[1] + 0.05 * abs(y[1]) * y[1]
        return [y[1], (0.45 * np.sin(omega * t) - lost - one.stiffness * y[0]) / INERTIA]

    last = np.linspace(30, 31, 501) * 2 * np.pi / omega
    swing = solve_ivp(rate, (0.0, last[-1]), [0.0, 0.0], t_eval=last, rtol=1e-8, atol=1e-10).y[0]
    assert mark.amplitude == pytest.approx(0.5 * np.ptp(swing), rel=1e-4)
    assert mark.amplitude < 0.4 * 0.45 / (damping * omega)
