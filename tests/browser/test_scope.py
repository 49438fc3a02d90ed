"""The oscilloscope in a real browser: cursors against a known signal, a picture that stands, the way to the begin."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.dashboard import Served, served
from tests.unit.test_dashboard_samples import RATE_HZ, SWING_HZ, sample

from sinew.bench.record.journal import Journal
from sinew.measure.recording import Segment
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig

pytestmark = pytest.mark.slow

Open = Callable[..., Any]

LONG_S = 600.0
SHOWN = "document.body.dataset.samples === 'shown' && SinewScope.bins.count > 100 && !SinewScope.missing.length"


@pytest.fixture(scope="module")
def swung(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Give a dashboard with a run of ten minutes of a lever that swings by 20° at 3 Hz."""
    runs: Path = tmp_path_factory.mktemp("swung")
    (runs / "swing").mkdir()
    words = dump_plan(load_plan("short")), dump_rig(load_rig("paper"))
    with Journal.create(runs / "swing" / "journal.sqlite", *words) as journal:
        journal.begin_segment(0, 0, Segment("steady", 4.0, SWING_HZ, 20.0, 0))
        for index in range(int(LONG_S * RATE_HZ)):
            journal.append(sample(index + 100_000))  # far from the odd one
    with served(runs) as dashboard:
        yield dashboard


@pytest.fixture
def page(opened: Open, swung: Served) -> Any:
    """Return the page of its samples, with what is seen there."""
    page = opened(swung, "/run/swing/samples")
    page.wait_for_function(SHOWN)
    return page


def show(page: Any, begin: float, end: float) -> None:
    page.evaluate(f"SinewScope.go({begin}, {end})")
    page.wait_for_function(f"{SHOWN} && Math.abs(SinewScope.scope.start - {begin}) < 1e-6")


def drag(page: Any, before: float, after: float) -> None:
    """Drag what stands at a time to another one."""
    box = page.locator("#sinew-scope").bounding_box()
    across = [page.evaluate(f"SinewScope.scope.x({time})") for time in (before, after)]
    page.mouse.move(box["x"] + across[0], box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + across[1], box["y"] + 60, steps=4)
    page.mouse.up()


NARROW = """(id) => {
  const canvas = document.getElementById(id);
  return canvas.clientWidth < 700 && canvas.width === Math.round(canvas.clientWidth * Math.min(2, devicePixelRatio));
}"""
"""Whether a canvas has the width of a narrow window, and is drawn for it."""


def numbers(text: str) -> list[float]:
    """Return the numbers of "A 1.2 s, B 3.4 s, Δt 2.2 s, 1/Δt 0.45 Hz"."""
    return [float(part.split()[-2]) for part in text.split(", ")]


def test_cursors_measure_a_period_and_the_lever_at_both(page: Any) -> None:
    show(page, 1.0, 3.0)
    page.click("#sinew-cursors")
    first, second = 1.25, 1.25 + 1 / SWING_HZ
    drag(page, 1.0 + 2.0 / 3, first)
    drag(page, 1.0 + 2.0 * 2 / 3, second)
    page.wait_for_function("document.querySelectorAll('#sinew-values tbody tr').length > 2")
    page.wait_for_function("document.querySelectorAll('#sinew-values tbody tr:first-child td').length === 6")
    page.wait_for_timeout(700)  # numbers follow three times a second
    a, b, apart, rate = numbers(page.inner_text("#sinew-apart"))
    pixel = 2.0 / page.evaluate("SinewScope.scope.width")
    assert (a, b) == (pytest.approx(first, abs=pixel), pytest.approx(second, abs=pixel))
    assert apart == pytest.approx(b - a, abs=2e-4)
    assert rate == pytest.approx(1 / apart, rel=1e-3)
    row = page.locator("#sinew-values tbody tr", has_text="lever θ").inner_text().split("\t")
    expected = 20 * np.sin(2 * np.pi * SWING_HZ * (np.array([a, b]) + 500.0))
    at_a, at_b, between = map(float, row[-3:])
    assert [at_a, at_b] == pytest.approx(expected.tolist(), abs=0.3)
    assert between == pytest.approx(at_b - at_a, abs=0.02)


