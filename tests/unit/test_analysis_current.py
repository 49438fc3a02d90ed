"""Whose current a register tells, on motors whose current is known: i = (δV - k ω - v sgn δ)/R."""

import math
from pathlib import Path

import numpy as np
import pytest
from tests.unit.bench_virtual import virtual_bench

from sinew.analysis.signal.motors import CurrentSense, sense_currents, sense_moving, sense_standing
from sinew.bench.record.conversion import recording_from_journal
from sinew.measure.errors import RecordingError
from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording
from sinew.plan.toml import load_rig, parse_plan
from sinew.twin.simulate import rest_tension

RESISTANCE, BACK_EMF, DROP, VOLTS, COUNT_A = 5.2, 2.3, 0.15, 12.0, 2.69e-3


def winding(duty: np.ndarray, speed: np.ndarray) -> np.ndarray:
    return (duty * VOLTS - BACK_EMF * speed - DROP * np.sign(duty)) / RESISTANCE


def read(current: np.ndarray, duty: np.ndarray, exponent: float, seed: int = 0) -> np.ndarray:
    """Return what a register tells: |δ|^s i, noisy by 5 mA, in whole counts."""
    noise = 5e-3 * np.random.default_rng(seed).standard_normal(duty.size)
    return COUNT_A * np.round((np.abs(duty) ** exponent * current + noise) / COUNT_A)


def swinging(exponent: float, seed: int = 0, count: int = 1500) -> CurrentSense:
    """Return the verdict on a motor that swings, with duties up to 0.9."""
    time = np.arange(count) / 200
    duty = 0.9 * np.sin(math.tau * 1.5 * time) * (0.4 + 0.6 * time / time[-1])
    speed = 2.0 * np.sin(math.tau * 1.5 * time - 1.0) * np.cos(0.3 * time)
    used = np.abs(duty) > 0.05
    told = read(winding(duty, speed), duty, exponent, seed)
    return sense_moving("drive", told[used], duty[used], speed[used], np.full(used.sum(), VOLTS))


def holding(exponent: float, duties: tuple[float, ...], seed: int = 0) -> CurrentSense:
    """Return the verdict on a motor that stands and pulls with some duties in turn, as its registers round them."""
    duty = np.array(duties) * (1 + 0.02 * np.random.default_rng(seed).random(len(duties)))
    told = COUNT_A * np.round(duty**exponent * winding(duty, 0 * duty) / COUNT_A)
    rounded = np.round(duty * 885) / 885
    return sense_standing("tendon 1", told, rounded, np.full(duty.size, VOLTS), COUNT_A)


@pytest.mark.parametrize(("exponent", "whose"), [(0.0, "motor"), (1.0, "supply")])
def test_it_is_told_on_a_motor_that_swings(exponent: float, whose: str) -> None:
    found = swinging(exponent)
    assert (found.whose, found.exponent.value) == (whose, pytest.approx(exponent, abs=0.05))


@pytest.mark.parametrize(("exponent", "whose"), [(0.0, "motor"), (1.0, "supply")])
def test_it_is_told_on_a_motor_that_stands_under_several_loads(exponent: float, whose: str) -> None:
    assert holding(exponent, (0.06, 0.12, 0.2, 0.3, 0.4)).whose == whose


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [0.0, 1.0])
@pytest.mark.parametrize("duties", [(0.06, 0.12, 0.2, 0.3, 0.4), (0.07, 0.11, 0.15, 0.2, 0.25)])
def test_what_a_standing_motor_rounds_off_is_in_the_interval(exponent: float, duties: tuple[float, ...]) -> None:
    found = [holding(exponent, duties, seed).exponent for seed in range(10)]
    # What is rounded off has bounds, and so have the intervals: none may miss, and they lie around what is true.
    assert all(one.low <= exponent <= one.high for one in found)


def test_loads_that_are_nearly_the_same_do_not_tell() -> None:
    assert holding(0.0, (0.1, 0.105, 0.11, 0.115)).whose == "undetermined"


def test_a_law_between_the_two_is_neither() -> None:
    found = swinging(0.5)
    assert found.whose == "undetermined"
    assert "neither 0, the motor's, nor 1, the supply's" in found.why


def test_the_interval_covers_as_often_as_it_says() -> None:
    covered = [
        found.exponent.low <= 1.0 <= found.exponent.high for found in (swinging(1.0, seed) for seed in range(20))
    ]
    assert sum(covered) >= 15  # 90 % of 20, less two standard deviations of a binomial count


def test_speed_and_voltage_come_from_the_recording() -> None:
    time = np.arange(1600) / 200
    angle = 0.3 * np.sin(math.tau * 2 * time)
    speed = 0.3 * math.tau * 2 * np.cos(math.tau * 2 * time)
    duty = 0.5 * np.sin(math.tau * 1.3 * time) + 0.3 * np.sin(math.tau * 0.2 * time)
    samples = {
        "time_s": time,
        "drive_rad": angle,
        "drive_pwm": duty,
        "drive_current_a": read(winding(duty, speed), duty, 0.0),
        "gyro_rad_s": np.zeros((time.size, 3)),
        "supply_v": np.full(time.size, VOLTS),
    }
    recording = build_recording(samples, [Segment("steady", 4.0, 2.0, 20.0, 0)], [time.size], provenance("twin"))
    (drive,) = sense_currents(recording, COUNT_A).motors
    assert (drive.motor, drive.whose) == ("drive", "motor")
    with pytest.raises(RecordingError, match="no motor with both current and duty"):
        sense_currents(recording.drop_vars("drive_pwm"), COUNT_A)


PLAN = parse_plan("""
name = "loaded"
pretension = { pretension_mm = [2, 5, 8, 11], rest_s = 0.5 }
sweep = { frequency_hz = [3], settle_s = 0.3, periods = 3, repeats = 1 }
""")


@pytest.mark.slow
def test_an_emulated_drive_that_tells_its_supplys_current_is_found_out_by_a_run(tmp_path: Path) -> None:
    rig = load_rig("paper")
    bench = virtual_bench(rig, tells_supply=True)
    pretensions = PLAN.pretension.pretension_mm
    tension = dict(zip(pretensions, rest_tension(pretensions, rig).tolist(), strict=True))
    report = bench.run(PLAN, tmp_path, tension)
    assert report.is_complete, report.sentence
    found = sense_currents(recording_from_journal(tmp_path / "journal.sqlite"), COUNT_A).motors
    assert found[0].whose == "supply"
    assert {one.whose for one in found[1:]} <= {"motor", "undetermined"}
    assert all(one.exponent.low <= 0.0 <= one.exponent.high for one in found[1:])
