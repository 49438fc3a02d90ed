"""The plan page: a plan chosen, edited, previewed and started."""

import asyncio
import json
import math
from datetime import datetime
from typing import Any

from nicegui import events, ui

from sinew.apps.dashboard.operators import is_run_name
from sinew.apps.dashboard.pages.curves import Curve, Curves
from sinew.apps.dashboard.pages.frame import Site, card, framed, heading
from sinew.measure.errors import SinewError

_TYPING_S = 0.4
_FIRST_PLAN = "first"
_ANEW = "The emulated bench is begun anew with a head that bends, where it is not there yet: that takes half a minute."


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
        self._rig = site.rig
        self._toml: str | None = None  # what was previewed and may start
        self._turn = 0

    def lay_out(self) -> None:
        """Lay out the page, without a plan yet."""
        with ui.element("div").classes("sinew-grid"):
            with card("What to run", 6):
                self._choice = ui.element("div").classes("sinew-stack")
                self._text = ui.textarea("Plan as TOML", on_change=self._check)
                self._text.props("borderless stack-label autogrow input-class=sinew-code spellcheck=false").classes(
                    "w-full"
                )
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

    async def begin(self) -> None:
        """Offer what is on the shelves, take the first plan and preview it."""
        shelves = await self._site.work.call("shelf", str(self._site.runs))
        with self._choice:
            self._choose(shelves)
        await self._take(_FIRST_PLAN)

    def _choose(self, shelves: dict[str, list[dict[str, Any]]]) -> None:
        rigs = {row["name"]: row["name"] for row in shelves["rigs"]} | {self._rig: self._rig}
        plans = {
            row["name"]: f"{row['name']} ({row['about']})" if row["about"] else row["name"] for row in shelves["plans"]
        }
        name = f"run-{datetime.now():%Y%m%d-%H%M%S}"
        letters: Any = {"letters, digits, dot, dash and underscore; a letter or digit first": is_run_name}
        rig = ui.select(rigs, value=self._rig, label="Rig", on_change=self._change_rig)
        plan = ui.select(plans, value=_FIRST_PLAN, label="Begin with the plan", on_change=lambda e: self._take(e.value))
        self._name = ui.input("Name of the run's folder", value=name, validation=letters)
        for made in (rig, plan, self._name):
            made.props("outlined dense").classes("w-full")

    async def _take(self, name: str) -> None:
        """Take a plan of the shelf."""
        try:
            text = await self._site.work.call("read_shelf", "plans", name, str(self._site.runs))
        except SinewError as trouble:
            ui.notify(str(trouble), type="negative")
            return
        self._text.set_value(text)

    async def _change_rig(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._rig = event.value
        await self._check()

    async def _check(self) -> None:
        """Say what is wrong with the plan, or preview it, once nobody has typed for a moment."""
        self._turn += 1
        turn, toml = self._turn, self._text.value
        self._offer(None)
        await asyncio.sleep(_TYPING_S)
        if turn != self._turn:
            return
        self._preview.clear()
        with self._preview:
            ui.spinner(size="2rem").props('aria-label="The preview is computed"')
            ui.label("The twin swings through the plan once.").classes("sinew-soft")
        try:
            rig = self._site.rig_text(self._rig)
            found = await self._site.work.call("preview_document", toml, rig, key=f"preview {id(self)}")
        except SinewError as trouble:
            found = {"trouble": str(trouble)}
        if turn == self._turn and found is not None:
            self._show(found)
            self._offer(toml if found.get("ok") else None)

    def _show(self, found: dict[str, Any]) -> None:
        self._preview.clear()
        with self._preview:
            if "trouble" in found:
                ui.label(found["trouble"]).classes("sinew-bad")
                return
            minutes = "{} min {} s".format(*divmod(round(found["bench_s"]), 60))
            longer = found["longest_s"] - found["duration_s"]
            more = f", at most {math.ceil((found['bench_s'] + longer) / 60)} min" if longer > 1 else ""
            said = ui.label(f"About {minutes}{more} with pull, pretensions and stop; {found['groups']} segments")
            said.props("id=sinew-duration")
            for finding in found["findings"]:
                word, style = ("Refused", "sinew-bad") if finding["severity"] == "refuse" else ("Mind", "sinew-warn")
                ui.label(f"{word}: {finding['sentence']}").classes(style)
            if found["ok"]:
                ui.label("No limit of the rig is broken.").classes("sinew-good")
            pose = found.get("pose")
            if pose:
                bent = f"The head is bent by {pose['bend_deg']:.4g}° towards {pose['azimuth_deg']:.4g}°"
                ui.label(f"{bent}; its largest torsion is not foretold.").props("id=sinew-pose")
                if self._site.bench == "emulator":
                    ui.label(_ANEW).classes("sinew-soft")
            twists = {row["pretension_mm"]: f"{row['torsion_deg']:.0f}" for row in found["torsion"]}
            rows = [
                {
                    "mm": f"{row['pretension_mm']:g}",
                    "n": f"{row['tension_n']:.1f}",
                    "deg": twists.get(row["pretension_mm"], "–"),
                }
                for row in found["tension"]
            ]
            pull = f"{'largest ' if pose else ''}tension of a tendon at rest / N"
            labels = {"mm": "pretension / mm", "n": pull, "deg": "largest torsion / °"}
            columns = [{"name": key, "label": label, "field": key, "align": "right"} for key, label in labels.items()]
            ui.table(rows=rows, columns=columns).props("flat dense").classes("w-full")
        drive = found["drive"]
        reached = Curve(
            "reachable", [one["frequency_hz"] for one in drive], [one["amplitude_deg"] for one in drive], is_line=True
        )
        self._reach.draw([reached] if drive else [])

    def _offer(self, toml: str | None) -> None:
        """Offer the start of a plan, or take it back."""
        self._toml = toml
        self._start.props(f"data-ready={'no' if toml is None else 'yes'}")

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
