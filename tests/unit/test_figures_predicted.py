"""What the figures and the page of a prediction show is what its curves hold."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from tests.unit.figures_panels import drawn

import sinew as sn
from sinew.figures.predicted import (
    Curves,
    draw_comparison,
    draw_predicted,
    draw_predicted_map,
    stretches,
    upper_gain,
    write_prediction,
)
from sinew.plan.toml import load_rig
from sinew.predict.predicted import PredictionRequest, predicted_of
from sinew.predict.validity import Check
from sinew.solve.branch import Branch, Mark, Prediction


def bent(shift_hz: float) -> Branch:
    """A made-up curve that leans over: straight up to a fold at 3.5 Hz, back to one at 3 Hz, and down to 4.5 Hz."""
    corners = np.array([[2.0, 0.1], [3.5, 1.0], [3.0, 0.4], [4.5, 0.1]])
    at = np.linspace(0, 3, 61)
    frequency, height = (np.interp(at, np.arange(4), column) for column in corners.T)
    frequency = frequency + shift_hz
    marks = (Mark(3.5 + shift_hz, 1.0, 1.2), Mark(3.0 + shift_hz, 0.4, 1.8))
    return Branch(
        frequency_hz=frequency,
        amplitude=height,
        phase=np.linspace(0.1, 3.0, frequency.size),
        orders=np.array([1]),
        harmonics=height[:, None].astype(complex),
        drive=np.ones(frequency.size, dtype=complex),
        multiplier=np.where((at > 1) & (at < 2), 1.2, 0.8),
        folds=marks,
        peak=marks[0],
        phase_90=None,
        error=np.zeros(frequency.size),
        complete=True,
        message="the curve was followed through the band",
    )


def curves(name: str = "a rig", shift: float = 0.0) -> Curves:
    return Curves(name, (0.0, 4.0, 8.0), tuple(bent(shift + 0.3 * i) for i in range(3)), 30.0)


def texts(figure: Figure) -> set[str]:
    return {text.get_text() for text in figure.findobj(Text)}


@pytest.mark.parametrize(
    ("stable", "missing", "parts"),
    [
        ([True, True, False, False, True, True], [], [(0, 2, True), (1, 5, False), (4, 6, True)]),
        ([True] * 6, [3], [(0, 3, True), (3, 6, True)]),
        ([True, True, True, False, False, False], [1, 3], [(1, 3, True), (3, 6, False)]),  # the first stands alone
    ],
)
def test_a_curve_is_cut_where_its_stability_changes_and_where_points_are_missing(
    stable: list[bool], missing: list[int], parts: list[tuple[int, int, bool]]
) -> None:
    assert stretches(stable, missing) == [(slice(a, b), one) for a, b, one in parts]


def test_between_its_folds_a_curve_is_read_on_the_upper_branch() -> None:
    one = Curves("", (0.0,), (bent(0.0),), float(np.degrees(1.0)))
    found = upper_gain(one, np.array([2.5, 3.2, 4.0]))[0]
    assert found == pytest.approx([0.1 + 0.9 * 0.5 / 1.5, 0.1 + 0.9 * 1.2 / 1.5, 0.4 - 0.3 * 1.0 / 1.5])


def test_the_phase_plot_of_a_prediction_is_the_lag_of_its_branch_in_degrees_with_its_folds() -> None:
    one, asked = bent(0.0), PredictionRequest([0.0], 30.0, "position", (), (2.0, 4.5))
    prediction = Prediction((one,), 1, 0.0, 0.0)
    found = predicted_of(load_rig("paper"), asked, None, prediction, [])  # type: ignore[arg-type]
    axes = sn.plot.predicted_phase(found, Figure().subplots())
    lines = [np.column_stack(line.get_data()).astype(float) for line in axes.lines]
    curve = np.concatenate([line for line in lines if len(line) > 2])
    expected = np.column_stack([one.frequency_hz, np.degrees(one.phase)])
    np.testing.assert_allclose(np.unique(curve, axis=0), np.unique(expected, axis=0))
    assert [line[0].tolist() for line in lines if len(line) == 1] == [[3.5, np.degrees(1.2)], [3.0, np.degrees(1.8)]]
    assert axes.get_ylabel() == "lag of torsion behind lever in degrees"


def test_a_curve_with_folds_tells_its_line_styles_apart() -> None:
    assert {"stable", "unstable", "fold"} <= texts(draw_predicted(curves()))


def test_the_comparison_names_each_rig_and_marks_each_resonance() -> None:
    figure = draw_comparison([curves("one"), curves("two", 1.0)])
    assert {"one", "two", "(c) one", "(d) two"} <= texts(figure)
    line = figure.axes[0].lines[1]
    assert np.asarray(line.get_ydata()) == pytest.approx([b.peak.frequency_hz for b in curves("", 1.0).branches])  # type: ignore[union-attr]


def test_a_map_needs_three_pretensions() -> None:
    few = Curves("few", (0.0, 4.0), tuple(bent(f) for f in (0.0, 0.2)), 30.0)
    assert draw_predicted_map([few]) is None
    ridges = [axes.lines[0] for axes in drawn(draw_predicted_map([few, curves()])).axes if axes.lines]
    assert [np.asarray(ridge.get_ydata()).tolist() for ridge in ridges] == [sorted(curves().pretension_mm)]


def test_a_map_has_its_ridge_at_the_peaks() -> None:
    figure = drawn(draw_predicted_map([curves()]))
    ridge = figure.axes[0].lines[0]
    expected = [b.peak.frequency_hz for b in curves().branches if b.peak is not None]
    assert np.asarray(ridge.get_xdata()) == pytest.approx(expected)


def test_the_page_says_what_does_not_hold(tmp_path: Path) -> None:
    checks = [
        Check("slenderness", 2.0, 1.0, True, "long enough"),
        Check("tension_n", 300.0, 200.0, False, "300 N are too many"),
    ]
    asked = PredictionRequest([4.0], 20.0, "position", (), (2.0, 4.5))
    prediction = Prediction((bent(0.0),), 19, 1e-3, 0.1)
    found = predicted_of(load_rig("paper"), asked, None, prediction, checks)  # type: ignore[arg-type]
    page = write_prediction(tmp_path, "prediction", found, rebuild="sinew predict").read_text(encoding="utf-8")
    assert "<b>Does not hold:</b> 300 N are too many." in page
    assert "1 of the checked assumptions does not hold" in page
    assert "3.5 Hz, 57.3°, gain 2.865" in page
