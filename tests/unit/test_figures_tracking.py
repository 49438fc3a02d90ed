"""The figure of tracked motions shows each motion over time, and its point beside the predicted backbone."""

import numpy as np
import pytest
from tests.unit.figures_panels import labelled, titled

from sinew.figures.tuned import draw_tracking

TIME = np.linspace(0.3, 9.7, 30)
TURNS = {
    "time_s": TIME.tolist(),
    "frequency_hz": (3.5 + 0.3 * np.exp(-TIME)).tolist(),
    "phase_error_deg": (10 * np.exp(-TIME)).tolist(),
    "torsion_deg": (36 * (1 - np.exp(-TIME))).tolist(),
}
EXPECTED = [
    {"pretension_mm": mm, "frequency_hz": [f, f - 0.05, f - 0.1], "torsion_deg": [1, 20, 36]}
    for mm, f in ((4.0, 3.4), (6.0, 3.6))
]


def estimate(value: float, half: float) -> dict[str, object]:
    return {"value": value, "std": half / 2, "interval90": [value - half, value + half]}


POINT = {"frequency_hz": estimate(3.5, 0.01), "torsion_deg": estimate(36.0, 0.2)}
STOOD = {"pretension_mm": 6.0, "point": POINT, "follow": None, "lock_cycles": 5.0, "turns": TURNS}
FOLLOW = {"from_hz": 3.4, "to_hz": 3.6, "begin_s": 2.0, "duration_s": 6.0}
MOVED = {"pretension_mm": 4.0, "point": None, "follow": FOLLOW, "lock_cycles": 5.0, "turns": TURNS}


def test_frequency_and_phase_error_are_those_of_the_turns() -> None:
    figure = draw_tracking([STOOD], EXPECTED)
    for panel, name in (("frequency", "frequency_hz"), ("lag of the torsion", "phase_error_deg")):
        line = titled(figure, panel).lines[0]
        assert np.array(line.get_data()) == pytest.approx(np.array([TURNS["time_s"], TURNS[name]]))


def test_the_point_of_what_stood_has_its_intervals_and_lies_beside_the_predicted_backbones() -> None:
    axes = titled(draw_tracking([STOOD], EXPECTED), "where it resonated")
    (point,) = axes.containers
    line, _, (across, along) = point.lines
    assert np.ravel(line.get_data()).tolist() == [3.5, 36.0]
    assert across.get_segments()[0] == pytest.approx(np.array([[3.49, 36.0], [3.51, 36.0]]))
    assert along.get_segments()[0] == pytest.approx(np.array([[3.5, 35.8], [3.5, 36.2]]))
    backbones = [np.array(one.get_data()).tolist() for one in axes.lines if len(one.get_xdata()) == 3]
    assert backbones == [[one["frequency_hz"], one["torsion_deg"]] for one in EXPECTED]


def test_what_moved_is_drawn_from_its_lock_on_and_what_was_wanted_beside_it() -> None:
    figure = draw_tracking([MOVED], EXPECTED)
    tracked = labelled(titled(figure, "where it resonated"), "tracked")
    np.testing.assert_allclose(tracked, np.column_stack([TURNS["frequency_hz"], TURNS["torsion_deg"]])[7:])
    wanted = labelled(titled(figure, "frequency"), "wanted")
    assert wanted[1:3].tolist() == [[2.0, 3.4], [8.0, 3.6]]
