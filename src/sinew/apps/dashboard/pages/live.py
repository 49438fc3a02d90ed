"""The live page: joint, oscilloscope, Lissajous figure, curves, bench; and the samples of runs that have ended."""

from typing import Annotated, Any

from fastapi import FastAPI, Query
from fastapi.responses import Response
from nicegui import ui

from sinew.apps.dashboard.access import said
from sinew.apps.dashboard.folders import is_run_name, unlinked
from sinew.apps.dashboard.hub import Results
from sinew.apps.dashboard.pages.curves import Curves
from sinew.apps.dashboard.pages.frame import (
    Site,
    card,
    empty,
    framed,
    heading,
    live_card,
    part,
    quantity,
    script,
)
from sinew.apps.dashboard.work.results import count_misses, misses
from sinew.apps.dashboard.work.samples import MOST_LEVEL, drawn_rig
from sinew.measure.errors import SinewError
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
            nothing = "No run since this server began." if site.bench else "No bench: start sinew serve with --emulate."
            with ui.element("div").props("id=sinew-nothing").classes("sinew-card"):
                ui.label(nothing).props("id=sinew-nothing-yet role=status").classes("text-bold")
                _part("steps").props("id=sinew-steps")
            with ui.element("div").classes("sinew-grid"):
                # As the grid of a desk shows them: what a key goes to next stands next.
                gain = _gain_card()
                scene = _joint_card()
                with live_card("Run", 3) as column:
                    column.classes("sinew-at-run")
                    _part("run").classes("w-full")
                with live_card("Oscilloscope", 6) as column:
                    column.classes("sinew-at-scope")
                    ui.html(part("scope", "scope", True), sanitize=False).classes("w-full")
                _curves(site, gain)
                for title, name, framing in _CARDS:
                    with framing(title, 4):
                        _part(name)
        script("sinew-live", {"scene": scene, "eye": _EYE, "rig": drawn_rig(rig)})
        ui.add_body_html(f'<script type="module" src="/sinew/live.js?{site.version}"></script>')


_CARDS = (("Bench", "bench", live_card), ("Alarms", "alarms", live_card), ("What happened", "happened", card))


def _part(name: str) -> ui.html:
    return ui.html(part("live", name), sanitize=False)


def _joint_card() -> int:
    """Lay the joint out and return the number of its scene."""
    with live_card("Joint", 3) as column:
        column.classes("sinew-at-joint")
        about = "The joint as it moves. Arrow keys turn it, plus and minus bring it nearer and farther, Home back."
        view = ui.element("div").props(f'id=sinew-joint role=application tabindex=0 aria-label="{about}"')
        with view:
            scene = ui.scene(width=320, height=360, grid=False, background_color="#000000", fps=25)
            scene.move_camera(*_EYE, 0.0, 0.0, 0.55, duration=0)
            ui.element("div").props("id=sinew-tensions")
        _part("joint")
    return scene.id


def _gain_card() -> Curves:
    """Lay out the gain, which grows with the run."""
    with card("Resonance curve: gain, torsion over commanded amplitude", 6) as column:
        gain = Curves("gain")
    column.classes("sinew-at-curve")
    return gain


def _curves(site: Site, gain: Curves) -> None:
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
        missed_points = misses(site.results.measured)
        for sentence in [one for one in lines if one not in missed_points]:
            lines.pop(sentence).delete()
        with missed:
            for sentence in [one for one in missed_points if one not in lines]:
                lines[sentence] = ui.element("li")
                with lines[sentence]:
                    ui.label(sentence)

    def look() -> None:
        nonlocal seen
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
        return count_misses(results.measured) or "Nothing is measured yet; the lines are the prediction."
    if results.remark:
        return "There is no prediction to hold this run against."
    return "The prediction is being computed." if results.is_predicting else _NOT_YET


def _in_words(damping: list[dict[str, Any]]) -> str:
    """Return what ring-downs say of the damping at each pretension."""
    rows = [f"{row['pretension_mm']:g} mm: {quantity(row['damping_ratio'], '')}" for row in damping]
    return f"Lehr's damping D of the ring-downs: {'; '.join(rows)}" if rows else ""


# The oscilloscope of runs that have ended, and where its pieces come from.

_LONGEST_S = 1e7

Level = Annotated[int, Query(ge=0, le=MOST_LEVEL)]
Number = Annotated[int, Query(ge=0, le=10**9)]
Seconds = Annotated[float, Query(ge=0, le=_LONGEST_S)]


def add_samples_page(app: FastAPI, site: Site) -> None:
    """Serve the samples of a run at /run/NAME/samples, and pieces of them below /samples/NAME."""

    @ui.page("/run/{name}/samples")
    def samples(name: str) -> None:
        known = is_run_name(name) and (site.runs / name).is_dir()
        with framed(site, "Samples", "/runs"):
            heading(f"Samples of {name}" if known else "No such run")
            ui.link("The run's curves" if known else "All runs", f"/runs/{name}" if known else "/runs")
            if not known:
                empty("No run has that name.")
                return
            with ui.element("div").classes("sinew-grid"), card("Oscilloscope", 12):
                ui.html(part("scope", "scope", False), sanitize=False).classes("w-full")
        script("sinew-samples", {"name": name})
        ui.add_body_html(f'<script type="module" src="/sinew/samples.js?{site.version}"></script>')

    async def answer(name: str, what: str, *arguments: Any) -> Response:
        folder = site.runs / name
        if not is_run_name(name) or not folder.is_dir():
            return said(404, "There is no such run.")
        try:
            found = await site.work.call(what, str(unlinked(folder)), *arguments)
        except SinewError as trouble:
            return said(409, str(trouble))
        return Response(found, media_type="application/json", headers={"Cache-Control": "no-store"})

    @app.get("/samples/{name}/about")
    async def about(name: str) -> Response:
        return await answer(name, "samples_about")

    @app.get("/samples/{name}/piece")
    async def piece(name: str, level: Level, number: Number) -> Response:
        return await answer(name, "samples_piece", level, number)

    @app.get("/samples/{name}/spectrum")
    async def spectrum(name: str, begin: Seconds, end: Seconds) -> Response:
        return await answer(name, "samples_spectrum", begin, end)
