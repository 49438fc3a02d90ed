"""Backbones of oscillators whose free motion is known, and what the fundamental alone says of them.

At phase resonance a viscous damper takes up just what the torque puts in, harmonic for harmonic but for those above the
first, which the torque does not have. So the backbone is the free motion without losses, up to the square of damping
ratio times share of the third harmonic.
"""

import json

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipk

from sinew.apps.cli import main
from sinew.predict.linear import equivalent_of_oscillator, harmonic_shares
from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
from sinew.solve.backbone import Backbone, follow_backbones
from sinew.solve.branch import Branch
from sinew.solve.curves import predict
from sinew.solve.programs import configure

configure()
INERTIA, NATURAL_HZ = 12.74e-3, 3.0
BAND_HZ = (1.0, 6.0)
STIFFNESS = INERTIA * (2 * np.pi * NATURAL_HZ) ** 2


def oscillator(**changed: float) -> Oscillator:
    values = {"inertia": INERTIA, "frequency_hz": NATURAL_HZ, "damping_ratio": 0.01, "torque": 0.09}
    return Oscillator(**(values | changed))


def backbone(one: Oscillator, band_hz: tuple[float, float] = BAND_HZ) -> Backbone:
    (found,) = follow_backbones(oscillator_problem([one], band_hz), band_hz, resolution_of([one]))
    return found


def curve(one: Oscillator) -> Branch:
    return predict(oscillator_problem([one], BAND_HZ), BAND_HZ, resolution_of([one])).branches[0]


def free_duffing_hz(amplitude: np.ndarray, cubic: float) -> np.ndarray:
    """Return the frequency of the free, undamped motion: I φ̈ + k φ + k₃ φ³ = 0 by Jacobi's elliptic functions."""
    stiff = STIFFNESS + cubic * amplitude**2
    return np.sqrt(stiff / INERTIA) / (4 * ellipk(cubic * amplitude**2 / (2 * stiff)))


def test_a_linear_oscillator_resonates_at_its_natural_frequency_at_every_amplitude() -> None:
    found = backbone(oscillator())
    damper = 2 * 0.01 * np.sqrt(STIFFNESS * INERTIA)
    assert found.curve.complete
    assert found.share[[0, -1]] == pytest.approx([0.02, 1.0])
    assert found.curve.frequency_hz == pytest.approx(NATURAL_HZ, rel=1e-10)
    assert found.curve.amplitude == pytest.approx(found.share * 0.09 / (damper * 2 * np.pi * NATURAL_HZ), rel=1e-10)


@pytest.mark.parametrize("cubic", [6.0, -3.0])
def test_a_backbone_is_the_free_motion_of_duffings_oscillator(cubic: float) -> None:
    found = backbone(oscillator(cubic=cubic, torque=0.09 if cubic > 0 else 0.04)).curve
    assert np.ptp(found.frequency_hz) > 0.1
    assert found.frequency_hz == pytest.approx(free_duffing_hz(found.amplitude, cubic), rel=3e-7)


def test_what_damping_moves_a_backbone_by_falls_with_its_square() -> None:
    apart = []
    for damping in (0.05, 0.01):
        found = backbone(oscillator(cubic=6.0, damping_ratio=damping, torque=9 * damping)).curve
        apart.append(abs(found.frequency_hz[-1] / free_duffing_hz(found.amplitude, 6.0)[-1] - 1))
    assert apart[1] == pytest.approx(apart[0] / 25, rel=0.02)


def test_a_lopsided_backbone_is_the_free_motion_by_its_integral_of_energy() -> None:
    one = oscillator(quadratic=3.0, damping_ratio=1e-3, torque=0.003)
    found = backbone(one).curve
    coefficients = np.array([3.0 / 3, STIFFNESS / 2, 0.0, 0.0])
    for i in (0, -1):
        # The turning points x and y of a level of energy with (y - x)/2 = amplitude: V(x) = V(y).
        half = found.amplitude[i]
        middle = (-STIFFNESS + np.sqrt(STIFFNESS**2 - 4 * 3.0**2 * half**2 / 3)) / (2 * 3.0)
        top = np.polyval(coefficients, middle + half)

        def slowness(angle: float, middle: float = middle, half: float = half, top: float = top) -> float:
            left = top - np.polyval(coefficients, middle + half * np.sin(angle))
            return float(half * np.cos(angle) / np.sqrt(2 * left / INERTIA))

        period = 2 * quad(slowness, -np.pi / 2 + 1e-7, np.pi / 2 - 1e-7, epsabs=1e-12, epsrel=1e-10)[0]
        assert found.frequency_hz[i] == pytest.approx(1 / period, rel=1e-6)


