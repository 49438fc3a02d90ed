"""What the figure of a broadband record shows is what its document holds."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from tests.experiments.impacts import Pulse, struck
from tests.unit.broadband_signals import noise, shaken
from tests.unit.figures_panels import labelled, smallest_type, titled

import sinew as sn
from sinew.figures.response import draw_broadband


@pytest.fixture(scope="module")
def found() -> sn.results.Analysed:
    table = shaken(noise, [(3.0, 0.05, 1.0)], 1, seconds=60.0)
    return sn.analyse(sn.read(table, time="t", drive="u:N*m", response="phi:deg", kind="broadband"))


def column(found: sn.results.Analysed, *keys: str) -> np.ndarray:
    rows = found.to_dict()["frequency_response"]
    return np.array([row[keys[0]] if len(keys) == 1 else row[keys[0]][keys[1]] for row in rows], dtype=float)


def test_the_panels_hold_gain_lag_and_coherence_of_each_line(found: sn.results.Analysed) -> None:
    figure = draw_broadband(found.to_dict())
    frequency = column(found, "frequency_hz")
    gain, coherence = labelled(titled(figure, "gain"), "H1"), labelled(titled(figure, "coherence"), "γ²")
    np.testing.assert_array_equal(gain, np.column_stack([frequency, column(found, "gain", "value")]))
    np.testing.assert_array_equal(coherence, np.column_stack([frequency, column(found, "coherence")]))
    assert smallest_type({"broadband": figure})[0] >= 8


def test_single_panels_are_drawn_on_axes_that_are_given(found: sn.results.Analysed) -> None:
    axes = Figure().subplots(3)
    drawn = [
        draw(found, one) for draw, one in zip((sn.plot.response, sn.plot.phase, sn.plot.coherence), axes, strict=True)
    ]
    assert [one.get_ylabel() for one in drawn] == ["response / drive in rad/(N*m)", "lag in degrees", "coherence γ²"]
    np.testing.assert_array_equal(labelled(drawn[0], "H1")[:, 1], column(found, "gain", "value"))
    lag, known = labelled(drawn[1], "H1")[:, 1], column(found, "phase_lag_deg", "value")
    np.testing.assert_array_equal(lag[np.isfinite(lag)], known[np.isfinite(lag)])  # a gap where it jumps by a turn
    assert np.isfinite(lag).mean() > 0.5
    np.testing.assert_array_equal(labelled(drawn[2], "γ²")[:, 1], column(found, "coherence"))


def test_the_figure_of_one_hit_has_no_h2_and_says_why_there_is_no_coherence() -> None:
    table = struck([(3.0, 0.05, 1.0)], [Pulse(0.5, 1.0, 0.015)], 5.0, np.random.default_rng(1), response_noise=0.01)
    one = sn.analyse(sn.read(table, time="t", drive="force:N", response="phi:deg", kind="impact"))
    figure = draw_broadband(one.to_dict())
    assert {line.get_label() for line in titled(figure, "gain").lines} & {"H1", "H2", "modes"} == {"H1", "modes"}
    assert [text.get_text() for text in titled(figure, "coherence").texts] == ["one hit: nothing to compare it with"]
