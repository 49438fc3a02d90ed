"""What the figure and the table of the energy show is what the results say."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from tests.unit.figures_panels import drawn
from tests.unit.ideal_motor import RIG, recorded

from sinew.analysis.analysed import analyse_recording
from sinew.figures.page import measured_tables
from sinew.figures.response import draw_energy
from sinew.measure.recording import ENERGY_QUANTITIES
from sinew.paper.campaign import summarise


@pytest.fixture(scope="module")
def results() -> xr.Dataset:
    return analyse_recording(recorded(), RIG)


@pytest.fixture(scope="module")
def figure(results: xr.Dataset) -> Figure:
    return drawn(draw_energy(recorded(), results))


def test_the_rings_are_the_power_at_resonance(figure: Figure, results: xr.Dataset) -> None:
    (rings,) = [line for line in figure.axes[0].lines if line.get_linestyle() == "None"]
    assert np.allclose(rings.get_data(), [results["resonance_hz"].values, results["drive_power_at_resonance_w"].values])


def test_the_triangles_are_the_cheapest_swings(figure: Figure, results: xr.Dataset) -> None:
    marks = [line for line in figure.axes[1].lines if line.get_marker() == "v"]
    cheapest = [results[name].values for name in ("cheapest_hz", "swing_cost_at_cheapest_j_rad2")]
    assert np.allclose([np.ravel(mark.get_data()) for mark in marks], np.transpose(cheapest))


def test_the_trend_lies_above_the_cost_by_what_is_saved(figure: Figure, results: xr.Dataset) -> None:
    lines = figure.axes[1].lines
    solid, dashed = lines[0], lines[1]
    at = np.interp(results["resonance_hz"].values[0], solid.get_xdata(), 1 - solid.get_ydata() / dashed.get_ydata())
    assert (solid.get_linestyle(), dashed.get_linestyle()) == ("-", "--")
    assert at == pytest.approx(results["energy_reduction"].values[0], abs=0.02)


def test_the_bars_are_the_shares_of_the_power_at_resonance_and_add_up_to_all_of_it(
    figure: Figure, results: xr.Dataset
) -> None:
    bars = {str(row.get_label()): [bar.get_height() for bar in row] for row in figure.axes[2].containers}
    for label, name in (("tendon motors", "holding"), ("copper", "copper"), ("mechanical", "mechanical")):
        assert bars[label] == pytest.approx(results[f"{name}_at_resonance_w"].values)
    whole = results["drive_power_at_resonance_w"] + results["holding_at_resonance_w"] + results.attrs["idle_power_w"]
    assert sum(map(sum, bars.values())) == pytest.approx(float(whole.sum()))


def test_the_table_has_a_row_for_each_pretension_and_tells_of_the_electronics(results: xr.Dataset) -> None:
    (table,) = [table for table in measured_tables(results) if table.title == "Energy"]
    assert [row[0] for row in table.rows] == ["0", "1"]
    assert "electronics" in table.note


def test_the_summary_lists_every_quantity_over_pretension(results: xr.Dataset) -> None:
    energy = summarise(results, wall_s=1.0, simulated_s=1.0)["energy"]
    assert energy["energy_reduction"] == pytest.approx(results["energy_reduction"].values.tolist())
    assert set(ENERGY_QUANTITIES) <= set(energy)


def test_without_powers_there_is_no_figure(results: xr.Dataset) -> None:
    bare = analyse_recording(recorded().drop_vars("drive_pwm"), RIG)
    assert draw_energy(recorded(), bare) is None
