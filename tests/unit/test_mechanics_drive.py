"""A motor that holds its horn: a spring and a loss, of its position loop, torque line and gear."""

import math

import pytest

from sinew.mechanics.drive import SLIDING_SPEED, holding_stiffness
from sinew.plan.toml import load_rig
from sinew.solve.programs import configure
from sinew.twin.parameters import from_rig

configure()

DRIVE = load_rig("paper").drive
P = from_rig(load_rig("paper"))
OMEGA = 27.0
SPRING = DRIVE.position_gain.value * DRIVE.duty_torque


def test_in_small_swings_a_gear_creeps_as_a_damper() -> None:
    damper = DRIVE.speed_slope + DRIVE.friction.value / SLIDING_SPEED
    assert holding_stiffness(0.0, OMEGA, P) == pytest.approx(complex(SPRING, OMEGA * damper), rel=1e-9)


def test_in_large_swings_it_takes_four_times_the_friction_at_every_degree_of_way() -> None:
    amplitude = 0.15
    lost = math.pi * amplitude**2 * OMEGA * DRIVE.speed_slope + 4 * DRIVE.friction.value * amplitude
    found = holding_stiffness(amplitude, OMEGA, P)
    assert math.pi * amplitude**2 * found.imag == pytest.approx(lost, rel=2e-3)
    assert found.real == pytest.approx(SPRING, rel=1e-9)


def test_where_the_duty_is_at_its_limit_the_spring_is_softer() -> None:
    assert holding_stiffness(1.0, OMEGA, P).real < 0.5 * SPRING
