"""What a fit is suspected of, and what a record is refused for: steps, and models that do not describe it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.identify_signals import OMEGA, motion, noisy, viscous

from sinew.identify.oscillator.diagnosis import diagnose, refuse_hopeless
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import Record, dominant_omega, is_step, make_record

TIME = np.arange(0, 5, 0.01)
MASS = 1.3


def stepped(damping_ratio: float, seed: int = 1) -> Record:
    """Return the response to a force that is switched on half-way between two samples."""
    jump = 0.995
    push = lambda t: 20.0 / MASS * (t >= jump)  # noqa: E731
    x = motion(viscous(damping_ratio), push, TIME)[0]
    given = 20.0 * (jump <= TIME)
    return make_record(TIME, noisy(x, 2e-4, seed), given, excitation="force", output_unit="m", input_unit="N")


@pytest.mark.parametrize("damping_ratio", [0.05, 0.17, 0.4, 0.8])
def test_a_step_response_tells_mass_frequency_and_damping(damping_ratio: float) -> None:
    record = stepped(damping_ratio)
    refuse_hopeless(record)
    found = fit(record, "linear")
    assert found.parameters["mass_kg"].value == pytest.approx(MASS, rel=0.02)
    assert found.natural_frequency_hz.value == pytest.approx(3.0, rel=0.01)
    assert found.damping_ratio.value == pytest.approx(damping_ratio, rel=0.03)


def test_the_frequency_of_a_step_response_is_that_of_its_ringing() -> None:
    assert dominant_omega(stepped(0.05)) == pytest.approx(OMEGA, rel=0.02)


def test_a_step_response_is_told_what_its_jump_hides_and_its_sound_sensor_is_not_asked_after() -> None:
    said = diagnose(fit(stepped(0.1), "linear"))
    assert any("input jumps" in s and "10 ms" in s for s in said)
    assert not any("sign" in s for s in said)


def test_a_sine_and_a_decay_are_no_steps() -> None:
    swing = np.sin(OMEGA * TIME)
    assert not is_step(make_record(TIME, swing, swing, excitation="force"))
    assert not is_step(make_record(TIME, swing))


@pytest.mark.slow
def test_a_free_decay_that_a_model_does_not_describe_is_sent_to_the_comparison() -> None:
    stiffer = motion(viscous(0.02, cubic=6 * OMEGA**2), lambda t: 0.0, TIME, (0.8, 0.0))[0]
    found = fit(make_record(TIME, noisy(stiffer, 0.002, 1), output_unit="rad"), "linear")
    assert any("linear does not describe it" in s and "--model auto" in s for s in diagnose(found))
    assert not any("--model auto" in s for s in diagnose(found, compared=True))


def test_suspicions_do_not_ask_of_what_was_held_out() -> None:
    x = motion(viscous(0.05), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    record = make_record(TIME, noisy(x, 0.002, 3), output_unit="rad")
    spoilt = replace(record, output=np.where(TIME < 3, record.output, 1.0))
    assert diagnose(fit(spoilt, "linear", selected=[TIME < 3])) == ()


SWEEP = np.arange(0, 20, 0.01)
PUSH = 3.0 * np.sin(2 * np.pi * (0.2 * SWEEP + 0.1 * SWEEP**2))


def cart(seed: int = 1, *, mass: float = 2.0, damper: float = 3.0, spring: float = 0.0) -> Record:
    """Return the way of a mass on a damper, with a spring or none, under a force that sweeps from 0.2 to 4.2 Hz."""
    force = lambda r, v: damper / mass * v + spring / mass * r  # noqa: E731
    x = motion(force, lambda t: float(np.interp(t, SWEEP, PUSH)) / mass, SWEEP)[0]
    return make_record(SWEEP, noisy(x, 1e-4, seed), PUSH, excitation="force", output_unit="m", input_unit="N")


def test_a_cart_has_a_mass_and_no_frequency() -> None:
    found = fit(cart(), "linear")
    assert np.isnan(found.natural_frequency_hz.value)
    assert found.parameters["mass_kg"].low < 2.0 < found.parameters["mass_kg"].high
    (told,) = [s for s in diagnose(found) if "not told from zero" in s]
    assert "a mass without a spring, a cart or a positioner, whose rate settles in 0.6" in told


def test_a_cart_on_a_soft_spring_has_its_frequency() -> None:
    found = fit(cart(spring=2.0 * (2 * np.pi * 0.5) ** 2), "linear")
    assert found.natural_frequency_hz.value == pytest.approx(0.5, rel=0.01)
    assert not any("not told from zero" in s for s in diagnose(found))


def test_a_positioner_that_creeps_away_is_not_said_to_be_too_short() -> None:
    t = np.arange(0, 3, 0.01)
    push = 1.0 * (t > 0.5)
    x = motion(lambda r, v: 4.0 * v, lambda s: float(s > 0.5), t)[0]
    refuse_hopeless(make_record(t, noisy(x, 1e-4, 2), push, excitation="force", output_unit="m", input_unit="N"))


@pytest.mark.parametrize("turned", ["input", "output"])
def test_a_reversed_sensor_is_asked_after(turned: str) -> None:
    record = stepped(0.1)
    turned_round = replace(record, **{turned: -getattr(record, turned)})
    found = fit(turned_round, "linear")
    assert found.parameters["mass_kg"].high < 0
    assert any("mass and stiffness came out negative: is a sensor's sign reversed?" in s for s in diagnose(found))


@pytest.mark.slow
def test_a_base_that_is_measured_the_wrong_way_round_is_asked_after() -> None:
    base = 0.05 * np.sin(2 * np.pi * (1.5 * TIME + 0.4 * TIME**2))

    def pull(t: float) -> float:
        """Return what the base's acceleration, θ'' = 0.05 (ψ'' cos ψ - ψ'² sin ψ), asks of the joint."""
        phase, rate, bend = 2 * math.pi * (1.5 * t + 0.4 * t**2), 2 * math.pi * (1.5 + 0.8 * t), 1.6 * math.pi
        return -0.05 * (bend * math.cos(phase) - rate**2 * math.sin(phase))

    x = motion(viscous(0.1), pull, TIME)[0] + base
    given = {"excitation": "base", "output_unit": "m", "input_unit": "m"}
    sound, turned = (make_record(TIME, noisy(x, 1e-4, 3), side * base, **given) for side in (1.0, -1.0))
    assert any("with the input's sign reversed" in s for s in diagnose(fit(turned, "linear")))
    assert not any("sign" in s for s in diagnose(fit(sound, "linear")))
