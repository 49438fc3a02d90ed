"""The page of past runs: searched, noted, named, put away; opened, laid over one another, compared and downloaded."""

import json
import math
import re
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any
from urllib.parse import urlencode

from nicegui import events, ui
from starlette.requests import Request

from sinew.analysis.run_index import COMMON, QUANTITIES
from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.hub import basis_of, numbered
from sinew.apps.dashboard.judgement import judged, misses, tally
from sinew.apps.dashboard.operators import is_run_name
from sinew.apps.dashboard.pages.curves import Curve, Curves, begun, options_of
from sinew.apps.dashboard.pages.frame import Site, card, clock_time, empty, framed, heading, quantity
from sinew.apps.dashboard.pages.plan import plain_button, why_not
from sinew.apps.dashboard.worker import Work
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
    "tags": "tags",
    "reason": "notes, and why it ended",
}
_RIGHT = ("mm", "hz", "value", "difference", *COMMON)
_DOWNLOADS = (("recording", "Recording (NetCDF)"), ("csv", "CSV"), ("mat", "MAT"), ("report", "Report"))
_MOST_OVERLAID, _MOST_ROWS, _MOST_POINTS = 24, 500, 400
_MS_OF_A_DAY = 86_400_000
_COMMAND_S = 30.0
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
            await _open(site, chosen, listed.refresh) if names else await ui.context.client.connected()
            if chosen or not names:
                await listed.show()


def _address(names: list[str], search: str = "") -> str:
    """Return the address of the page that shows these runs, which others can open."""
    asked = [*(("open", name) for name in names), *([("search", search)] if search else [])]
    return f"/runs?{urlencode(asked)}" if asked else "/runs"


async def _command(name: str, /, **more: object) -> bool:
    """Have this browser give a command at the steering port, with its own ticket; return whether it was carried out."""
    told = f"return (await Sinew.command({json.dumps(name)}, {json.dumps(more)})).ok"
    return bool(await ui.run_javascript(told, timeout=_COMMAND_S))


def _columns(labels: dict[str, str]) -> list[dict[str, Any]]:
    """Return columns as a table takes them."""
    sides = {key: "right" if key in _RIGHT else "left" for key in labels}
    return [
        {"name": key, "label": label, "field": key, "align": sides[key], "sortable": True}
        for key, label in labels.items()
    ]


