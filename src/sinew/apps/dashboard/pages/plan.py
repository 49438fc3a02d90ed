"""The plan page: a plan chosen, edited, previewed, kept in the library and started."""

import asyncio
import html
import json
import math
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from itertools import groupby
from operator import itemgetter
from typing import Any

from nicegui import events, ui

from sinew.apps.dashboard.folders import is_run_name
from sinew.apps.dashboard.pages.curves import Curve, Curves, begun
from sinew.apps.dashboard.pages.frame import Site, card, empty, framed, heading, part, tabulate
from sinew.apps.dashboard.worker import unless_left
from sinew.measure.errors import SinewError
from sinew.plan.plan import Plan
from sinew.plan.toml import MOST_CHARACTERS, parse_plan

_TYPING_S = 0.4
_ANSWER_S = 10.0
_FIRST_PLAN, _QUICK_PLAN = "first", "quick"
_BENDS = "The emulated bench begins with a head that bends: that takes half a minute."
_AT_ITS_LINE = re.compile(r"^(the plan is |plan key \S+ )")  # what need not be said where it stands
_DRAFT = "sinew-plan"
_RUN_NAME = "up to 80 letters, digits, dots, dashes and underscores, a letter or digit first"
LIBRARY_NAME = "letters, digits, dots, dashes, underscores and spaces, a letter or digit first"
_FINDINGS = {"refuse": ("Refused", "sinew-bad"), "warn": ("Mind", "sinew-warn"), "note": ("Note", "sinew-soft")}
_GROUPS = {"steady": "swing", "ring-down": "decay", "idle": "rest", "tracking": "tracking"}


def add_plan_page(site: Site) -> None:
    """Serve the page on which a run is prepared, at /plan; /plan?rig=NAME chooses the rig."""

    @ui.page("/plan")
    async def plan(rig: str = "") -> None:
        with framed(site, "Plan", "/plan"):
            ui.add_body_html(f'<script type="module" src="/sinew/plan.js?{site.version}"></script>')
            heading("Plan a run")
            desk = _Desk(site, rig)
            desk.lay_out()
            await ui.context.client.connected()
            await desk.begin()


