"""Answers on a joint that bends: their figures, their page, and intervals of what cannot be negative."""

import math
from pathlib import Path

import numpy as np
import pytest
from tests.unit.figures_pages import alternatives, asked_outside
from tests.unit.figures_panels import bars, drawn

from sinew.figures.style import save_figure
from sinew.measure.estimate import Estimate
from sinew.paper.answers.answer import Answer, Cell
from sinew.paper.answers.bent import ASYMMETRY, CARRYING, COUPLING, ENGINE, RESONANCE
from sinew.paper.answers.of_rig import CAPTIONS, draw_rig_answer
from sinew.paper.report import write_rig_answers
from sinew.plan.toml import load_rig
from sinew.predict.workspace import at_least_zero

COLUMNS = {
    RESONANCE: ("relative_shift", "slack_tendons"),
    COUPLING: ("tilt_across_per_torsion", "half_sine_of_bend"),
    ASYMMETRY: ("highest_n", "lowest_n"),
    ENGINE: (
        "twist_deg",
        "twist_per_tilt",
        "twist_per_tilt_slow",
        "recast_twist_deg",
        "recast_twist_per_tilt",
        "recast_twist_per_tilt_slow",
    ),
    CARRYING: ("slack_moment_n_m", "tension_moment_n_m", "upright_kg", "bent_kg"),
}


def told(name: str) -> Answer:
    """Return an answer of this name at two pretensions and three bends, no two numbers alike."""
    rows: list[dict[str, Cell]] = []
    for mm in (6.0, 12.0):
        for bend in (0.0, 10.0, 20.0):
            row: dict[str, Cell] = {"pretension_mm": mm, "bend_deg": bend}
            for k, column in enumerate(COLUMNS[name]):
                row[column] = Estimate.normal(1 + 0.01 * mm + 0.001 * bend + k, 0.1)
            rows.append(row)
    first = COLUMNS[name][0]
    value = rows[0][first]
    assert isinstance(value, Estimate)
    return Answer(
        name, f"Is {name} <real>?", "yes", (f"It is {name}.", "To test it: look."), {first: value}, tuple(rows)
    )


def test_tensions_are_drawn_over_the_bend_with_their_intervals() -> None:
    answer = told(ASYMMETRY)
    shown = bars(drawn(draw_rig_answer(answer)).axes[0])["6 mm, highest"]
    cells = [row["highest_n"] for row in answer.rows[:3]]
    expected = [[one.value, one.low, one.high] for one in cells]  # type: ignore[union-attr]
    np.testing.assert_allclose(shown[:, 1:], expected)
    np.testing.assert_allclose(shown[:, 0], (0, 10, 20))


def test_the_page_of_a_rig_has_each_answer_with_its_figure_and_how_to_test_it(tmp_path: Path) -> None:
    answers = [told(name) for name in COLUMNS]
    drawn_ones = [(one, draw_rig_answer(one)) for one in answers]
    figures = [
        path
        for one, figure in drawn_ones[:1]
        for path in save_figure(figure, tmp_path / "figures", f"answer_{one.name}", ("png",))
    ]
    path = write_rig_answers(
        tmp_path, answers, load_rig("paper"), captions=CAPTIONS, figures=figures, rebuild="sinew answer paper"
    )
    page = path.read_text(encoding="utf-8")
    assert alternatives(page) == [CAPTIONS[f"answer_{answers[0].name}"].alt]
    assert page.count("To test it: look.") == len(answers)
    assert "This recording" not in page
    assert not asked_outside(page)


@pytest.mark.parametrize(
    ("pull", "tension"),
    [
        (Estimate.normal(30.0, 1.0), Estimate.normal(30.0, 1.0)),
        (Estimate(-10.0, 2.0, -13.0, -7.0), Estimate(0.0, 0.0, 0.0, 0.0)),
        (Estimate(1.0, 2.0, -2.0, 4.0), Estimate(1.0, 4 / 3.29, 0.0, 4.0)),
    ],
    ids=["taut", "slack", "nearly slack"],
)
def test_a_tension_is_what_is_left_of_a_pull_that_may_be_negative(pull: Estimate, tension: Estimate) -> None:
    found = at_least_zero(pull)
    assert (found.value, found.low, found.high) == pytest.approx((tension.value, tension.low, tension.high))
    assert math.isclose(found.std, tension.std, rel_tol=1e-3, abs_tol=1e-12)
