"""What the pages show and do in every state of a bench, in a real browser: nothing old looks new, every stop stops.

The runs are played: no test here keeps time with a bench.
"""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from tests.browser import played_run
from tests.browser.dashboard import edit_plan, findings
from tests.browser.stage import PLAN, Stage, staged
from tests.contracts.serving import until

pytestmark = pytest.mark.slow

Open = Callable[..., Any]

PATHS = ("/", "/plan", "/runs", "/design", "/no-such-page")
CONFIRMED_MS = 200


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    with staged(tmp_path_factory.mktemp("stage") / "runs") as stage:
        yield stage


@pytest.fixture
def stage(standing: Stage) -> Iterator[Stage]:
    """Give a dashboard at rest, on which nothing has run."""
    standing.clear()
    yield standing
    standing.clear()


@pytest.fixture
def name(request: pytest.FixtureRequest) -> str:
    """Return a name for a run that no other test has."""
    return f"run-{zlib.crc32(request.node.name.encode()):x}"


def watch(page: Any) -> None:
    """Wait until the live page draws what comes."""
    page.wait_for_function("Number(document.body.dataset.samples) > 100 && document.body.dataset.stale === 'false'")


def is_uncovered(page: Any) -> bool:
    """Return whether whoever clicks into the middle of the stop hits it, and the same at its corners."""
    return bool(
        page.evaluate("""() => {
          const stop = document.getElementById("sinew-emergency"), box = stop.getBoundingClientRect();
          const hits = (a, b) => stop.contains(
            document.elementFromPoint(box.left + a * box.width, box.top + b * box.height));
          return [0.1, 0.5, 0.9].every((a) => [0.25, 0.75].every((b) => hits(a, b)))
            && box.left >= 0 && box.top >= 0 && box.right <= innerWidth && box.bottom <= innerHeight;
        }""")
    )


# Each state: how it comes, what is seen, whether values are grey; and axe finds nothing in it, the stop is free.


@dataclass(frozen=True)
class State:
    """A state of the bench as the live page has it.

    behaviour: of the run that leads to it; None: without a run. then: what brings the run there. seen: what the text
    of places says, patterns. stale: whether the values are grey. repeats: of the run's plan.
    """

    behaviour: str | None = ""
    then: Callable[[Stage, Any], object] = lambda stage, page: None
    seen: dict[str, str] = field(default_factory=dict)
    stale: bool | None = None
    repeats: int = 20
    runs: bool = True


def pause(stage: Stage, page: Any) -> None:
    stage.steward.tell("pause")
    stage.until("paused")


def lose_steering(stage: Stage, page: Any) -> None:
    page.wait_for_selector("#sinew-stop:not([disabled])")
    page.route(f"**:{stage.steward.settings.access.steering_port}/**", lambda route: route.abort())
    stage.kill_pages()
    page.wait_for_function("document.body.dataset.pages === 'lost'")
    page.wait_for_function("!document.getElementById('sinew-notices').textContent.includes('stop works')")
    assert page.locator("#sinew-buttons button:not([disabled])").count() == 0