def test_a_cursor_is_moved_by_keys_and_keeps_its_time_when_the_picture_moves(page: Any) -> None:
    show(page, 10.0, 12.0)
    page.click("#sinew-cursors")
    page.focus("#sinew-cursor-a")
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    before = page.evaluate("SinewScope.cursorTime(SinewScope.cursors[0])")
    page.focus("#sinew-scope")
    page.keyboard.press("+")
    page.keyboard.press("ArrowRight")
    assert before == pytest.approx(10.0 + 2.0 / 3 + 5 * 0.002, abs=0.003)
    assert page.evaluate("SinewScope.cursorTime(SinewScope.cursors[0])") == pytest.approx(before, abs=1e-6)


def test_the_whole_run_is_seen_and_the_way_back_leads_to_its_first_sample(page: Any) -> None:
    page.click("#sinew-whole")
    page.wait_for_function(f"{SHOWN} && SinewScope.scope.end > 599", timeout=120_000)
    seen = page.evaluate(
        "[SinewScope.bins.time[0], SinewScope.bins.time[SinewScope.bins.count - 1], SinewScope.bins.count]"
    )
    assert seen[0] == 0.0
    assert seen[1] == pytest.approx(LONG_S, abs=2.0)
    assert seen[2] < 3 * page.evaluate("SinewScope.scope.pixels")
    assert page.locator("#sinew-base input:checked").count() == 0
    page.locator("#sinew-base label", has_text="2 s").click()
    assert page.locator("#sinew-base input:checked").input_value() == "2"
    page.focus("#sinew-scope")
    page.keyboard.press("Home")
    page.wait_for_function(f"{SHOWN} && SinewScope.scope.end - SinewScope.scope.start < 3")
    drive = page.evaluate("[...SinewScope.bins.low[SinewScope.bins.row('drive')].slice(0, 20)]")
    assert page.evaluate("[SinewScope.scope.start, SinewScope.bins.time[0]]") == [0.0, 0.0]
    assert drive == pytest.approx((20 * np.sin(2 * np.pi * SWING_HZ * np.arange(20) / RATE_HZ)).tolist(), abs=0.01)


def test_the_spectrum_says_where_the_swing_is(page: Any) -> None:
    show(page, 0.0, 10.0)
    page.click("#sinew-spectrum")
    page.wait_for_function("document.querySelector('#sinew-peaks').textContent.includes('lever')")
    assert "at 3.00 Hz" in page.inner_text("#sinew-peaks").split("lever θ")[1].split(";")[0]
    page.set_viewport_size({"width": 700, "height": 900})
    page.wait_for_function(NARROW, arg="sinew-spectrum-canvas")


TRIGGERED = """async ([hz, gain]) => {
  const scope = window.SinewScope, { traces } = scope, keys = scope.rig.traces, starts = [], gains = [];
  traces.reset(keys);
  scope.base = 2; scope.follows = true; scope.isTriggered = true; scope.maths.gain = true; scope.see();
  const phase = 2 * Math.PI * hz, lever = (t) => 20 * Math.sin(phase * t);
  const rows = { drive: lever, torsion: (t) => 20 * gain * Math.sin(phase * t - 1.5) };
  for (let frame = 0, k = 0; frame < 400; frame++) {
    const time = [];
    for (; k / 200 < frame * 0.037; k++) time.push(k / 200);
    const low = keys.map(({ key }) => time.map((t) => rows[key]?.(t) ?? 0));
    traces.put({ time, low, high: null });
    scope.isFresh = true;
    scope.render();
    if (scope.mark === null) continue;
    starts.push(scope.shown.start);
    gains.push(scope.bins.low[scope.bins.row("gain")][scope.bins.count - 1]);
  }
  return [starts, gains];
}"""


@pytest.mark.parametrize("hz", [2.9, 4.3])
def test_a_triggered_picture_stands_and_its_gain_is_that_of_the_amplitudes(
    opened: Open, swung: Served, hz: float
) -> None:
    page = opened(swung, "/")
    page.wait_for_function("window.SinewScope?.rig && document.body.dataset.stream === 'open'")
    starts, gains = (np.array(found) for found in page.evaluate(TRIGGERED, [hz, 2.5]))
    assert np.unique(starts).size > 20  # it goes on
    periods = (starts + 0.2) * hz  # the crossing is a tenth of the screen from its left
    assert np.abs(periods - np.round(periods)).max() / hz < 0.001
    assert gains == pytest.approx(2.5, rel=0.01)
