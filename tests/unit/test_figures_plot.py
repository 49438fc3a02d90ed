"""Single plots for a notebook: each draws the numbers of its result, in the unit of its axes."""

import math

import numpy as np
from matplotlib.figure import Figure
from tests.unit.figures_drawn import results
from tests.unit.figures_panels import labelled
from tests.unit.figures_sample import SMALL

import sinew as sn
from sinew.measure.estimate import Estimate
from sinew.measure.result import Rows
from sinew.tune.pretension import Reachable, Resonance, Setting, Tuning


def test_the_phase_is_the_lag_over_frequency_in_degrees() -> None:
    axes = sn.plot.phase(results(), Figure().subplots())
    for p, pretension in enumerate(SMALL[0]):
        lag = np.degrees(results()["phase_lag_rad"].values[p].mean(axis=1))
        np.testing.assert_allclose(labelled(axes, f"{pretension:g} mm"), np.column_stack([SMALL[1], lag]))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("drive frequency in Hz", "lag of torsion behind drive in degrees")


def test_a_tuning_is_the_reachable_curve_and_a_ring_with_its_interval_for_each_feasible_setting() -> None:
    curve = [(0.0, 3.0), (6.0, 3.6), (12.0, 4.1)]
    reachable = tuple(Resonance(mm, hz, hz, 0.3, 0.3, 1j, 20.0, 30.0) for mm, hz in curve)
    at, unsure = Estimate.normal(6.0, 0.5), Estimate(3.0, *3 * (math.nan,))
    settings = (
        Setting(3.6, True, "so it is set", at, Estimate.normal(3.6, 0.05)),
        Setting(9.0, False, "too fast for it"),
        Setting(3.3, True, "nothing is known of its uncertainty", unsure, Estimate(3.3, *3 * (math.nan,))),
    )
    found = Tuning(
        Rows(settings), Reachable(reachable, None, None, ("", "")), (), "paper", 20.0, None, "position", None
    )
    axes = sn.plot.tuning(found, Figure().subplots())
    shown = [[tuple(point) for point in np.column_stack(line.get_data()).tolist()] for line in axes.lines]
    assert shown == [curve, [(at.low, 3.6), (at.high, 3.6)], [(6.0, 3.6)], [(3.0, 3.3)]]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("pretension in mm", "resonance in Hz")
