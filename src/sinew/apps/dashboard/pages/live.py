"""The live page: joint, oscilloscope, Lissajous figure, curves, bench."""

from pathlib import Path
from typing import Any

from nicegui import ui

from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.hub import Results
from sinew.apps.dashboard.judgement import misses, tally
from sinew.apps.dashboard.pages.curves import Curves
from sinew.apps.dashboard.pages.frame import Site, card, choice, framed, live_card, quantity, script
from sinew.apps.dashboard.pages.samples import lay_out_scope
from sinew.apps.dashboard.work.runs import RECORDING
from sinew.apps.dashboard.work.samples import drawn_rig
from sinew.plan.toml import load_rig

_LOOK_S = 0.5
_EYE = (0.95, -1.1, 1.15)
"""Where the joint is seen from at first, in lengths of its silicone."""


def add_live_page(site: Site) -> None:
    """Serve the live page at /."""
    rig = load_rig(site.rig)

    @ui.page("/")
    def live() -> None:
        with framed(site, "Live", "/"):
            ui.label("Live").props("role=heading aria-level=1").classes("sinew-hidden")
            nothing = _nothing(site.runs) if site.bench else "No bench: start sinew serve with --emulate."
            with ui.element("div").props("id=sinew-nothing").classes("sinew-card"):
                ui.label(nothing).props("id=sinew-nothing-yet role=status").classes("text-bold")
                ui.html(_STEPS, sanitize=False).props("id=sinew-steps")
            with ui.element("div").classes("sinew-grid"):
                # As the grid of a desk shows them: what a key goes to next stands next.
                gain, coming = _gain_card()
                scene = _joint_card()
                _numbers_card()
                with live_card("Oscilloscope", 6) as place:
                    place.classes("sinew-at-scope")
                    lay_out_scope(is_live=True)
                _curves(site, gain, coming)
                _bench_card()
                _alarms_card()
                _happened_card()
        script("sinew-live", {"scene": scene, "eye": _EYE, "rig": drawn_rig(rig)})
        ui.add_body_html(f'<script type="module" src="/sinew/live.js?{site.version}"></script>')


def _nothing(runs: Path) -> str:
    """Return that nothing has run; of what ran before, this page's server knows only that it lies in the folder."""
    kept = any((folder / file).is_file() for folder in runs.glob("*/") for file in (JOURNAL, RECORDING))
    since = "Nothing has run since this page's server began; the page Runs has what was run before."
    return since if kept else "Nothing has run yet."


_STEPS = """<ol class="sinew-steps">
<li><a href="/plan">Plan a run</a>: one is chosen already, of half a minute.</li>
<li><b>Take control and start</b>, on that page.</li>
<li>Watch it here: the joint, its swing, and the resonance curve as it grows. <b>Open its results</b> comes at the
end.</li>
</ol><p class="sinew-soft">What the words and the buttons mean: <a href="/help">Help</a>.</p>"""


def _joint_card() -> int:
    """Lay the joint out and return the number of its scene."""
    with live_card("Joint", 3) as place:
        place.classes("sinew-at-joint")
        about = "The joint as it moves. Arrow keys turn it, plus and minus bring it nearer and farther, Home back."
        view = ui.element("div").props(f'id=sinew-joint role=application tabindex=0 aria-label="{about}"')
        with view:
            scene = ui.scene(width=320, height=360, grid=False, background_color="#000000", fps=25)
            scene.move_camera(*_EYE, 0.0, 0.0, 0.55, duration=0)
            ui.element("div").props("id=sinew-tensions")
        ui.html(
            '<div class="sinew-row"><label for="sinew-exaggeration">Deformation drawn '
            '<output id="sinew-exaggeration-said" for="sinew-exaggeration">1×</output></label>'
            '<input type="range" id="sinew-exaggeration" min="1" max="10" step="0.5" value="1" '
            'aria-valuetext="1 times"><button type="button" class="sinew-button" id="sinew-slow" aria-pressed="false">'
            'Last periods, 1/10 speed</button><button type="button" class="sinew-button" id="sinew-joint-home">'
            "Reset view</button>"
            '</div><div class="sinew-soft">Tendons: <span style="color:var(--low)">●</span> 0 N to '
            '<span style="color:var(--high)">●</span> '
            '<span id="sinew-tension-limit">–</span> N, the rig\'s limit</div>',
            sanitize=False,
        )
    return scene.id