STATES = {
    "empty": State(None, seen={"#sinew-state": "^Emulated bench . at rest"}),
    "preparing": State(played_run.PREPARES, seen={"#sinew-notice-begins": "begins"}, runs=False),
    "running": State(seen={"#sinew-state": "^Emulated bench", "#sinew-source": "emulated"}, stale=False),
    "doubting": State(played_run.DOUBTS, seen={"#sinew-notice-doubts": "0.41"}),
    "paused": State(then=pause, seen={"#sinew-state": "paused"}, stale=False),
    "run is silent": State(
        played_run.FALLS_SILENT,
        seen={"#sinew-state": "does not answer", "#sinew-notice-quiet, #sinew-notice-silent": ""},
        stale=True,
    ),
    "bench is silent": State(played_run.GIVES_NOTHING, seen={"#sinew-notice-quiet": "the run"}, stale=True),
    "ended early": State(
        then=lambda _, page: page.click("#sinew-stop"),
        seen={
            "#sinew-notice-ended.bad": "ended early(.|\n)*Stopped by the operator",
            "#sinew-state.bad": "ended early",
            ".sinew-age": "^[3-9] s ago$",
            "section:has(#sinew-tension) .sinew-last": "last sample, before the release",
        },
        stale=True,
    ),
    "emergency": State(
        then=lambda _, page: page.keyboard.press("F9"), seen={"#sinew-notice-emergency": "Emergency stop"}, stale=True
    ),
    "complete": State(seen={"#sinew-notice-ended.good": "complete"}, stale=True, repeats=1),
    "pages are lost": State(
        then=lambda stage, _: stage.kill_pages(),
        seen={"#sinew-notice-lost": "the emergency stop works"},
        stale=True,
    ),
    "steering is lost": State(then=lose_steering, seen={"#sinew-notices": "does not reach the bench"}),
}


@pytest.mark.parametrize("state", STATES)
def test_what_each_state_says_is_seen_old_values_are_grey_and_axe_finds_nothing(
    opened: Open, stage: Stage, name: str, state: str
) -> None:
    what = STATES[state]
    page = opened(stage, complain="lost" not in state)
    if what.behaviour is not None:
        stage.begin(name, what.behaviour, repeats=what.repeats)
        if what.runs:
            watch(page)
    what.then(stage, page)
    for place, pattern in what.seen.items():
        page.wait_for_selector(place)
        says = "([place, pattern]) => new RegExp(pattern).test(document.querySelector(place)?.innerText)"
        page.wait_for_function(says, arg=[place, pattern], timeout=120_000)
    if what.stale is not None:
        page.wait_for_function(f"document.body.dataset.stale === '{str(what.stale).lower()}'")
        assert page.locator(".sinew-live.stale").count() == 5 * what.stale
    for theme, width, height in (("light", 1440, 900), ("dark", 1440, 900), ("dark", 390, 844)):
        page.emulate_media(color_scheme=theme)
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(400)
        assert is_uncovered(page)
        assert (theme, width, findings(page)) == (theme, width, [])
    if "lost" in state:
        until(lambda: stage.steward.page_state == "up")


def test_a_run_that_ended_early_goes_on_from_its_notice(opened: Open, stage: Stage, name: str) -> None:
    page = opened(stage)
    stage.begin(name)
    watch(page)
    page.click("#sinew-stop")
    page.wait_for_selector("#sinew-notice-ended.bad")
    recorded = stage.steward.status()["last"]["groups_done"]
    page.click("#sinew-go-on")
    stage.until("running")
    watch(page)
    assert page.locator("#sinew-notice-ended").count() == 0
    page.wait_for_function(f"parseInt(document.querySelector('#sinew-progress-text').textContent) > {recorded}")


def test_a_normal_end_is_never_called_silent(opened: Open, stage: Stage, name: str) -> None:
    page = opened(stage)
    page.evaluate("""() => {
      window.said = new Set();
      const places = ["sinew-state", "sinew-notices"].map((id) => document.getElementById(id));
      const note = () => said.add(places.map((place) => place.textContent).join(" "));
      new MutationObserver(note).observe(document.body, { childList: true, subtree: true, characterData: true });
    }""")
    stage.begin(name, played_run.LINGERS, repeats=1)
    watch(page)
    page.wait_for_selector("#sinew-notice-ended.good", timeout=120_000)
    said = page.evaluate("[...said]")
    assert any("writes its recording" in one for one in said)
    assert not [one for one in said if "answer" in one or "silent" in one or "early" in one]


# Stops.


@pytest.mark.parametrize("path", PATHS)
def test_the_stop_is_the_first_tab_stop_of_every_page_and_stops(opened: Open, stage: Stage, path: str) -> None:
    page = opened(stage, path, complain=False)
    page.wait_for_timeout(1000)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "sinew-emergency"
    assert is_uncovered(page)
    page.keyboard.press("Enter")
    page.wait_for_function("document.body.dataset.emergencyMs !== undefined")
    assert stage.steward.status()["emergency"] is not None


