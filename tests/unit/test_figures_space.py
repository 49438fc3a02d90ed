"""Figures of modes over pretension and bend, against the modes they draw; and how an oval section turns the sways."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from tests.unit.figures_panels import drawn

from sinew.figures.space import draw_coupling, draw_over_pretension
from sinew.plan.toml import load_rig
from sinew.predict.design import Design, design_rig
from sinew.predict.modes import Modes, find_modes
from sinew.predict.section import ellipse_section

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found() -> Modes:
    """Return the modes of a joint that stands and is bent across the arms; at 20° and 0 mm a tendon is slack."""
    return find_modes("paper", [0.0, 12.0], bend_deg=[0.0, 20.0], azimuth_deg=90.0)


def rows(axes: Axes) -> list[np.ndarray]:
    return [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines if np.size(line.get_xdata()) > 2]


def test_a_panel_has_the_modes_of_its_bend_twice_the_torsion_and_a_gap_where_there_are_none(
    found: Modes,
) -> None:
    track = found.scanned[20.0]
    gap = len(track) // 2
    parted = tuple(replace(one, modes=()) if i == gap else one for i, one in enumerate(track))
    panels = drawn(draw_over_pretension(replace(found, scanned=found.scanned | {20.0: parted}))).axes[:2]
    for axes, poses in zip(panels, (found.scanned[0.0], parted), strict=True):
        *each, double = rows(axes)
        slowest = np.array([one.modes[0].frequency_hz if one.modes else np.nan for one in poses])
        torsion = [2 * next((m.frequency_hz for m in one.modes if m.group == "torsion"), np.nan) for one in poses]
        np.testing.assert_array_equal(each[0], slowest)
        np.testing.assert_array_equal(double, torsion)
    assert np.flatnonzero(np.isnan(rows(panels[1])[0])).tolist() == [gap]
    assert panels[0].get_xlabel() == "pretension in mm"


def test_coupling_is_drawn_over_the_bend_beside_half_its_sine_hollow_where_a_tendon_is_slack(found: Modes) -> None:
    left, right = drawn(draw_coupling(found)).axes[:2]
    curves = [line for line in left.lines if len(np.atleast_1d(line.get_xdata())) == 2]
    mine = [[one for one in found.nominal if one.pretension_mm == mm] for mm in (0.0, 12.0)]
    for line, poses in zip(curves, mine, strict=True):
        tilts = [abs(torsion.tilt_across_per_torsion) for one in poses if (torsion := one.of("torsion")) is not None]
        np.testing.assert_allclose(np.abs(np.asarray(line.get_ydata(), dtype=float)), tilts, atol=1e-12)
    (sine,) = rows(left)
    assert sine[-1] == pytest.approx(0.5 * np.sin(np.radians(20.0)))
    fills = {
        float(np.asarray(line.get_xdata()).ravel()[0]): line.get_markerfacecolor() == "white"
        for line in right.lines
        if np.size(line.get_xdata()) == 1 and line.get_color() == right.lines[0].get_color()
    }
    assert fills == {0.0: False, 20.0: True}
    for line in right.lines:
        if np.size(line.get_xdata()) == 2:
            assert np.asarray(line.get_ydata(), dtype=float)[0] == pytest.approx(1.0)


def test_the_flat_side_of_an_oval_decides_which_sway_is_the_slower_one() -> None:
    """Of a round joint it is the one towards the lever's arms (y), which have the inertia; an oval that is wide along y
    bends towards z more easily by far."""
    oval = design_rig(load_rig("paper"), Design(section=ellipse_section(0.065, 0.040), name="oval"))
    slower = []
    for rig in ("paper", oval):
        (pose,) = find_modes(rig, 12.0, bend_deg=0.0).nominal
        sway = next(mode for mode in pose.modes if mode.group != "torsion")
        slower.append(abs(sway.tilt_in_plane) > abs(sway.tilt_across))
    assert slower == [True, False]
