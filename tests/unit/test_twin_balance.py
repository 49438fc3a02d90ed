"""The exact power balance: it closes, and it is the work that can be written down for a viscous joint."""

import numpy as np
import pytest
from campaigns.balance import Balance, balance_groups, balance_lanes

from sinew.measure.errors import SpecError
from sinew.plan.plan import Group
from sinew.plan.toml import load_rig
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters

pytestmark = pytest.mark.slow

RIG = load_rig("paper")
FREQUENCIES = (2.1, 3.0, 3.6, 4.5)


def group(pretension_mm: float, frequency_hz: float, amplitude_deg: float = 20.0) -> Group:
    return Group("steady", pretension_mm, frequency_hz, amplitude_deg, 0, 3.0, 1.0)


@pytest.fixture(scope="module")
def balance() -> Balance:
    return balance_groups([group(p, f) for p in (0, 12) for f in FREQUENCIES], RIG)


def test_what_the_drive_takes_up_is_copper_gear_friction_and_work(balance: Balance) -> None:
    assert np.abs(balance.drive_residual).max() < 1e-12


def test_the_work_of_a_steady_cycle_is_what_silicone_and_guides_lose(balance: Balance) -> None:
    assert np.abs(balance.joint_residual / balance.mechanical).max() < 1e-4
    assert np.abs(balance.stored / balance.mechanical).max() < 1e-4


def test_power_drawn_is_never_less_than_power(balance: Balance) -> None:
    assert (balance.drawn >= balance.electrical).all()


def test_a_viscous_joint_takes_up_half_its_damping_times_the_squared_speed() -> None:
    # Without friction of its gear the drive is linear while its duty stays below the limit, and the swing is a sine.
    viscous = RIG.with_values({"silicone.viscous": 0.03, "drive.friction": 0.0})
    effects = Effects().without("tendons", "guide_friction", "silicone_loss", "axial_motion")
    lanes = lane_parameters([group(0, f, 2.0) for f in FREQUENCIES], viscous, effects=effects)
    found = balance_lanes(lanes, viscous, settle_cycles=60)
    speed = 2 * np.pi * np.array(FREQUENCIES) * found.torsion
    assert np.allclose(found.mechanical, 0.5 * 0.03 * speed**2, rtol=1e-3)


def test_a_motor_whose_two_constants_are_one_has_no_loss_in_its_gear() -> None:
    # No friction, and a no-load speed at which the back-EMF of k_t is the whole voltage.
    drive = RIG.drive
    speed = drive.nominal_voltage.value / (drive.stall_torque.value / drive.stall_current.value)
    data = RIG.model_dump()
    data["drive"]["no_load_speed"] |= {"value": speed, "bounds": (1.0, 20.0)}
    data["drive"]["friction"]["value"] = 0.0
    found = balance_groups([group(0, 3.0)], type(RIG).model_validate(data))
    assert abs(found.gear[0]) < 1e-12
    assert found.electrical[0] == pytest.approx(found.copper[0] + found.mechanical[0], rel=1e-12)


def test_tendon_motors_draw_what_holds_the_tension_at_rest_when_the_head_hardly_moves() -> None:
    found = balance_groups([group(12, 1.5, 0.1)], RIG)
    lanes, shortening = lane_parameters([group(12, 1.5, 0.1)], RIG, mode="current")
    current = float(lanes.held_tension[0]) * RIG.tendons.pulley_radius.value / RIG.tendons.torque_constant.value
    assert shortening.size == 1
    assert found.holding[0] == pytest.approx(4 * 12.0 / 1.3 * current**2, rel=1e-3)


def test_a_ring_down_has_no_balance() -> None:
    with pytest.raises(SpecError, match="steady groups"):
        balance_groups([Group("ring-down", 0, 3.0, 20.0, 0, 3.0, 3.0)], RIG)
