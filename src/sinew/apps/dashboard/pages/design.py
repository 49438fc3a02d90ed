"""The design page: sliders of a joint, what the equations say of it at once, and joints side by side."""

import asyncio
import math
from collections.abc import Awaitable, Coroutine, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import Any, NamedTuple
from urllib.parse import urlencode

from nicegui import events, ui

from sinew.apps.dashboard.operators import is_run_name
from sinew.apps.dashboard.pages.curves import Curve, Curves
from sinew.apps.dashboard.pages.frame import Site, card, empty, framed, heading, quantity
from sinew.apps.dashboard.pages.plan import (
    SHELF_NAME,
    count_seconds,
    in_words,
    plain_button,
    recall,
    remember,
    say,
    steer,
    why_not,
)
from sinew.apps.dashboard.work.design import kept_curves
from sinew.apps.dashboard.worker import unless_left
from sinew.measure.errors import SinewError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig

_THROTTLE_S = 0.05
_SETTLED_S = 0.4
_BAND_HZ = (1.0, 6.0)
_MOST_KEPT = 5
_LETTERS = "ABCDE"
_TICK_S, _AWAITED_S = 0.25, 0.3


class _Size(NamedTuple):
    """What a slider sets. key, scale: of the option of `sinew predict` that it is, times its value; None: of no rig."""

    name: str
    unit: str
    low: float
    high: float
    step: float
    key: str | None = None
    scale: float = 1.0


_SIZES = {
    "length_mm": _Size("Length of the silicone", "mm", 60.0, 150.0, 1.0, "length_mm"),
    "outer_mm": _Size("Diameter of the silicone", "mm", 40.0, 80.0, 0.5, "outer_mm"),
    "tendon_circle_mm": _Size("Radius of the guides' circle", "mm", 15.0, 60.0, 0.5, "tendon_circle_mm"),
    "lever_g_m2": _Size("Inertia of the lever", "g m²", 4.0, 20.0, 0.1, "lever_inertia_kg_m2", 1e-3),
    "pretension_mm": _Size("Pretension", "mm", 0.0, math.inf, 0.25),  # as far as the rig's limits: `_ranges`
    "amplitude_deg": _Size("Amplitude of the command", "°", 2.0, 30.0, 0.5),
    "wanted_hz": _Size("Wanted resonance", "Hz", 1.0, 6.0, 0.05),
}
_DRAWN_ONLY = "wanted_hz"
"""It moves a mark, and nothing is computed for it."""


_COMPILES = "The equations behind the sliders are being compiled: some seconds, more where the computer is busy."
_COMPUTES = "The equations are being computed."
_OUTDATED = "What is grey is of the joint before."
_SAVES = "The rig is being saved. Where this page is left before it is, that goes on when the page is opened again."


def add_design_page(site: Site) -> None:
    """Serve the page for designing at /design, from the rig that is offered first; /design?rig=NAME from another."""

    @ui.page("/design")
    async def design(rig: str = "") -> None:
        with framed(site, "Design", "/design"):
            heading("Design a joint")
            try:
                sliders = _Sliders(site, rig or site.rig)
            except SinewError as trouble:
                ui.label(str(trouble)).props("role=alert").classes("sinew-bad")
                ui.link("Design from the rig that is offered first", "/design")
                return
            sliders.lay_out()
            await ui.context.client.connected()
            await sliders.begin()


@dataclass
class _Joint:
    """A joint with its curve. name: in legend and table. values: of the sliders. found: of `design_curves`, or None
    while it is not computed. number: which colour."""

    name: str
    values: dict[str, float]
    number: int
    found: dict[str, Any] | None = None
    is_fine: bool = False


@dataclass
class _Row:
    """What is laid out for one slider."""

    slider: ui.slider
    number: ui.number
    reset: ui.element
    said: ui.label