def test_the_stop_needs_no_sign_in_on_the_machine_that_serves(opened: Open, stage: Stage, name: str) -> None:
    page = opened(stage, signed_in=False)
    assert page.evaluate("Sinew.status().signed_in") is False
    stage.begin(name)
    watch(page)
    page.keyboard.press("F9")
    page.wait_for_function("document.body.dataset.emergencyMs !== undefined")
    stage.until("over")
    assert page.locator("dialog[open]").count() == 0
    assert "STOPPED" in page.inner_text("#sinew-emergency")


def test_f9_stops_while_the_pages_server_is_lost(opened: Open, stage: Stage, name: str) -> None:
    page = opened(stage, complain=False)
    stage.begin(name)
    watch(page)
    stage.kill_pages()
    page.wait_for_selector("#sinew-notice-lost")
    page.keyboard.press("F9")
    page.wait_for_function("document.body.dataset.emergencyMs !== undefined")
    stage.until("over")
    until(lambda: stage.steward.page_state == "up")


def open_sign_in(page: Any) -> None:
    page.evaluate("Sinew.signIn('to see what it covers')")
    page.wait_for_selector("dialog[open]")


def open_list(page: Any) -> None:
    page.get_by_label("Begin with the plan").click()
    page.wait_for_selector(".q-menu [role=option]")


OPEN = {"sign-in": ("/", open_sign_in), "list of plans": ("/plan", open_list)}


@pytest.mark.parametrize("what", OPEN)
def test_escape_twice_stops_whatever_is_open(opened: Open, stage: Stage, what: str) -> None:
    path, open_it = OPEN[what]
    page = opened(stage, path)
    page.wait_for_selector("#sinew-duration, #sinew-scope")
    page.wait_for_timeout(1000)
    page.evaluate("window.pressed = []; addEventListener('keydown', (event) => pressed.push(event.timeStamp), true)")
    for _ in range(10):  # until a busy computer presses twice within half a second
        open_it(page)
        assert is_uncovered(page)
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")
        if page.evaluate("pressed.at(-1) - pressed.at(-2)") < 500:
            break
    page.wait_for_function("document.body.dataset.emergencyMs !== undefined")


def test_escape_once_stops_nothing(opened: Open, stage: Stage) -> None:
    page = opened(stage)
    for _ in range(3):
        page.keyboard.press("Escape")
        page.wait_for_timeout(700)
    assert stage.steward.status()["emergency"] is None


@pytest.mark.realtime
def test_a_stop_is_confirmed_within_200_ms_while_a_preview_computes(opened: Open, stage: Stage, name: str) -> None:
    page = opened(stage, "/plan")
    page.wait_for_selector("#sinew-duration")
    computed, times = "[aria-label='The twin swings through the plan once']", []
    for number in range(5):
        stage.begin(f"{name}-{number}")
        stage.until("running")
        many = ", ".join(f"{0.1 * (number + 5 * i):.1f}" for i in range(1, 24))
        edit_plan(page, r"pretension_mm = .*", f"pretension_mm = [{many}]")
        page.wait_for_function(f"document.querySelector({computed!r})")
        page.keyboard.press("F9")
        page.wait_for_function("document.getElementById('sinew-emergency').dataset.stop === 'done'")
        assert page.query_selector(computed), "the preview was there before the stop was"
        times.append(page.evaluate("Number(document.body.dataset.emergencyMs)"))
        stage.until("over")
        page.wait_for_selector("#sinew-duration")
    assert sorted(times)[2] < CONFIRMED_MS, times


