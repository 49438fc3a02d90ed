"""Noise of a force sensor: an impulse test whose silent force is noise, and one whose silent force is none."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.experiments.impulses import Struck, struck_record

from sinew.identify.identified import identify
from sinew.identify.oscillator.comparison import split_record
from sinew.identify.oscillator.diagnosis import warn_of_noise, widen, window_force
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import Record, make_record

STRUCK = Struck("linear", 3.0, 0.03, ((0.3, 0.03, 1.0),), 0.005, 0.001)


def struck(seed: int = 0, **numbers: Any) -> Record:
    return struck_record(replace(STRUCK, **numbers), seed)


def test_the_silent_force_of_an_impulse_test_is_taken_as_its_mean() -> None:
    record = struck()
    found = window_force(record)
    assert found is not None
    silent = record.time_s > 0.5
    assert np.ptp(found.record.input[silent]) == 0
    assert found.noise == pytest.approx(0.005 * np.abs(record.input).max(), rel=0.1)
    assert "the torque is silent in 9" in found.sentence


def test_without_the_noise_of_the_silent_force_the_joint_leaves_the_noise_of_its_angle() -> None:
    record = struck()
    found = window_force(record)
    assert found is not None
    noise = 0.001 * np.abs(record.output).max()
    assert fit(found.record, "linear").rmse == pytest.approx(noise, rel=0.1)
    assert fit(record, "linear").rmse > 1.5 * noise


def test_a_small_force_that_moves_the_joint_is_no_noise() -> None:
    # The force that is measured between the strokes is the force that acts: what it does is seen in the angle.
    t = np.arange(0, 6, 0.002)
    rng = np.random.default_rng(3)
    force = 0.002 * rng.standard_normal(t.size)
    force[150:165] += 1.0
    state, angle = np.zeros(2), []
    for push in force:  # a semi-implicit step is exact enough for a joint of its own
        rate = state[1] + 0.002 * (push / 0.01 - 1.0 * state[1] - 360.0 * state[0])
        state = np.array([state[0] + 0.002 * rate, rate])
        angle.append(state[0])
    record = make_record(t, np.array(angle), force, excitation="torque", output_unit="rad", input_unit="N*m")
    assert window_force(record) is None


@pytest.mark.parametrize("shape", ["sweep", "constant zero"])
def test_a_force_that_is_not_silent_or_has_no_noise_stays_as_measured(shape: str) -> None:
    record = struck(input_noise=0.0)
    given = np.sin(record.time_s**2) if shape == "sweep" else record.input
    assert window_force(replace(record, input=given)) is None


def test_noise_inside_a_stroke_widens_the_inertia_by_what_it_does_to_its_strength() -> None:
    found = window_force(struck())
    assert found is not None
    plain = fit(found.record, "linear")
    own, more = plain.parameters["inertia_kg_m2"], widen(plain, found).parameters["inertia_kg_m2"]
    assert more.std == pytest.approx(np.hypot(own.std, found.gain_std * own.value))


def test_not_to_know_how_strong_two_strokes_were_widens_the_damping() -> None:
    twice = window_force(struck(pulses=((0.3, 0.03, 1.0), (1.5, 0.03, 0.8))))
    assert twice is not None
    plain = fit(twice.record, "linear")
    assert widen(plain, twice).damping_ratio.std > 1.05 * plain.damping_ratio.std


def test_the_strength_of_a_stroke_is_as_uncertain_as_its_area() -> None:
    found = [window_force(struck(seed, output_noise=1e-4)) for seed in range(12)]
    inertia = [fit(one.record, "linear").parameters["inertia_kg_m2"].value for one in found if one is not None]
    stated = np.mean([one.gain_std for one in found if one is not None])
    assert np.std(inertia, ddof=1) / np.mean(inertia) == pytest.approx(stated, rel=0.6)  # of 12 draws: 95 % of them


@pytest.mark.slow
def test_noise_on_a_drive_that_never_rests_is_warned_of() -> None:
    t = np.arange(0, 20, 0.005)
    rng = np.random.default_rng(5)
    drive = np.sin(2 * np.pi * (0.8 * t + 0.02 * t**2))
    from tests.unit.identify_signals import motion, viscous

    angle = motion(viscous(0.03), lambda s: float(np.interp(s, t, drive)) * 10, t)[0]
    angle = angle + 1e-4 * rng.standard_normal(t.size)
    clean = make_record(t, angle, drive, excitation="force", output_unit="m", input_unit="N")
    loud = replace(clean, input=drive + 0.05 * rng.standard_normal(t.size))
    assert warn_of_noise(fit(clean, "linear")) == []
    assert any("noise of the input" in one for one in warn_of_noise(fit(loud, "linear")))


def test_strokes_are_put_right_without_the_output_that_is_held_out() -> None:
    record = struck(pulses=((0.3, 0.03, 1.0), (2.3, 0.03, 0.8)))
    held = record.time_s >= 2.0
    other = replace(record, output=np.where(held, 1.2 * record.output, record.output))
    one, two = (identify(x, "linear", train=(0, 800), test=(800, 1600)).split for x in (record, other))
    assert one is not None
    assert two is not None
    assert np.ptp(one.record.input[held & (record.time_s > 2.5)]) == 0  # it is silent there, too
    assert one.record.input == pytest.approx(two.record.input, abs=1e-6 * np.ptp(record.input))


def test_blocks_that_are_held_out_put_right_the_force_of_the_last_fit_alone() -> None:
    record = struck()
    blocks = split_record(record, None, None)
    other = replace(record, output=np.where(blocks.tested, 1.05 * record.output, record.output))
    one, two = (identify(x, "linear").split for x in (record, other))
    assert one is not None
    assert two is not None
    assert (one.tested == two.tested).all()
    assert one.record.input == pytest.approx(two.record.input, abs=1e-6 * np.ptp(record.input))
    assert one.whole is not None
    assert two.whole is not None
    assert np.abs(one.whole.input - two.whole.input).max() > 1e-3 * np.ptp(record.input)