class _Sliders:
    """One viewer's joint while it is designed. name: of the rig that it is designed from. Raises SpecError."""

    def __init__(self, site: Site, name: str) -> None:
        self._site, self._rig_name = site, name
        self._rig_toml = site.rig_text(name)
        rig = parse_rig(self._rig_toml)
        self._ranges, self._built = _ranges(rig), _sizes(rig)
        of_rig = "" if name == site.rig else f" {name}"
        self._kept_as, self._saving_as = f"sinew-design{of_rig}", f"sinew-design-saving{of_rig}"
        self._as_built = _Joint("as built", dict(self._built), 1)
        self._now = _Joint("this joint", dict(self._built), 0)
        self._kept: list[_Joint] = []
        self._rows: dict[str, _Row] = {}
        self._cells: list[tuple[_Joint, list[ui.label]]] = []  # of the table, by joint
        self._best = 0.0
        self._awaited_from: float | None = (
            None  # since when the present joint's curve, or the first sketch, is computed
        )
        self._is_outdated = False  # whether what is shown is of another joint than the sliders'
        self._replacing: str | None = None  # what the next saving may take the place of
        self._turn = 0
        self._is_sketched = False  # whether the equations of a sketch are compiled, as far as this page knows

    def lay_out(self) -> None:
        """Lay out sliders, curves and what is to know of them."""
        with ui.element("div").classes("sinew-grid"):
            with card("Joint", 4):
                self._rigs = ui.select(
                    {self._rig_name: self._rig_name}, value=self._rig_name, label="Rig as built", on_change=self._go_to
                )
                self._rigs.props("outlined dense").classes("w-full")
                for key, size in self._ranges.items():
                    self._slider(key, size)
                with ui.element("div").classes("sinew-row"):
                    self._keep = plain_button("Keep this joint", "sinew-keep", self._pin)
                    plain_button("Reset all", "sinew-reset", lambda: self._put(self._built))
                with ui.element("div").classes("sinew-row"):
                    self._suggest = plain_button("Suggest a pretension", "sinew-suggest", self._suggested)
                    self._use = plain_button("Use it", "sinew-use", self._use_suggestion)
                    self._use.set_visibility(False)
                self._suggestion = ui.label().props("id=sinew-suggestion role=status").classes("sinew-soft")
                self._searching = ui.element("div").classes("sinew-row").props("id=sinew-searching")
                with ui.element("div").classes("sinew-row"):
                    self._name = ui.input("Name of the rig", value="my joint").props(
                        "outlined dense for=sinew-rig-name"
                    )
                    self._save = plain_button("Save as rig", "sinew-rig-save", self._ask_to_save, needs_operator=True)
                    plain_button("Download", "sinew-rig-download", self._download)
                    why_not()
                self._saved = ui.label().props("id=sinew-rig-state role=status").classes("sinew-soft")
                self._plan_it = ui.link("Plan a run with it", "/plan")
                self._plan_it.set_visibility(False)
            with ui.element("div").classes("span-8 sinew-stack"):
                with card("Gain: torsion over commanded amplitude", 12) as gain:
                    self._waiting = empty("").props("id=sinew-compiling role=timer")
                    self._waiting.set_visibility(False)
                    self._gain = Curves("gain")
                    self._gain.element.props("id=sinew-design-gain")
                with card("Phase: lag of the torsion", 12) as phase:
                    self._phase = Curves("phase")
                with card("What it is worth", 12) as worth:
                    with ui.element("div").props("role=status").classes("sinew-stack"):
                        self._notes = [
                            ui.label().props(f"id=sinew-{name}") for name in ("peak", "lag", "folds", "worth")
                        ]
                    self._trouble = ui.label().props("role=alert").classes("sinew-bad")
                    self._trouble.set_visibility(False)
                    self._checks = ui.element("div").classes("sinew-stack")
                with card("Joints side by side", 12):
                    self._table = (
                        ui.element("div")
                        .classes("sinew-scroll sinew-whole")
                        .props('tabindex=0 role=region aria-label="Joints"')
                    )
        self._dated, self._client = (gain, phase, worth), ui.context.client
        self._clock = ui.timer(_TICK_S, self._count, active=False)

    def _slider(self, key: str, size: _Size) -> None:
        value, called = self._now.values[key], f"{size.name} / {size.unit}"
        with ui.element("div").classes("sinew-slider"):
            ui.html(f"{size.name}", sanitize=False, tag="label").props(f"id=sinew-label-{key}")
            slider = ui.slider(min=size.low, max=size.high, step=size.step, value=value)
            slider.props(f'id=sinew-slider-{key} aria-label="{size.name}" dense')
            number = ui.number(
                value=value, step=size.step, suffix=size.unit
            )  # with min and max it clamps without a word
            number.props(f'for=sinew-number-{key} aria-label="{called}" outlined dense hide-bottom-space')
            reset = plain_button("Reset", f"sinew-reset-{key}", lambda: self._put({key: self._built[key]}))
            reset.props(f'disabled aria-label="Reset: {size.name}"')
            said = ui.label().props("role=status").classes("sinew-warn")
        self._rows[key] = _Row(slider, number, reset, said)

        async def moved(event: Any) -> None:
            await self._put({key: float(event.args)})

        async def typed(event: Any) -> None:
            if event.value is not None and size.low <= event.value <= size.high:
                await self._put({key: float(event.value)})

        async def left() -> None:
            if number.value is None:
                self._show_value(key)
            else:
                await self._put({key: float(number.value)})

        number.on("blur", left, []).on("keydown.enter", left, [])
        slider.on("update:model-value", moved, throttle=_THROTTLE_S, leading_events=True, trailing_events=True)
        number.on_value_change(typed)

    async def begin(self) -> None:
        """Show the joint that was designed here last, else the rig as built, with the curves that are known."""
        kept = await recall(self._kept_as)
        known = _values_of(kept, self._built, self._ranges)
        if known:
            self._now.values = known[0]
            for values in known[1:]:
                self._pinned(values)
        for key in _SIZES:
            self._show_value(key)
        joints = [self._now, self._as_built, *self._kept]
        for joint in joints:
            joint.found = await asyncio.to_thread(kept_curves, *self._asked(joint.values))
            joint.is_fine = joint.found is not None
        self._draw()
        self._tabulate()
        await self._list_rigs()
        ui.timer(0.0, self._save_what_was_left, once=True)
        if self._now.found is None:
            await self._change()
        else:
            self._tell(self._now.found, fine=True)
            self._await(is_outdated=False)
            with suppress(SinewError):  # what cannot be sketched is said when a slider asks for it
                await self._curves_of(self._now.values, "sketch_curves")
                self._is_sketched = True
            if not self._is_outdated:
                self._arrived()
        self._site.work.warm_up()
        if self._now.found is not None and self._now.found.get("is_shipped"):
            await self._compute(self._turn, self._present_curves("design_curves"), fine=True)
        for joint in joints[1:]:
            if joint.found is None or joint.found.get("is_shipped"):
                await self._finish(joint)

    async def _list_rigs(self) -> None:
        """Offer what is on the shelf of rigs now."""
        try:
            shelves = await self._site.work.call("shelf", str(self._site.runs))
        except SinewError:  # what was offered stays; a rig is not needed to move a slider
            return
        rigs = {self._rig_name: self._rig_name, self._site.rig: self._site.rig}
        self._rigs.set_options(rigs | in_words(shelves["rigs"], self._site.rig), value=self._rig_name)

    def _go_to(self, event: events.ValueChangeEventArguments[str]) -> None:
        if event.value != self._rig_name:
            ui.navigate.to("/design" if event.value == self._site.rig else f"/design?{urlencode({'rig': event.value})}")

    def _await(self, *, is_outdated: bool) -> None:
        """Count from now on, where nothing is counted yet, how long a sketch is waited for."""
        self._awaited_from, self._is_outdated = self._awaited_from or monotonic(), is_outdated
        self._clock.activate()

    def _count(self) -> None:
        """Say how long it has been, and grey what is old, where that is not over before anybody could look."""
        if self._awaited_from is None or (spent := monotonic() - self._awaited_from) < _AWAITED_S:
            return
        said = [_COMPUTES if self._is_sketched else _COMPILES, f"{spent:.0f} s so far."]
        self._waiting.set_text(" ".join([*said, _OUTDATED] if self._is_outdated else said))
        self._waiting.set_visibility(True)
        self._grey(self._is_outdated)

    def _arrived(self) -> None:
        self._awaited_from, self._is_outdated = None, False
        self._clock.deactivate()
        self._waiting.set_visibility(False)
        self._grey(False)

    def _grey(self, is_old: bool) -> None:
        for part in self._dated:
            part.classes(add="stale") if is_old else part.classes(remove="stale")

    async def _put(self, values: Mapping[str, float]) -> None:
        """Set some sliders, each within its ends, and show what comes of it."""
        asked, values = values, {key: self._within(key, value) for key, value in values.items()}
        changed = [key for key, value in values.items() if value != self._now.values[key]]
        self._now.values |= {key: values[key] for key in changed}
        for key in asked:
            if values[key] != asked[key]:
                self._rows[key].said.set_text(f"{values[key]:g} {_SIZES[key].unit} is the end of this slider.")
                self._show_value(key)
            elif key in changed:
                self._rows[key].said.set_text("")
        if not changed:
            return  # the last of a burst comes twice, and slider and number tell each other
        if changed == [_DRAWN_ONLY]:
            self._show_asked(changed)
            self._draw()
        else:
            await self._change(changed)

    def _show_asked(self, changed: Sequence[str]) -> None:
        """Show what some sliders were set to, and have the browser remember it."""
        for key in changed:
            self._show_value(key)
        if set(changed) - {"pretension_mm"}:
            self._suggestion.set_text("")
            self._use.set_visibility(False)
        remember(self._kept_as, [one.values for one in (self._now, *self._kept)])

    def _within(self, key: str, value: float) -> float:
        return min(max(value, self._ranges[key].low), self._ranges[key].high)

    def _show_value(self, key: str) -> None:
        row, value = self._rows[key], self._now.values[key]
        row.slider.set_value(value)
        row.slider.props(f'aria-valuetext="{value:g} {_SIZES[key].unit}"')
        row.number.set_value(value)
        is_built = value == self._built[key]
        row.reset.props("disabled") if is_built else row.reset.props(remove="disabled")

    async def _change(self, changed: Sequence[str] = ()) -> None:
        """Show the curves of the joint as it is now: a sketch at once, the fine ones when the sliders rest.

        changed: sliders that have another value than the page shows.
        """
        self._turn += 1
        turn, self._now.is_fine = self._turn, False
        sketch = asyncio.ensure_future(self._present_curves("sketch_curves"))
        await asyncio.sleep(0)  # it is under way before the page is laid out for what is asked
        if changed:
            self._show_asked(changed)
        self._await(is_outdated=True)
        self._fill_table()
        await self._compute(turn, sketch, fine=False)
        await asyncio.sleep(_SETTLED_S)
        if turn == self._turn:
            await self._compute(turn, self._present_curves("design_curves"), fine=True)

    def _present_curves(self, name: str) -> Coroutine[Any, Any, Any]:
        """Return what to await for the curves of the joint as it is now; of those that wait the newest is run."""
        return self._curves_of(dict(self._now.values), name, key=f"{name} {id(self)}")

    async def _compute(self, turn: int, asked: Awaitable[Any], *, fine: bool) -> None:
        try:
            found = await asked
        except SinewError as trouble:
            found = {"trouble": str(trouble)}
        if found is None or (fine and turn != self._turn) or self._table.is_deleted:
            return
        self._arrived()
        if "trouble" not in found:
            self._now.found, self._now.is_fine, self._is_sketched = found, fine, self._is_sketched or not fine
        else:
            self._grey(True)
        if turn != self._turn:
            self._await(is_outdated=True)
        self._draw()
        self._tell(found, fine)
        if fine:
            self._fill_table()

    async def _curves_of(self, values: Mapping[str, float], name: str, key: str | None = None) -> Any:
        more = [True] if name == "design_curves" else []
        call = self._site.work.call(name, *self._asked(values), *more, key=key)
        return await unless_left(call, self._client.disconnected())

    def _asked(self, values: Mapping[str, float]) -> tuple[str, dict[str, float], float, float, tuple[float, float]]:
        return self._rig_toml, self._changes(values), values["pretension_mm"], values["amplitude_deg"], _BAND_HZ

    def _changes(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return what differs from the rig as built, as options of `sinew predict`."""
        sizes = {key: size for key, size in _SIZES.items() if size.key is not None and values[key] != self._built[key]}
        return {str(size.key): size.scale * values[key] for key, size in sizes.items()}

    async def _finish(self, joint: _Joint) -> None:
        """Compute the refined curve of a joint that stands beside the present one."""
        try:
            joint.found = await self._curves_of(joint.values, "design_curves")
        except SinewError as trouble:
            say(str(trouble))
            return
        joint.is_fine = True
        if not self._table.is_deleted:
            self._draw()
            self._fill_table()

    def _draw(self) -> None:
        """Draw what is known of all joints; it computes nothing."""
        joints = [one for one in (self._now, self._as_built, *self._kept) if one.found is not None]
        folds = self._now.found["folds"] if self._now.found else []
        marks = [(f["frequency_hz"], f["gain"], "fold") for f in folds]
        for curves, what, marked in ((self._gain, "gain", marks), (self._phase, "phase_deg", [])):
            curves.marked_hz, curves.marks = self._now.values[_DRAWN_ONLY], marked
            curves.draw([_curve(one, what) for one in joints])

    def _tell(self, found: dict[str, Any], fine: bool) -> None:
        trouble = found.get("trouble", "")
        said = ("",) * len(self._notes) if trouble else _sentences(found, fine)
        for label, sentence in zip((self._trouble, *self._notes), (trouble, *said), strict=True):
            label.set_text(sentence)
            label.set_visibility(bool(sentence))
        if trouble:
            return
        if found["validity"] is not None:  # of a sketch it is not asked; what is known stays meanwhile
            self._checks.clear()
            with self._checks:
                for check in found["validity"]:
                    if not check["holds"]:
                        ui.label(f"Mind: {check['sentence']}").classes("sinew-warn")

    # Joints are kept beside the present one.

    def _pinned(self, values: Mapping[str, float]) -> _Joint:
        taken = {one.name for one in self._kept}
        letter = next(letter for letter in _LETTERS if f"joint {letter}" not in taken)
        self._kept.append(_Joint(f"joint {letter}", dict(values), 2 + _LETTERS.index(letter)))
        return self._kept[-1]

    async def _pin(self) -> None:
        if len(self._kept) >= _MOST_KEPT:
            say(f"{_MOST_KEPT} joints are kept already; remove one first.")
            return
        joint = self._pinned(self._now.values)
        if self._now.is_fine:
            joint.found, joint.is_fine = self._now.found, True
        self._note_kept()
        if not joint.is_fine:
            await self._finish(joint)

    def _unpin(self, joint: _Joint) -> None:
        self._kept.remove(joint)
        self._note_kept()

    def _note_kept(self) -> None:
        remember(self._kept_as, [one.values for one in (self._now, *self._kept)])
        self._draw()
        self._tabulate()

    def _tabulate(self) -> None:
        """Lay the joints side by side, with how each differs from the rig as built."""
        self._table.clear()
        with self._table, ui.element("table").classes("sinew-joints"):
            with ui.element("thead"), ui.element("tr"):
                for text in _HEADS:
                    _cell("th", text, "scope=col")
            with ui.element("tbody"):
                self._cells = [(one, self._joint_row(one)) for one in (self._as_built, self._now, *self._kept)]
        self._fill_table()

    def _fill_table(self) -> None:
        """Say in the table what is known of its joints; before it is laid out there is nothing to say it in."""
        for joint, cells in self._cells:
            built = None if joint is self._as_built else self._as_built.found
            numbers = _numbers(joint.found if joint.is_fine else None, built)
            for cell, text in zip(cells, (_different(joint.values, self._built), *numbers), strict=True):
                cell.set_text(text)

    def _joint_row(self, joint: _Joint) -> list[ui.label]:
        """Lay out a joint's row, and return the cells whose texts change."""
        with ui.element("tr"):
            _cell("th", joint.name, "scope=row")
            cells = [_cell("td", "") for _ in _HEADS[1:-1]]
            with ui.element("td"):
                if joint in self._kept:
                    with ui.element("div").classes("sinew-row"):
                        plain_button("Use", "", lambda: self._put(joint.values)).props(f'aria-label="Use {joint.name}"')
                        plain_button("Remove", "", lambda: self._unpin(joint)).props(
                            f'aria-label="Remove {joint.name}"'
                        )
        return cells

    # A pretension is suggested, and a joint becomes a rig.

    async def _suggested(self) -> None:
        wanted = self._now.values[_DRAWN_ONLY]
        self._suggestion.set_text(f"Joints of other pretensions are swung until one resonates at {wanted:g} Hz.")
        with self._searching:
            ui.spinner(size="1.5rem").props('aria-label="A pretension is looked for"')
            count_seconds("Looked for")
        self._suggest.props("disabled")
        self._use.set_visibility(False)
        values = dict(self._now.values)
        asked = self._rig_toml, self._changes(values), values["wanted_hz"], values["amplitude_deg"]
        try:
            found = await self._site.work.call("suggest_pretension", *asked)
        except SinewError as trouble:
            found = {"pretension_mm": None, "sentence": str(trouble)}
        self._searching.clear()
        self._suggest.props(remove="disabled")
        best = found["pretension_mm"]
        if any(self._now.values[key] != values[key] for key in values if key != "pretension_mm"):
            self._suggestion.set_text("The sliders were moved meanwhile; ask again.")
            return
        if best is None:
            self._suggestion.set_text(found["sentence"])
            return
        said = f"{quantity(best, 'mm')}: " if None not in (best.get("interval90") or [None]) else ""
        self._suggestion.set_text(f"{said}{found['sentence']}")
        self._best = round(best["value"], 2)
        self._use.set_visibility(True)

    async def _use_suggestion(self) -> None:
        await self._put({"pretension_mm": self._best})

    async def _rig(self, name: str, values: Mapping[str, float]) -> tuple[str, str] | None:
        """Return (name of its file, text) of a joint as a rig; None where it cannot be one, which is said."""
        if not is_run_name(name.replace(" ", "_")):
            self._saved.set_text(f"A rig's name takes {SHELF_NAME}.")
            return None
        try:
            text = await self._site.work.call("rig_text", self._rig_toml, self._changes(values), name)
        except SinewError as trouble:
            self._saved.set_text(str(trouble))
            return None
        return f"{name.removesuffix('.toml')}.toml", text

    async def _ask_to_save(self) -> None:
        await self._put_on_shelf((self._name.value or "").strip(), dict(self._now.values))

    async def _save_what_was_left(self) -> None:
        """Save the rig whose saving was under way when this browser left the page."""
        told = await recall(self._saving_as)
        if isinstance(told, dict) and isinstance(told.get("name"), str):
            await self._put_on_shelf(told["name"], _values_of([told], self._built, self._ranges)[0])

    async def _put_on_shelf(self, name: str, values: dict[str, float]) -> None:
        """Have the operator's browser put the rig on the shelf; over another one only when asked a second time.

        It alone has the leave to do so, and remembers until then what it is about.
        """
        self._saved.set_text(_SAVES)
        self._plan_it.set_visibility(False)
        self._save.props("data-operator=busy")
        remember(self._saving_as, {"name": name, **values})
        made = await self._rig(name, values)
        if self._saved.is_deleted:
            return
        remember(self._saving_as, None)
        if made is not None:
            told = {"shelf": "rigs", "name": made[0], "text": made[1], "replace": made[0] == self._replacing}
            answer = await steer("shelve", told)
            self._replacing = made[0] if answer.get("exists") else None
            unknown = "Not saved." if answer else "Whether it is saved is not known; the page Plan lists the rigs."
            self._saved.set_text(answer.get("sentence") or unknown)
            self._plan_it.props(f'href="/plan?{urlencode({"rig": made[0]})}"')
            self._plan_it.set_visibility(bool(answer.get("ok")))
            await self._list_rigs()
        self._save.props("data-operator=ready")

    async def _download(self) -> None:
        self._saved.set_text("The rig is being made.")
        if (made := await self._rig((self._name.value or "").strip(), self._now.values)) is not None:
            self._saved.set_text("")
            ui.download.content(made[1], made[0])


def _ranges(rig: RigSpec) -> dict[str, _Size]:
    """Return the sliders with the ends that a rig gives them."""
    (low, high), (_, travel) = rig.limits.pretension_mm, rig.limits.tendon_travel_mm
    pretension = _SIZES["pretension_mm"]._replace(low=max(0.0, low), high=min(high, travel))
    return {**_SIZES, "pretension_mm": pretension}


def _sizes(rig: RigSpec) -> dict[str, float]:
    """Return where the sliders of a rig begin."""
    limits = _ranges(rig)["pretension_mm"]
    return {
        "length_mm": round(1e3 * rig.silicone.length.value, 3),
        "outer_mm": round(1e3 * rig.silicone.diameter.value, 3),
        "tendon_circle_mm": round(1e3 * rig.tendons.head_radius.value, 3),
        "lever_g_m2": round(1e3 * rig.inertia.lever.value, 3),
        "pretension_mm": min(max(4.0, limits.low), limits.high),
        "amplitude_deg": 20.0,
        "wanted_hz": 3.6,
    }


def _values_of(kept: Any, built: Mapping[str, float], ranges: Mapping[str, _Size]) -> list[dict[str, float]]:
    """Return the sliders' values of what a browser keeps, the present joint first, as far as they can be meant."""
    found = []
    for told in kept if isinstance(kept, list) else []:
        values = dict(built)
        for key, size in ranges.items():
            number = told.get(key) if isinstance(told, dict) else None
            if isinstance(number, (int, float)) and size.low <= number <= size.high:
                values[key] = float(number)
        found.append(values)
    return found[: 1 + _MOST_KEPT]


def _curve(joint: _Joint, what: str) -> Curve:
    assert joint.found is not None
    found = joint.found
    return Curve(joint.name, found["frequency_hz"], found[what], (), (), True, found["stable"], joint.number)


_HEADS = (
    "joint",
    "differs from the rig in",
    "resonance f / Hz (90° of lag)",
    "difference / %",
    "largest gain",
    "difference / %",
    "at / Hz",
    "damping D (slope of the lag)",
    "use it, or remove it",
)


def _numbers(found: dict[str, Any] | None, built: dict[str, Any] | None) -> list[str]:
    """Return the cells of a joint: resonance, gain, where that is, damping; and how the first two differ."""
    if found is None:
        return ["…"] * 6

    def told(what: str, part: str, digits: int) -> tuple[str, str]:
        mark, other = found[what], built and built[what]
        if mark is None:
            return "–", "–"
        difference = "" if not other else f"{100 * (mark[part] / other[part] - 1):+.1f}"
        return f"{mark[part]:.{digits}f}", difference

    damping = "–" if found["damping"] is None else f"{found['damping']:.3f}"
    return [*told("phase_90", "frequency_hz", 3), *told("peak", "gain", 3), told("peak", "frequency_hz", 3)[0], damping]


def _different(values: Mapping[str, float], built: Mapping[str, float]) -> str:
    told = [
        f"{size.name.lower()} {values[key]:g} {size.unit}"
        for key, size in _SIZES.items()
        if key != _DRAWN_ONLY and values[key] != built[key]
    ]
    return ", ".join(told) or "nothing"


def _cell(tag: str, text: str, props: str = "") -> ui.label:
    with ui.element(tag).props(props):
        return ui.label(text)


def _sentences(found: dict[str, Any], fine: bool) -> tuple[str, str, str, str]:
    """Return what is to be said of a predicted curve, of its peak, its lag of 90°, its folds and its worth; empty where
    it has none."""
    peak, lag, folds = found["peak"], found["phase_90"], len(found["folds"])
    many = f"{folds} folds: between them a sweep up and one down differ"
    worth = f"{100 * found['error_estimate']:.2g} % of the curve's height"
    how = f"Refined, to {worth}" if fine else f"A sketch while sliders move, right to {worth}"
    return (
        f"Largest gain {peak['gain']:.3f} at {peak['frequency_hz']:.3f} Hz" if peak else "",
        f"Lag of 90° behind the lever at {lag['frequency_hz']:.3f} Hz" if lag else "",
        many if folds else "No fold: one motion at each frequency",
        f"{how}; what the parameters leave open is not in it",
    )
