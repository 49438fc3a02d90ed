"""The pages in a real browser, without a bench: what a designer and a reader of past runs see and do."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.browser.dashboard import IN_SPACE, Served, choose_plan, edit_plan, findings, plan_text, served

from sinew.plan.toml import dump_rig, load_rig

pytestmark = pytest.mark.slow

Open = Callable[..., Any]

FIND_SCENE = """() => {
  const numbers = [...document.querySelectorAll('[id]')].map(element => Number(element.id.slice(1)));
  const scene = () => numbers.map(number => window.getElement?.(number)).find(found => found?.renderer?.info);
"""
"""Begin of a function of the browser in which `scene` finds what the joint is drawn in, and no chart."""

PAGES = {
    "/": "#sinew-scope",
    "/plan": "#sinew-duration",
    "/runs": "#sinew-open",
    "/runs/soft,stiff": "a[data-kind=csv]",
    "/run/odd/samples": "#sinew-scope",
    "/design": "#sinew-peak",
}


@pytest.mark.parametrize("path", PAGES)
def test_axe_finds_nothing(opened: Open, shown: Served, path: str) -> None:
    page = opened(shown, path)
    page.wait_for_selector(PAGES[path], state="attached")
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)
        page.wait_for_timeout(500)
        assert (theme, findings(page)) == (theme, [])


def test_a_bent_joint_is_drawn_as_an_even_rod_between_its_plates(launch: Callable[..., Any], shown: Served) -> None:
    torsion, pitch, roll, nearer = 0.6, -0.3, 0.2, 0.06
    around = 2 * np.pi * np.arange(28) / 28
    outline = np.column_stack([0.3 * np.cos(around), 0.2 * np.sin(around)])
    browser = launch(*IN_SPACE)
    page = browser.new_page()
    page.set_default_timeout(120_000)
    page.goto(shown.link)
    page.wait_for_function(f"{FIND_SCENE} return scene(); }}")
    drawn = page.evaluate(
        f"""async ([torsion, pitch, roll, nearer, outline]) => {{
      const {{ Joint }} = await import("/sinew/joint.js"), found = ({FIND_SCENE} return scene(); }})();
      const shape = {{ length: 1, outline, circle: 0.34, plate: 0.5, lever: 0.7, tendons: 4 }};
      const joint = await Joint.build(found, shape);
      joint.pose(torsion, 0.1, [0, 0, 0, 0], [pitch, roll], nearer);
      const points = joint.silicone.geometry.attributes.position.array, sections = [];
      for (let ring = 0; ring <= 14; ring++) {{
        const mean = [0, 0, 0];
        for (let k = 0; k < 28; k++) for (let c = 0; c < 3; c++) mean[c] += points[3 * (29 * ring + k) + c] / 28;
        sections.push(mean);
      }}
      const chord = joint.tendons[0].scale.y, surface = Array.from(points.slice(0, 3 * 28));
      const head = joint.head.position.toArray(), turn = joint.head.quaternion.toArray();
      return {{ head, turn, sections, surface, chord }};
    }}""",
        [torsion, pitch, roll, nearer, outline.tolist()],
    )
    browser.close()

    # x, y, z of the picture are y, z, x of frame B.
    head = Rotation.from_rotvec([pitch, roll, 0.0]) * Rotation.from_rotvec([0.0, 0.0, torsion])
    nodes, weights = np.polynomial.legendre.leggauss(12)

    def place(share: float) -> np.ndarray:
        turns = Rotation.from_rotvec(np.outer(0.5 * share * (1 + nodes), head.as_rotvec()))
        return np.asarray(0.5 * share * weights @ turns.apply([0.0, 0.0, 1.0]))

    long = (1 - nearer) / np.linalg.norm(place(1.0))
    expected = np.array([long * place(1 - ring / 14) for ring in range(15)])
    guide = head.apply([0.34, 0.0, 0.0]) + expected[0]
    assert np.allclose(drawn["sections"], expected, atol=1e-5)
    surface = head.inv().apply(np.reshape(drawn["surface"], (28, 3)) - expected[0])
    assert np.allclose((surface[:, 0] / 0.3) ** 2 + (surface[:, 1] / 0.2) ** 2, 1.0, atol=1e-5)
    assert np.allclose(drawn["head"], expected[0], atol=1e-9)
    assert (Rotation.from_quat(drawn["turn"]).inv() * head).magnitude() < 1e-9
    assert drawn["chord"] == pytest.approx(np.linalg.norm(guide - [0.34, 0.0, 0.0]), abs=1e-9)


@pytest.fixture(scope="module")
def spatial(launch: Callable[..., Any], shown: Served) -> Iterator[Any]:
    """Give the live page in a browser that draws in space."""
    browser = launch(*IN_SPACE)
    page = browser.new_page()
    page.set_default_timeout(120_000)
    page.goto(shown.link)
    page.wait_for_function(f"{FIND_SCENE} return scene()?.renderer.info.render.triangles > 500; }}")
    yield page
    browser.close()


def camera(page: Any) -> tuple[float, float, float]:
    """Return where the joint is seen from: azimuth and height in degrees, distance."""
    x, y, z = page.evaluate(
        f"{FIND_SCENE} return scene().camera.position.clone().sub(scene().controls.target).toArray(); }}"
    )
    distance = np.linalg.norm([x, y, z])
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arcsin(z / distance))), float(distance)


def test_the_joint_is_turned_brought_nearer_and_turned_back_by_keys(spatial: Any) -> None:
    spatial.focus("#sinew-joint")
    spatial.keyboard.press("Home")  # the scene may not have moved to its eye yet
    azimuth, height, distance = camera(spatial)
    for key in ("ArrowRight", "ArrowUp", "+"):
        spatial.keyboard.press(key)
    assert camera(spatial) == pytest.approx((azimuth + 10.0, height + 10.0, 0.9 * distance))
    spatial.keyboard.press("Home")
    assert camera(spatial) == pytest.approx((azimuth, height, distance))


MOVED = """async ([exaggerated, slowly, frames]) => {
  const { JointView } = await import("/sinew/joint.js"), { Traces } = await import("/sinew/scope.js");
  const scene = (FIND)(), given = JSON.parse(document.getElementById("sinew-live").textContent), { rig } = given;
  const traces = new Traces(), keys = rig.traces.map((trace) => trace.key);
  const view = new JointView(scene, traces, given.eye);
  const time = Array.from({ length: 800 }, (_, k) => k / 200), lever = (t) => 20 * Math.sin(2 * Math.PI * 3 * t);
  const swung = { drive: lever, torsion: (t) => lever(t) / 2 };
  traces.reset(rig.traces);
  traces.put({ time, low: keys.map((key) => time.map((t) => swung[key]?.(t) ?? 0)), high: null });
  await view.show(rig);
  const slider = document.getElementById("sinew-exaggeration");
  slider.focus();
  slider.value = exaggerated;
  slider.dispatchEvent(new Event("input"));
  view.slow = slowly ? { at: 0, periods: null } : null;
  const now = keys.map((key) => ({ drive: 12, torsion: 6 })[key] ?? 0), drawn = [];
  for (let k = 0; k < frames; k++) {
    view.move(now, 40 * k);
    const { x, y, z, w } = view.joint.head.quaternion;
    drawn.push([view.joint.lever.rotation.z, 2 * Math.atan2(z, w)].map((angle) => angle * 180 / Math.PI));
  }
  view.joint.remove();
  slider.value = 1;
  slider.dispatchEvent(new Event("input"));
  return [drawn, slider.getAttribute("aria-valuetext")];
}""".replace("FIND", f"{FIND_SCENE} return scene(); }}")


@pytest.mark.parametrize("factor", [1.0, 7.5])
def test_the_torsion_is_drawn_larger_by_the_factor_that_is_set_and_the_lever_as_it_is(
    spatial: Any, factor: float
) -> None:
    (drawn,), _ = spatial.evaluate(MOVED, [factor, False, 1])
    assert drawn == pytest.approx([12.0, 6.0 * factor])


def test_the_last_periods_are_drawn_at_a_tenth_of_their_speed(spatial: Any) -> None:
    drawn, _ = spatial.evaluate(MOVED, [1.0, True, 120])
    lever = np.array(drawn)[:, 0]
    # A frame of 40 ms shows 4 ms of the swing: 120 frames, 0.48 s of 3 Hz, begun at the lever's rising zero.
    assert lever == pytest.approx(20 * np.sin(2 * np.pi * 3 * 0.004 * np.arange(120)), abs=0.4)


@pytest.mark.parametrize("path", PAGES)
def test_a_phone_shows_the_page_without_scrolling_sideways_and_the_stop(opened: Open, shown: Served, path: str) -> None:
    page = opened(shown, path, size=(390, 780))
    page.wait_for_selector(PAGES[path], state="attached")
    page.wait_for_function("document.documentElement.scrollWidth <= 391")  # wider for a moment, while it is built
    box = page.locator("#sinew-emergency").bounding_box()
    assert box is not None
    assert box["y"] + box["height"] <= 781


def test_two_runs_are_laid_over_one_another(opened: Open, shown: Served) -> None:
    page = opened(shown, "/runs")
    for name in ("soft", "stiff"):
        page.locator("tr", has_text=name).locator("[role=checkbox]").first.click()
    page.click("#sinew-open")
    page.wait_for_url("**/runs?open=*&open=*")
    page.wait_for_selector("a[data-kind=csv]")
    legend = page.locator(".nicegui-echart").first.inner_text()
    assert "soft, 2 mm" in legend
    assert "stiff, 8 mm" in legend


def test_a_row_opens_its_run_and_its_numbers_have_units_and_intervals(opened: Open, shown: Served) -> None:
    page = opened(shown, "/runs")
    page.locator("td", has_text="soft").first.click()
    page.wait_for_url("**/runs?open=soft")
    row = page.locator("tr", has_text="frequency of the largest fundamental").first
    assert " Hz (" in row.inner_text()


@pytest.mark.parametrize("kind", ["recording", "csv", "mat", "report"])
def test_the_files_of_a_run_are_downloaded(opened: Open, shown: Served, kind: str) -> None:
    page = opened(shown, "/runs/soft")
    page.wait_for_selector(f"a[data-kind={kind}]")
    with page.expect_download(timeout=120_000) as download:
        page.click(f"a[data-kind={kind}]")
    assert Path(download.value.path()).stat().st_size > 1000


def test_a_damaged_run_is_said_to_be_and_the_others_are_shown(opened: Open, shown: Served) -> None:
    page = opened(shown, "/runs/damaged,soft")
    page.wait_for_selector("a[data-kind=csv]")
    assert page.locator(".sinew-bad", has_text="not").count() >= 1


@pytest.mark.parametrize("path", ["/runs", "/runs/odd,soft", "/plan"])
def test_a_script_in_a_name_is_text(opened: Open, shown: Served, path: str) -> None:
    page = opened(shown, path)
    page.wait_for_selector("#sinew-open, a[data-kind=csv], #sinew-duration")
    if path == "/plan":
        choose_plan(page, "odd")
        page.wait_for_function("document.querySelector('#sinew-plan-text').textContent.includes('onerror')")
    if path == "/runs":
        page.locator("td", has_text="onerror").nth(1).wait_for()  # the rows come after the button
    page.wait_for_timeout(500)
    assert page.evaluate("window.pwned") is None
    assert page.locator("img[src=x]").count() == 0


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (r"repeats = \d+", 'repeats = "many"', "sweep.repeats: found 'many', expected"),
        (r"\[sweep\]", "[sweep", "the plan is not valid TOML"),
        (r"pretension_mm = .*", "pretension_mm = [2, 60]", "Refused:"),
    ],
    ids=["no number", "no TOML", "beyond the rig"],
)
def test_what_is_wrong_with_a_plan_is_told_and_nothing_can_start(
    opened: Open, shown: Served, before: str, after: str, said: str
) -> None:
    page = opened(shown, "/plan")
    page.wait_for_selector("#sinew-duration")
    edit_plan(page, before, after)
    page.wait_for_selector(f"text={said}")
    assert page.locator("#sinew-start").is_disabled()


def _foot(box: dict[str, float]) -> float:
    return box["y"] + box["height"]


def test_a_fault_is_said_at_its_line_and_the_edit_is_there_when_one_comes_back(opened: Open, shown: Served) -> None:
    page = opened(shown, "/plan")
    page.wait_for_selector(".sinew-timeline")
    edit_plan(page, r"periods = \d+", "periods = -3")
    marked = page.locator(".sinew-fault-line")
    assert "periods = -3" in marked.inner_text()
    assert "found -3" in marked.locator(".sinew-fault").inner_text()
    editor, fault = (page.locator(one).bounding_box() for one in (".sinew-editor", ".sinew-fault"))
    assert fault["x"] + fault["width"] <= editor["x"] + editor["width"]
    assert _foot(fault) == pytest.approx(_foot(marked.bounding_box()), abs=2)
    assert findings(page) == []
    page.goto(shown.base + "/runs")
    page.goto(shown.base + "/plan")
    page.wait_for_selector("#sinew-faults")
    assert "periods = -3" in plan_text(page)
    assert page.inner_text("#sinew-plan-state").startswith("Changed")
    page.click("#sinew-plan-discard")
    page.wait_for_selector(".sinew-timeline")
    assert page.inner_text("#sinew-plan-state").startswith("As the plan")


def test_a_plan_is_kept_in_the_library(opened: Open, shown: Served) -> None:
    page = opened(shown, "/plan")
    page.wait_for_selector(".sinew-timeline")
    edit_plan(page, r"periods = \d+", "periods = 4")
    page.fill("#sinew-plan-name", "kept")
    page.click("#sinew-plan-save")
    page.wait_for_function("document.querySelector('#sinew-plan-state').textContent.startsWith('As kept')")
    kept = shown.runs / "plans" / "kept.toml"
    assert kept.read_text() == plan_text(page)


def test_a_design_is_held_against_the_rig_as_built_and_becomes_a_rig(
    opened: Open, shown: Served, tmp_path: Path
) -> None:
    page = opened(shown, "/design")
    page.wait_for_selector("#sinew-peak")
    page.fill("#sinew-number-length_mm", "110")
    page.keyboard.press("Tab")
    page.wait_for_selector("#sinew-lag:has-text('% against the rig as built')")
    legend = page.locator(".nicegui-echart").first.inner_text()
    assert "this joint" in legend
    assert "as built" in legend
    assert page.get_by_role("slider", name="Length of the silicone").get_attribute("aria-valuetext") == "110 mm"
    assert findings(page) == []
    with page.expect_download() as download:
        page.click("#sinew-rig-download")
    download.value.save_as(tmp_path / "mine.toml")
    assert load_rig(tmp_path / "mine.toml").silicone.length.value == pytest.approx(0.110)
    page.click("#sinew-reset-length_mm")
    page.wait_for_function("document.querySelector('#sinew-number-length_mm').value === '95'")


def test_a_joint_is_designed_from_a_rig_of_the_labs_own(opened: Open, shown: Served) -> None:
    library = shown.runs / "rigs"
    library.mkdir(exist_ok=True)
    rig = load_rig("paper")
    length = rig.silicone.length.model_copy(update={"value": 0.1})
    silicone = rig.silicone.model_copy(update={"length": length})
    (library / "a long one.toml").write_text(dump_rig(rig.model_copy(update={"name": "long", "silicone": silicone})))
    page = opened(shown, "/design")
    page.wait_for_selector("#sinew-peak")
    page.get_by_label("Rig as built").click()
    page.get_by_role("option", name="a long one (yours; ").click()
    page.wait_for_url("**/design?rig=a+long+one.toml")
    page.wait_for_selector("#sinew-peak")
    assert page.input_value("#sinew-number-length_mm") == "100"
    page.goto(shown.base + "/plan?rig=a+long+one.toml")
    page.wait_for_selector(".sinew-fields:has-text('a long one (yours')")
    page.get_by_label("Rig", exact=True).click()
    page.get_by_role("option", name="curved (").click()
    page.wait_for_selector(".sinew-fields:has-text('curved (')")
    page.goto(shown.base + "/plan")
    page.wait_for_selector(".sinew-fields:has-text('curved (')")
    page.goto(shown.base + "/design?rig=none.toml")
    page.wait_for_selector("[role=alert]:has-text('there is no none.toml')")


def test_a_number_beyond_a_slider_says_where_that_ends(opened: Open, shown: Served) -> None:
    page = opened(shown, "/design")
    page.wait_for_selector("#sinew-peak")
    for key, end in (("length_mm", 150), ("pretension_mm", load_rig("paper").limits.pretension_mm[1])):
        page.fill(f"#sinew-number-{key}", "999")
        page.keyboard.press("Tab")
        page.wait_for_selector(f"text={end:g} mm is the end of this slider")
        page.wait_for_function(f"document.querySelector('#sinew-number-{key}').value === '{end:g}'")
    assert findings(page) == []


def test_the_page_is_grey_until_the_curve_of_its_joint_is_there(opened: Open, tmp_path: Path) -> None:
    with served(tmp_path / "runs") as fresh:
        page = opened(fresh, "/design")
        page.wait_for_selector(".stale #sinew-compiling:has-text('is being computed')")
        page.wait_for_selector(".stale #sinew-design-gain")
        page.wait_for_selector(".stale", state="detached")
        assert page.inner_text("#sinew-peak").startswith("Largest gain")


def test_who_is_not_signed_in_may_watch_and_is_asked_for_the_token(opened: Open, shown: Served) -> None:
    page = opened(shown, "/", signed_in=False)
    page.click("#sinew-in")
    page.fill("#sinew-token", "wrong")
    page.keyboard.press("Enter")
    page.wait_for_function("document.querySelector('dialog [role=alert]').textContent.length > 10")
    assert page.evaluate("Sinew.status().signed_in") is False


def test_the_token_leaves_the_address_at_once(opened: Open, shown: Served) -> None:
    page = opened(shown)
    assert "token" not in page.url
