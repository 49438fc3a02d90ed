"""The page of past runs: searched; opened, laid over one another, compared and downloaded."""

import json
import math
import re
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any
from urllib.parse import urlencode

from nicegui import events, ui
from starlette.requests import Request

from sinew.analysis.runs import COMMON, QUANTITIES
from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.folders import is_run_name
from sinew.apps.dashboard.hub import basis_of, numbered
from sinew.apps.dashboard.pages.curves import Curve, Curves, begun, options_of
from sinew.apps.dashboard.pages.frame import (
    Site,
    card,
    clock_time,
    columns_of,
    empty,
    framed,
    heading,
    quantity,
    tabulate,
)
from sinew.apps.dashboard.work.results import count_misses, judged, misses
from sinew.apps.dashboard.worker import Worker
from sinew.measure.errors import SinewError
from sinew.measure.estimate import span, typeset
from sinew.measure.recording import SOURCES
from sinew.plan.toml import parse_rig

_COLUMNS = {
    "name": "run",
    "started": "started",
    "plan": "plan",
    "rig": "rig",
    "state": "state",
    **{
        one: QUANTITIES[one].called[0] + (f" / {QUANTITIES[one].unit}" if QUANTITIES[one].unit else "")
        for one in COMMON
    },
    "reason": "why it ended",
}
_DOWNLOADS = (("recording", "Recording (NetCDF)"), ("csv", "CSV"), ("mat", "MAT"), ("report", "Report"))
_MOST_OVERLAID, _MOST_ROWS, _MOST_POINTS = 24, 500, 400
_MS_OF_A_DAY = 86_400_000
_HINT = "Tick one run to open it, or several to compare them; a click on a row opens it too."
_NO_RING_DOWNS = "no ring-downs"
_NEEDS_RING_DOWNS = (
    "Lehr's damping D needs ring-downs, which its plan lacks: measure with a [ring_down], as the plan first has one"
)


def add_runs_pages(site: Site) -> None:
    """Serve the list of runs at /runs, and some of them laid over one another at /runs?open=a&open=b or /runs/a,b."""

    @ui.page("/runs")
    async def runs(request: Request) -> None:
        await shown(request.query_params.getlist("open"), request.query_params.get("search", ""))

    @ui.page("/runs/{names}")
    async def opened(names: str) -> None:
        await shown(names.split(","), "")

    async def shown(names: list[str], search: str) -> None:
        with framed(site, "Runs", "/runs"):
            chosen = [name for name in dict.fromkeys(names) if is_run_name(name)][:_MOST_OVERLAID]
            heading(", ".join(chosen) if chosen else "No such run" if names else "Runs")
            ui.add_body_html(f'<script type="module" src="/sinew/runs.js?{site.version}"></script>')
            if names:
                ui.link("All runs", "/runs")
            listed = _List(site, chosen, search)
            await _open(site, chosen) if names else await ui.context.client.connected()
            if chosen or not names:
                await listed.show()


def _address(names: list[str], search: str = "") -> str:
    """Return the address of the page that shows these runs, which others can open."""
    address_query = [*(("open", name) for name in names), *([("search", search)] if search else [])]
    return f"/runs?{urlencode(address_query)}" if address_query else "/runs"


