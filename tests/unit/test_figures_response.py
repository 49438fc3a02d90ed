"""What the figures of the response and its map show is what the results hold."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from tests.unit.figures_drawn import panel, results
from tests.unit.figures_panels import drawn, labelled, titled
from tests.unit.figures_sample import SMALL

from sinew.figures.response import along_ridge, draw_response


def test_the_response_lines_are_means_over_repeats() -> None:
    left = panel("figure06_response", "amplitude response")
    for p, pretension in enumerate(SMALL[0]):
        expected = results()["gain"].values[p].mean(axis=1)
        np.testing.assert_allclose(labelled(left, f"{pretension:g} mm"), np.column_stack([SMALL[1], expected]))


def test_the_tubes_are_one_standard_deviation_to_both_sides() -> None:
    left = panel("figure06_response", "amplitude response")
    tubes = [c for c in left.collections if isinstance(c, PolyCollection)]
    values = results()["gain"].values
    for p, tube in enumerate(tubes):
        corners = tube.get_paths()[0].vertices
        for f, frequency in enumerate(SMALL[1]):
            at = corners[np.isclose(corners[:, 0], frequency), 1]
            spread = values[p, f].std(ddof=1)
            assert np.ptp(at) == pytest.approx(2 * spread)
    assert len(tubes) == len(SMALL[0])


def test_one_repeat_gives_lines_without_tubes() -> None:
    left = titled(drawn(draw_response(results().isel(repeat=[0]))), "amplitude response")
    assert len(left.lines) > len(SMALL[0])
    assert not left.collections


def test_a_foreign_gain_keeps_its_units_and_is_not_held_against_one() -> None:
    foreign = results().assign_attrs(response_unit="m", drive_unit="V")
    left = titled(drawn(draw_response(foreign)), "amplitude response")
    assert left.get_ylabel() == "gain in m per V"
    assert not [line for line in left.lines if list(line.get_ydata()) == [1.0, 1.0]]


def test_the_ridge_of_the_map_is_the_resonance_over_pretension() -> None:
    above = panel("figure08_map", "from above")
    assert any(
        np.array_equal(line.get_xdata(), results()["resonance_hz"].values)
        and np.array_equal(line.get_ydata(), SMALL[0])
        for line in above.lines
    )


def test_the_mesh_of_the_map_reproduces_a_straight_response() -> None:
    f = np.array([1.5, 2.0, 3.0, 4.5, 6.0])
    gain = 0.3 * f + np.array([[0.0], [1.0], [2.0]])
    mesh, found = along_ridge(f, gain, np.array([3.0, np.nan, 4.0]))
    np.testing.assert_allclose(found, 0.3 * mesh + np.array([[0.0], [1.0], [2.0]]))
