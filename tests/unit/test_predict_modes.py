"""Modes of a joint in space: where their energy is, what else moves, what the guides lose, what is drawn."""

import math

import numpy as np
import pytest

from sinew.measure.errors import SpecError
from sinew.plan.toml import load_rig
from sinew.predict.modes import SHARES, Finder, ModesRequest, draw_spatial, energy_shares, find_modes


@pytest.fixture(scope="module")
def finder() -> Finder:
    """Return the modes of the paper's rig with guides that slip in swings of 20°."""
    return Finder(load_rig("paper"), ModesRequest((12.0,), (0.0, 20.0), swing_deg=20.0))


def test_the_torsion_of_a_straight_joint_is_nothing_else(finder: Finder) -> None:
    torsion = finder.at(12, 0).modes[0]
    assert torsion.kind == "torsion"
    assert torsion.shares == pytest.approx([1, 0, 0, 0], abs=1e-9)
    assert torsion.tilt_across == pytest.approx(0, abs=1e-9)


def test_a_straight_torsion_tilts_nothing_not_even_by_what_rounding_leaves(finder: Finder) -> None:
    assert finder.at(12, 0).modes[0].tilt_across_per_torsion == 0


def test_the_torsion_of_a_straight_joint_is_that_of_its_inertia_and_stiffness(finder: Finder) -> None:
    linear, space = finder.linear(12, 0)
    mode = finder.at(12, 0).modes[0]
    held, _ = linear.stiffness(2 * math.pi * mode.frequency_hz, space)
    # Twisted by a torque on the head, the rod is a spring; the rod's own inertia adds a third of it to the head's.
    spring = 1 / float(linear.around.by_torsion @ np.linalg.solve(held, linear.around.by_torsion))
    rod = float(space.rod.line_inertia[0]) * float(space.rod.joint.length) / 3
    inertia = float(space.head_tensor[0] + space.lever_tensor[0]) + rod
    assert mode.frequency_hz == pytest.approx(math.sqrt(spring / inertia) / (2 * math.pi), rel=2e-3)


def test_a_torque_on_a_bent_head_tilts_it_across_by_half_the_sine_of_the_bend(finder: Finder) -> None:
    around = finder.linear(12, 20)[0].around
    moved = np.linalg.solve(around.stiffness, around.by_torsion)
    across = np.array([-finder.direction[1], finder.direction[0]])
    per = float(across @ around.by_tilt @ moved) / float(around.by_torsion @ moved)
    assert per == pytest.approx(0.5 * math.sin(math.radians(20)), rel=0.05)


def test_shares_of_the_kinetic_energy_are_those_of_the_potential_one(finder: Finder) -> None:
    linear, _ = finder.linear(12, 20)
    for mode in finder.at(12, 20).modes:
        assert energy_shares(mode.shape, linear.mass, finder.direction) == pytest.approx(mode.shares, abs=1e-8)
        assert mode.shares.sum() == pytest.approx(1)


def test_guides_that_slip_take_the_energy_of_their_loop_from_the_torsion(finder: Finder) -> None:
    linear, space = finder.linear(12, 0)
    mode, swing = finder.at(12, 0).modes[0], math.radians(20)
    lost = float(space.rod.joint.guides.loss(float(linear.around.tension.sum()), np.asarray(swing)))
    modal = mode.shape @ linear.mass @ mode.shape  # of a head that twists by one radian [kg m²]
    omega, small = 2 * math.pi * mode.swung_hz, 2 * math.pi * mode.frequency_hz
    silicone = 4 * math.pi * mode.damping * 0.5 * modal * small**2 * swing**2
    stored = 0.5 * modal * omega**2 * swing**2
    assert mode.swung_damping == pytest.approx((silicone + lost) / (4 * math.pi * stored), rel=1e-6)


def test_sway_keeps_its_frequency_where_guides_slip(finder: Finder) -> None:
    sway = finder.at(12, 0).of("in_plane")
    assert sway is not None
    assert sway.swung_hz == pytest.approx(sway.frequency_hz, rel=1e-9)


def test_a_drawn_head_is_a_body_and_heavier_than_its_lever() -> None:
    rigs, names, _ = draw_spatial(load_rig("paper"), 40, seed=0)
    assert "inertia.head_mass" in names
    for rig in rigs:
        assert rig.space is not None
        assert rig.inertia.head.value <= 2 * rig.space.head_across.value
        assert rig.space.lever_mass.value < rig.inertia.head_mass.value


def test_a_rig_without_masses_is_refused() -> None:
    flat = load_rig("paper").model_copy(update={"space": None})
    with pytest.raises(SpecError, match=r"has no \[space\]"):
        find_modes(flat)


@pytest.mark.slow
def test_a_sway_held_by_current_crosses_the_torsion_between_six_and_twelve_millimetres() -> None:
    at = Finder(load_rig("paper"), ModesRequest((6.0, 12.0), (0.0,), mode="current"))
    apart = []
    for pretension_mm in (6.0, 12.0):
        pose = at.at(pretension_mm, 0.0)
        sway = pose.of("across")
        assert sway is not None
        apart.append(sway.frequency_hz - pose.torsion_hz())
    assert apart[0] > 0 > apart[1]


@pytest.mark.slow
def test_modes_state_shares_of_energy_intervals_and_what_is_assumed() -> None:
    found = find_modes("paper", (0, 12), bend_deg=(0,), mode="current", bands=4, seed=1)
    document = found.to_dict()
    first = document["poses"][0]["modes"][0]
    assert set(first["energy_shares"]) == set(SHARES)
    assert first["frequency_hz"]["interval90"][0] is not None
    assert "- assumed: space.head_across, the head's moment across its axis, is 0.0025 kg m²" in str(found.blocks())