class _List:
    """The list of runs in a page, with its search and its trend. opened: runs whose boxes are ticked."""

    def __init__(self, site: Site, opened: list[str], search: str) -> None:
        self._site, self._opened, self._search = site, opened, search
        self._is_shown = False

    async def show(self) -> None:
        """Draw it, and fill it with what the search finds."""
        with ui.element("section").classes("sinew-card"):
            if self._opened:
                ui.label("Open others").props("role=heading aria-level=2").classes("text-bold")
            self._field = ui.input("Search: words and ranges, as aged f_r=3.2.. pretension=6", value=self._search)
            self._field.props("outlined dense clearable type=search debounce=300 for=sinew-search maxlength=500")
            self._field.classes("w-full")
            self._said = (
                ui.label("The runs are being listed …").props("role=status id=sinew-found").classes("sinew-soft")
            )
            self._table = self._made_table()
            with ui.element("div").classes("sinew-row"):
                button = ui.button("Open, or compare several", on_click=self._open_chosen)
                button.props("id=sinew-open no-caps unelevated color=primary")
            self._hint = ui.label(_HINT)
            self._hint.props("role=status").classes("sinew-soft")
            ui.label("Keys: arrows go from row to row, space chooses, Enter opens, / goes to the search.").classes(
                "sinew-soft"
            )
        with ui.element("div").classes("sinew-grid"), card("Over months", 12):
            names = {one: f"{QUANTITIES[one].words}, {QUANTITIES[one].called[0]}" for one in COMMON}
            names["gain_peak"] = QUANTITIES["gain_peak"].words
            self._quantity = ui.radio({one: begun(name) for one, name in names.items()}, value=COMMON[0])
            self._quantity.props("inline")
            self._quantity.on_value_change(self._draw_trend)
            self._trend = ui.element("div").classes("w-full").props("data-trend")
        self._field.on_value_change(self._searched)
        self._is_shown = True
        await self.refresh()

    def _made_table(self) -> ui.table:
        table = ui.table(
            rows=[],
            columns=columns_of(_COLUMNS, right=COMMON),
            row_key="name",
            selection="multiple",
            pagination={"rowsPerPage": 20, "sortBy": "started", "descending": True},
        )
        table.props("flat dense wrap-cells id=sinew-runs").classes("w-full")
        table.props(':grid="window.innerWidth < 620"')  # of a phone, whose width cuts a table off
        table.add_slot("header-selection", '<q-checkbox v-model="props.selected" dense aria-label="choose all" />')
        table.add_slot(
            "body-selection", '<q-checkbox v-model="props.selected" dense :aria-label="`choose ${props.row.name}`" />'
        )
        table.add_slot(
            "body-cell-resonance_hz", '<q-td :props="props" :title="props.row.untold">{{ props.value }}</q-td>'
        )
        table.props("hide-no-data")  # until there is an answer
        table.add_slot("no-data", '<span class="sinew-empty">No run is found.</span>')
        table.on("rowClick", self._open_row)
        table.on_select(lambda: self._hint.set_text(_HINT))
        return table

    async def _searched(self) -> None:
        self._search = self._field.value or ""
        self._said.set_text("The runs are being searched; what is listed was found before.")
        ui.run_javascript(f"history.replaceState(null, '', {json.dumps(_address(self._opened, self._search))})")
        await self.refresh()

    async def refresh(self) -> None:
        """Fill table and trend anew, once they are drawn."""
        if not self._is_shown:
            return
        work, runs = self._site.work, str(self._site.runs)
        try:
            async for found in looks(work, runs, self._search, key=f"runs {id(self)}"):
                if found is None or self._table.is_deleted:  # another search came after this one, or the page was left
                    return
                self._said.classes("sinew-soft", remove="sinew-bad")
                self._said.set_text(_counted(found, bool(self._search)))
                self._table.update_rows([_row(run) for run in found["runs"]], clear_selection=False)
                opened = [row for row in self._table.rows if row["name"] in self._opened]
                others = (row for row in self._table.selected if row["name"] not in self._opened)
                self._table.selected = [*opened, *others]
        except SinewError as trouble:
            self._said.set_text(str(trouble))
            self._said.classes("sinew-bad", remove="sinew-soft")
            return
        self._table.props(remove="hide-no-data")
        await self._draw_trend()

    async def _draw_trend(self) -> None:
        try:
            found = await self._site.work.call("run_trends", str(self._site.runs), self._search, self._quantity.value)
        except SinewError as trouble:
            found, said = [], str(trouble)
        else:
            said = (
                f"No run of the list determines the {QUANTITIES[self._quantity.value].words}; opening one analyses it."
            )
        if self._trend.is_deleted:
            return
        self._trend.clear()
        with self._trend:
            if not found:
                empty(said)
                return
            ui.echart(trend_options(found, self._quantity.value), renderer="svg").props(
                'role=img aria-label="Values of the runs over their dates; the sentences below sum it up"'
            )
            for one in found[:_MOST_OVERLAID]:
                ui.label(typeset(f"{one['title']}: {one['sentence']}"))

    def _chosen(self) -> list[str]:
        names = dict.fromkeys(row["name"] for row in self._table.selected if is_run_name(row["name"]))
        return list(names)[:_MOST_OVERLAID]

    def _open_chosen(self) -> None:
        if names := self._chosen():
            ui.navigate.to(_address(names))
        else:
            self._hint.set_text("No run is ticked: tick one to open it, or several to compare them.")

    def _open_row(self, event: events.GenericEventArguments) -> None:
        name = event.args[1]["name"]
        if is_run_name(name):
            ui.navigate.to(_address([name]))


