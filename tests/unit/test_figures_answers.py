"""The page of answers: every question has its verdict, its figure and its numbers, and says what cannot be told."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.figures_pages import alternatives, asked_outside
from tests.unit.figures_panels import bars, drawn, labelled

from sinew.measure.estimate import Estimate
from sinew.paper.answers.answer import CANNOT_TELL, Answer, Cell, cannot_tell
from sinew.paper.answers.questions import ANSWER_FIGURES, draw_answer, draw_answers
from sinew.paper.report import write_answers

QUESTIONS = tuple(ANSWER_FIGURES)


def about(value: float, std: float = 0.1) -> Estimate:
    return Estimate.normal(value, std * abs(value))


PRETENSION_MM = (0.0, 6.0, 12.0)
PANELS: dict[str, dict[str, dict[str, tuple[str, float]]]] = {
    "hardening": {
        "shift of f₀ at the swing in %": {"": ("frequency_shift", 100)},
        "share of the linear force in %": {"": ("quadratic_share", 100)},
        "larger on one side by %": {"": ("half_area_asymmetry", 100)},
    },
    "saturation": {
        "gain": {"by nominal drive": ("gain_peak", 1), "by measured drive": ("gain_peak_measured_drive", 1)},
        "amplitude in degrees": {"": ("drive_amplitude_at_resonance_rad", 180 / math.pi)},
        "frequency in Hz": {"": ("resonance_hz", 1)},
    },
    "losses": {
        "share of D in %": {
            "silicone": ("silicone_share", 100),
            "guides' friction": ("guide_friction_share", 100),
            "lever's recoil": ("recoil_share", 100),
            "sensors": ("sensor_share", 100),
            "method": ("method_share", 100),
        },
        "D": {"measured": ("lehr_damping", 1), "fitted joint": ("lehr_damping_model", 1)},
    },
    "constancy": {"D": {"mean over repeats, 90 %": ("damping_ratio", 1)}},
    "delay": {"delay in ms": {"extra delay": ("extra_delay_s", 1e3)}},
}
"""What each answer's figure draws: by the label of each panel's axis its rows, their columns, and factors."""


def told(name: str) -> Answer:
    """Return an answer of this name at three pretensions with every column that its figure draws, no two alike."""
    numbers = {
        "constancy": {"slope_per_mm": about(1e-4), "mean": about(0.06)},
        "delay": {"budget_s": about(0.0105, 0.05), "extra_delay_s": about(2e-4)},
        "saturation": {"threshold_mm": about(5.0), "drives_share_of_the_fall": Estimate(1.0, 0.1, -math.inf, math.inf)},
    }.get(name, {"frequency_shift": about(0.02)})
    columns = [column for panel in PANELS[name].values() for column, _ in panel.values()]
    rows: list[dict[str, Cell]] = []
    for i, pretension in enumerate(PRETENSION_MM):
        row: dict[str, Cell] = {"pretension_mm": pretension, "omega_rad_s": 18.0 + 4 * i, "repeat_0": 0.06}
        rows.append(row | {column: about(0.1 * (i + 1) + 0.01 * k) for k, column in enumerate(columns)})
    return Answer(name, f"Is {name} <real>?", "yes, it is", (f"It is {name}.", "More."), numbers, tuple(rows))


@pytest.mark.parametrize("name", QUESTIONS)
def test_every_answer_has_its_estimates_over_pretension_in_the_unit_of_the_axis(name: str) -> None:
    answer = told(name)
    figure = drawn(draw_answer(answer))
    assert {axes.get_xlabel() for axes in figure.axes} == {"pretension in mm"}
    assert [axes.get_ylabel() for axes in figure.axes] == list(PANELS[name])
    for axes, panel in zip(figure.axes, PANELS[name].values(), strict=True):
        shown = bars(axes)
        assert set(shown) == set(panel)
        for label, (column, factor) in panel.items():
            cells = [row[column] for row in answer.rows]
            expected = [[factor * one.value, factor * one.low, factor * one.high] for one in cells]  # type: ignore[union-attr]
            np.testing.assert_allclose(shown[label][:, 1:], expected)
            np.testing.assert_allclose(shown[label][:, 0], PRETENSION_MM, atol=0.3)  # side by side


def test_the_threshold_stands_at_its_pretension() -> None:
    assert labelled(drawn(draw_answer(told("saturation"))).axes[0], "threshold")[:, 0].tolist() == [5.0, 5.0]


def test_the_line_of_constancy_has_the_answers_slope_and_its_laws_fall_with_the_frequency() -> None:
    axes = drawn(draw_answer(told("constancy"))).axes[0]
    slope, at_zero = np.polyfit(*labelled(axes, "line").T, 1)
    assert (slope, at_zero + 6.0 * slope) == (pytest.approx(1e-4), pytest.approx(0.06))
    for label, power in (("constant d", 1), ("silicone alone", 2)):
        law = labelled(axes, label)[:, 1]
        assert law.mean() == pytest.approx(0.06)
        assert law / law[0] == pytest.approx(np.array([1.0, 18 / 22, 18 / 26]) ** power)


def test_the_budget_and_the_delay_of_all_together_are_bands_in_milliseconds() -> None:
    patches = drawn(draw_answer(told("delay"))).axes[0].patches
    found = {one.get_label(): (one.get_y(), one.get_y() + one.get_height()) for one in patches}  # type: ignore[attr-defined]
    budget, together = about(0.0105, 0.05), about(2e-4)
    half = 1e3 * (budget.high - budget.value)
    assert found == {
        "written budget, 90 %": pytest.approx((-half, half)),
        "all together, 90 %": pytest.approx((1e3 * together.low, 1e3 * together.high)),
    }


@pytest.mark.parametrize("name", QUESTIONS)
def test_an_answer_that_cannot_be_told_has_no_figure(name: str) -> None:
    assert draw_answer(cannot_tell(name, "Is it?", "It lacks a drive.")) is None


def test_an_answer_with_one_pretension_is_drawn_with_its_interval_alone() -> None:
    one = told("constancy")
    (row,) = bars(drawn(draw_answer(replace(one, rows=one.rows[:1]))).axes[0])["mean over repeats, 90 %"]
    assert row == pytest.approx([0.0, 0.1, about(0.1).low, about(0.1).high])


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
