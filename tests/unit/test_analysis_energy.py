"""Power and energy of a linear joint that an ideal motor swings: everything is known in closed form."""

import numpy as np
import pytest
import xarray as xr
from tests.unit.ideal_motor import (
    ARMATURE,
    CONSTANT,
    FREQUENCY,
    JOINTS,
    LEVER,
    RESISTANCE,
    RIG,
    TENDON_A,
    VOLTS,
    recorded,
    truth,
)

from sinew.analysis.analysed import analyse_recording


@pytest.fixture(scope="module")
def results() -> xr.Dataset:
    return analyse_recording(recorded(), RIG)


@pytest.mark.parametrize("name", ["drive_power_w", "drive_copper_w", "drive_mechanical_w", "amplitude_rad"])
def test_every_group_has_the_power_of_the_closed_form(results: xr.Dataset, name: str) -> None:
    expected = np.array([[truth(joint, f)[name] for f in FREQUENCY] for joint in JOINTS])
    assert np.allclose(results[name].values, expected[..., None], rtol=2e-3)


def test_the_tendon_motors_draw_what_their_resistance_takes(results: xr.Dataset) -> None:
    assert np.allclose(results["holding_power_w"].values, 4 * 12.0 / 1.3 * TENDON_A**2, rtol=1e-6)


def test_power_drawn_is_more_than_power_where_the_motor_gives_back(results: xr.Dataset) -> None:
    # Far below the resonance the motor brakes the lever for a quarter of the time.
    assert (results["drive_drawn_w"].values[:, 0] > 1.01 * results["drive_power_w"].values[:, 0]).all()


def test_the_reduction_at_resonance_is_the_share_that_spring_and_inertia_save(results: xr.Dataset) -> None:
    for p, joint in enumerate(JOINTS):
        inertia = LEVER / joint.share
        stiffness = inertia * (2 * np.pi * joint.natural_hz) ** 2
        spring = (1 + ARMATURE / LEVER) * stiffness
        mass = inertia * (1 + ARMATURE / LEVER) - LEVER
        damper = 2 * joint.damping * np.sqrt(stiffness * inertia) * (1 + ARMATURE / LEVER)
        omega = 2 * np.pi * results["resonance_hz"].values[p]
        there = truth(joint, omega / 2 / np.pi)
        saved = (2 * spring * mass - damper**2) * (omega * there["amplitude_rad"] / CONSTANT) ** 2 / 2 * RESISTANCE
        expected = saved / (there["drive_power_w"] + saved)
        assert results["energy_reduction"].values[p] == pytest.approx(expected, abs=2e-3)


def test_the_cheapest_frequency_is_the_least_of_the_closed_form(results: xr.Dataset) -> None:
    fine = np.linspace(2.0, 6.0, 4001)
    for p, joint in enumerate(JOINTS):
        powers = [truth(joint, f) for f in fine]
        cost = [one["drive_power_w"] / f / one["amplitude_rad"] ** 2 for one, f in zip(powers, fine, strict=True)]
        assert results["cheapest_hz"].values[p] == pytest.approx(fine[int(np.argmin(cost))], abs=0.03)


def test_the_tendon_motors_are_paid_from_the_break_even_swing_on(results: xr.Dataset) -> None:
    even, hertz = results["break_even_rad"].values, results["resonance_hz"].values
    saved = (results["trend_cost_at_resonance_j_rad2"] - results["swing_cost_at_resonance_j_rad2"]).values
    assert np.allclose(saved * even**2 * hertz, 4 * 12.0 / 1.3 * TENDON_A**2, rtol=1e-3)


def test_a_recording_without_voltage_and_duty_of_the_tendons_takes_the_rigs_voltage() -> None:
    plain = analyse_recording(recorded(with_volts=False), RIG)
    share = RIG.drive.supply_voltage.value / VOLTS
    expected = truth(JOINTS[0], FREQUENCY[3])["drive_power_w"] * share
    assert plain["drive_power_w"].values[0, 3, 0] == pytest.approx(expected, rel=2e-3)
    assert np.allclose(plain["holding_power_w"].values, 4 * 12.0 / 1.3 * TENDON_A**2)


def test_without_a_rig_or_the_duty_there_is_no_power() -> None:
    assert "drive_power_w" not in analyse_recording(recorded())
    assert "drive_power_w" not in analyse_recording(recorded().drop_vars("drive_pwm"), RIG)