async def looks(work: Worker, runs: str, query: str, key: str) -> AsyncIterator[dict[str, Any] | None]:
    """Yield what `look_at_runs` says, again and again until every folder is read; None where another look came after.

    Between two looks others that ask the worker have their turn.
    """
    left = math.inf
    while True:
        found = await work.call("look_at_runs", runs, query, _MOST_ROWS, key=key)
        yield found
        if found is None or not 0 < found["left"] < left:
            return
        left = found["left"]


def _counted(found: dict[str, Any], is_search: bool) -> str:
    """Return how many runs are listed."""
    count, listed = found["count"], len(found["runs"])
    if not count and not is_search and not found["left"]:
        return "There is no run yet. Start one on the page Plan, or put the folder of one where sinew serve looks."
    said = f"{count} {'run' if count == 1 else 'runs'}{' found' if is_search else ''}"
    said += f", the newest {listed} are listed" if listed < count else ""
    return f"{said}; {found['left']} folders are not read yet" if found["left"] else said


def _row(run: dict[str, Any]) -> dict[str, Any]:
    done = "" if run.get("groups") is None else f" ({run['groups_done']:.0f} of {run['groups']:.0f})"
    row = {key: run.get(key) or "–" for key in ("name", "plan", "rig")}
    row |= {"started": clock_time(run.get("started") or "–"), "state": f"{run['state']}{done}"}
    row |= {one: typeset(_shown([found[one] for found in run["found"] if one in found])) for one in COMMON}
    if not any(_has_value(found, "resonance_hz") for found in run["found"]):
        row["untold"] = run.get("untold") or run.get("remark") or ""
        row["resonance_hz"] = re.split("[:;]", row["untold"])[0] or "–"
    if run.get("has_ring_downs") is False and not any("damping_ratio" in found for found in run["found"]):
        row["damping_ratio"] = _NO_RING_DOWNS
    reason = run.get("sentence") or "" if run["state"] in ("stopped", "damaged") else run.get("remark") or ""
    return row | {"reason": reason[:200]}


def _has_value(row: dict[str, Any], quantity: str) -> bool:
    return quantity in row and row[quantity]["value"] is not None


def _shown(found: list[dict[str, Any]]) -> str:
    """Return what was found at one pretension with its interval, or from least to greatest at several."""
    if len(found) < 2:
        return quantity(found[0], "") if found else "–"
    values = [one["value"] for one in found]
    return span(min(values), max(values))


