"""What the pages make of numbers: options of charts, words for estimates, data that no script can hide in."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.patience import Patience
from tests.unit.bench_journal import RIG_TEXT

from sinew.apps.dashboard.hub import Hub, Live, Results, Ring
from sinew.apps.dashboard.pages.curves import Curve, options_of
from sinew.apps.dashboard.pages.frame import quantity
from sinew.measure.errors import SpecError
from sinew.plan.toml import dump_plan, load_plan

LINE = Curve("line", [1, 2, 3], [1.0, 2.0, 3.0], is_line=True)
POINTS = Curve("points", [1, 2], [1.0, 2.0], [0.5, None], [1.5, None])


def drawn(*curves: Curve, **more: Any) -> dict[str, Any]:
    return options_of("gain", curves, "frequency / Hz", **more)


def test_points_have_whiskers_where_they_have_an_interval() -> None:
    scatter, whiskers = drawn(POINTS)["series"]
    assert scatter["data"] == [[1, 1.0], [2, 2.0]]
    assert whiskers["data"] == [[1, 0.5, 1.5]]


def test_an_unstable_stretch_is_dotted_and_joins_the_stable_one() -> None:
    curve = Curve("fold", [1, 2, 3, 4], [1, 2, 3, 4], is_line=True, is_stable=[True, True, False, True])
    solid, dotted = drawn(curve)["series"]
    assert [y for _, y in solid["data"]] == [1, 2, None, 4]
    assert [y for _, y in dotted["data"]] == [None, 2, 3, 4]
    assert dotted["lineStyle"]["type"] == "dotted"


def test_a_band_is_one_polygon_there_and_back() -> None:
    curve = Curve("band", [1, 2], [1, 2], [0, 1], [2, 3], is_line=True)
    band = drawn(curve)["series"][0]
    assert "[[1, 0], [2, 1], [2, 3], [1, 2]]" in band[":renderItem"]


def test_one_pretension_has_one_colour_however_it_is_shown() -> None:
    curves = [Curve("p", [1], [1], is_line=True, number=3), Curve("m", [1], [1], [0], [2], number=3)]
    colours = {series["itemStyle"]["color"] for series in drawn(*curves)["series"] if "itemStyle" in series}
    assert len(colours) == 1


def test_a_wanted_frequency_is_marked() -> None:
    mark = drawn(LINE, marked=2.5)["series"][-1]["markLine"]
    assert mark["data"] == [{"xAxis": 2.5}]


def test_an_empty_chart_says_so() -> None:
    assert drawn()["graphic"][0]["style"]["text"] == "nothing to show yet"


def test_a_line_fills_its_axis_and_points_keep_off_the_frame() -> None:
    assert drawn(LINE)["xAxis"]["min"] == "dataMin"
    assert ":min" in drawn(LINE, POINTS)["xAxis"]


@pytest.mark.parametrize(
    ("estimate", "unit", "said"),
    [
        ({"value": 3.17712, "interval90": [3.1444, 3.2105]}, "Hz", "3.177 Hz (3.144 to 3.211)"),
        ({"value": 0.05976, "interval90": [0.05549, 0.06402]}, "", "0.060 (0.055 to 0.064)"),
        ({"value": 120.4, "interval90": [90.0, 150.0]}, "N", "120 N (90 to 150)"),
        ({"value": 2.0, "interval90": [None, None]}, "mm", "2 mm"),
        ({"value": None, "interval90": [None, None]}, "mm", "–"),
    ],
)
def test_an_estimate_is_said_to_the_digits_that_its_interval_tells(
    estimate: dict[str, Any], unit: str, said: str
) -> None:
    assert quantity(estimate, unit) == said


def estimate(value: float) -> dict[str, Any]:
    return {"value": value, "std": 0.1, "interval90": [value - 0.2, value + 0.2]}


class FakeWork:
    """Answers as the worker does; notes what it is asked."""

    def __init__(self, can_have_bands: bool = True) -> None:
        self.asked: list[tuple[str, Any]] = []
        self.can_have_bands = can_have_bands
        self.pending = [1, 0]

    def warm_up(self) -> None:
        pass

    async def call(self, name: str, *arguments: Any, key: str | None = None) -> Any:
        self.asked.append((name, arguments[-1]))
        if name == "prediction_for_plan":
            curve = {"pretension_mm": 12.0, "frequency_hz": [1.0], "gain": [1.0], "phase": [0.0], "stable": [True]}
            bands = {"gain_low": [0.9], "gain_high": [1.1]} if arguments[-1] else {}
            return {"curves": [curve | bands], "can_have_bands": self.can_have_bands}
        curve = {"pretension_mm": 12.0, "frequency_hz": [1.0], "gain": [estimate(1.0)], "phase": [estimate(90.0)]}
        return {"curves": [curve], "damping": [], "notes": [], "pending": self.pending.pop(0) if self.pending else 0}


def results_with(work: Any) -> Results:
    async def status() -> dict[str, Any]:
        return {}

    hub = Hub(Path("runs"), status)
    hub.live = Live("run", 0.0, 1, {}, (), Ring(1, 10), dump_plan(load_plan("short")), RIG_TEXT, 3)
    return Results(hub, work, Path("runs"))


async def followed(results: Results, claim: Callable[[], Any]) -> None:
    """Let results follow a run until a claim comes true, and a moment longer."""
    patience = Patience(20.0)
    task = asyncio.create_task(results.run())
    while not claim() and not patience.is_over():
        await asyncio.sleep(0.02)
    await asyncio.sleep(0.1)
    task.cancel()


def test_curves_are_predicted_first_and_their_bands_after() -> None:
    work = FakeWork()
    results = results_with(work)
    asyncio.run(followed(results, lambda: "Band" in results.remark))
    assert [draws for name, draws in work.asked if name == "prediction_for_plan"] == [0, 40]
    assert "gain_low" in results.predicted[0]
    assert "Band" in results.remark


def test_a_rig_without_intervals_has_no_band_and_the_page_says_why() -> None:
    work = FakeWork(can_have_bands=False)
    results = results_with(work)
    asyncio.run(followed(results, lambda: "no band" in results.remark))
    assert [draws for name, draws in work.asked if name == "prediction_for_plan"] == [0]
    assert "no band" in results.remark


def test_groups_that_are_not_analysed_yet_are_asked_for_again() -> None:
    work = FakeWork()

    def times_asked() -> int:
        return sum(name == "measured_so_far" for name, _ in work.asked)

    asyncio.run(followed(results_with(work), lambda: times_asked() == 2))
    assert times_asked() == 2


def test_a_curve_has_the_number_of_its_pretension_in_the_plan() -> None:
    results = results_with(FakeWork())
    asyncio.run(followed(results, lambda: results.predicted and results.measured))
    assert [curve["number"] for curve in (*results.predicted, *results.measured)] == [2, 2]


def test_what_cannot_be_computed_is_kept_as_a_sentence() -> None:
    class Broken(FakeWork):
        async def call(self, name: str, *arguments: Any, key: str | None = None) -> Any:
            raise SpecError("no such thing")

    results = results_with(Broken())
    asyncio.run(followed(results, lambda: results.trouble))
    assert "no such thing" in results.trouble
    assert json.dumps(results.measured) == "[]"
