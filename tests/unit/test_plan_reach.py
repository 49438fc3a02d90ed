"""The drive's reach by harmonic balance, against closed forms and against the servo's own equation of motion."""

import cmath
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sinew.plan.check import drive_reach
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig

# With fixed values, so that a recalibration of the shipped rig cannot move a case across its threshold.
RIG = load_rig("paper").with_values(
    {"drive.friction": 0.15, "drive.supply_voltage": 14.7, "drive.armature": 0.0125, "inertia.lever": 0.0083}
)
FRICTIONLESS = RIG.with_values({"drive.friction": 0.0})


def integrated_amplitude(rig: RigSpec, command_rad: float, frequency_hz: float) -> float:
    """Return the fundamental of the lever after 30 periods of the servo's equation of motion [rad]."""
    drive, omega = rig.drive, 2 * math.pi * frequency_hz
    inertia = rig.inertia.lever.value + drive.armature.value
    slope = drive.stall_torque.value / drive.no_load_speed.value
    full = (drive.stall_torque.value + drive.friction.value) * drive.supply_voltage.value / drive.nominal_voltage.value

    def rate(time: float, state: np.ndarray) -> list[float]:
        error = command_rad * math.sin(omega * time) - state[0]
        duty = min(1.0, max(-1.0, drive.position_gain.value * error))
        torque = full * duty - slope * state[1] - drive.friction.value * math.tanh(state[1] / 0.02)
        return [state[1], torque / inertia]

    times = np.linspace(29 / frequency_hz, 30 / frequency_hz, 401)
    solution = solve_ivp(rate, (0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-7, atol=1e-9, max_step=0.02)
    wave = solution.y[0][:-1]
    return float(abs(2 / wave.size * np.sum(wave * np.exp(-1j * omega * times[:-1]))))


def test_an_unsaturated_frictionless_servo_follows_its_transfer_function() -> None:
    omega, command = 2 * math.pi * 3.0, math.radians(1.0)
    drive = FRICTIONLESS.drive
    inertia = RIG.inertia.lever.value + drive.armature.value
    stiffness = drive.stall_torque.value * drive.supply_voltage.value / 12 * drive.position_gain.value
    slope = drive.stall_torque.value / drive.no_load_speed.value
    transfer = stiffness / complex(stiffness - inertia * omega**2, slope * omega)
    reach = drive_reach(FRICTIONLESS, command, 3.0)
    assert (reach.amplitude_rad, reach.lag_rad) == pytest.approx(
        (command * abs(transfer), -cmath.phase(transfer)), rel=1e-9
    )


def test_a_huge_command_meets_the_square_wave_of_full_torque() -> None:
    omega = 2 * math.pi * 4.0
    drive = FRICTIONLESS.drive
    inertia = RIG.inertia.lever.value + drive.armature.value
    slope = drive.stall_torque.value / drive.no_load_speed.value
    torque = 4 / math.pi * drive.stall_torque.value * drive.supply_voltage.value / 12
    expected = torque / math.hypot(inertia * omega**2, slope * omega)
    assert drive_reach(FRICTIONLESS, 500.0, 4.0).amplitude_rad == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("frequency_hz", [1.5, 3.0, 4.3, 6.0])
def test_the_reach_agrees_with_the_integrated_servo_within_3_percent(frequency_hz: float) -> None:
    command = math.radians(20)
    truth = integrated_amplitude(RIG, command, frequency_hz)
    assert drive_reach(RIG, command, frequency_hz).amplitude_rad == pytest.approx(truth, rel=0.03)


def test_a_command_below_the_friction_does_not_move_the_lever() -> None:
    assert drive_reach(RIG, math.radians(0.1), 1.0).amplitude_rad == 0.0


def test_a_small_command_does_not_saturate_and_a_large_one_does() -> None:
    assert [drive_reach(RIG, math.radians(deg), 3.0).saturated for deg in (2.0, 20.0)] == [False, True]


def test_the_current_is_the_torque_of_inertia_over_the_torque_constant() -> None:
    reach = drive_reach(FRICTIONLESS, math.radians(20), 6.0)
    inertia = RIG.inertia.lever.value + RIG.drive.armature.value
    torque = inertia * (2 * math.pi * 6.0) ** 2 * reach.amplitude_rad
    assert reach.current_a == pytest.approx(torque / (4.1 / 2.3), rel=1e-9)
