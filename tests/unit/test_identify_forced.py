"""The forced response of a fit: what is known in closed form or by time integration, and what a fit cannot tell."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp
from tests.experiments.forced import ERROR, HARDENING, SOFTENING, Oscillator, predicted, swing

import sinew as sn
from sinew.identify.forced import Mechanics, mechanics_of, predict_fit, read_mechanics
from sinew.measure.arrays import Array
from sinew.mechanics.silicone import prony_shares, relaxation_times

OMEGA, DAMPING = 2 * np.pi * 3.0, 0.05
BAND_HZ = (2.0, 4.0)


def law(model: str, excitation: str = "none", unit: str = "rad", **numbers: float) -> Mechanics:
    """A law of 3 Hz and D = 0.05 whose numbers are known to a thousandth, seen up to 0.5."""
    numbers = {"stiffness": OMEGA**2, "damping": 2 * DAMPING * OMEGA} | numbers
    spread = np.diag((1e-3 * np.array(list(numbers.values()))) ** 2)
    return Mechanics(model, excitation, unit, "N*m", numbers, spread, 500.0, 0.5)  # type: ignore[arg-type]


def transfer(hertz: float | Array) -> Array:
    """Return the linear law's amplitude over that at rest."""
    ratio = np.asarray(hertz) / 3.0
    return np.asarray(1 / np.abs(1 - ratio**2 + 2j * DAMPING * ratio))


def decay() -> sn.Record:
    t = np.arange(0, 4, 0.01)
    noise = np.random.default_rng(0).normal(0, 0.003, t.size)
    return sn.make_record(t, 0.35 * np.exp(-1.2 * t) * np.cos(2 * np.pi * 3 * t) + noise, output_unit="rad")


def test_a_linear_law_goes_through_the_measured_point_and_scales_with_the_drive() -> None:
    found = predict_fit(law("linear"), torque=[1.0, 3.0], through=(2.8, 0.1, 0.0, 1.0), band_hz=BAND_HZ, draws=20)
    for one in found.levels:
        expected = 0.1 * one.level * transfer(one.branch.frequency_hz) / transfer(2.8)
        assert one.branch.amplitude == pytest.approx(expected, rel=1e-6)
    assert found.gain.value == pytest.approx(0.1 * OMEGA**2 / float(transfer(2.8)), rel=1e-6)  # the acceleration there


@pytest.mark.slow
def test_an_error_of_the_measured_amplitude_is_one_of_every_level() -> None:
    found = predict_fit(law("linear"), torque=[1.0, 4.0], through=(2.0, 0.02, 0.002), band_hz=BAND_HZ, draws=300)
    for one in found.levels:
        assert one.band.peak is not None
        assert one.band.peak.amplitude.std / one.band.peak.amplitude.value == pytest.approx(0.1, rel=0.15)


def test_a_base_that_moves_in_the_unit_of_the_motion_needs_no_point() -> None:
    (one,) = predict_fit(law("linear"), base=float(np.degrees(0.05)), band_hz=BAND_HZ, draws=20).levels
    ratio = one.branch.frequency_hz / 3.0
    assert one.branch.amplitude == pytest.approx(0.05 * ratio**2 * transfer(one.branch.frequency_hz), rel=1e-6)


def test_a_driven_fit_knows_its_gain_and_its_document_has_the_resonance_in_the_middle_of_the_band() -> None:
    found = predict_fit(law("linear", "torque", gain=80.0), torque=0.1, band_hz=BAND_HZ, draws=40)
    (one,) = found.levels
    assert one.branch.amplitude == pytest.approx(8.0 / OMEGA**2 * transfer(one.branch.frequency_hz), rel=1e-6)
    (one,) = found.to_dict()["levels"]
    expected = np.degrees(8.0 / OMEGA**2) * transfer(np.array(one["band"]["frequency_hz"]))
    for way in ("up", "down"):
        assert one["band"][way]["amplitude"]["median"] == pytest.approx(expected, rel=0.02)