def test_who_signs_out_only_watches_and_is_offered_to_sign_in(opened: Open, stage: Stage) -> None:
    page = opened(stage)
    assert page.locator("#sinew-in").is_hidden()
    page.click("#sinew-out")
    page.wait_for_function("document.querySelector('#sinew-who')?.innerText === 'You only watch'")
    assert page.locator("#sinew-in").is_visible()
    assert page.locator("#sinew-buttons button:not([disabled])").count() == 0


# What is predicted, what misses it, and what is alarming.


ALARM = {"key": "tilt", "run": "one", "of": "head plate", "value": 9.5, "worst": 9.5, "limit": 9, "at": 1000}
ALARM |= {"inRun": 1, "over": None, "isSeen": False}


def after(page: Any, alarms: dict[str, Any], *tilts: float, limit: float | None = 9.0, run: str = "one") -> Any:
    """Return (alarms, how many began) after some readings of the tilt, a second apart."""
    return page.evaluate(
        """async ([alarms, tilts, limit, run]) => {
          const { judge } = await import("/sinew/alarms.js");
          let raised = 0;
          for (const [i, tilt] of tilts.entries()) {
            const found = judge(alarms, { tilt: [tilt, "head plate"] }, { tilt: limit }, run, 1000 * (i + 1), i + 1);
            alarms = found.alarms;
            raised += found.raised.length;
          }
          return [alarms, raised];
        }""",
        [alarms, tilts, limit, run],
    )


def test_an_alarm_passes_through_its_states(opened: Open, stage: Stage) -> None:
    page = opened(stage)
    seen, passed = ALARM | {"isSeen": True}, ALARM | {"over": 1000}
    assert after(page, {}, 9.0) == [{}, 0]
    assert after(page, {}, 9.5) == [{"tilt": ALARM}, 1]
    assert after(page, {"tilt": ALARM}, 11.0, 10.0) == [{"tilt": ALARM | {"worst": 11}}, 0]
    assert after(page, {"tilt": ALARM}, 8.8) == [{"tilt": ALARM}, 0]  # not 3 % below
    assert after(page, {"tilt": ALARM}, 8.7) == [{"tilt": passed}, 0]  # latched
    assert after(page, {"tilt": passed}, 9.2) == [{"tilt": ALARM}, 0]
    assert after(page, {"tilt": seen}, 9.2) == [{"tilt": seen}, 0]
    assert after(page, {"tilt": seen}, 8.7) == [{}, 0]
    assert after(page, {"tilt": seen}, 8.7, 9.5) == [{"tilt": ALARM | {"at": 2000, "inRun": 2}}, 1]
    assert after(page, {"tilt": seen}, 9.5, run="two") == [{"tilt": ALARM | {"run": "two"}}, 1]
    assert after(page, {}, 99.0, limit=None) == [{}, 0]


def test_an_alarm_that_was_seen_lasts_no_longer_than_what_it_is_about(opened: Open, stage: Stage) -> None:
    told = opened(stage).evaluate(
        """async (alarm) => {
          const { acknowledge, rest } = await import("/sinew/alarms.js");
          const [lasting, passed] = [{ tilt: alarm }, { tilt: { ...alarm, over: 2000 } }];
          const seen = acknowledge(lasting, "tilt");
          return [seen.tilt.isSeen, acknowledge(passed, "tilt"), rest(seen), Object.keys(rest(passed))];
        }""",
        ALARM,
    )
    assert told == [True, {}, {}, ["tilt"]]


def test_what_cannot_be_read_as_a_limit_is_none_and_no_limit_exceeds_that_of_the_rig(
    opened: Open, stage: Stage
) -> None:
    told = opened(stage).evaluate(
        """async () => {
          const { limitsOf, typed } = await import("/sinew/alarms.js");
          const rig = Object.fromEntries(["temperature", "tension", "tilt"].map((key) => [key, { limit: 9, rig: 10 }]));
          const field = (value, badInput) => typed({ value, validity: { badInput } }) === undefined;
          return [limitsOf({ ...rig, missed: { limit: 5, rig: null } }, { tension: 99, tilt: null }),
            field("", true), field("", false), field("-1", false)];
        }"""
    )
    assert told == [{"temperature": 9, "tension": 10, "tilt": None, "missed": 5}, True, False, True]


