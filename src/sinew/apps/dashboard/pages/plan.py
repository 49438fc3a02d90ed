"""This is where a plan is chosen, edited, previewed and started."""

import json
import math
from datetime import datetime
from typing import Any

from nicegui import events, ui

from sinew.apps.dashboard.operators import is_run_name
from sinew.apps.dashboard.pages.curves import Curve, Curves
from sinew.apps.dashboard.pages.frame import Site, card, empty, framed, heading
from sinew.apps.dashboard.work.form import fields_of, form_of, plan_from_form
from sinew.measure.errors import SinewError
from sinew.plan.plan import Plan
from sinew.plan.toml import parse_plan

_TYPING_S = 0.4
_FIRST_PLAN = "first"
_PARTS = {"": "Plan", "pretension": "Pretension", "sweep": "Sweep", "ring_down": "Ring-downs", "track": "Tracking"}


def add_plan_page(site: Site) -> None:
    """Serve the page on which a run is prepared, at /plan."""

    @ui.page("/plan")
    async def plan() -> None:
        with framed(site, "Plan", "/plan"):
            heading("Plan a run")
            desk = _Desk(site)
            desk.lay_out()
            await ui.context.client.connected()
            await desk.begin()


class _Desk:
    """One viewer's plan while it is prepared."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._fields = fields_of(Plan)
        self._inputs: dict[str, Any] = {}
        self._values: dict[str, Any] = {}
        self._rig = site.rig
        self._toml: str | None = None
        self._turn = 0

    def lay_out(self) -> None:
        """Lay out the page, without a plan yet."""
        with ui.element("div").classes("sinew-grid"):
            with card("What to run", 6):
                self._choice = ui.element("div").classes("sinew-stack")
                self._form = ui.element("div").classes("sinew-stack")
            with ui.element("div").classes("span-6 sinew-stack"):
                with card("Preview", 12):
                    # Above what grows, so that it keeps its place; steering.js knows whether this page may start.
                    with ui.element("div").classes("sinew-row"):
                        self._start = ui.element("button").props("id=sinew-start type=button data-ready=no disabled")
                        self._start.classes("sinew-button main").on("click", self._ask_to_start)
                        with self._start:
                            ui.html("Start", sanitize=False, tag="span")
                        ui.html('<span id="sinew-start-why" class="sinew-soft"></span>', sanitize=False, tag="span")
                    self._preview = ui.element("div").classes("sinew-stack")
                with card("Drive amplitude that can be reached against a held head", 12):
                    self._reach = Curves("amplitude_drive")
                with card("The plan as a file", 12):
                    self._text = (
                        ui.label().classes("sinew-code").props('tabindex=0 role=region aria-label="Plan as TOML"')
                    )

    async def begin(self) -> None:
        """Offer what is on the shelves, put the first plan into the form and preview it."""
        shelves = await self._site.work.call("shelf", str(self._site.runs))
        with self._choice:
            self._choose(shelves)
        await self._take(_FIRST_PLAN)

    def _choose(self, shelves: dict[str, list[dict[str, Any]]]) -> None:
        rigs = {row["name"]: row["name"] for row in shelves["rigs"]} | {self._rig: self._rig}
        plans = {
            row["name"]: f"{row['name']} ({row['about']})" if row["about"] else row["name"] for row in shelves["plans"]
        }
        ui.select(rigs, value=self._rig, label="Rig", on_change=self._change_rig).props("outlined dense").classes(
            "w-full"
        )
        ui.select(plans, value=_FIRST_PLAN, label="Begin with the plan", on_change=lambda e: self._take(e.value)).props(
            "outlined dense"
        ).classes("w-full")
        name = f"run-{datetime.now():%Y%m%d-%H%M%S}"
        self._name = (
            ui.input(
                "Name of the run's folder",
                value=name,
                validation={"letters, digits, dot, dash and underscore; a letter or digit first": is_run_name},
            )
            .props("outlined dense")
            .classes("w-full")
        )

    async def _take(self, name: str) -> None:
        """Put a plan of the shelf into the form."""
        try:
            text = await self._site.work.call("read_shelf", "plans", name, str(self._site.runs))
            self._values = form_of(parse_plan(text))
        except SinewError as trouble:
            ui.notify(str(trouble), type="negative")
            return
        self._form.clear()
        self._inputs.clear()
        with self._form:
            for part, title in _PARTS.items():
                self._part(part, title)
        await self._check()

    def _part(self, part: str, title: str) -> None:
        fields = [field for field in self._fields if field["part"] == part and field["type"] != "part"]
        optional = any(field["path"] == part and not field["required"] for field in self._fields)
        with ui.element("fieldset").classes("sinew-part"):
            with ui.element("legend"):
                ui.label(title).classes("text-bold")
            switch = ui.switch("part of this plan", value=bool(self._values.get(part))) if optional else None
            rows = ui.element("div").classes("sinew-fields")
            with rows:
                for field in fields:
                    self._field(field)
        if switch is not None:
            rows.bind_visibility_from(switch, "value")

            async def turned(event: events.ValueChangeEventArguments[Any]) -> None:
                self._values[part] = event.value
                await self._check()

            switch.on_value_change(turned)

    def _field(self, field: dict[str, Any]) -> None:
        path = field["path"]
        value = self._values.get(path, field["default"])
        label = field["title"]

        async def changed(event: events.ValueChangeEventArguments[Any], path: str = path) -> None:
            self._values[path] = event.value
            await self._check()

        if field["type"] == "choice":
            made: Any = ui.select(field["choices"], value=value, label=label, on_change=changed)
        else:
            made = ui.input(label, value="" if value is None else str(value), on_change=changed)
            made.props(f"debounce={int(1000 * _TYPING_S)}")
        made.props("outlined dense").classes("w-full")
        if field["help"]:
            made.tooltip(field["help"])
        self._inputs[path] = made

    async def _change_rig(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._rig = event.value
        await self._check()

    async def _check(self) -> None:
        """Validate what the form holds, show what is wrong at its place, and preview what is right."""
        self._turn += 1
        turn = self._turn
        self._toml, errors = plan_from_form(self._values)
        for path, made in self._inputs.items():
            made.error = errors.get(path)
        self._ready(False)
        self._preview.clear()
        others = {path: sentence for path, sentence in errors.items() if path not in self._inputs}
        with self._preview:
            for sentence in others.values():
                ui.label(sentence).classes("sinew-bad")
            if self._toml is None:
                empty("The preview comes as soon as every field is right.")
                return
            ui.spinner(size="2rem").props('aria-label="The preview is computed"')
            ui.label("The twin swings through the plan once.").classes("sinew-soft")
        self._text.set_text(self._toml)
        try:
            rig = self._site.rig_text(self._rig)
            found = await self._site.work.call("preview_document", self._toml, rig, key=f"preview {id(self)}")
        except SinewError as trouble:
            found = {"trouble": str(trouble)}
        if turn == self._turn and found is not None:
            self._show(found)

    def _show(self, found: dict[str, Any]) -> None:
        self._preview.clear()
        with self._preview:
            if "trouble" in found:
                ui.label(found["trouble"]).classes("sinew-bad")
                return
            minutes = "{} min {} s".format(*divmod(round(found["bench_s"]), 60))
            longer = found["longest_s"] - found["duration_s"]
            more = f", at most {math.ceil((found['bench_s'] + longer) / 60)} min" if longer > 1 else ""
            ui.label(f"About {minutes}{more} with pull, pretensions and stop; {found['groups']} segments").props(
                "id=sinew-duration"
            )
            for finding in found["findings"]:
                style = "sinew-bad" if finding["severity"] == "refuse" else "sinew-warn"
                ui.label(("Refused: " if finding["severity"] == "refuse" else "Mind: ") + finding["sentence"]).classes(
                    style
                )
            if found["ok"]:
                ui.label("No limit of the rig is broken.").classes("sinew-good")
            rows = [
                {
                    "mm": f"{t['pretension_mm']:g}",
                    "n": f"{t['tension_n']:.1f}",
                    "deg": f"{w:.0f}" if w is not None else "–",
                }
                for t, w in zip(found["tension"], _twists(found), strict=True)
            ]
            columns = [
                {"name": "mm", "label": "pretension / mm", "field": "mm", "align": "right"},
                {"name": "n", "label": "tension of a tendon at rest / N", "field": "n", "align": "right"},
                {"name": "deg", "label": "largest torsion / °", "field": "deg", "align": "right"},
            ]
            ui.table(rows=rows, columns=columns).props("flat dense").classes("w-full")
        drive = found["drive"]
        self._reach.draw(
            [Curve("reachable", [d["frequency_hz"] for d in drive], [d["amplitude_deg"] for d in drive], is_line=True)]
            if drive
            else []
        )
        self._ready(bool(found["ok"]))

    def _ready(self, is_ready: bool) -> None:
        """Offer the start, or take it back."""
        self._start.props(f"data-ready={'yes' if is_ready else 'no'}")

    def _ask_to_start(self) -> None:
        """Have the operator's browser ask the steward: this process steers nothing."""
        if self._toml is None:
            return
        if not is_run_name(self._name.value):
            ui.notify("The run's folder needs a name.", type="negative")
            return
        try:
            rig = self._site.rig_text(self._rig)
        except SinewError as trouble:
            ui.notify(str(trouble), type="negative")
            return
        asked = ", ".join(json.dumps(text) for text in (self._toml, rig, self._name.value))
        ui.run_javascript(f"Sinew.start({asked}).then(a => {{ if (a.ok) location.href = '/'; }})")


def _twists(found: dict[str, Any]) -> list[float | None]:
    known = {row["pretension_mm"]: row["torsion_deg"] for row in found["torsion"]}
    return [known.get(row["pretension_mm"]) for row in found["tension"]]
