"""What a fit is suspected of, and what a record is refused for: steps, hands, and models that do not describe it."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.identify_signals import OMEGA, motion, noisy, viscous

from sinew.identify.choice.diagnosis import refuse_hopeless, suspicions
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import Record, make_record
from sinew.identify.oscillator.start import dominant_omega, is_step

TIME = np.arange(0, 5, 0.01)
MASS = 1.3


def stepped(damping_ratio: float, seed: int = 1) -> Record:
    """Return the response to a force that is switched on half-way between two samples."""
    jump = 0.995
    push = lambda t: 20.0 / MASS * (t >= jump)  # noqa: E731
    x = motion(viscous(damping_ratio), push, TIME)[0]
    given = 20.0 * (jump <= TIME)
    return make_record(TIME, noisy(x, 2e-4, seed), given, excitation="force", output_unit="m", input_unit="N")


def held(seed: int = 1) -> Record:
    """Return a decay that a hand slows down in its first half swing."""
    free = motion(viscous(0.03), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    slow = 0.55 * np.cos(0.5 * OMEGA * np.arange(0, 2 * np.pi / OMEGA, 0.01))
    x = np.concatenate([slow, -free[: TIME.size - slow.size]])
    return make_record(TIME, noisy(x, 0.002, seed), output_unit="rad")


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


def test_a_step_response_is_told_what_its_jump_hides() -> None:
    assert any("input jumps" in s and "10 ms" in s for s in suspicions(fit(stepped(0.1), "linear")))


def test_a_sine_and_a_decay_are_no_steps() -> None:
    swing = np.sin(OMEGA * TIME)
    assert not is_step(make_record(TIME, swing, swing, excitation="force"))
    assert not is_step(held())


def test_a_decay_that_begins_in_the_hand_is_told_where_to_begin() -> None:
    (told,) = [s for s in suspicions(fit(held(), "linear")) if "look not free" in s]
    assert "with 3 Hz and a damping ratio of 0.03" in told
    begin = int(told.rsplit(" ", 1)[1])
    assert 0.9 < TIME[begin] * OMEGA / (2 * np.pi) < 1.7  # the hand lets go after one period


def test_a_free_decay_is_not_said_to_begin_in_the_hand() -> None:
    for damping_ratio in (0.01, 0.05, 0.2):
        x = motion(viscous(damping_ratio), lambda t: 0.0, TIME, (0.5, 0.0))[0]
        record = make_record(TIME, noisy(x, 0.002, 3), output_unit="rad")
        assert suspicions(fit(record, "linear")) == ()


@pytest.mark.slow
def test_a_free_decay_that_a_model_does_not_describe_is_sent_to_the_comparison() -> None:
    stiffer = motion(viscous(0.02, cubic=6 * OMEGA**2), lambda t: 0.0, TIME, (0.8, 0.0))[0]
    found = fit(make_record(TIME, noisy(stiffer, 0.002, 1), output_unit="rad"), "linear")
    assert any("linear does not describe it" in s and "--model auto" in s for s in suspicions(found))
    assert not any("--model auto" in s for s in suspicions(found, compared=True))


def test_suspicions_do_not_ask_of_what_was_held_out() -> None:
    x = motion(viscous(0.05), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    record = make_record(TIME, noisy(x, 0.002, 3), output_unit="rad")
    spoilt = replace(record, output=np.where(TIME < 3, record.output, 1.0))
    assert suspicions(fit(spoilt, "linear", kept=[TIME < 3])) == ()