def _numbers(rows: tuple[tuple[str, str], ...]) -> None:
    text = "".join(f'<dt>{label}</dt><dd id="sinew-{key}">–</dd>' for label, key in rows)
    ui.html(f'<dl class="sinew-numbers">{text}</dl>', sanitize=False)


def _numbers_card() -> None:
    with live_card("Run", 3) as place:
        place.classes("sinew-at-run")
        _numbers((("Run", "run"), ("Doing", "doing"), ("At", "at"), ("Recorded on", "source")))
        ui.html(
            '<progress id="sinew-progress" max="1" value="0" aria-label="Progress of the plan"></progress>'
            '<div id="sinew-progress-text" class="sinew-soft">–</div>',
            sanitize=False,
        )
        ui.html(
            '<canvas id="sinew-lissajous" class="sinew-canvas" role="img" aria-label="Torsion over lever angle">'
            "</canvas>",
            sanitize=False,
        ).classes("w-full")


def _bench_card() -> None:
    with live_card("Bench", 4):
        rows = (
            ("Tension of the tendons", "tension"),
            ("Tilt of the head plate", "tilt"),
            ("Temperatures", "temperature"),
            ("Supply", "supply"),
            ("Cycles", "cycles"),
            ("Latest begin of a cycle", "late"),
            ("Bus", "bus"),
        )
        _numbers(rows)


_READINGS = (
    ("temperature", "Temperature", "°C"),
    ("tension", "Tension", "N"),
    ("tilt", "Tilt from the pose", "°"),
    ("missed", "Missed cycles a minute", ""),
)


def _alarms_card() -> None:
    """Lay out what alarms are about, with their limits, which a viewer may change; see `static/alarms.js`."""
    rows = "".join(
        f'<tr id="sinew-alarm-{key}"><th scope="row"><label for="sinew-limit-{key}">{label}</label></th>'
        f'<td id="sinew-reading-{key}">–</td>'
        f'<td><input type="number" min="0" step="any" inputmode="decimal" id="sinew-limit-{key}" '
        f'aria-describedby="sinew-limit-said-{key}"> {unit}'
        f'<div id="sinew-limit-said-{key}" class="sinew-limit-said" role="status"></div></td>'
        f'<td id="sinew-most-{key}">–</td><td id="sinew-alarm-state-{key}">quiet</td></tr>'
        for key, label, unit in _READINGS
    )
    with live_card("Alarms", 4):
        ui.html(
            '<div class="sinew-scrolls" tabindex="0" role="region" aria-label="Limits of the alarms">'
            "<table><thead><tr>"
            '<th scope="col">Reading</th><th scope="col">Now</th><th scope="col">Alarm above</th>'
            '<th scope="col">Rig stops at</th><th scope="col">State</th></tr></thead>'
            f"<tbody>{rows}</tbody></table></div>"
            '<div class="sinew-row">'
            '<button type="button" class="sinew-button" id="sinew-sound" aria-pressed="true">Sound is on</button>'
            '<button type="button" class="sinew-button" id="sinew-notify">Notify me</button>'
            '<button type="button" class="sinew-button" id="sinew-limits-back">Limits of the rig</button></div>'
            '<p id="sinew-sound-waits" class="sinew-soft"></p>'
            '<p class="sinew-soft">Limits are kept in this browser; an empty one never alarms.</p>',
            sanitize=False,
        )


