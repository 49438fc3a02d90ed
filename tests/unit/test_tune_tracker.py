"""The tracking law on a linear joint, whose phase resonance is its natural frequency whatever its damping."""

import math

import numpy as np
import pytest
from tests.unit.tune_joint import Joint, Run, run, setting

from sinew.tune.track import Follow, Mode, Ramp


def settled(found: Run, since: float) -> np.ndarray:
    return np.flatnonzero(found.time >= since)


@pytest.mark.parametrize("share", [0.8, 1.2])
@pytest.mark.parametrize("damping", [0.04, 0.08])
def test_the_drive_comes_to_the_natural_frequency_from_either_side(share: float, damping: float) -> None:
    joint = Joint(3.3, damping)
    found = run(joint, setting(joint, share * 3.3, mode=Mode(3.3, 0.06)), 10.0)
    assert found.frequency_hz[settled(found, 8.0)] == pytest.approx(3.3, rel=1e-3)


def test_a_delay_that_is_not_corrected_moves_the_lock_by_its_phase_times_the_half_width() -> None:
    joint = Joint(3.5, 0.05, delay=0.011, known_delay=0.008)
    found = run(joint, setting(joint, 3.3), 14.0)
    omega, phase = math.tau * 3.5, math.tau * 3.5 * 0.003  # the torsion is thought to lag more than it does
    lower = 3.5 - 0.05 * omega * math.tan(phase) / math.tau
    assert found.frequency_hz[settled(found, 12.0)].mean() == pytest.approx(lower, abs=0.001)


def test_it_bridges_half_a_second_without_the_sensor() -> None:
    joint = Joint(silent=(8.0, 8.5))
    found = run(joint, setting(joint, 3.3), 12.0)
    assert np.isnan(found.error[(found.time > 8.35) & (found.time < 8.45)]).all()
    assert found.locked[settled(found, 6.0)].all()
    assert found.frequency_hz[settled(found, 8.0)] == pytest.approx(3.5, rel=5e-3)


def test_a_long_silence_ends_the_lock_and_it_comes_back_by_itself() -> None:
    joint = Joint(silent=(8.0, 10.0))
    found = run(joint, setting(joint, 3.3), 14.0)
    assert not found.locked[(found.time > 9.8) & (found.time < 10.0)].any()
    assert found.locked[settled(found, 12.5)].all()
    assert found.tracker.lock.losses == 1


@pytest.mark.parametrize("begin", [8.0, 8.07, 8.14])
def test_a_push_is_forgotten(begin: float) -> None:
    joint = Joint(push=(begin, begin + 0.1, 1.0))
    found = run(joint, setting(joint, 3.3, wanted_deg=8.0), 14.0)
    assert np.degrees(np.abs(found.error[(found.time > begin) & (found.time < begin + 1)])).max() > 3
    assert np.degrees(np.abs(found.error[settled(found, 12.0)])).max() < 1
    assert found.frequency_hz[settled(found, 12.0)] == pytest.approx(3.5, rel=2e-3)


def rising(pretension_mm: float) -> float:
    return 3.0 + 0.1 * pretension_mm


def test_it_stays_locked_while_the_pretension_moves() -> None:
    joint = Joint(rising, 0.05)
    law = setting(joint, 3.0, mode=Mode(3.0, 0.05), hz_per_mm=0.1)
    found = run(joint, law, 26.0, Ramp(0.0, 12.0, 15.0, lead=5.0))
    late = settled(found, 5.0)
    assert found.locked[late].all()
    assert np.degrees(np.sqrt(np.mean(found.error[late] ** 2))) < 1
    assert found.pretension_mm[-1] == pytest.approx(12.0)
    assert found.frequency_hz[-1] == pytest.approx(4.2, rel=1e-3)


def test_what_is_fed_forward_keeps_the_phase_closer_than_the_loop_alone() -> None:
    joint = Joint(rising, 0.05)
    errors = []
    for slope in (0.0, 0.1):
        law = setting(joint, 3.0, mode=Mode(3.0, 0.05), hz_per_mm=slope)
        found = run(joint, law, 15.0, Ramp(0.0, 12.0, 15.0, lead=5.0))
        errors.append(np.abs(found.error[settled(found, 10.0)]).mean())
    assert errors[1] < 0.3 * errors[0]


def test_the_resonance_follows_a_commanded_frequency_although_the_table_is_wrong() -> None:
    joint = Joint(rising, 0.05)

    def wanted(time: float) -> float:
        return float(np.interp(time, [5.0, 25.0], [3.2, 4.0]))

    path = Follow(wanted, [0.0, 6.0, 12.0], [3.1, 3.8, 4.3], rate=0.4)  # a tenth of a hertz too high, bent
    law = setting(joint, 3.2, mode=Mode(3.2, 0.05), hz_per_mm=0.1)
    found = run(joint, law, 27.0, path)
    late = settled(found, 8.0)
    off = found.natural_hz[late] - np.array([wanted(time) for time in found.time[late]])
    assert np.abs(off).max() < 0.03
    assert found.frequency_hz[-1] == pytest.approx(4.0, rel=3e-3)


def test_it_holds_the_torsion_if_asked() -> None:
    joint = Joint()
    found = run(joint, setting(joint, 3.3, wanted_deg=15.0, held="torsion"), 14.0)
    assert np.degrees(found.torsion[settled(found, 12.0)]) == pytest.approx(15.0, rel=5e-3)


def test_an_amplitude_out_of_reach_is_said_to_be_and_does_not_wind_up() -> None:
    joint = Joint(damping_ratio=0.3)
    found = run(joint, setting(joint, 3.3, wanted_deg=79.0, held="torsion"), 10.0)
    state = found.tracker.tell()
    assert state.is_limited
    assert state.command_deg == pytest.approx(45.0)


def test_without_any_torsion_it_never_claims_a_lock() -> None:
    joint = Joint(silent=(0.0, math.inf))
    found = run(joint, setting(joint, 3.3), 4.0)
    assert not found.locked.any()
    assert found.frequency_hz == pytest.approx(3.3)
