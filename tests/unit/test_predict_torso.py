"""A joint under the weight of a torso: buckling, tension, strain and tipping, against closed forms."""

import math

import numpy as np
import pytest

from sinew.measure.errors import SpecError
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.rod import column_load
from sinew.plan.check import mast_load
from sinew.plan.toml import load_rig
from sinew.predict.design import section_of, shear_modulus_of
from sinew.predict.validity import (
    Check,
    Loads,
    Torso,
    check_joint,
    euler_load,
    loads_under,
)
from sinew.tune.candidate import DesignTarget
from sinew.tune.design import assumptions

RIG = load_rig("paper")
REST = Loads(*(np.array([x]) for x in (50.0, 60.0, 0.95, 0.94, 0.3)))


def checks(torso: Torso | None, *, tilt_held: bool = True) -> dict[str, Check]:
    return {one.check: one for one in check_joint(RIG, [8.0], REST, tilt_held=tilt_held, torso=torso)}


def test_a_mast_of_no_height_falls_at_eulers_load_of_a_free_end() -> None:
    assert mast_load(2.0, 0.1, 0.0) == pytest.approx(math.pi**2 * 2.0 / (4 * 0.1**2))


def test_a_high_mast_falls_at_the_stiffness_of_a_bent_column_over_its_height() -> None:
    # A column bent by a moment at its end turns by M L/(E I), so that a high mast falls at P h = E I/L.
    assert mast_load(2.0, 0.1, 1000.0) == pytest.approx(2.0 / (0.1 * 1000.0), rel=1e-3)


def test_the_silicone_under_a_weight_carries_tendons_and_weight() -> None:
    torso, rigidity = Torso(12.0, 0.0), 900.0
    under = loads_under(REST, torso, rigidity, (4, 0.03), 10.0)
    before, after = float(REST.stretch[0]), float(under.stretch[0])
    assert rigidity * (after**-2 - after) == pytest.approx(rigidity * (before**-2 - before) + 12.0 * STANDARD_GRAVITY)


def test_the_moment_of_a_tilted_torso_is_the_moment_of_the_tensions_that_hold_it() -> None:
    torso = Torso(20.0, 0.3)
    more = float(loads_under(REST, torso, 1e4, (4, 0.1), 10.0).tension[0] - REST.tension[0])
    around = np.arange(4) * math.pi / 2
    held = float(np.sum(more * np.cos(around) * 0.1 * np.cos(around)))
    assert held == pytest.approx(20.0 * STANDARD_GRAVITY * 0.3 * math.sin(math.radians(10.0)))


def test_shares_of_tendons_and_weight_add_up_in_buckling() -> None:
    section, modulus, length = section_of(RIG), shear_modulus_of(RIG), RIG.silicone.length.value
    stiffness, sliding = 3 * modulus * section.least, modulus * section.area
    tendons = column_load(4 * math.pi**2 * stiffness / length**2, sliding)
    sway = column_load(euler_load(stiffness, length, tilt_held=False), sliding)
    found = checks(Torso(3.0))["buckling_sideways"]
    assert found.value == pytest.approx(4 * 60.0 / tendons + 3.0 * STANDARD_GRAVITY / sway)


@pytest.mark.parametrize("name", ["buckling_sideways", "tension_n", "tipping_over", "local_strain"])
def test_what_holds_without_a_torso_breaks_under_a_heavy_one(name: str) -> None:
    light = checks(None)
    assert name == "tipping_over" or light[name].holds
    assert not checks(Torso(400.0, 0.5))[name].holds


def test_a_torso_of_almost_nothing_changes_no_check() -> None:
    plain, light = checks(None), checks(Torso(1e-6))
    assert {name: one.holds for name, one in plain.items()}.items() <= {n: c.holds for n, c in light.items()}.items()
    assert light["tension_n"].value == pytest.approx(plain["tension_n"].value, rel=1e-4)


def test_without_tilt_held_the_weight_stands_on_a_mast() -> None:
    held, free = (checks(Torso(10.0), tilt_held=way)["buckling_sideways"].value for way in (True, False))
    assert held is not None
    assert free is not None
    assert free > held


def target(mass: float | None, centre_mm: float | None = None) -> DesignTarget:
    return DesignTarget((0.7, 1.1), 7.0, 0.25, torso_kg=mass, torso_centre_mm=centre_mm)


def test_without_a_mass_it_is_said_that_the_weight_is_left_out() -> None:
    assert "the weight of what sits on it is left out" in assumptions(target(None))[0]


def test_with_a_mass_it_is_said_where_its_centre_is_taken_to_be() -> None:
    told = assumptions(target(30.0))[0]
    assert "30 kg" in told
    assert "centre 250 mm above the head plate" in told
    assert "press with 294 N" in told


@pytest.mark.parametrize("torso", [(-1.0, None), (1e9, None), (math.nan, None), (30.0, -100.0), (30.0, math.inf)])
def test_a_torso_that_cannot_be_meant_is_refused(torso: tuple[float, float | None]) -> None:
    with pytest.raises(SpecError, match="expected above 0 and up to 500 kg"):
        target(*torso)
