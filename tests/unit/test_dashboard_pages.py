"""What the pages make of numbers: options of charts, words for estimates, data that no script can hide in."""

import asyncio
import json
import re
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from tests.patience import Patience
from tests.unit.bench_journal import RIG_TEXT

from sinew.analysis.runs import parse_search
from sinew.apps.dashboard.hub import Hub, Live, Results, Ring
from sinew.apps.dashboard.pages.curves import Curve, options_of, style_of, summary_of, table_of
from sinew.apps.dashboard.pages.frame import part, quantity
from sinew.apps.dashboard.pages.runs import looks, trend_options
from sinew.apps.dashboard.work.results import Verdict
from sinew.apps.dashboard.worker import TooSlowError
from sinew.plan.toml import dump_plan, load_plan

LINE = Curve("line", [1, 2, 3], [1.0, 2.0, 3.0], is_line=True)


def drawn(*curves: Curve, **more: Any) -> dict[str, Any]:
    return options_of("gain", curves, "frequency / Hz", **more)


def test_a_trend_within_a_day_has_an_axis_of_days() -> None:
    value = {"value": 3.0, "std": 0.1, "interval90": [2.9, 3.1]}
    one = {"title": "f_r", "days": [20000.97], "values": [value], "line": None}
    axis = trend_options([one], "resonance_hz")["xAxis"]
    begin, end = (float(axis[key].removeprefix("() => ")) for key in (":min", ":max"))
    assert begin < 20000.97 * 86_400_000 < end
    assert end - begin >= 86_400_000


def test_an_unstable_stretch_is_dotted_and_joins_the_stable_one() -> None:
    curve = Curve("fold", [1, 2, 3, 4], [1, 2, 3, 4], is_line=True, is_stable=[True, True, False, True])
    solid, dotted = drawn(curve)["series"][:2]
    assert [y for _, y in solid["data"]] == [1, 2, None, 4]
    assert [y for _, y in dotted["data"]] == [None, 2, 3, 4]
    assert dotted["lineStyle"]["type"] == [1, 4]


def test_a_band_is_one_polygon_there_and_back() -> None:
    curve = Curve("band", [1, 2], [1, 2], [0, 1], [2, 3], is_line=True)
    band = drawn(curve)["series"][-1]
    assert "[[1.0, 0.0], [2.0, 1.0], [2.0, 3.0], [1.0, 2.0]]" in band[":renderItem"]


def test_one_pretension_has_one_colour_however_it_is_shown() -> None:
    curves = [Curve("p", [1], [1], is_line=True, number=3), Curve("m", [1], [1], [0], [2], number=3)]
    styles = [series["itemStyle"] for series in drawn(*curves)["series"] if "itemStyle" in series]
    colours = {style.get("borderColor", style["color"]) for style in styles}
    assert len(colours) == 1


MISSED = Verdict(2.0, 1.8, 2.2, 0.5, 0.25, misses=True, sentence="+25 %, 2.0 of its uncertainty")
HIT = Verdict(2.0, 1.8, 2.2, 0.1, 0.25, misses=False, sentence="+5 %, 0.4 of its uncertainty")
AGAINST = Curve("6 mm, <measured>", [3, 4], [2.5, 2.1], [2.3, 2.0], [2.7, 2.2], number=1, verdicts=[MISSED, HIT])


def test_a_point_that_misses_changes_colour_and_marker_and_its_whisker_stays() -> None:
    scatter, whiskers = drawn(AGAINST)["series"]
    missed, hit = scatter["data"]
    assert missed["itemStyle"]["color"] not in (scatter["itemStyle"]["color"], whiskers["itemStyle"]["color"])
    assert missed["symbol"] not in {style_of(i)[2] for i in range(7)}
    assert "symbol" not in hit


def test_the_tooltip_says_by_how_much_and_no_script_hides_in_it() -> None:
    said = drawn(AGAINST)["series"][0]["data"][0]["said"]
    assert "misses by +25 %, 2.0 of its uncertainty" in said
    assert "&lt;measured&gt;" in said