def trend_options(found: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Return ECharts' options of values over dates, with lines and their 90 % bands."""
    curves = []
    for index, one in enumerate(found[:_MOST_OVERLAID]):
        every = -(-len(one["days"]) // _MOST_POINTS)
        at = [_MS_OF_A_DAY * day for day in one["days"][::every]]
        curves.append(Curve.of_estimates(one["title"], at, one["values"][::every], index))
        if one["line"] is not None:
            line = one["line"]
            days = [_MS_OF_A_DAY * day for day in line["days"]]
            curves.append(
                Curve(f"{one['title']}, line", days, line["value"], line["low"], line["high"], True, number=index)
            )
    options = options_of("gain", curves, "")
    dates = {"year": "{yyyy}", "month": "{MMM} {yyyy}", "day": "{d} {MMM}"}
    options["xAxis"] = {**options["xAxis"], "type": "time", "axisLabel": {"color": "var(--soft)", "formatter": dates}}
    at = [_MS_OF_A_DAY * day for one in found[:_MOST_OVERLAID] for day in one["days"]]
    if max(at) - min(at) < _MS_OF_A_DAY:  # so that its axis tells days, not milliseconds
        begin, end = min(at) - _MS_OF_A_DAY, max(at) + _MS_OF_A_DAY
        options["xAxis"] |= {":min": f"() => {begin}", ":max": f"() => {end}", "minInterval": _MS_OF_A_DAY}
    options["yAxis"]["name"] = QUANTITIES[name].head()
    return options


async def _open(site: Site, names: list[str]) -> None:
    """Draw what some runs found."""
    if not names:
        empty("No run has that name.")
        return
    beneath = ui.element("div").classes("w-full")
    with beneath:
        said = "The run is being analysed" if len(names) == 1 else "The runs are being analysed"
        ui.spinner(size="2rem").props(f'aria-label="{said}"')
        ui.label(f"{said} …; the first time takes some seconds.").classes("sinew-soft")
    await ui.context.client.connected()
    found: list[tuple[str, dict[str, Any]]] = []
    about: dict[str, dict[str, Any]] = {}
    for name in names:
        try:
            found.append((name, await site.work.call("run_results", str(site.runs / name))))
        except SinewError as trouble:
            found.append((name, {"trouble": str(trouble)}))
        with suppress(SinewError):
            about[name] = await site.work.call("read_run", str(site.runs / name))
    compared: dict[str, Any] = {"rows": [], "sentences": []}
    if len(names) > 1:
        compared = await site.work.call("run_differences", str(site.runs), names[0], names[1:])
    beneath.clear()
    with beneath, ui.element("div").classes("sinew-grid"):
        _headlines(found, about)
        _doubts(found)
        charts = _curves(found)
        verdict = ui.element("div").classes("span-12")
        _compared(names[0], compared)
        _numbers(found, [name for name in about if about[name]["has_ring_downs"] is False])
        for name, results in found:
            _coupling(name, results.get("coupling", ""))
        for run in about.values():
            with card(f"About {run['name']}", 6):
                said = f"{run['sentence'].rstrip('.')}. Begun {clock_time(run['started'])}."
                ui.label(said).props("data-reason")
        for name in names:
            _downloads(name, has_samples=(site.runs / name / JOURNAL).is_file())
    if len(found) == 1 and found[0][1].get("curves") and (site.runs / found[0][0] / JOURNAL).is_file():
        await _draw_expected(site, *found[0], charts, verdict)


async def _draw_expected(
    site: Site, name: str, results: dict[str, Any], charts: dict[str, Curves], element: ui.element
) -> None:
    """Draw what was to be expected of a run behind what it measured, and say what misses it."""
    with element, card("Measured against predicted", 12):
        ui.label("The prediction is being computed …").props("role=status").classes("sinew-soft")
    try:
        found = await site.work.call("prediction_of_run", str(site.runs / name))
    except SinewError:
        found = {"curves": []}  # a recording from elsewhere: nobody knows its rig and plan
    if element.is_deleted:
        return
    element.clear()
    if not found["curves"]:
        return
    predicted = numbered(found["curves"], found["plan"])
    measured = judged(predicted, numbered(results["curves"], found["plan"]))
    for chart in charts.values():
        chart.show(predicted, measured)
    with element, card("Measured against predicted", 12):
        ui.label(count_misses(measured)).classes("text-bold").props("data-verdict")
        for sentence in misses(measured):
            ui.label(sentence)
        ui.label(basis_of(parse_rig(found["rig"]))).classes("sinew-soft")


def _headlines(found: list[tuple[str, dict[str, Any]]], about: dict[str, dict[str, Any]]) -> None:
    """Say of each run what it is and the numbers that one came for; the other resonances are in the table below."""
    with card("Resonance and damping", 12) as panel:
        panel.props("data-headline")
        for name, results in found:
            rows, parts = results.get("parameters", []), []
            for one in ("resonance_hz", "damping_ratio"):
                if numbers := [row["estimate"] for row in rows if row["quantity"] == one]:
                    unit = f" {QUANTITIES[one].unit}".rstrip()
                    parts.append(f"{QUANTITIES[one].called[0]} {typeset(_shown(numbers))}{unit}")
            levels = " to ".join(f"{mm:g}" for mm in _ends([row["pretension_mm"] for row in rows]))
            said = f"{', '.join(parts)} at {levels} mm of pretension" if parts else _NOTHING
            ui.label(f"{name}: {said}" if len(found) > 1 else said).classes("text-h6")
            if source := SOURCES.get(results.get("source") or ""):
                rig = f", rig {about[name]['rig']}" if name in about and about[name]["rig"] else ""
                ui.label(f"{begun(source)}{rig}.").classes("sinew-soft")
        ui.label(_HOW_SHOWN).classes("sinew-soft")


def _ends(levels: list[float]) -> list[float]:
    """Return the least and the greatest, once where they are one; empty where there is none."""
    return list(dict.fromkeys((min(levels), max(levels)))) if levels else []


_NOTHING = "No resonance and no damping could be told."
_HOW_SHOWN = (
    "f_r: frequency at which torsion over commanded amplitude is largest; D: Lehr's damping, of the ring-downs; with "
    "90 % intervals, or from the least to the greatest over the pretensions. What else is called a resonance (by 90° "
    "of lag, by the paper's mean of peaks, of the decay) is in What was found."
)


_SURE = {True: "yes", False: "no", None: "not known"}


def _compared(first: str, compared: dict[str, Any]) -> None:
    """Show in what runs differ from the first one that is open, and whether that is more than their uncertainty."""
    if not compared["rows"]:
        if compared["sentences"]:
            with card(f"Against {first}", 12):
                for sentence in compared["sentences"]:
                    ui.label(sentence)
        return
    labels = {"run": "run", "mm": "pretension / mm", "name": "quantity", "first": first, "other": "the other"}
    labels |= {"difference": "difference, 90 % interval", "sure": "significant"}
    with card(f"Against {first}", 12):
        for sentence in compared["sentences"]:
            ui.label(sentence)
        rows = []
        for row in compared["rows"]:
            about = QUANTITIES[row["quantity"]]
            estimates = (quantity(row[name], about.unit) for name in ("first", "other", "difference"))
            rows.append(
                (row["run"], f"{row['pretension_mm']:g}", about.words, *estimates, _SURE[row["is_significant"]])
            )
        tabulate(labels, rows, right=("mm", "difference")).props("data-compared")


def _doubts(found: list[tuple[str, dict[str, Any]]]) -> None:
    """Say what speaks against the runs, above everything that they found."""
    for name, results in found:
        if results.get("doubts"):
            with card(f"{name} contradicts itself or its rig", 12), ui.element("div").props("role=alert data-doubts"):
                for sentence in results["doubts"]:
                    ui.label(sentence).classes("sinew-bad")


def _curves(found: list[tuple[str, dict[str, Any]]]) -> dict[str, Curves]:
    """Draw what runs measured, and return the charts of gain and phase where there are such."""
    several = len(found) > 1
    lines: dict[str, list[Curve]] = {"gain": [], "phase": []}
    damping: list[Curve] = []
    for name, results in found:
        if "trouble" in results:
            with card(name, 12):
                ui.label(results["trouble"]).classes("sinew-bad")
            continue
        before = f"{name}, " if several else ""
        for curve in results["curves"]:
            for what, made in lines.items():
                named = f"{before}{curve['pretension_mm']:g} mm"
                made.append(Curve.of_estimates(named, curve["frequency_hz"], curve[what], len(made)))
        rows = results["damping"]
        if rows:
            values = [row["damping_ratio"] for row in rows]
            named, at = before.rstrip(", ") or "ring-downs", [row["pretension_mm"] for row in rows]
            damping.append(Curve.of_estimates(named, at, values, len(damping)))
    charts = {}
    for what, title in (("gain", "Resonance curve: gain"), ("phase", "Phase: lag of the torsion")):
        with card(title, 6):
            if lines[what]:
                charts[what] = Curves(what)
                charts[what].draw(lines[what])
            else:
                empty("No frequency was recorded whole.")
    if damping:
        with card("Damping", 6):
            Curves("damping", "pretension / mm").draw(damping)
    return charts


def _numbers(found: list[tuple[str, dict[str, Any]]], undamped: list[str]) -> None:
    """Show what runs found, and what is said of that. undamped: runs whose plans have no ring-downs."""
    rows = [{"run": name, **row} for name, results in found for row in results.get("parameters", [])]
    notes = [
        f"{name}: {note}" if len(found) > 1 else begun(note)
        for name, results in found
        for text in [*results.get("notes", []), *([_NEEDS_RING_DOWNS] if name in undamped else [])]
        for note in text.splitlines()
    ]
    if not rows and not notes:
        return
    with card("What was found", 12):
        for note in dict.fromkeys(notes):
            ui.label(note).classes("sinew-soft").props("data-note")
        labels = {"run": "run", "mm": "pretension / mm", "name": "quantity", "value": "value, 90 % interval"}
        cells = [
            (
                *([row["run"]] if len(found) > 1 else []),
                f"{row['pretension_mm']:g}",
                row["name"],
                quantity(row["estimate"], row["unit"]),
            )
            for row in rows
        ]
        if len(found) == 1:
            del labels["run"]
        tabulate(labels, cells, right=("mm", "value"))


def _coupling(name: str, html: str) -> None:
    """Show what a bent head did besides twisting, at each frequency; nothing of an upright one."""
    if html:
        with card(f"{name}: coupling", 12):
            ui.html(html, sanitize=False).props("data-coupling")


def _downloads(name: str, *, has_samples: bool) -> None:
    with card(f"Files of {name}", 6), ui.element("div").classes("sinew-row"):
        if has_samples:
            ui.link("Samples over time", f"/run/{name}/samples").classes("sinew-button")
        for kind, label in _DOWNLOADS:
            ui.link(label, f"/download/{name}/{kind}").props(f"download data-kind={kind}").classes("sinew-button")