def alarmed(opened: Open, stage: Stage, name: str, **how: Any) -> Any:
    """Return a page on which the temperature alarms: 41 °C, and somebody set the limit to 40."""
    page = opened(stage, **how)
    assert page.input_value("#sinew-limit-temperature") == "63"  # nine tenths of what the rig allows
    page.fill("#sinew-limit-temperature", "40")
    page.keyboard.press("Tab")
    stage.begin(name)
    page.wait_for_selector("#sinew-notice-alarm-temperature")
    return page


def test_an_alarm_is_an_alert_with_a_sound_and_stays_until_it_is_acknowledged(
    opened: Open, stage: Stage, name: str
) -> None:
    page = alarmed(opened, stage, name)
    notice = page.locator("#sinew-notice-alarm-temperature")
    assert notice.get_attribute("role") == "alert"
    said = notice.inner_text()
    assert "Temperature of the drive: 41\u00a0°C" in said
    assert "the limit is 40\u00a0°C" in said
    assert f"into the run {name}" in said
    page.wait_for_function("Number(document.body.dataset.beeps) >= 2")
    assert page.title().startswith("◆ 1 · ")
    assert "Alarm" in page.locator("#sinew-log li", has_text="Temperature").inner_text()
    page.reload()
    page.wait_for_selector("#sinew-acknowledge-temperature")
    assert page.input_value("#sinew-limit-temperature") == "40"
    page.click("#sinew-acknowledge-temperature")
    page.wait_for_function("document.body.dataset.alarms === '0'")
    assert notice.count() == 0
    assert "seen" in page.inner_text("#sinew-alarm-state-temperature")
    page.fill("#sinew-limit-temperature", "50")
    page.keyboard.press("Tab")
    page.wait_for_function("document.getElementById('sinew-alarm-state-temperature').textContent === 'quiet'")


def test_an_alarm_that_nobody_saw_outlasts_its_run(opened: Open, stage: Stage, name: str) -> None:
    page = alarmed(opened, stage, name)
    stage.steward.tell("stop")
    page.wait_for_selector("#sinew-notice-ended")
    page.wait_for_function("document.body.dataset.stale === 'true'")
    assert page.locator("#sinew-notice-alarm-temperature").count() == 1


def test_what_happened_has_times_and_severity_and_is_filtered(opened: Open, stage: Stage, name: str) -> None:
    page = opened(stage)
    stage.begin(name, played_run.DOUBTS)
    watch(page)
    page.wait_for_function("document.querySelectorAll('#sinew-log li').length === 3")
    newest = page.locator("#sinew-log li").first
    assert newest.locator(".sinew-severity").inner_text() == "▲ Warning"
    assert "0.41" in newest.inner_text()
    assert page.locator("#sinew-log time[datetime]").count() == 3
    page.locator("#sinew-severity label", has_text="Warnings").click()
    page.wait_for_function("document.querySelectorAll('#sinew-log li').length === 1")
    stage.steward.tell("stop")
    page.wait_for_selector("#sinew-log li.bad")
    assert "■ Stop" in page.locator("#sinew-log li").first.inner_text()
    assert page.locator("#sinew-log li").count() == 2


def test_a_run_is_held_against_its_prediction_and_misses_are_told(opened: Open, stage: Stage, name: str) -> None:
    page = opened(stage)
    page.set_default_timeout(180_000)  # equations are compiled
    stage.begin(name, repeats=1)
    page.wait_for_function("document.getElementById('sinew-basis').textContent.includes('parameters of the rig')")
    page.wait_for_function("document.getElementById('sinew-misses').children.length >= 4")
    assert "miss the prediction" in page.inner_text("#sinew-verdict")
    assert page.locator("#sinew-verdict").get_attribute("role") == "status"
    assert "its uncertainty" in page.locator("#sinew-misses li").first.inner_text()
    summary = page.locator(".nicegui-echart").first.get_attribute("aria-label")
    assert "missed the prediction at" in summary
    page.locator("details.sinew-table summary").first.click()
    page.wait_for_selector("details.sinew-table td >> text=misses by")
    assert findings(page) == []