def test_a_chart_is_summarised_in_words() -> None:
    assert summary_of("gain", [LINE, AGAINST], "frequency / Hz") == (
        "gain over frequency / Hz. line: line from 1 to 3, largest 3 at 3. 6 mm, <measured>: 2 points from 3 to 4, "
        "largest 2.5 at 3; missed the prediction at 3 by +25 %, 2.0 of its uncertainty."
    )


def test_the_table_holds_every_point_and_escapes_its_words() -> None:
    table = table_of("gain", [AGAINST], "frequency / Hz")
    assert table.count("<tr>") == 3
    assert "<td>misses by +25 %, 2.0 of its uncertainty</td>" in table
    assert "<measured>" not in table


def test_a_long_line_has_few_rows_with_both_its_ends() -> None:
    line = Curve("line", list(range(500)), [float(x) for x in range(500)], is_line=True)
    table = table_of("gain", [line], "frequency / Hz")
    assert table.count("<tr>") == 22
    assert "<td>499</td>" in table


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

    async def call(self, name: str, *arguments: Any, key: str | None = None) -> Any:
        self.asked.append((name, arguments[-1]))
        if name == "prediction_for_plan":
            curve = {"pretension_mm": 12.0, "frequency_hz": [1.0], "gain": [1.0], "phase": [0.0], "stable": [True]}
            bands = {"gain_low": [0.9], "gain_high": [1.1]} if arguments[-1] else {}
            return {"curves": [curve | bands], "can_have_bands": self.can_have_bands}
        curve = {"pretension_mm": 12.0, "frequency_hz": [1.0], "gain": [estimate(1.0)], "phase": [estimate(90.0)]}
        return {"curves": [curve], "damping": [], "notes": [], "pending": self.pending.pop(0) if self.pending else 0}


def test_a_list_of_runs_is_looked_at_until_every_folder_is_read() -> None:
    class Slow(FakeWork):
        async def call(self, name: str, *arguments: Any, key: str | None = None) -> Any:
            return {"left": lefts.pop(0)}

    async def told() -> list[int]:
        return [found["left"] async for found in looks(Slow(), "runs", "", "key") if found is not None]

    lefts = [700, 300, 0, 5]
    assert (asyncio.run(told()), lefts) == ([700, 300, 0], [5])
    lefts = [9, 9, 9]  # of more folders than there may be some are never read
    assert asyncio.run(told()) == [9, 9]


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


def test_a_computer_that_is_too_busy_is_said_to_be_until_it_comes_to_it() -> None:
    class Busy(FakeWork):
        is_busy = True

        async def call(self, name: str, *arguments: Any, key: str | None = None) -> Any:
            if name == "measured_so_far" and self.is_busy:
                self.is_busy = False
                raise TooSlowError("this took more than 60 s")
            return await super().call(name, *arguments, key=key)

    results = results_with(Busy())
    told: set[str] = set()

    def has_measured() -> bool:
        told.add(results.trouble)
        return bool(results.measured)

    asyncio.run(followed(results, has_measured))
    assert any("too busy" in one and "again" in one for one in told)
    assert results.trouble == ""


def test_every_search_that_help_shows_is_understood() -> None:
    section = part("frame", "help").split("Search of Runs")[1].split("</dl>")[0]
    for shown in re.findall("<dt>(.*?)</dt>", section):
        query = parse_search(unescape(shown).replace(",", ""))
        assert query.words or query.ranges


def test_what_a_file_says_in_place_of_a_number_does_not_get_into_a_chart() -> None:
    script: Any = {":x": "document.title = 'taken'"}
    estimates = [
        {"value": 1.0, "interval90": [script, 2.0]},
        {"value": script, "interval90": [0.5, script]},
        {"value": 1.5, "interval90": [1.0, 2.0]},
    ]
    points = Curve.of_estimates("4 mm", [1.0, 2.0, script], estimates, 0)
    line = Curve(script, [1.0, script], [1.0, 2.0], [script, 1.0], ["1", 2.0], is_line=True)
    text = json.dumps(options_of("gain", [points, line], "f / Hz")["series"]) + table_of("gain", [points, line], "f")
    assert points.low == [None, 0.5, 1.0]
    assert '":x"' not in text
