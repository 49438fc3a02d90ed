"""The samples of a run: the oscilloscope's card, its page for runs that have ended, and where its pieces come from."""

import sqlite3
from typing import Annotated, Any

from fastapi import FastAPI, Query
from fastapi.responses import JSONResponse, Response
from nicegui import ui
from starlette.concurrency import run_in_threadpool

from sinew.apps.dashboard.operators import is_run_name, unlinked
from sinew.apps.dashboard.pages.frame import Site, card, choice, empty, framed, heading, script
from sinew.apps.dashboard.work import samples as reader
from sinew.apps.dashboard.work.samples import MOST_LEVEL, SHORT_LEVEL, SHORT_S
from sinew.measure.errors import SinewError

_BASES_S = (0.5, 1, 2, 5, 10, 30, 60)
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
                lay_out_scope(is_live=False)
        script("sinew-samples", {"name": name})
        ui.add_body_html(f'<script type="module" src="/sinew/samples.js?{site.version}"></script>')

    async def answer(name: str, what: str, *arguments: Any, is_short: bool = True) -> Response:
        folder = site.runs / name
        if not is_run_name(name) or not folder.is_dir():
            return JSONResponse({"ok": False, "sentence": "There is no such run."}, 404)
        live = site.hub.live
        # Of the run that is followed anyway, what is short is read here, without waiting for a worker.
        is_near = is_short and live is not None and live.name == name
        try:
            place = str(unlinked(folder))
            if is_near:
                said = await run_in_threadpool(getattr(reader, what), place, *arguments)
            else:
                said = await site.work.call(what, place, *arguments)
        except (SinewError, sqlite3.Error) as trouble:
            return JSONResponse({"ok": False, "sentence": str(trouble)}, 409)
        return Response(said, media_type="application/json", headers={"Cache-Control": "no-store"})

    @app.get("/samples/{name}/about")
    async def about(name: str) -> Response:
        return await answer(name, "samples_about")

    @app.get("/samples/{name}/piece")
    async def piece(name: str, level: Level, number: Number) -> Response:
        return await answer(name, "samples_piece", level, number, is_short=level <= SHORT_LEVEL)

    @app.get("/samples/{name}/spectrum")
    async def spectrum(name: str, begin: Seconds, end: Seconds) -> Response:
        return await answer(name, "samples_spectrum", begin, end, is_short=end - begin <= SHORT_S)


def _button(name: str, text: str, label: str = "", *, is_switch: bool = False) -> str:
    more = f' aria-label="{label}" title="{label}"' if label else ""
    more += ' aria-pressed="false"' if is_switch else ""
    return f'<button type="button" class="sinew-button" id="sinew-{name}"{more}>{text}</button>'


def _select(name: str, label: str, options: str = "") -> str:
    return f'<select id="sinew-{name}" class="sinew-select" aria-label="{label}">{options}</select>'


def lay_out_scope(*, is_live: bool) -> None:
    """Lay out the oscilloscope with what moves it; `oscilloscope.js` has its keys. is_live: whether samples come."""
    bases = choice("sinew-base", "Time base", tuple((f"{s:g}", f"{s:g} s") for s in _BASES_S), "5")
    moves = (
        _button("first", "Begin", "To the begin of the run"),
        _button("back", "◀", "Back by half a screen"),
        _button("forth", "▶", "Forth by half a screen"),
        _button("closer", "+", "Closer: half as long"),
        _button("wider", "−", "Wider: twice as long"),
        _button("whole", "Whole run"),
        _button("live", "Newest") if is_live else "",
    )
    segments = _select("segment", "Go to a segment", '<option value="">Go to …</option>')
    switches = (
        _button("freeze", "Freeze", is_switch=True) if is_live else "",
        _button("trigger", "Trigger", "Trigger: the lever's zero, rising", is_switch=True) if is_live else "",
        _button("cursors", "Cursors", is_switch=True),
        _button("spectrum", "Spectrum", is_switch=True),
    )
    operations = "".join(f'<option value="{x}">{x or "nothing"}</option>' for x in ("", "x-y", "x/y"))
    most = "".join(
        f'<option value="{hz}">{label}</option>' for hz, label in ((20, "20 Hz"), (50, "50 Hz"), (1000, "all"))
    )
    pair = f"{_select('maths-x', 'x')} {_select('maths-y', 'y')}"
    cursors = "".join(
        f'<label for="sinew-cursor-{one.lower()}">{one}</label>'
        f'<input type="range" id="sinew-cursor-{one.lower()}" min="0" max="1" step="0.001" aria-label="Cursor {one}">'
        for one in "AB"
    )
    here = _button("cursors-here", "Bring A and B here")
    ui.html(
        f"""<div class="sinew-row"><span class="sinew-soft" aria-hidden="true">Time base</span>{bases}
{"".join(switches)}</div>
<canvas id="sinew-scope" class="sinew-canvas sinew-scope" role="application" tabindex="0"
aria-describedby="sinew-scope-keys" aria-label="Oscilloscope"></canvas>
<p id="sinew-scope-keys" class="sinew-hidden">Arrow keys move in time, with Shift by a whole screen; plus and minus
zoom; Home goes to the begin of the run, End to its newest sample; the space bar freezes; C brings both cursors into
the picture. What is seen stands in the table of values.</p>
<div class="sinew-row sinew-position"><div class="sinew-row">{"".join(moves)}{"" if is_live else segments}</div>
<input type="range" id="sinew-position" min="0" max="5" value="5" aria-label="Position in the run"></div>
<div id="sinew-where" class="sinew-soft sinew-figures">–</div>
<div id="sinew-cursor-row" hidden><div class="sinew-row">{cursors}{here}</div>
<div id="sinew-apart" class="sinew-figures">–</div></div>
<div id="sinew-legend" class="sinew-legend" role="group" aria-label="Traces"></div>
<div class="sinew-row"><label class="sinew-check"><input type="checkbox" id="sinew-gain"> Gain, torsion over lever
(running amplitudes)</label><span class="sinew-soft" aria-hidden="true">Compute</span>
{_select("operation", "Compute", operations)}<span id="sinew-maths-pair" hidden>{pair}</span></div>
<details id="sinew-values"><summary>Values as a table</summary><div class="sinew-scroll" tabindex="0" role="region"
aria-label="Values of the traces"><table class="sinew-table"><thead></thead><tbody></tbody></table></div></details>
<div id="sinew-spectrum-box" hidden><div class="sinew-row"><strong>Spectrum of what is seen</strong>
<span class="sinew-soft" aria-hidden="true">up to</span>{_select("spectrum-most", "Spectrum up to", most)}</div>
<canvas id="sinew-spectrum-canvas" class="sinew-canvas" role="img" aria-label="Spectrum"></canvas>
<div id="sinew-peaks" class="sinew-soft"></div></div>""",
        sanitize=False,
    ).classes("w-full")
