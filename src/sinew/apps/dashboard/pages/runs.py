"""The page of past runs: searched, opened, laid over one another and downloaded."""

from typing import Any

from nicegui import events, ui

from sinew.apps.dashboard.operators import is_run_name
from sinew.apps.dashboard.pages.curves import Curve, Curves
from sinew.apps.dashboard.pages.frame import Site, card, empty, framed, heading, quantity
from sinew.measure.errors import SinewError
from sinew.measure.units import local_time

_COLUMNS = {"name": "run", "started": "started", "plan": "plan", "rig": "rig", "groups": "segments", "state": "state"}
_RIGHT = ("groups", "mm", "hz", "value")
_DOWNLOADS = (("recording", "Recording (NetCDF)"), ("csv", "CSV"), ("mat", "MAT"), ("report", "Report"))
_MOST_OVERLAID = 6


def add_runs_pages(site: Site) -> None:
    """Serve the list of runs at /runs, and some of them laid over one another at /runs/a,b."""

    @ui.page("/runs")
    async def runs() -> None:
        with framed(site, "Runs", "/runs"):
            heading("Runs")
            place = ui.element("div").classes("sinew-content")
            with place:
                empty("The runs are listed.")
            await ui.context.client.connected()
            try:
                found, trouble = await site.work.call("list_runs", str(site.runs)), ""
            except SinewError as error:
                found, trouble = [], str(error)
            place.clear()
            with place:
                if trouble:
                    ui.label(trouble).classes("sinew-bad")
                else:
                    _table(found)

    @ui.page("/runs/{names}")
    async def opened(names: str) -> None:
        with framed(site, "Runs", "/runs"):
            chosen = [name for name in dict.fromkeys(names.split(",")) if is_run_name(name)][:_MOST_OVERLAID]
            heading(", ".join(chosen) or "No such run")
            ui.link("All runs", "/runs")
            await _open(site, chosen)


def _columns(labels: dict[str, str]) -> list[dict[str, Any]]:
    """Return columns as a table takes them."""
    sides = {key: "right" if key in _RIGHT else "left" for key in labels}
    return [
        {"name": key, "label": label, "field": key, "align": sides[key], "sortable": True}
        for key, label in labels.items()
    ]


def _table(found: list[dict[str, Any]]) -> None:
    if not found:
        with ui.element("div").classes("sinew-card"):
            empty("There is no run yet. Start one on the page Plan, or put the folder of one where sinew serve looks.")
        return
    rows = [_row(run) for run in found]
    with ui.element("section").classes("sinew-card"):
        search = ui.input("Search").props("outlined dense clearable type=search").classes("w-full")
        table = ui.table(
            rows=rows,
            columns=_columns(_COLUMNS),
            row_key="name",
            selection="multiple",
            pagination={"rowsPerPage": 20, "sortBy": "started", "descending": True},
        )
        table.props("flat dense").classes("w-full")
        table.add_slot("header-selection", '<q-checkbox v-model="props.selected" dense aria-label="choose all" />')
        table.add_slot(
            "body-selection", '<q-checkbox v-model="props.selected" dense :aria-label="`choose ${props.row.name}`" />'
        )
        search.bind_value_to(table, "filter")

        def open_chosen() -> None:
            names = [row["name"] for row in table.selected if is_run_name(row["name"])]
            if names:
                ui.navigate.to(f"/runs/{','.join(names[:_MOST_OVERLAID])}")
            else:
                ui.notify("Choose one run, or several to lay over one another.")

        def open_row(event: events.GenericEventArguments) -> None:
            name = event.args[1]["name"]
            if is_run_name(name):
                ui.navigate.to(f"/runs/{name}")

        table.on("rowClick", open_row)
        ui.button("Open what is chosen", on_click=open_chosen).props("id=sinew-open no-caps unelevated color=primary")


def _row(run: dict[str, Any]) -> dict[str, Any]:
    done = "–" if run.get("groups") is None else f"{run['groups_done']} of {run['groups']}"
    started = local_time(run.get("started") or "–")
    return {**{key: run.get(key) or "–" for key in _COLUMNS}, "groups": done, "started": started}


async def _open(site: Site, names: list[str]) -> None:
    if not names:
        empty("No run has that name.")
        return
    place = ui.element("div").classes("w-full")
    with place:
        ui.spinner(size="2rem").props('aria-label="The runs are analysed"')
        ui.label("The runs are analysed; the first time takes some seconds.").classes("sinew-soft")
    await ui.context.client.connected()
    found: list[tuple[str, dict[str, Any]]] = []
    for name in names:
        try:
            found.append((name, await site.work.call("run_results", str(site.runs / name))))
        except SinewError as trouble:
            found.append((name, {"trouble": str(trouble)}))
    place.clear()
    with place, ui.element("div").classes("sinew-grid"):
        _doubts(found)
        _curves(found)
        _numbers(found)
        for name, results in found:
            _coupling(name, results.get("document") or {})
        for name, _ in found:
            _downloads(name)


def _doubts(found: list[tuple[str, dict[str, Any]]]) -> None:
    """Say what speaks against the runs, above everything that they found."""
    for name, results in found:
        if results.get("doubts"):
            with card(f"{name} contradicts itself or its rig", 12), ui.element("div").props("role=alert data-doubts"):
                for sentence in results["doubts"]:
                    ui.label(sentence).classes("sinew-bad")


def _curves(found: list[tuple[str, dict[str, Any]]]) -> None:
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
    for what, title in (("gain", "Gain"), ("phase", "Phase")):
        with card(title, 6):
            if lines[what]:
                Curves(what).draw(lines[what])
            else:
                empty("No frequency was recorded whole.")
    if damping:
        with card("Damping", 6):
            Curves("damping", "pretension / mm").draw(damping)


def _numbers(found: list[tuple[str, dict[str, Any]]]) -> None:
    rows = [{"run": name, **row} for name, results in found for row in results.get("parameters", [])]
    if not rows:
        return
    with card("What was found", 12):
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
        table = ui.table(rows=shown, columns=_columns(labels), row_key="key", pagination=12)
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
        for kind, label in _DOWNLOADS:
            ui.link(label, f"/download/{name}/{kind}").props(f"download data-kind={kind}").classes("sinew-button")