LAWS = {
    "pendulum": law("pendulum", "torque", gain=1.0),
    "cubic-quadratic": law("cubic-quadratic", "torque", quadratic=0.6 * OMEGA**2, cubic=0.8 * OMEGA**2, gain=1.0),
    "drag-cubic": law("drag-cubic", "torque", drag=0.2, cubic=-0.4 * OMEGA**2, gain=1.0),
    "coulomb": law("coulomb", "torque", coulomb=3.0, gain=1.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("model", LAWS)
def test_every_law_swings_as_time_integration_does(model: str) -> None:
    known, hertz, push = LAWS[model], 2.6, 12.0
    (one,) = predict_fit(known, torque=push, band_hz=(1.5, hertz), draws=20).levels

    def rate(t: float, y: Array) -> list[float]:
        spring = np.sin(y[0]) if model == "pendulum" else y[0]
        bent = known.value("quadratic") * y[0] ** 2 + known.value("cubic") * y[0] ** 3
        lost = known.value("damping") * y[1] + known.value("drag") * abs(y[1]) * y[1]
        dry = known.value("coulomb") * np.tanh(y[1] / 0.02)
        return [y[1], push * np.sin(2 * np.pi * hertz * t) - OMEGA**2 * spring - bent - lost - dry]

    last = np.linspace(40, 41, 501) / hertz
    moved = solve_ivp(rate, (0, last[-1]), [0.0, 0.0], t_eval=last, rtol=1e-7, atol=1e-9).y[0]
    assert one.branch.amplitude[-1] == pytest.approx(0.5 * np.ptp(moved), rel=3e-3)


@pytest.mark.slow
def test_a_loss_factor_lets_it_swing_at_resonance_by_its_inverse() -> None:
    numbers = {"stiffness": OMEGA**2, "loss_factor": 0.1, "gain": 1.0}
    spread = np.diag((1e-3 * np.array(list(numbers.values()))) ** 2)
    known = Mechanics("loss-factor", "torque", "rad", "N*m", numbers, spread, 500.0, 0.5)
    (one,) = predict_fit(known, torque=4.0, band_hz=(2.9, 3.0), draws=20).levels
    turn = OMEGA * relaxation_times()
    storage, loss = (prony_shares(0.1) @ (part / (1 + turn**2)) for part in (turn**2, turn))
    assert loss / (1 + storage) == pytest.approx(0.1, rel=0.03)
    assert one.branch.amplitude[-1] == pytest.approx(4.0 / OMEGA**2 * (1 + storage) / loss, rel=1e-3)


def test_a_push_on_a_free_decay_is_undetermined_and_the_sentence_says_what_to_do() -> None:
    with pytest.raises(sn.SpecError, match=r"does not determine the inertia.*--through"):
        predict_fit(law("linear"), torque=1.0)


def test_a_number_that_the_record_does_not_determine_is_named() -> None:
    vague = law("linear")
    vague.covariance[1, 1] = np.inf
    with pytest.raises(sn.SpecError, match="does not determine the damping"):
        predict_fit(vague, base=0.1)


def test_a_law_with_an_inner_state_is_refused_by_name() -> None:
    with pytest.raises(sn.SpecError, match="Bouc-Wen hysteresis has an inner state"):
        predict_fit(law("bouc-wen", hysteresis=1.0, **{"yield": 0.1}), base=0.1)


@pytest.mark.slow
def test_a_point_on_an_unstable_stretch_is_remarked_on() -> None:
    # The backbone of 3 Hz and k₃ = 1.5 k passes 3.5 Hz at 0.57 rad; below it, at 0.4 rad, no motion is stable.
    cubic = law("cubic", damping=0.6, cubic=1.5 * OMEGA**2)
    told = predict_fit(cubic, torque=1.0, through=(3.5, 0.4), band_hz=BAND_HZ, draws=20).remarks
    assert any("unstable" in one for one in told)


def test_what_lies_beyond_the_record_is_called_extrapolated() -> None:
    found = predict_fit(law("linear"), base=np.degrees([0.01, 0.1]), band_hz=BAND_HZ, draws=20)
    assert ["5.73 deg" in one for one in found.remarks if "extrapolated" in one] == [True]


def test_a_document_holds_the_law_as_the_fit_does() -> None:
    found = sn.identify(decay(), "linear")
    assert found.fit is not None
    held, own = read_mechanics(found.to_dict()), mechanics_of(found.fit)
    assert held.values == pytest.approx(own.values)
    assert held.covariance == pytest.approx(own.covariance)
    assert np.sqrt(own.covariance[1, 1]) == pytest.approx(found.fit.parameters["damping_per_s"].std, rel=1e-9)
    assert held.largest == pytest.approx(0.5 * 0.35 * (1 + np.exp(-0.2)), rel=0.02)  # half of the first half swing


@pytest.mark.slow
def test_a_unit_that_is_no_angle_changes_nothing_but_the_words() -> None:
    in_volts = law("linear", unit="V")
    one, other = (
        predict_fit(x, torque=1.0, through=(2.8, 0.1), band_hz=BAND_HZ, draws=20) for x in (in_volts, law("linear"))
    )
    assert one.levels[0].branch.amplitude == pytest.approx(other.levels[0].branch.amplitude)
    assert (one.to_dict()["unit"], other.to_dict()["unit"]) == ("V", "deg")


@pytest.mark.slow
@pytest.mark.parametrize("one", [HARDENING, SOFTENING], ids=lambda one: one.name)
def test_other_levels_follow_from_decays_and_one_point(one: Oscillator) -> None:
    """Near every maximum, where a sweep comes to it; whether the maxima are right is counted by the campaign."""
    found = predicted(one, seed=0, draws=20)
    side = -1 if one is HARDENING else 1
    for level, push in zip(found.levels, one.pushes, strict=True):
        branch = level.branch
        top = int(np.argmax(branch.amplitude))
        near = slice(None, top) if side < 0 else slice(top, None)
        hertz = branch.frequency_hz[top] * (1 + 0.02 * side)
        at = int(np.argmin(np.abs(branch.frequency_hz[near] - hertz))) + (0 if side < 0 else top)
        waves, turn = branch.harmonics[at], 2 * np.pi * branch.frequency_hz[at] * branch.orders
        state = np.array([waves.sum().real, (1j * turn * waves).sum().real])
        truth, _ = swing(one, push, float(branch.frequency_hz[at]), state)
        assert branch.amplitude[at] == pytest.approx(truth, rel=ERROR)


def test_a_rate_without_a_spring_has_a_document_and_no_resonance() -> None:
    t = np.arange(0, 10, 0.01)
    volts = np.sin(2 * np.pi * (0.2 * t + 0.1 * t**2))
    rate = signal.lsim(([40.0], [1.0, 4.0]), volts, t)[1] + np.random.default_rng(1).normal(0, 0.02, t.size)
    found = sn.identify(
        sn.make_record(t, rate, volts, excitation="torque", output_unit="rad/s", input_unit="V"), "linear"
    )
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["natural_frequency_hz"]["value"] is None
    with pytest.raises(sn.SpecError, match="does not say how far its motion went"):
        found.predict(torque=1.0)


def test_a_sentence_on_the_measured_point_has_the_unit_of_the_record() -> None:
    known = replace(law("linear", unit="m"), unit_said="mm")
    with pytest.raises(sn.SpecError, match="amplitude is 4 mm with a standard deviation of 3 mm"):
        predict_fit(known, torque=1.0, through=(2.8, 0.004, 0.003))


@pytest.mark.parametrize(
    ("said", "unit", "motion"), [("mm", "m", "mm"), ("mm/s", "m/s", "mm"), ("%", "1", "%"), ("dps", "rad/s", "")]
)
def test_the_unit_of_a_motion_is_told_by_that_of_its_rate(said: str, unit: str, motion: str) -> None:
    assert replace(decay(), output_unit=unit, output_said=said).motion_said == motion