class _Desk:
    """One viewer's plan while it is prepared."""

    def __init__(self, site: Site, rig: str) -> None:
        self._site, self._requested_rig = site, rig
        self._rig = site.rig
        self._plan = _QUICK_PLAN if site.bench == "emulator" else _FIRST_PLAN
        self._stored = ""  # the plan's text as it is in the library
        self._draft = ("", "")  # plan, and what was changed in it; the browser keeps it, too
        self._replacing: str | None = None  # what the next saving may take the place of
        self._toml: str | None = None  # what was previewed and may start
        self._suggested = ""  # the run's name, until somebody gives it another
        self._turn = 0

    def lay_out(self) -> None:
        """Lay out the page, without a plan yet."""
        with ui.element("div").classes("sinew-grid"):
            with card("Start", 12):
                # Above what grows, so that it keeps its place; steering.js knows whether this page may start.
                with ui.element("div").classes("sinew-row"):
                    self._start = ui.element("button").props("id=sinew-start type=button data-ready=no disabled")
                    self._start.classes("sinew-button main").on("click", self._ask_to_start)
                    with self._start:
                        ui.html("Start", sanitize=False, tag="span")
                    ui.html('<span id="sinew-start-why" class="sinew-soft"></span>', sanitize=False, tag="span")
                    self._length = ui.label().props("id=sinew-duration")
                self._choice = ui.element("div").classes("sinew-fields")
            with card("What the bench does, and when (min:s)", 12):
                self._timeline = ui.element("div").classes("sinew-stack sinew-timeline-place")
            with card("Plan", 6):
                with ui.element("div").props("id=sinew-plan-text").classes("sinew-editor"):
                    self._text = ui.codemirror(language="TOML", indent="  ", on_change=self._edited)
                self._state = ui.label().props("id=sinew-plan-state role=status").classes("sinew-soft")
                with ui.element("div").classes("sinew-row"):
                    self._name = ui.input("Name in the library", validation={LIBRARY_NAME: _is_file_name})
                    self._name.props("outlined dense for=sinew-plan-name")
                    self._save = plain_button("Save", "sinew-plan-save", self._keep, steers=True)
                    self._discard = plain_button("Discard changes", "sinew-plan-discard", self._take_stored)
                    why_not()
            with ui.element("div").classes("span-6 sinew-stack"):
                with card("Preview", 12):
                    self._preview = ui.element("div").classes("sinew-stack")
                with card("How far the drive gets: amplitude of the lever, the head held still", 12):
                    self._reach = Curves("amplitude_drive")

    async def begin(self) -> None:
        """Offer what is in the libraries, with the plan that was edited last or the first one, and preview it."""
        chosen, rig, draft = await self._kept()
        self._draft = (chosen or "", draft)
        libraries = await self._site.work.call("library", str(self._site.runs))
        if chosen is not None and chosen in {row["name"] for row in libraries["plans"]}:
            self._plan = chosen
        library = {row["name"] for row in libraries["rigs"]}
        self._rig = next((one for one in (self._requested_rig, rig) if one is not None and one in library), self._rig)
        if self._requested_rig not in ("", self._rig):
            say(f"There is no rig {self._requested_rig} in the library; {self._rig} is chosen.")
        with self._choice:
            self._choose(libraries)
        await self._take(self._plan)

    def _choose(self, libraries: dict[str, list[dict[str, Any]]]) -> None:
        rigs = {self._site.rig: self._site.rig} | in_words(libraries["rigs"], self._site.rig)
        name = self._run_name(self._plan)
        letters: Any = {_RUN_NAME: is_run_name}
        self._plans = ui.select(
            in_words(libraries["plans"], _QUICK_PLAN),
            value=self._plan,
            label="Begin with the plan",
            on_change=self._change_plan,
        )
        rig = ui.select(rigs, value=self._rig, label="Rig", on_change=self._change_rig)
        self._run = ui.input("Name of the run's folder", value=name, validation=letters)
        for made in (self._plans, rig, self._run):
            made.props("outlined dense").classes("w-full")

    def _run_name(self, plan: str) -> str:
        """Return a name for a run of a plan: what it is, and when."""
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", plan.removesuffix(".toml")).strip("-._") or "run"
        self._suggested = f"{stem[:40]}-{datetime.now():%Y%m%d-%H%M%S}"
        return self._suggested

    async def _change_plan(self, event: events.ValueChangeEventArguments[Any]) -> None:
        if event.value != self._plan:
            await self._take(event.value)

    async def _take(self, name: str) -> None:
        """Take a plan of the library, with what was changed in it before."""
        try:
            text = await self._site.work.call("read_library", "plans", name, str(self._site.runs))
        except SinewError as trouble:
            say(str(trouble))
            return
        self._plan, self._stored = name, text
        if self._run.value == self._suggested:
            self._run.set_value(self._run_name(name))
        self._name.set_value(name.removesuffix(".toml") if _is_own(name) else f"my {name}")
        was = self._text.value
        self._text.set_value(self._draft[1] if self._draft[0] == name and self._draft[1] else text)
        if self._text.value == was:
            await self._edited()

    def _take_stored(self) -> None:
        self._text.set_value(self._stored)

    async def _change_rig(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._rig = event.value
        self._remember()
        await self._check()

    async def _edited(self) -> None:
        """Keep what was typed, in the browser, and look at it."""
        is_changed = self._text.value != self._stored and len(self._text.value) <= MOST_CHARACTERS
        if is_changed or self._draft[0] == self._plan:
            self._draft = (self._plan, self._text.value if is_changed else "")
        self._remember()
        self._tell_state()
        await self._check()

    def _remember(self) -> None:
        text = json.dumps(json.dumps({"plan": self._plan, "rig": self._rig, "draft": self._draft[1]}))
        ui.run_javascript(f"try {{ localStorage.setItem('{_DRAFT}', {text}); }} catch {{ /* storage is off */ }}")

    async def _kept(self) -> tuple[str | None, str | None, str]:
        """Return plan, rig and draft that this browser keeps; None and none where it keeps nothing."""
        question = f"try {{ return localStorage.getItem('{_DRAFT}') }} catch {{ return null }}"
        with suppress(TimeoutError, ValueError, TypeError, KeyError):
            stored = json.loads(await ui.run_javascript(question, timeout=_ANSWER_S))
            return str(stored["plan"]), str(stored["rig"]), str(stored["draft"])
        return None, None, ""

    def _tell_state(self) -> None:
        is_changed = self._text.value != self._stored
        name = self._plan.removesuffix(".toml")
        where = f"{name} in the library" if _is_own(self._plan) else f"the plan {name} that ships with Sinew"
        said = f"Changed: this browser keeps it, {where} is as it was." if is_changed else f"As {where}."
        self._state.set_text(said)
        self._state.classes(replace="sinew-warn" if is_changed else "sinew-soft")
        self._discard.props(remove="disabled") if is_changed else self._discard.props("disabled")

    async def _check(self) -> None:
        """Say what is wrong with the plan, or preview it, once nobody has typed for a moment."""
        self._turn += 1
        turn, toml = self._turn, self._text.value
        self._offer(None, "The plan is looked at.")
        await asyncio.sleep(_TYPING_S)
        if self._is_past(turn):
            return
        try:
            rig = self._site.rig_text(self._rig)
        except SinewError as trouble:
            outline: dict[str, Any] | None = {"trouble": str(trouble)}
        else:
            outline = await self._tried("plan_outline", toml, rig)
        if self._is_past(turn) or outline is None:
            return
        self._mark(toml, outline.get("faults", []))
        self._preview.clear()
        self._reach.draw([])  # what stood there was of another plan
        with self._preview:
            if "stages" not in outline:
                self._say_faults(outline)
                lines = sorted({fault["line"] for fault in outline.get("faults", []) if fault["line"] is not None})
                self._offer(None, f"The plan is wrong{f' at line {lines[0]}' if lines else ''}: see Preview.")
                return
            self._draw_timeline(outline["stages"])
            ui.spinner(size="2rem").props('aria-label="The twin swings through the plan once"')
        self._offer(None, "The plan is tried on the twin: see Preview.")
        found = await self._tried("preview_document", toml, rig)
        if found is not None and not self._is_past(turn):
            self._show(found)
            self._offer(toml if found.get("ok") else None, "The plan is refused: see Preview.")

    def _is_past(self, turn: int) -> bool:
        """Return whether something else was typed since, or the page was left."""
        return turn != self._turn or self._text.is_deleted

    async def _tried(self, name: str, *arguments: Any) -> dict[str, Any] | None:
        try:
            awaited = self._site.work.call(name, *arguments, key=f"{name} {id(self)}")
            request: dict[str, Any] | None = await unless_left(awaited, ui.context.client.disconnected())
        except SinewError as trouble:
            return {"trouble": str(trouble)}
        return request

    def _mark(self, toml: str, faults: Sequence[dict[str, Any]]) -> None:
        """Mark the lines of a plan at which something is wrong, and say there what."""
        marks: list[dict[str, Any]] = []
        ends = [end for end, letter in enumerate(toml) if letter == "\n"] + [len(toml)]
        for number in sorted({fault["line"] for fault in faults if fault["line"]}):
            said = "; ".join(_AT_ITS_LINE.sub("", one["sentence"]) for one in faults if one["line"] == number)
            marks.append({"kind": "line", "line": number, "class": "sinew-fault-line"})
            end_s = ends[min(number, len(ends)) - 1]
            marks.append({"kind": "widget", "position": end_s, "text": said, "class": "sinew-fault"})
        if marks != self._text.decorations:
            self._text.decorations = marks

    def _say_faults(self, outline: dict[str, Any]) -> None:
        self._length.set_text("")
        self._timeline.clear()
        with self._timeline:
            empty("The timeline comes back when the plan can be read.")
        with ui.element("div").props("role=alert id=sinew-faults").classes("sinew-stack"):
            if "trouble" in outline:
                ui.label(outline["trouble"]).classes("sinew-bad")
                return
            for fault in outline["faults"]:
                with ui.element("div").classes("sinew-row"):
                    if fault["line"] is not None:
                        plain_button(
                            f"Line {fault['line']}", "", lambda line=fault["line"]: self._text.reveal_line(line)
                        )
                    ui.label(fault["sentence"]).classes("sinew-bad")

    def _draw_timeline(self, stages: Sequence[dict[str, Any]]) -> None:
        self._timeline.clear()
        with self._timeline:
            ui.html(timeline_html(stages), sanitize=False)

    def _show(self, found: dict[str, Any]) -> None:
        self._preview.clear()
        self._length.set_text("")
        with self._preview:
            if "trouble" in found:
                ui.label(found["trouble"]).props("role=alert").classes("sinew-bad")
                return
            whole = round(found["bench_s"])
            minutes = "{} min {} s".format(*divmod(whole, 60)) if whole >= 60 else f"{whole} s"
            took = f"About {minutes} on the bench, after some seconds to get ready"
            self._length.set_text(f"{took}; {found['groups']} groups: {_groups_in_words(parse_plan(self._text.value))}")
            if found["ok"]:
                rest = ", knowing this:" if any(one["severity"] == "warn" for one in found["findings"]) else "."
                ui.label(f"No limit of the rig is broken. You may start{rest}").classes("sinew-good")
            for finding in found["findings"]:
                word, style = _FINDINGS[finding["severity"]]
                said = ui.label(f"{word}: {finding['sentence']}").classes(style)
                said.props("role=alert" if word == "Refused" else "")
            pose = found.get("pose")
            if pose:
                bent = f"The head is bent by {pose['bend_deg']:.4g}° towards {pose['azimuth_deg']:.4g}°"
                ui.label(f"{bent}; its largest torsion is not foretold.").props("id=sinew-pose")
            if self._site.bench == "emulator" and pose:
                ui.label(_BENDS).classes("sinew-soft")
            twists = {row["pretension_mm"]: f"{row['torsion_deg']:.0f}" for row in found["torsion"]}
            rows = [
                (f"{row['pretension_mm']:g}", f"{row['tension_n']:.1f}", twists.get(row["pretension_mm"], "–"))
                for row in found["tension"]
            ]
            pull = f"{'largest ' if pose else ''}tension of a tendon at rest / N"
            labels = {"mm": "pretension / mm", "n": pull, "deg": "largest torsion / °"}
            tabulate(labels, rows, right=labels)
        drive = found["drive"]
        reached = Curve(
            "reachable", [one["frequency_hz"] for one in drive], [one["amplitude_deg"] for one in drive], is_line=True
        )
        self._reach.draw([reached] if drive else [])

    def _offer(self, toml: str | None, why: str) -> None:
        """Offer the start of a plan, or take it back and say why."""
        self._toml = toml
        self._start.props(f'data-ready={"no" if toml is None else "yes"} data-why="{why}"')

    def _ask_to_start(self) -> None:
        """Have the viewer's browser ask the steward: this process steers nothing."""
        if self._toml is None:
            return
        if not is_run_name(self._run.value):
            say(f"A run's folder takes {_RUN_NAME}.")
            return
        try:
            rig = self._site.rig_text(self._rig)
        except SinewError as trouble:
            say(str(trouble))
            return
        arguments = ", ".join(json.dumps(text) for text in (self._toml, rig, self._run.value))
        ui.run_javascript(f"Sinew.start({arguments}).then(a => {{ if (a.ok) location.href = '/'; }})")

    async def _keep(self) -> None:
        """Have the viewer's browser put the plan in the library; over another one only when asked a second time."""
        name, text = self._name.value.strip(), self._text.value
        if not _is_file_name(name):
            say(f"A plan's name in the library takes {LIBRARY_NAME}.")
            return
        file = f"{name.removesuffix('.toml')}.toml"
        request = {"library": "plans", "name": file, "text": text, "replace": file in (self._plan, self._replacing)}
        answer = await steer("store", request)
        self._replacing = file if answer.get("exists") else None
        for label in self._save:
            label.props(f"innerHTML={'Replace' if self._replacing else 'Save'}")
        if answer.get("ok"):
            self._draft = ("", "")
            self._plan, self._stored = file, text
            self._remember()
            self._tell_state()
            if self._run.value == self._suggested:
                self._run.set_value(self._run_name(file))
            with suppress(SinewError):  # what was done in the library is done; the list here is as it was
                libraries = await self._site.work.call("library", str(self._site.runs))
                self._plans.set_options(in_words(libraries["plans"], _QUICK_PLAN), value=file)


def plain_button(text: str, name: str, act: Any, *, steers: bool = False) -> ui.element:
    """Return a plain button. steers: it is for who is signed in, which steering.js knows."""
    made = ui.element("button").props(f"type=button {f'id={name}' if name else ''}").classes("sinew-button")
    if steers:
        made.props("data-steers=ready disabled")
    with made.on("click", act):
        ui.html(html.escape(text), sanitize=False, tag="span")
    return made


def why_not() -> None:
    """Leave place for why the buttons beside it are not for this page's viewer; steering.js fills it."""
    ui.element("span").classes("sinew-why-not sinew-soft")


def say(sentence: str) -> None:
    """Tell this browser's user of something that went wrong, where steering says such things."""
    ui.run_javascript(f"Sinew.say({json.dumps(sentence)}, 'bad')")


async def steer(command: str, request: dict[str, Any]) -> dict[str, Any]:
    """Return what the steward answers to a command of this browser, which also shows it."""
    try:
        answer = await ui.run_javascript(
            f"return Sinew.command({json.dumps(command)}, {json.dumps(request)})", timeout=_ANSWER_S
        )
    except TimeoutError:
        return {}
    return answer if isinstance(answer, dict) else {}


def _is_own(name: str) -> bool:
    return name.endswith(".toml")


def _is_file_name(name: str | None) -> bool:
    return is_run_name((name or "").strip().replace(" ", "_"))


def in_words(library: Sequence[dict[str, Any]], first: str) -> dict[str, str]:
    """Return what a list calls rigs or plans, by their names: the lab's own, then `first`, then the rest."""
    words = {}
    for row in sorted(library, key=lambda row: (row["shipped"], row["name"] != first, row["name"])):
        name, about = row["name"].removesuffix(".toml"), [row["about"]] if row["about"] else []
        notes = "; ".join([*([] if row["shipped"] else ["yours"]), *about])
        words[row["name"]] = f"{name} ({notes})" if notes else name
    return words


def _groups_in_words(plan: Plan) -> str:
    """Return how many groups of each kind a plan has."""
    counts = Counter(group.kind for group in plan.groups())
    return ", ".join(f"{count} {_GROUPS.get(kind, kind)}{'s' * (count != 1)}" for kind, count in counts.items())


# The timeline of a plan: plain HTML of its stages, and the same as a table.

_DOES = {
    "pull": "pull to first contact",
    "change": "set the pretension and level",
    "rest": "rest",
    "settle": "drive until it is steady",
    "steady": "record the steady swing",
    "calm": "wait until the joint is calm",
    "ring-down": "record the free decay",
    "tracking": "track the resonance",
    "stop": "let the tension down",
}
_STEPS_S = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 28800, 86400)
_TICKS = 8
_LAST_TICK = 0.93  # of the whole: the time of one farther right would be cut off


