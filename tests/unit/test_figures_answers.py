"""The page of answers: every question has its verdict, its figure and its numbers, and says what cannot be told."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import LineCollection
from tests.unit.figures_pages import alternatives, asked_outside
from tests.unit.figures_panels import drawn

from sinew.measure.estimate import Estimate
from sinew.paper.answers.answer import CANNOT_TELL, Answer, Cell, cannot_tell
from sinew.paper.answers.questions import ANSWER_FIGURES, draw_answer, draw_answers
from sinew.paper.report import write_answers

QUESTIONS = tuple(ANSWER_FIGURES)


def about(value: float, std: float = 0.1) -> Estimate:
    return Estimate.normal(value, std * abs(value))


def told(name: str) -> Answer:
    """Return an answer of this name at three pretensions with every column that its figure draws."""
    columns = {
        "hardening": ("frequency_shift", "quadratic_share", "half_area_asymmetry"),
        "saturation": ("gain_peak", "gain_peak_measured_drive", "drive_amplitude_at_resonance_rad", "resonance_hz"),
        "losses": ("silicone_share", "guide_friction_share", "recoil_share", "sensor_share", "method_share",
                   "lehr_damping", "lehr_damping_model"),
        "constancy": ("damping_ratio",),
        "delay": ("extra_delay_s",),
    }[name]  # fmt: skip
    numbers = {
        "constancy": {"slope_per_mm": about(1e-4), "mean": about(0.06)},
        "delay": {"budget_s": about(0.0105, 0.05), "extra_delay_s": about(2e-4)},
        "saturation": {"threshold_mm": about(5.0), "drives_share_of_the_fall": Estimate(1.0, 0.1, -math.inf, math.inf)},
    }.get(name, {"frequency_shift": about(0.02)})
    rows: list[dict[str, Cell]] = []
    for i, pretension in enumerate((0.0, 6.0, 12.0)):
        row: dict[str, Cell] = {"pretension_mm": pretension, "omega_rad_s": 18.0 + 4 * i, "repeat_0": 0.06}
        rows.append(row | {column: about(0.1 * (i + 1)) for column in columns})
    return Answer(name, f"Is {name} <real>?", "yes, it is", (f"It is {name}.", "More."), numbers, tuple(rows))


@pytest.mark.parametrize("name", QUESTIONS)
def test_every_answer_has_a_figure_with_a_labelled_axis_of_pretension(name: str) -> None:
    figure = drawn(draw_answer(told(name)))
    assert {axes.get_xlabel() for axes in figure.axes} == {"pretension in mm"}
    assert all(axes.get_ylabel() for axes in figure.axes)


@pytest.mark.parametrize("name", QUESTIONS)
def test_an_answer_that_cannot_be_told_has_no_figure(name: str) -> None:
    assert draw_answer(cannot_tell(name, "Is it?", "It lacks a drive.")) is None


def ends_of_bars(answer: Answer) -> set[float]:
    """Return where the bars of an answer's figure end."""
    figure = drawn(draw_answer(answer))
    bars = [part for part in figure.axes[0].collections if isinstance(part, LineCollection)]
    return {round(float(y), 6) for bar in bars for part in bar.get_segments() for y in np.asarray(part)[:, 1]}


def test_an_answer_with_one_pretension_is_drawn_with_its_interval_alone() -> None:
    one = told("constancy")
    assert ends_of_bars(replace(one, rows=one.rows[:1])) == {round(about(0.1).low, 6), round(about(0.1).high, 6)}


def test_the_intervals_are_in_the_figure() -> None:
    assert {round(1e3 * about(0.1).low, 6), round(1e3 * about(0.1).high, 6)} <= ends_of_bars(told("delay"))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    answers = [told(name) for name in QUESTIONS[:-1]] + [cannot_tell("delay", "Which delay?", "The drive lacks.")]
    figures = draw_answers(answers, folder, ("png",))
    recording = xr.Dataset(attrs={"source": "twin", "effects_off": "guide_friction", "content_hash": "abc123"})
    path = write_answers(folder, answers, recording=recording, figures=figures, rebuild="sinew answer x.nc")
    assert path == folder / "answers.html"
    return Path(path).read_text(encoding="utf-8")


def test_the_page_counts_the_questions_that_are_answered(page: str) -> None:
    assert "answers 4 of 5 questions" in page
    assert CANNOT_TELL in page
    assert "The drive lacks." in page


def test_the_page_needs_nothing_beside_itself(page: str) -> None:
    assert asked_outside(page) == []
    assert len(alternatives(page)) == 4
    assert all(alternatives(page))


def test_what_a_question_holds_is_not_taken_for_html(page: str) -> None:
    assert "&lt;real&gt;" in page
    assert "<real>" not in page


def test_an_unbounded_interval_is_shown_as_one(page: str) -> None:
    assert "−∞ to ∞" in page


def test_the_page_says_what_was_switched_off_and_how_to_rebuild_it(page: str) -> None:
    assert "Simulated without: guide_friction" in page
    assert "sinew answer x.nc" in page
    assert "abc123" in page
