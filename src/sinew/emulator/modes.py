"""This is where an operating mode becomes a law: what of the registers the motor's controller uses.

    0 current           goal_current, duty limited by goal_pwm
    1 velocity          goal_velocity, duty limited by goal_pwm
    3 position          goal_position within the position limits, one turn, duty limited by goal_pwm
    4 extended position goal_position over 512 turns, duty limited by goal_pwm
    5 current-based     as 4, and the current limited by goal_current
    16 PWM              goal_pwm

Source: e-Manual, pages XH430-W350 and XM430-W350, "Operating Mode(11)". Integral, derivative and feed-forward gains are
kept in their registers and have no effect; the velocity loop's missing integral part is made up for by a larger P gain.
"""

import math

from sinew.emulator.control_table import ControlTable
from sinew.emulator.mechanics import PULSE
from sinew.emulator.plant import Law
from sinew.hardware.motor_registers import (
    CURRENT_MODE,
    CURRENT_POSITION_MODE,
    EXTENDED_POSITION_MODE,
    POSITION_MODE,
    PWM_MODE,
    VELOCITY_MODE,
)
from sinew.plan.servo import FULL_DUTY_COUNTS

__all__ = ["CURRENT", "FULL_DUTY", "MODES", "POSITION_MODES", "SPEED", "goal_of", "law_of", "reset_for_mode"]

MODES = (CURRENT_MODE, VELOCITY_MODE, POSITION_MODE, EXTENDED_POSITION_MODE, CURRENT_POSITION_MODE, PWM_MODE)
"""Values of operating_mode that there are."""
POSITION_MODES = (POSITION_MODE, EXTENDED_POSITION_MODE, CURRENT_POSITION_MODE)
"""Those that go to goal_position."""
FULL_DUTY = FULL_DUTY_COUNTS
"""Counts of PWM that are the whole supply."""
SPEED = 0.229 * math.tau / 60
"""One count of speed [rad/s]."""
CURRENT = 2.69e-3
"""One count of current [A]."""

_INTEGRAL = 16.0  # factor on the velocity loop's P gain that stands for its integral part
_GAINS = (
    "velocity_i_gain",
    "velocity_p_gain",
    "position_d_gain",
    "position_i_gain",
    "position_p_gain",
    "feedforward_2nd_gain",
    "feedforward_1st_gain",
)


def goal_of(mode: int) -> str:
    """Return the register that a mode goes by."""
    return {CURRENT_MODE: "goal_current", VELOCITY_MODE: "goal_velocity", PWM_MODE: "goal_pwm"}.get(
        mode, "goal_position"
    )


def reset_for_mode(registers: ControlTable) -> None:
    """Do to the registers what a new operating mode does: gains as from the factory, no profile, goals to their limits.

    The manual gives the gains of mode 5 no numbers of their own; they are taken to be those of the others.
    """
    for name in _GAINS:
        initial = registers.rows[name].initial
        assert initial is not None
        registers[name] = initial
    registers["profile_velocity"] = registers["profile_acceleration"] = 0
    registers["goal_pwm"] = registers["pwm_limit"]
    registers["goal_current"] = registers["current_limit"]


def law_of(registers: ControlTable, sign: int, angle: float, speed: float) -> Law:
    """Return the law of the present mode and goals.

    sign: of the plant's sense that counts have. angle: the plant's angle to go to [rad], speed: the plant's speed to
    keep [rad/s], in the modes that do so.
    """
    mode = registers["operating_mode"]
    if mode == PWM_MODE:
        return Law("pwm", sign * _duty(registers["goal_pwm"]))
    limit = abs(_duty(registers["goal_pwm"]))
    if mode == CURRENT_MODE:
        return Law("current", sign * registers["goal_current"] * CURRENT, duty_limit=limit)
    if mode == VELOCITY_MODE:
        gain = registers["velocity_p_gain"] / 128 / FULL_DUTY / SPEED * _INTEGRAL
        return Law("velocity", speed, gain, limit)
    gain = registers["position_p_gain"] / 128 / FULL_DUTY / PULSE
    current = abs(registers["goal_current"]) * CURRENT if mode == CURRENT_POSITION_MODE else math.inf
    return Law("position", angle, gain, limit, current)


def _duty(counts: int) -> float:
    return max(-1.0, min(1.0, counts / FULL_DUTY))