def _happened_card() -> None:
    severities = (("all", "All"), ("warning", "Warnings and worse"), ("bad", "Alarms and stops"))
    with card("What happened", 4):
        ui.html(
            f'<div class="sinew-row">{choice("sinew-severity", "Show", severities, "all")}</div>'
            '<p id="sinew-log-empty" class="sinew-soft">Nothing yet.</p>'
            '<ol id="sinew-log" class="sinew-log" tabindex="0" reversed aria-label="Events of the run, newest first">'
            "</ol>",
            sanitize=False,
        )


def _gain_card() -> tuple[Curves, ui.label]:
    """Lay out the gain, which grows with the run; return its curves and what is said of them before they come."""
    with card("Resonance curve: gain, torsion over commanded amplitude", 6) as place:
        gain = Curves("gain")
        coming = ui.label().classes("sinew-soft").props("id=sinew-coming role=status")
    place.classes("sinew-at-curve")
    return gain, coming


def _coming(results: Results) -> str:
    """Return how much is recorded as long as no point of a curve has come of it."""
    live, run = results.hub.live, (results.hub.steward or {}).get("run")
    begins = live is not None and run is not None and run["name"] != live.name
    if live is None or begins or not live.groups_done or results.measured or results.trouble:
        return ""
    recorded = "1 group is" if live.groups_done == 1 else f"{live.groups_done} groups are"
    return f"{recorded} recorded. A point comes for each swing at one frequency, as soon as it is analysed."


def _curves(site: Site, gain: Curves, coming: ui.label) -> None:
    """Lay out the phase, and how measured and predicted compare, and keep all of them up to date."""
    with card("Phase: lag of the torsion behind the lever, 90° at resonance", 6):
        phase = Curves("phase")
    with card("Measured against predicted", 6):
        verdict = ui.label(_NOT_YET).props("id=sinew-verdict role=status").classes("text-bold")
        missed = ui.element("ul").props(
            'id=sinew-misses tabindex=0 aria-live=polite aria-label="Values that miss the prediction"'
        )
        missed.classes("sinew-misses")
        basis, note = (ui.label().classes("sinew-soft").props(f"id=sinew-{name}") for name in ("basis", "remark"))
        damping, wrong = ui.label().props("id=sinew-damping"), ui.label().classes("sinew-bad").props("role=status")
    seen = -1
    lines: dict[str, ui.element] = {}

    def list_misses() -> None:
        """Add what is new and take away what is gone: whoever hears the page hears each once."""
        told = misses(site.results.measured)
        for sentence in [one for one in lines if one not in told]:
            lines.pop(sentence).delete()
        with missed:
            for sentence in [one for one in told if one not in lines]:
                lines[sentence] = ui.element("li")
                with lines[sentence]:
                    ui.label(sentence)

    def look() -> None:
        nonlocal seen
        coming.set_text(_coming(site.results))
        if site.results.version != seen:
            seen = site.results.version
            for curves in (gain, phase):
                curves.show(site.results.predicted, site.results.measured)
            list_misses()
            verdict.set_text(_verdict(site.results))
            basis.set_text(site.results.basis)
            note.set_text(site.results.remark)
            damping.set_text(_in_words(site.results.damping))
            wrong.set_text(" ".join(filter(None, (site.results.trouble, *site.results.notes[-3:]))))

    look()
    ui.timer(_LOOK_S, look)


_NOT_YET = "No prediction yet: it comes as soon as a run begins."


def _verdict(results: Results) -> str:
    """Return how measured and predicted compare, or what is waited for."""
    if results.predicted:
        return tally(results.measured) or "Nothing is measured yet; the lines are the prediction."
    if results.remark:
        return "There is no prediction to hold this run against."
    return "The prediction is being computed." if results.is_predicting else _NOT_YET


def _in_words(damping: list[dict[str, Any]]) -> str:
    """Return what ring-downs say of the damping at each pretension."""
    rows = [f"{row['pretension_mm']:g} mm: {quantity(row['damping_ratio'], '')}" for row in damping]
    return f"Lehr's damping D of the ring-downs: {'; '.join(rows)}" if rows else ""