def timeline_html(stages: Sequence[dict[str, Any]]) -> str:
    """Return a plan's stages as bars over time, told on hovering, and as a table. stages: of `plan_outline`."""
    whole = stages[-1]["start_s"] + stages[-1]["duration_s"]
    bars = [{**one, "style": one["kind"], "label": _short(one), "told": _stage_words(one)} for one in stages]
    levels = []
    for mm, level in groupby((one for one in stages if one["pretension_mm"] is not None), itemgetter("pretension_mm")):
        first, last = itemgetter(0, -1)(list(level))
        held = {"start_s": first["start_s"], "duration_s": last["start_s"] + last["duration_s"] - first["start_s"]}
        levels.append({**held, "style": "level", "label": f"{mm:g} mm", "told": f"{mm:g} mm: {_span(held)}"})
    step = next((step for step in _STEPS_S if whole / step <= _TICKS), _STEPS_S[-1])
    ticks = [(at, _clock(at)) for at in range(0, math.ceil(_LAST_TICK * whole), step)]
    rows = [
        (
            _clock(one["start_s"]),
            f"{one['duration_s']:.1f}",
            _doing(one),
            *(
                "" if one[key] is None else f"{one[key]:.4g}"
                for key in ("pretension_mm", "frequency_hz", "amplitude_deg")
            ),
        )
        for one in stages
    ]
    legend = [(kind, _DOES[kind]) for kind in dict.fromkeys(one["kind"] for one in stages)]
    said = f"The run over {_clock(whole)} min; the table of the run says the same"
    return part("plan", "timeline", whole, said, levels, bars, ticks, legend, rows)


def _doing(one: dict[str, Any]) -> str:
    return _DOES[one["kind"]] + (f", {one['groups']} times" if one["groups"] > 1 else "")


def _short(one: dict[str, Any]) -> str:
    is_record = one["kind"] in ("steady", "ring-down") and one["groups"] == 1
    return f"{one['frequency_hz']:.3g} Hz" if is_record and one["frequency_hz"] is not None else ""


def _stage_words(one: dict[str, Any]) -> str:
    drive = "" if one["frequency_hz"] is None or one["groups"] > 1 else f" at {one['frequency_hz']:.4g} Hz"
    held = "" if one["pretension_mm"] is None else f", {one['pretension_mm']:g} mm"
    return f"{begun(_doing(one))}{drive}{held}: {_span(one)}"


def _span(one: dict[str, Any]) -> str:
    return f"{_clock(one['start_s'])} to {_clock(one['start_s'] + one['duration_s'])}, {one['duration_s']:.1f} s"


def _clock(seconds: float) -> str:
    return "{}:{:02d}".format(*divmod(round(seconds), 60))