class _List:
    """The list of runs in a page, with its search, its trend and the bin. opened: runs whose boxes are ticked."""

    def __init__(self, site: Site, opened: list[str], search: str) -> None:
        self._site, self._opened, self._search = site, opened, search
        self._is_shown = False
        self._unopened = 0  # of the listed runs: that were not analysed yet
        self._count = 0
        self._offered: str | None = COMMON[0]  # the trend that is shown until somebody chooses one

    async def show(self) -> None:
        """Draw it, and fill it with what the search finds."""
        with ui.element("section").classes("sinew-card"):
            if self._opened:
                ui.label("Open others").props("role=heading aria-level=2").classes("text-bold")
            self._field = ui.input("Search: words, f_r>3.2 pretension=6 tag:aged begin>=2026-03", value=self._search)
            self._field.props("outlined dense clearable type=search debounce=300 for=sinew-search maxlength=500")
            self._field.classes("w-full")
            self._said = (
                ui.label("The runs are being listed …").props("role=status id=sinew-found").classes("sinew-soft")
            )
            self._table = self._made_table()
            with ui.element("div").classes("sinew-row"):
                button = ui.button("Open, or compare several", on_click=self._open_chosen)
                button.props("id=sinew-open no-caps unelevated color=primary")
                plain_button("Put into the bin", "sinew-bin", self._bin_chosen, needs_operator=True)
                why_not()
            self._hint = ui.label(_HINT)
            self._hint.props("role=status").classes("sinew-soft")
            ui.label("Keys: arrows go from row to row, space chooses, Enter opens, / goes to the search.").classes(
                "sinew-soft"
            )
        with ui.element("div").classes("sinew-grid"):
            with card("Over months", 12):
                names = {one: f"{QUANTITIES[one].words}, {QUANTITIES[one].called[0]}" for one in COMMON}
                names["gain_peak"] = QUANTITIES["gain_peak"].words
                self._quantity = ui.radio({one: begun(name) for one, name in names.items()}, value=self._offered)
                self._quantity.props("inline")
                self._quantity.on_value_change(self._choose_trend)
                self._trend = ui.element("div").classes("w-full").props("data-trend")
            self._bin = ui.element("div").classes("span-12")
        self._field.on_value_change(self._searched)
        self._is_shown = True
        await self.refresh()

    def _made_table(self) -> ui.table:
        table = ui.table(
            rows=[],
            columns=_columns(_COLUMNS),
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
        """Fill table, trend and bin anew, once they are drawn."""
        if not self._is_shown:
            return
        work, runs = self._site.work, str(self._site.runs)
        told: set[str] = set()
        try:
            async for found in looks(work, runs, self._search, key=f"runs {id(self)}"):
                if found is None or self._table.is_deleted:  # another search came after this one, or the page was left
                    return
                self._said.classes("sinew-soft", remove="sinew-bad")
                self._said.set_text(_counted(found, bool(self._search)))
                self._table.update_rows([_row(run) for run in found["runs"]], clear_selection=False)
                rows = (row for run in found["runs"] for row in run["found"])
                told |= {name for row in rows for name in COMMON if _is_told(row, name)}
                self._count = len(found["runs"])
                self._unopened = sum(not run["analysed"] for run in found["runs"])
                opened = [row for row in self._table.rows if row["name"] in self._opened]
                others = (row for row in self._table.selected if row["name"] not in self._opened)
                self._table.selected = [*opened, *others]
        except SinewError as trouble:
            self._said.set_text(str(trouble))
            self._said.classes("sinew-bad", remove="sinew-soft")
            return
        self._table.props(remove="hide-no-data")
        if self._offered is not None:
            self._offered = next((name for name in COMMON if name in told), COMMON[0])
            self._quantity.set_value(self._offered)
        await self._draw_trend()
        names = await work.call("list_bin", runs)
        self._bin.clear()
        if names:
            with self._bin, card("Bin", 12):
                ui.label("Runs that were put away, in .bin below the folder of the runs.").classes("sinew-soft")
                for name in names:
                    with ui.element("div").classes("sinew-row"):
                        ui.label(name)
                        button = plain_button("Restore", "", lambda name=name: self._restore(name), needs_operator=True)
                        button.props(f'data-restore aria-label="Restore {_attribute(name)}"')

    async def _choose_trend(self, event: events.ValueChangeEventArguments[str]) -> None:
        if event.value != self._offered:
            self._offered = None
            await self._draw_trend()

    async def _draw_trend(self) -> None:
        try:
            found = await self._site.work.call("run_trends", str(self._site.runs), self._search, self._quantity.value)
        except SinewError as trouble:
            found, said = [], str(trouble)
        else:
            asked = "any of these" if self._offered else _the(self._quantity.value)
            said = f"No run of the list tells {asked}{_why_untold(self._count, self._unopened)}."
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

    async def _bin_chosen(self) -> None:
        """Put runs into the bin that are ticked and listed, once somebody has read their names and said yes."""
        listed = {row["name"] for row in self._table.rows}
        ticked = [row["name"] for row in self._table.selected if row["name"] in listed]
        names = [name for name in ticked if is_run_name(name)][:_MOST_OVERLAID]
        if not names:
            self._hint.set_text("No run is ticked: tick those to put into the bin.")
            return
        with ui.dialog().props('aria-label="Put runs into the bin"') as sure, ui.card():
            few = f"the first {len(names)} of {len(ticked)} that are chosen, " if len(names) < len(ticked) else ""
            ui.label(f"Put {few}{', '.join(names)} into the bin? It can be taken out again.").props("data-asked")
            with ui.element("div").classes("sinew-row"):
                plain_button("Put into the bin", "sinew-bin-sure", lambda: sure.submit(True))
                plain_button("Leave it", "sinew-bin-not", lambda: sure.submit(False))
        is_sure = await sure
        sure.delete()
        if not is_sure:
            return
        put = []
        for name in names:
            if not await _command("bin", name=name):
                break
            put.append(name)
        self._table.selected = [row for row in self._table.selected if row["name"] not in names]
        if put:
            lies = "lies" if len(put) == 1 else "lie"
            self._hint.set_text(f"{', '.join(put)} {lies} in the bin; Restore, below, takes a run out again.")
        await self.refresh()

    async def _restore(self, name: str) -> None:
        await _command("restore", name=name)
        await self.refresh()


def _attribute(text: str) -> str:
    """Return text as an attribute of a page takes it between quotes."""
    return "".join(letter if letter.isalnum() or letter in "._-" else " " for letter in text)


async def looks(work: Work, runs: str, query: str, key: str) -> AsyncIterator[dict[str, Any] | None]:
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
    if not any(_is_told(found, "resonance_hz") for found in run["found"]):
        row["untold"] = run.get("untold") or run.get("remark") or ""
        row["resonance_hz"] = re.split("[:;]", row["untold"])[0] or "–"
    if run.get("has_ring_downs") is False and not any("damping_ratio" in found for found in run["found"]):
        row["damping_ratio"] = _NO_RING_DOWNS
    reason = run.get("sentence") or "" if run["state"] in ("stopped", "damaged") else run.get("remark") or ""
    said = " · ".join(part for part in (run.get("notes") or "", reason) if part)
    return row | {"tags": " ".join(run.get("tags") or []), "reason": said[:200]}


def _why_untold(count: int, unopened: int) -> str:
    """Return why none of so many runs tells a quantity, of which some were not analysed yet."""
    if not count:
        return ""
    if not unopened:
        return ": what they measured does not determine it; a run's page says why"
    if unopened == count:
        return ": none is analysed yet, which opening one does"
    return f": {unopened} of {count} are not analysed yet, which opening one does, and the others do not determine it"


def _is_told(row: dict[str, Any], quantity: str) -> bool:
    return quantity in row and row[quantity]["value"] is not None


def _the(quantity: str) -> str:
    return f"the {QUANTITIES[quantity].words}"


def _shown(found: list[dict[str, Any]]) -> str:
    """Return what was found at one pretension with its interval, or from least to greatest at several."""
    if len(found) < 2:
        return quantity(found[0], "") if found else "–"
    values = [one["value"] for one in found]
    return span(min(values), max(values))


def trend_options(found: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Return ECharts' options of values over dates, with lines and their 90 % bands."""
    curves = []
    for place, one in enumerate(found[:_MOST_OVERLAID]):
        every = -(-len(one["days"]) // _MOST_POINTS)
        at = [_MS_OF_A_DAY * day for day in one["days"][::every]]
        curves.append(Curve.of_estimates(one["title"], at, one["values"][::every], place))
        if one["line"] is not None:
            line = one["line"]
            days = [_MS_OF_A_DAY * day for day in line["days"]]
            curves.append(
                Curve(f"{one['title']}, line", days, line["value"], line["low"], line["high"], True, number=place)
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


async def _open(site: Site, names: list[str], changed: Callable[[], Awaitable[None]]) -> None:
    """Draw what some runs found. changed: is called when notes of one have changed."""
    if not names:
        empty("No run has that name.")
        return
    gone = [name for name in names if not (site.runs / name).is_dir()]
    for name in gone:
        ui.label(f"There is no run {name}: renamed, or put into the bin? It may be among all runs.").props("role=alert")
    if not (names := [name for name in names if name not in gone]):
        await ui.context.client.connected()
        return
    place = ui.element("div").classes("w-full")
    with place:
        said = "The run is being analysed" if len(names) == 1 else "The runs are being analysed"
        ui.spinner(size="2rem").props(f'aria-label="{said}"')
        ui.label(f"{said} …; the first time takes some seconds.").classes("sinew-soft")
    await ui.context.client.connected()
    found: list[tuple[str, dict[str, Any]]] = []
    for name in names:
        try:
            folder = str(site.runs / name)
            kept = await site.work.call("kept_results", folder)
            found.append((name, kept or await site.work.call("run_results", folder)))
        except SinewError as trouble:
            found.append((name, {"trouble": str(trouble)}))
    about = {}
    for name in names:
        try:
            about[name] = await site.work.call("run_summary", str(site.runs / name))
        except SinewError:
            continue
    compared: dict[str, Any] = {"rows": [], "sentences": []}
    if len(names) > 1:
        compared = await site.work.call("run_differences", str(site.runs), names[0], names[1:])
    place.clear()
    with place, ui.element("div").classes("sinew-grid"):
        _headlines(found, about)
        _doubts(found)
        charts = _curves(found)
        verdict = ui.element("div").classes("span-12")
        _compared(names[0], compared)
        _numbers(found, [name for name in about if about[name]["has_ring_downs"] is False])
        for name, results in found:
            _coupling(name, results.get("document") or {})
        for name, _ in found:
            if name in about:
                _about(about[name], changed)
        for name, _ in found:
            _downloads(name)
    if len(found) == 1 and found[0][1].get("curves") and (site.runs / found[0][0] / JOURNAL).is_file():
        await _foretell(site, *found[0], charts, verdict)


async def _foretell(
    site: Site, name: str, results: dict[str, Any], charts: dict[str, Curves], place: ui.element
) -> None:
    """Draw what was to be expected of a run behind what it measured, and say what misses it."""
    with place, card("Measured against predicted", 12):
        ui.label("The prediction is being computed …").props("role=status").classes("sinew-soft")
    try:
        found = await site.work.call("prediction_of_run", str(site.runs / name))
    except SinewError:
        found = {"curves": []}  # a recording from elsewhere: nobody knows its rig and plan
    if place.is_deleted:
        return
    place.clear()
    if not found["curves"]:
        return
    predicted = numbered(found["curves"], found["plan"])
    measured = judged(predicted, numbered(results["curves"], found["plan"]))
    for chart in charts.values():
        chart.show(predicted, measured)
    with place, card("Measured against predicted", 12):
        ui.label(tally(measured)).classes("text-bold").props("data-verdict")
        for sentence in misses(measured):
            ui.label(sentence)
        ui.label(basis_of(parse_rig(found["rig"]))).classes("sinew-soft")


def _headlines(found: list[tuple[str, dict[str, Any]]], about: dict[str, dict[str, Any]]) -> None:
    """Say of each run what it is and the numbers that one came for; the other resonances are in the table below."""
    with card("Resonance and damping", 12) as place:
        place.props("data-headline")
        explained: set[str] = set()
        for name, results in found:
            rows = results.get("parameters", [])
            told = []
            for one in _HEADLINES:
                unit = f" {QUANTITIES[one].unit}".rstrip()
                if numbers := [row["estimate"] for row in rows if row["quantity"] == one]:
                    explained.add(one)
                    told.append(f"{QUANTITIES[one].called[0]} {typeset(_shown(numbers))}{unit}")
            levels = sorted({row["pretension_mm"] for row in rows})
            where = " to ".join(f"{mm:g}" for mm in dict.fromkeys((levels[0], levels[-1]))) if levels else ""
            said = f"{', '.join(told)} at {where} mm of pretension" if told else _NOTHING
            ui.label(f"{name}: {said}" if len(found) > 1 else said).classes("text-h6")
            if source := SOURCES.get(results.get("source") or ""):
                rig = f", rig {about[name]['rig']}" if name in about and about[name]["rig"] else ""
                ui.label(f"{begun(source)}{rig}.").classes("sinew-soft")
        if explained:
            what = "; ".join(said for one, said in _HEADLINES.items() if one in explained)
            ui.label(f"{what}; {_HOW_TOLD}").classes("sinew-soft")


_NOTHING = "No resonance and no damping could be told."
_HEADLINES = {
    "resonance_hz": "f_r: frequency at which torsion over commanded amplitude is largest",
    "damping_ratio": "D: Lehr's damping, of the ring-downs",
}
_HOW_TOLD = (
    "with 90 % intervals, or from the least to the greatest over the pretensions. What else is called a resonance (by "
    "90° of lag, by the paper's mean of peaks, of the decay) is in What was found."
)


def _about(run: dict[str, Any], changed: Callable[[], Awaitable[None]]) -> None:
    """Show what a run was and why it ended, with name, notes and tags to be changed."""
    name = run["name"]

    async def rename() -> None:
        if await _command("rename", name=name, to=to.value):
            ui.navigate.to(_address([to.value]))

    async def note() -> None:
        if await _command(
            "note", name=name, notes=notes.value or "", tags=(tags.value or "").replace(",", " ").split()
        ):
            await changed()

    async def put_away() -> None:
        if await _command("bin", name=name):
            about.clear()
            with about:
                ui.label(f"{name} lies in the bin.").props("role=status")
                with ui.element("div").classes("sinew-row"):
                    plain_button("Take it out again", "", restore, needs_operator=True).props("data-restore")
                    ui.link("All runs", "/runs")
                    why_not()
            await changed()

    async def restore() -> None:
        if await _command("restore", name=name):
            ui.navigate.to(_address([name]))

    with card(f"About {name}", 6), ui.element("div").classes("sinew-stack") as about:
        ui.label(f"{run['sentence'].rstrip('.')}. Begun {clock_time(run['started'])}.").props("data-reason")
        with ui.element("div").classes("sinew-row"):
            to = ui.input("Name", value=name).props("outlined dense maxlength=80 data-name").classes("sinew-name")
            plain_button("Rename", "", rename, needs_operator=True).props("data-rename")
        notes = ui.textarea("Notes", value=run["notes"]).props("outlined dense autogrow maxlength=4000 data-notes")
        notes.classes("w-full")
        tags = ui.input("Tags, with spaces or commas between", value=" ".join(run["tags"])).props(
            "outlined dense data-tags"
        )
        tags.classes("w-full")
        with ui.element("div").classes("sinew-row"):
            plain_button("Keep notes and tags", "", note, needs_operator=True).props("data-keep")
            plain_button("Put into the bin", "", put_away, needs_operator=True).props("data-bin")
            why_not()


def _compared(first: str, compared: dict[str, Any]) -> None:
    """Show in what runs differ from the first one that is open, and whether that is more than their uncertainty."""
    if not compared["rows"]:
        if compared["sentences"]:
            with card(f"Against {first}", 12):
                for sentence in compared["sentences"]:
                    ui.label(sentence)
        return
    rows = []
    for row in compared["rows"]:
        about = QUANTITIES[row["quantity"]]
        rows.append(
            {
                "key": f"{row['run']} {row['pretension_mm']} {row['quantity']}",
                "run": row["run"],
                "mm": f"{row['pretension_mm']:g}",
                "name": about.words,
                "first": quantity(row["first"], about.unit),
                "other": quantity(row["other"], about.unit),
                "difference": quantity(row["difference"], about.unit),
                "sure": row["sentence"],
            }
        )
    with card(f"Against {first}", 12):
        for sentence in compared["sentences"]:
            ui.label(sentence)
        labels = {"run": "run", "mm": "pretension / mm", "name": "quantity", "first": first, "other": "the other"}
        labels |= {"difference": "difference, 90 % interval", "sure": "significant"}
        table = ui.table(rows=rows, columns=_columns(labels), row_key="key", pagination=12)
        table.props("flat dense wrap-cells data-compared").classes("w-full")


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
        shown = [
            {
                "key": f"{row['run']} {row['pretension_mm']} {row['name']}",
                "run": row["run"],
                "mm": f"{row['pretension_mm']:g}",
                "name": row["name"],
                "value": quantity(row["estimate"], row["unit"]),
            }
            for row in rows
        ]
        labels = {"run": "run", "mm": "pretension / mm", "name": "quantity", "value": "value, 90 % interval"}
        if len(found) == 1:
            del labels["run"]
        table = ui.table(rows=shown, columns=_columns(labels), row_key="key", pagination=20)
        table.props("flat dense wrap-cells").classes("w-full")


def _coupling(name: str, document: dict[str, Any]) -> None:
    """Show what a bent head did besides twisting, at each frequency; nothing of an upright one."""
    pose, rows = document.get("pose"), document.get("coupling")
    if not pose or not rows:
        return
    title = f"{name}: coupling at a bend of {pose['bend_deg']:.4g}° towards {pose['azimuth_deg']:.4g}°"
    with card(title, 12):
        shown = [
            {
                "key": f"{row['pretension_mm']} {row['frequency_hz']} {row['channel']}",
                "mm": f"{row['pretension_mm']:g}",
                "hz": f"{row['frequency_hz']:g}",
                "channel": row["channel"].replace("-", " "),
                "amplitude": quantity(row["amplitude_deg"], "°"),
                "ratio": quantity(row["coupling_ratio"], "") if "coupling_ratio" in row else "–",
                "lag": quantity(row["lag_behind_torsion_deg"], "°") if "lag_behind_torsion_deg" in row else "–",
                "second": quantity(row["second_harmonic_deg"], "°"),
            }
            for row in rows
        ]
        labels = {"mm": "pretension / mm", "hz": "frequency / Hz", "channel": "motion", "amplitude": "amplitude"}
        labels |= {"ratio": "over the torsion", "lag": "lag behind it", "second": "at twice the frequency"}
        table = ui.table(rows=shown, columns=_columns(labels), row_key="key", pagination=12)
        table.props("flat dense wrap-cells data-coupling").classes("w-full")
        ui.label("Means over repeats with 90 % intervals; tilt in and out of the plane of the bend.").classes(
            "sinew-soft"
        )


def _downloads(name: str) -> None:
    with card(f"Files of {name}", 6), ui.element("div").classes("sinew-row"):
        ui.link("Samples over time", f"/run/{name}/samples").classes("sinew-button")
        for kind, label in _DOWNLOADS:
            ui.link(label, f"/download/{name}/{kind}").props(f"download data-kind={kind}").classes("sinew-button")