# Whoever reads by ear or with other colours.


FOCUS = """() => {
  const at = document.activeElement;
  if (at === document.body || at.closest("[id^=q-portal]")) return null;
  const shows = (element) => {
    const style = getComputedStyle(element);
    return (style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0) || style.boxShadow.includes("0px 5px");
  };
  const around = [at.parentElement, at.parentElement?.parentElement, at.nextElementSibling];
  const seen = [at, ...around, at.closest(".q-field__control")].filter(Boolean);
  return [at.id || at.getAttribute("aria-label") || at.outerHTML.slice(0, 120), seen.some(shows)];
}"""


def go_to(page: Any, target: str, key: str = "Tab") -> None:
    """Go to what a selector finds, by a key alone; whatever has the focus on the way shows it."""
    page.wait_for_selector(target)
    for _ in range(90):
        page.keyboard.press(key)
        where, is_shown = page.evaluate(FOCUS) or ("the page", True)
        assert is_shown, where
        if page.evaluate("target => document.activeElement.matches(target)", target):
            return
    raise AssertionError(f"{key} does not lead to {target}")


BRIEF = PLAN.format(name="brief", repeats=2).replace("[2, 6]", "[2]")


def test_a_run_is_planned_and_steered_by_keyboard_alone(opened: Open, stage: Stage) -> None:
    library = stage.runs / "plans"
    library.mkdir(exist_ok=True)
    (library / "a brief one.toml").write_text(BRIEF)
    page = opened(stage)
    go_to(page, ".sinew-nav a[href='/plan']")
    page.keyboard.press("Enter")
    page.wait_for_url("**/plan")
    page.wait_for_selector("#sinew-duration:not(:empty)")
    go_to(page, "[aria-label='Begin with the plan']")
    for _ in range(30):
        here = page.locator(".q-menu .q-manual-focusable--focused")
        if here.count() and "a brief one" in here.inner_text():
            break
        page.keyboard.press("ArrowUp" if here.count() else "Space")  # the list may close again while the page is busy
        page.wait_for_timeout(300)
    page.keyboard.press("Enter")
    page.wait_for_function("document.querySelector('#sinew-plan-text').textContent.includes('brief')")
    page.wait_for_selector("#sinew-start:not([disabled])")
    go_to(page, "#sinew-start", "Shift+Tab")
    page.keyboard.press("Enter")
    page.wait_for_url(f"{stage.base}/")
    watch(page)
    go_to(page, "#sinew-pause")
    page.keyboard.press("Space")
    page.wait_for_function("Sinew.status().run?.state === 'paused'")
    go_to(page, "#sinew-resume")
    page.keyboard.press("Space")
    page.wait_for_selector("#sinew-notice-ended.good")
    page.wait_for_selector(".nicegui-echart >> nth=0 >> text=2 mm, measured")
    go_to(page, "#sinew-open-last")
    page.keyboard.press("Enter")
    page.wait_for_selector("[data-reason]")
    go_to(page, "a[href$='/samples']")
    page.keyboard.press("Enter")
    page.wait_for_function("document.body.dataset.samples === 'shown'")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "sinew-emergency"


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("what", [*OPEN, "no such page", "sign-in page", "help"])
def test_axe_finds_nothing_where_something_lies_over_or_is_missing(
    opened: Open, stage: Stage, what: str, theme: str
) -> None:
    path, open_it = OPEN.get(
        what, ({"no such page": "/no-such-page", "help": "/help"}.get(what, "/login"), lambda _: None)
    )
    page = opened(stage, path, theme=theme)
    page.wait_for_timeout(3000)
    open_it(page)
    page.wait_for_timeout(500)
    assert findings(page) == []