def test_a_backbone_ends_in_the_point_of_the_curve_at_the_whole_drive_that_lags_by_90_degrees() -> None:
    one = oscillator(cubic=6.0, damping_ratio=0.05, torque=0.45)
    found, mark = backbone(one).curve, curve(one).phase_90
    assert mark is not None
    assert found.frequency_hz[-1] == pytest.approx(mark.frequency_hz, rel=1e-9)
    assert found.amplitude[-1] == pytest.approx(mark.amplitude, rel=1e-9)


def test_a_base_that_turns_has_the_same_backbone_as_a_torque() -> None:
    found = backbone(oscillator(cubic=6.0, torque=0.0, base=0.006)).curve
    assert found.complete
    assert found.frequency_hz == pytest.approx(free_duffing_hz(found.amplitude, 6.0), rel=3e-7)


def test_dry_friction_is_the_damper_that_takes_up_as_much_work() -> None:
    # Coulomb friction M_c takes up 4 M_c A per period, a damper d takes up π d Ω A²; it moves the frequency by little.
    one = oscillator(coulomb=0.02, damping_ratio=0.02, torque=0.2)
    found = backbone(one)
    large = found.share > 0.5
    omega = 2 * np.pi * found.curve.frequency_hz
    expected = 2 * 0.02 * np.sqrt(STIFFNESS * INERTIA) + 4 * 0.02 / (np.pi * omega * found.curve.amplitude)
    equivalent = equivalent_of_oscillator(found.curve, one, found.share)
    assert equivalent.damping_n_m_s_rad[large] == pytest.approx(expected[large], rel=1e-3)
    assert found.curve.frequency_hz[large] == pytest.approx(NATURAL_HZ, rel=1e-3)


def test_the_spring_that_takes_the_fundamentals_place_hardens_by_three_quarters_of_the_cubic_term() -> None:
    # ∫ k₃ A³ sin³ sin / ∫ A sin² = 3/4 k₃ A², where the third harmonic is small; not only at 90°.
    one = oscillator(cubic=0.6, damping_ratio=0.05, torque=0.2)
    branch = curve(one)
    equivalent = equivalent_of_oscillator(branch, one)
    assert equivalent.stiffness_n_m_rad == pytest.approx(STIFFNESS + 0.75 * 0.6 * branch.fundamental**2, rel=2e-4)
    assert equivalent.damping_ratio == pytest.approx(0.05 * np.sqrt(STIFFNESS / equivalent.stiffness_n_m_rad), rel=2e-3)


def test_the_third_harmonic_of_a_weakly_cubic_spring_is_that_of_the_perturbation_series() -> None:
    found = backbone(oscillator(cubic=0.6)).curve
    shares = harmonic_shares(found)
    assert set(shares) == {3, 5}
    assert shares[3][-1] == pytest.approx(0.6 * found.amplitude[-1] ** 2 / (32 * STIFFNESS), rel=0.1)


def test_the_second_harmonic_of_a_weakly_quadratic_spring_is_that_of_the_perturbation_series() -> None:
    found = backbone(oscillator(quadratic=0.3)).curve
    shares = harmonic_shares(found)
    assert set(shares) == {2, 3, 4, 5}
    assert shares[2][-1] == pytest.approx(0.3 * found.amplitude[-1] / (6 * STIFFNESS), rel=0.02)


def test_a_band_without_resonance_gives_no_points_and_a_sentence() -> None:
    found = backbone(oscillator(), (4.0, 6.0)).curve
    assert found.frequency_hz.size == 0
    assert not found.complete
    assert "does not pass 90° in the band" in found.message


def test_a_backbone_that_leaves_the_band_ends_there_with_a_sentence() -> None:
    found = backbone(oscillator(cubic=600.0, torque=0.45)).curve
    assert found.frequency_hz[-1] < BAND_HZ[1]
    assert found.message == "the backbone left the band; widen it"


def test_the_command_adds_backbone_and_harmonics_to_its_document(capsys: pytest.CaptureFixture[str]) -> None:
    text = "inertia_kg_m2=12.74e-3,frequency_hz=3,damping_ratio=0.05,cubic_n_m_rad3=6"
    status = main(["predict", "--oscillator", text, "--torque-n-m", "0.45", "--to-hz", "6", "--backbone", "--json"])
    document = json.loads(capsys.readouterr().out)
    (one,), (branch,) = document["backbone"], document["branches"]
    assert status == 0
    assert one["torque_n_m"][-1] == pytest.approx(0.45)
    assert one["frequency_hz"][-1] == pytest.approx(branch["phase_90"]["frequency_hz"], rel=1e-9)
    assert {len(one[key]) for key in ("amplitude_deg", "stiffness_n_m_rad", "damping_ratio", "stable")} == {
        len(one["frequency_hz"])
    }
    assert set(branch["harmonic_shares"]) == {"3", "5"}
