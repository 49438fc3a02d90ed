"""The page of answers: every question has its verdict, its figure and its numbers, and says what cannot be told."""

import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.figures_pages import alternatives, asked_outside
from tests.unit.figures_panels import bars, drawn

from sinew.measure.estimate import Estimate
from sinew.paper.answer import CANNOT_TELL, QUESTIONS, Answer, Cell, cannot_tell
from sinew.paper.questions import draw_answer, draw_answers
from sinew.paper.report import write_answers
from sinew.plan.toml import load_rig

PRETENSION_MM = (0.0, 6.0, 12.0)
SHOWN = ("share", "extra_delay_s")


def told(name: str, bends: tuple[float, ...] = ()) -> Answer:
    """Return an answer of this name at three pretensions, and bends, no two numbers alike."""
    rows: list[dict[str, Cell]] = []
    for mm in PRETENSION_MM:
        for bend in bends or (0.0,):
            cells: dict[str, Cell] = {
                name: Estimate.normal(0.1 + mm + 0.01 * bend + k, 0.1) for k, name in enumerate(SHOWN)
            }
            rows.append({"pretension_mm": mm, **({"bend_deg": bend} if bends else {}), **cells})
    numbers = {"drives_share_of_the_fall": Estimate(1.0, 0.1, -math.inf, math.inf)}
    return Answer(name, "yes, <it> is", (f"It is {name}.", "To test it: look."), numbers, tuple(rows), SHOWN)


def shown(answer: Answer, column: str, rows: slice) -> np.ndarray:
    return np.stack(answer.column(column), axis=1)[rows]


def test_every_shown_column_is_drawn_over_pretension_with_its_intervals() -> None:
    answer = told("saturation")
    figure = drawn(draw_answer(answer))
    assert [axes.get_ylabel() for axes in figure.axes] == ["share", "extra delay/s"]
    assert {axes.get_xlabel() for axes in figure.axes} == {"pretension/mm"}
    for axes, column in zip(figure.axes, SHOWN, strict=True):
        (points,) = bars(axes).values()
        np.testing.assert_allclose(points[:, 0], PRETENSION_MM)
        np.testing.assert_allclose(points[:, 1:], shown(answer, column, slice(None)))


def test_of_a_bent_joint_each_pretension_is_a_line_over_the_bend() -> None:
    answer = told("asymmetry", (0.0, 10.0))
    axes = drawn(draw_answer(answer)).axes[0]
    found = bars(axes)
    assert axes.get_xlabel() == "bend/deg"
    assert list(found) == ["0 mm", "6 mm", "12 mm"]
    np.testing.assert_allclose(found["6 mm"][:, 0], (0.0, 10.0))
    np.testing.assert_allclose(found["6 mm"][:, 1:], shown(answer, SHOWN[0], slice(2, 4)))


@pytest.mark.parametrize("name", QUESTIONS)
def test_an_answer_that_cannot_be_told_has_no_figure(name: str) -> None:
    assert draw_answer(cannot_tell(name, "It lacks a drive.")) is None


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    answers = [told(name) for name in list(QUESTIONS)[:4]] + [cannot_tell("delay", "The drive lacks.")]
    figures = draw_answers(answers, folder, ("png",))
    recording = xr.Dataset(attrs={"source": "twin", "effects_off": "guide_friction", "content_hash": "abc123"})
    path = write_answers(folder, answers, recording, figures=figures, rebuild="sinew report x.nc --answers")
    assert path == folder / "answers.html"
    return path.read_text(encoding="utf-8")


def test_the_page_counts_the_questions_that_are_answered(page: str) -> None:
    assert "answers 4 of 5 questions" in page
    assert CANNOT_TELL in page
    assert "The drive lacks." in page
    assert "−∞ to ∞" in page  # of an unbounded interval


def test_the_page_says_what_was_switched_off_and_how_to_rebuild_it(page: str) -> None:
    assert "Simulated without: guide_friction" in page
    assert "sinew report x.nc --answers" in page
    assert "abc123" in page


def test_the_page_of_a_rig_has_each_answer_and_how_to_test_it(tmp_path: Path) -> None:
    answers = [told(name, (0.0, 20.0)) for name in list(QUESTIONS)[5:]]
    figures = draw_answers(answers[:1], tmp_path / "figures", ("png",))
    page = write_answers(tmp_path, answers, load_rig("paper"), figures=figures).read_text(encoding="utf-8")
    assert alternatives(page) == [answers[0].question]
    assert page.count("To test it: look.") == len(answers)
    assert "This recording" not in page
    assert asked_outside(page) == []
