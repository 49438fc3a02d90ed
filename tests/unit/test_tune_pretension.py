"""Pretension for a wanted resonance: the right one, its interval, the reachable range and the sentence why not."""

import math

import numpy as np
import pytest

from sinew.measure.errors import SpecError
from sinew.plan.rig import Calibrated, RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.band import draw_rigs
from sinew.tune.candidate import drive_load
from sinew.tune.pretension import Swing, Tuning, find_reachable, find_resonances, tune_pretension

pytestmark = pytest.mark.slow

RIG = load_rig("paper")
SWING, PLAIN = Swing(yaw_deg=7.0), Swing(command_deg=20.0)
RADIUS = "tendons.head_radius"


@pytest.fixture(scope="module")
def tuned() -> Tuning:
    """Return the paper's rig at two frequencies that it does not reach, and between them one that it does."""
    return tune_pretension(RIG, [1.0, 3.7, 9.0], SWING)


def limited(rig: RigSpec, **limits: object) -> RigSpec:
    return rig.model_copy(update={"limits": rig.limits.model_copy(update=limits)})


def nearly_linear() -> RigSpec:
    """Return the paper's rig with hardly any loss, and a drive that is hardly a load."""
    return RIG.with_values({"silicone.loss_factor": 0.02, "tendons.guide_friction": 0.0})


def test_the_pretension_of_a_nearly_linear_joint_brings_the_stiffness_that_inertia_and_frequency_ask_for() -> None:
    rig = nearly_linear()
    (found,) = tune_pretension(rig, [3.4], Swing(command_deg=2.0)).settings
    assert found.resonance is not None
    tension, inertia = found.resonance.rest_tension, 12.74e-3
    silicone, tendons = rig.silicone, rig.tendons
    area = math.pi * silicone.diameter.value**2 / 4
    modulus = silicone.torsional_rigidity.value / (math.pi * silicone.diameter.value**4 / 32)
    # Neo-Hookean in compression: 4 T = G A (1/λ² - λ). Torsion: G J/(L λ) + 4 T r²/ℓ, with the storage of a loss factor
    # that is constant from 0.3 to 30 Hz, (2/π) tan δ ln(f/f_low) above the relaxed stiffness.
    stretch = np.roots([1.0, 4 * tension / (modulus * area), 0.0, -1.0])
    (stretch,) = stretch[(np.abs(stretch.imag) < 1e-9) & (stretch.real > 0)].real
    length = silicone.length.value
    own = silicone.torsional_rigidity.value / (length * stretch) * (1 + 2 / math.pi * 0.02 * math.log(3.4 / 0.3))
    pull = 4 * tension * tendons.head_radius.value**2 / (length * stretch)
    assert math.sqrt((own + pull) / inertia) / (2 * math.pi) == pytest.approx(3.4, rel=0.01)


def test_the_joint_resonates_where_it_was_asked_to_and_as_far_as_it_was_asked_to(tuned: Tuning) -> None:
    found = tuned.settings[1]
    assert found.feasible
    assert "used most" in found.sentence
    assert "_" not in found.sentence
    assert found.pretension_mm is not None
    assert found.pretension_mm.to_json()["interval90"] == [None, None]  # without draws
    assert found.resonance is not None
    assert found.resonance.frequency_hz == pytest.approx(3.7, rel=1e-4)
    assert math.degrees(found.resonance.torsion) == pytest.approx(7.0, rel=3e-3)
    (again,) = find_resonances(
        RIG, [found.resonance.pretension_mm], Swing(command_deg=math.degrees(found.resonance.command))
    )
    assert again is not None
    assert again.frequency_hz == pytest.approx(3.7, rel=1e-4)


def test_a_frequency_out_of_reach_is_told_with_what_ends_the_range(tuned: Tuning) -> None:
    slow, _, fast = tuned.settings
    assert (slow.feasible, fast.feasible) == (False, False)
    assert "below the 2.9" in slow.sentence
    assert "0 mm is the rig's lowest pretension" in slow.sentence
    assert "above the 4.8" in fast.sentence
    assert "16 mm is the rig's highest pretension" in fast.sentence


def test_the_range_ends_where_a_tendon_pulls_as_much_as_the_rig_allows() -> None:
    rig = limited(RIG, tension_n=60.0)
    reachable = find_reachable(rig, SWING)
    assert reachable.pretension_mm is not None
    (end,) = find_resonances(rig, [reachable.pretension_mm[1]], SWING)
    assert end is not None
    assert end.tension == pytest.approx(60.0, rel=2e-3)
    assert "the rig allows 60 N" in reachable.why[1]


def test_a_drive_that_may_not_swing_far_enough_leaves_no_pretension_at_all() -> None:
    reachable = find_reachable(limited(RIG, drive_amplitude_deg=1.0), SWING)
    assert reachable.pretension_mm is None
    assert "the rig allows 1°" in reachable.why[0]


def test_the_interval_is_what_the_uncertain_radius_moves_the_pretension_by() -> None:
    std = 1e-4
    base = RIG.with_values({RADIUS: RIG.tendons.head_radius.value}, origin="calibrated")
    rig = base.model_copy(update={"calibration": Calibrated(parameters=(RADIUS,), std=(std,), correlation=((1.0,),))})
    (found,) = tune_pretension(rig, [3.6], PLAIN, draws=draw_rigs(rig, 24, 1000)).settings
    shifted = [
        tune_pretension(RIG.with_values({RADIUS: RIG.tendons.head_radius.value + sign * std}), [3.6], PLAIN)
        for sign in (-1, 1)
    ]
    low, high = (one.settings[0].resonance for one in shifted)
    assert low is not None
    assert high is not None
    assert found.pretension_mm is not None
    assert found.draws == 24
    # A larger circle needs less pretension. 24 draws know a standard deviation to 1/sqrt(2·23) of it.
    expected = 0.5 * (low.pretension_mm - high.pretension_mm)
    assert found.pretension_mm.std == pytest.approx(expected, rel=3 / math.sqrt(46))
    assert found.pretension_mm.low < found.pretension_mm.value < found.pretension_mm.high


@pytest.mark.parametrize("arguments", [{}, {"command_deg": 20.0, "yaw_deg": 7.0}, {"yaw_deg": -1.0}])
def test_a_swing_is_one_positive_amplitude(arguments: dict[str, float]) -> None:
    with pytest.raises(SpecError, match="one positive amplitude"):
        Swing(**arguments)


def test_a_frequency_must_be_positive() -> None:
    with pytest.raises(SpecError, match="positive frequency"):
        tune_pretension(RIG, [0.0], SWING)


def test_a_lever_that_lags_does_the_work_that_the_torsion_takes() -> None:
    # Torsion alone: M = -I_l Ω² Φ against a lever 90° ahead, so that the work in a cycle is π I_l Ω² Φ |Θ|.
    hertz, torsion, lever = 1.0, math.radians(7), math.radians(20)
    load = drive_load(RIG, hertz, 1j * lever, torsion)
    own = RIG.inertia.lever.value * (2 * math.pi * hertz) ** 2 * torsion
    assert load.work == pytest.approx(math.pi * own * lever, rel=1e-9)
    assert load.speed == pytest.approx(2 * math.pi * hertz * lever, rel=1e-3)
