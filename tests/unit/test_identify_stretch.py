"""Which stretch of a record is fitted: between two times, an angle unwrapped, the free part of a decay."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tests.unit.identify_signals import OMEGA, motion, noisy, viscous

import sinew as sn
from sinew.identify.oscillator.record import Record, cut_to, find_decays, free_part, make_record, telling, unwrapped
from sinew.measure.errors import RecordingError, TimeError

TIME = np.arange(0, 6, 0.01)


def decay(start: float, lasts_s: float = 6.0, damping_ratio: float = 0.05) -> np.ndarray:
    return motion(viscous(damping_ratio), lambda t: 0.0, np.arange(0, lasts_s, 0.01), (start, 0.0))[0]


def record_of(x: np.ndarray, seed: int = 0) -> Record:
    return make_record(0.01 * np.arange(x.size), noisy(x, 0.002, seed), output_unit="rad")


def test_a_record_is_cut_between_two_times_of_its_own() -> None:
    cut = cut_to(record_of(decay(0.5)), 1.0, 2.0)
    assert (cut.time_s[0], cut.time_s[-1]) == (pytest.approx(1.0), pytest.approx(2.0))


def test_a_stretch_outside_the_record_is_refused() -> None:
    with pytest.raises(TimeError, match="the record runs from 0 s to"):
        cut_to(record_of(decay(0.5)), 50.0, None)


def test_a_stretch_of_a_few_samples_is_refused() -> None:
    with pytest.raises(RecordingError, match="found 11 samples between start and stop"):
        cut_to(record_of(decay(0.5)), 1.0, 1.1)


def test_a_decay_that_begins_free_is_fitted_whole() -> None:
    record = record_of(decay(0.5))
    assert free_part(record) is record


def test_of_a_driven_motion_before_a_decay_only_the_free_part_is_fitted() -> None:
    driven = 0.3 * np.sin(0.8 * OMEGA * np.arange(0, 3, 0.01))
    free = free_part(record_of(np.concatenate([driven, 0.5 * decay(1.0)])))
    assert 2.9 < free.time_s[0] < 3.5
    assert "the motion is free from 3." in free.notes[-1] or "the motion is free from 2.9" in free.notes[-1]


def test_of_two_decays_in_one_record_both_are_told_and_the_larger_is_fitted() -> None:
    pulled = np.linspace(0, 0.5, 60)
    held = np.full(100, 0.5)
    both = np.concatenate([decay(0.3), pulled, held, decay(0.5)])
    free = free_part(record_of(both))
    assert 7.3 < free.time_s[0] < 8.0
    assert "the record holds 2 free decays, " in free.notes[-1]


def test_the_beat_of_two_modes_is_one_decay() -> None:
    t = np.arange(0, 8, 0.01)
    beat = np.exp(-0.2 * t) * (np.cos(OMEGA * t) + 0.9 * np.cos(1.2 * OMEGA * t))
    assert len(find_decays(t, 0.2 * beat)) == 1


def test_identify_says_which_stretch_it_took() -> None:
    x = np.concatenate([np.zeros(100), np.linspace(0, 0.4, 60), np.full(100, 0.4), decay(0.4)])
    found = sn.identify(record_of(x), "linear")
    assert "the motion is free from 2." in found.to_dict()["message"]
    assert found.fit is not None
    assert found.fit.damping_ratio.low < 0.05 < found.fit.damping_ratio.high


def test_identify_takes_the_stretch_that_is_asked_for() -> None:
    found = sn.identify(record_of(decay(0.4)), "linear", start_s=0.5, stop_s=2.0)
    assert found.fit is not None
    assert found.fit.records[0].time_s[[0, -1]] == pytest.approx([0.5, 2.0])


def test_an_angle_that_wraps_at_half_a_turn_is_unwrapped_with_a_remark() -> None:
    x = decay(1.2) + 2.5
    wrapped = make_record(TIME, np.angle(np.exp(1j * x)), output_unit="rad")
    found = unwrapped(wrapped)
    assert found.output - found.output[0] == pytest.approx(x - x[0], abs=1e-9)
    assert "jumps by a whole turn" in found.notes[-1]


@pytest.mark.parametrize("unit", ["rad", "m"])
def test_what_does_not_jump_by_a_turn_stays_as_it_is(unit: str) -> None:
    record = make_record(
        TIME, 2.0 * np.cos(OMEGA * TIME) if unit == "rad" else 40 * np.sign(TIME - 3), output_unit=unit
    )
    assert unwrapped(record) is record


def test_an_angle_is_unwrapped_though_the_sensor_makes_its_turn_two_per_cent_too_large() -> None:
    wrapped = 1.018 * np.angle(np.exp(1j * (decay(1.2) + 2.5)))
    assert np.ptp(wrapped) > 1.005 * 2 * np.pi
    assert np.abs(np.diff(unwrapped(make_record(TIME, wrapped, output_unit="rad")).output)).max() < 1.0


def test_clipped_samples_of_a_decay_are_left_out_and_said() -> None:
    record = record_of(decay(0.5))
    found = sn.identify(replace(record, output=np.clip(record.output, -0.3, 0.3)), "linear")
    assert found.fit is not None
    assert found.fit.damping_ratio.value == pytest.approx(0.05, rel=0.01)
    assert "the response is clipped at -0.3 and 0.3" in found.to_dict()["message"]


def test_clipped_samples_that_are_counted_stay_with_a_remark() -> None:
    record = record_of(decay(0.5))
    clipped = telling(replace(record, output=np.clip(record.output, -0.3, 0.3)), counted=True)
    assert clipped.size == record.size
    assert "samples are clipped or frozen, and fitted" in clipped.notes[-1]


def released(held_s: float, noise_deg: float = 0.0) -> Record:
    """Return an angle held at 10° and let go at rest at held_s: the closed solution of 3 Hz with D = 0.03."""
    t = np.arange(0, held_s + 8, 0.005)
    after, omega, rate = np.maximum(t - held_s, 0.0), 6 * np.pi, 0.03 * 6 * np.pi
    swing = 10 * np.exp(-rate * after) * (np.cos(omega * after) + rate / omega * np.sin(omega * after))
    noise = np.random.default_rng(0).normal(0, noise_deg, t.size)
    return make_record(t, np.radians(swing + noise), output_unit="rad")


@pytest.mark.parametrize(("held_s", "noise_deg"), [(0.048, 0.02), (0.2, 0.02), (6.25, 0.02), (6.25, 0.1)])
def test_a_fit_starts_where_analyse_starts_after_a_release(held_s: float, noise_deg: float) -> None:
    """Nothing before the release is fitted: its step would pass for a law, or for a rest position that creeps."""
    record = released(held_s, noise_deg)
    free = free_part(record)
    table = pd.DataFrame({"t_s": record.time_s, "x_rad": record.output})
    analysed = sn.analyse(sn.read(table, time="t_s", response="x_rad", kind="ring-down"))
    assert free.time_s[0] == pytest.approx(analysed.start_s, abs=0.0026)  # half of a sample's 5 ms
    assert held_s <= free.time_s[0] < held_s + 0.1
    assert f"the motion is free from {free.time_s[0]:.4g} s on" in free.notes[-1]


def test_a_start_before_the_release_is_said_with_a_time_to_try() -> None:
    found = sn.identify(released(6.25), "linear", start_s=6.2)
    said = re.search(r"probably starts before the release; try --start (\d+\.?\d*)", found.to_dict()["message"])
    assert said is not None
    assert 6.25 <= float(said[1]) < 6.4
