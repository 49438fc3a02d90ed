"""The design page: sliders of a joint, what the equations say of it at once, and joints side by side."""

import asyncio
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple
from urllib.parse import urlencode

from nicegui import background_tasks, events, ui

from sinew.apps.dashboard.folders import is_run_name
from sinew.apps.dashboard.pages.curves import Curve, Curves
from sinew.apps.dashboard.pages.frame import Site, card, empty, framed, heading
from sinew.apps.dashboard.pages.plan import (
    LIBRARY_NAME,
    in_words,
    plain_button,
    say,
    steer,
    why_not,
)
from sinew.apps.dashboard.worker import unless_left
from sinew.measure.errors import SinewError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig

_THROTTLE_S = 0.05
_BAND_HZ = (1.0, 6.0)
_AWAITED_S = 0.3


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
}
_AWAITED = "The curve of this joint is being computed: some seconds where its equations are compiled first."


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
        self._values = dict(self._built)
        self._found: dict[str, Any] | None = None  # of `design_curves`, as that of the rig as built
        self._as_built: dict[str, Any] | None = None
        self._rows: dict[str, _Row] = {}
        self._turn = 0
        self._is_awaited = False  # whether a curve of the present joint is computed, and none of it is there
        self._replacing: str | None = None  # what the next saving may take the place of

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
                    plain_button("Reset all", "sinew-reset", lambda: self._put(self._built))
                with ui.element("div").classes("sinew-row"):
                    self._name = ui.input("Name of the rig", value="my joint").props(
                        "outlined dense for=sinew-rig-name"
                    )
                    plain_button("Save as rig", "sinew-rig-save", self._put_in_library, steers=True)
                    plain_button("Download", "sinew-rig-download", self._download)
                    why_not()
                self._saved = ui.label().props("id=sinew-rig-state role=status").classes("sinew-soft")
                self._plan_it = ui.link("Plan a run with it", "/plan")
                self._plan_it.set_visibility(False)
            with ui.element("div").classes("span-8 sinew-stack"):
                with card("Gain: torsion over commanded amplitude", 12) as gain:
                    self._waiting = empty(_AWAITED).props("id=sinew-compiling role=status")
                    self._waiting.set_visibility(False)
                    self._gain = Curves("gain")
                    self._gain.element.props("id=sinew-design-gain")
                with card("Phase: lag of the torsion", 12) as phase:
                    self._phase = Curves("phase")
                with card("What it is worth", 12) as worth:
                    with ui.element("div").props("role=status").classes("sinew-stack"):
                        self._notes = [
                            ui.label().props(f"id=sinew-{name}")
                            for name in ("peak", "lag", "damping", "folds", "worth")
                        ]
                    self._trouble = ui.label().props("role=alert").classes("sinew-bad")
                    self._trouble.set_visibility(False)
                    self._checks = ui.element("div").classes("sinew-stack")
        self._dated, self._client = (gain, phase, worth), ui.context.client

    def _slider(self, key: str, size: _Size) -> None:
        value, called = self._values[key], f"{size.name} / {size.unit}"
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
        """Show the rig as built, and compute its curves."""
        for key in _SIZES:
            self._show_value(key)
        background_tasks.create(self._await())
        await self._list_rigs()
        try:
            self._as_built = await self._curves_of(self._built)
        except SinewError as trouble:
            say(str(trouble))
        await self._change()

    async def _list_rigs(self) -> None:
        """Offer what is in the library of rigs now."""
        try:
            libraries = await self._site.work.call("library", str(self._site.runs))
        except SinewError:  # what was offered stays; a rig is not needed to move a slider
            return
        rigs = {self._rig_name: self._rig_name, self._site.rig: self._site.rig}
        self._rigs.set_options(rigs | in_words(libraries["rigs"], self._site.rig), value=self._rig_name)

    def _go_to(self, event: events.ValueChangeEventArguments[str]) -> None:
        if event.value != self._rig_name:
            ui.navigate.to("/design" if event.value == self._site.rig else f"/design?{urlencode({'rig': event.value})}")

    async def _await(self) -> None:
        """Say that a curve is computed, and grey what is old, where that is not over before anybody could look."""
        if not self._is_awaited:
            self._is_awaited = True
            await asyncio.sleep(_AWAITED_S)
            if self._is_awaited and not self._trouble.is_deleted:
                self._waiting.set_visibility(True)
                self._grey(True)

    def _grey(self, is_old: bool) -> None:
        for part in self._dated:
            part.classes(add="stale") if is_old else part.classes(remove="stale")

    async def _put(self, values: Mapping[str, float]) -> None:
        """Set some sliders, each within its ends, and show what comes of it."""
        wanted, values = values, {key: self._within(key, value) for key, value in values.items()}
        changed = [key for key, value in values.items() if value != self._values[key]]
        self._values |= {key: values[key] for key in changed}
        for key in wanted:
            if values[key] != wanted[key]:
                self._rows[key].said.set_text(f"{values[key]:g} {_SIZES[key].unit} is the end of this slider.")
                self._show_value(key)
            elif key in changed:
                self._rows[key].said.set_text("")
        if not changed:
            return  # the last of a burst comes twice, and slider and number tell each other
        await self._change(changed)

    def _within(self, key: str, value: float) -> float:
        return min(max(value, self._ranges[key].low), self._ranges[key].high)

    def _show_value(self, key: str) -> None:
        row, value = self._rows[key], self._values[key]
        row.slider.set_value(value)
        row.slider.props(f'aria-valuetext="{value:g} {_SIZES[key].unit}"')
        row.number.set_value(value)
        is_built = value == self._built[key]
        row.reset.props("disabled") if is_built else row.reset.props(remove="disabled")

    async def _change(self, changed: Sequence[str] = ()) -> None:
        """Show the curves of the joint as it is now. changed: sliders that have another value than the page shows."""
        self._turn += 1
        turn = self._turn
        under_way = asyncio.ensure_future(self._curves_of(self._values, key=f"design_curves {id(self)}"))
        await asyncio.sleep(0)  # it is under way before the page is laid out for what is asked
        for key in changed:
            self._show_value(key)
        background_tasks.create(self._await())
        try:
            found = await under_way
        except SinewError as trouble:
            found = {"trouble": str(trouble)}
        if found is None or self._trouble.is_deleted:
            return  # another joint was asked for since; of those that wait the newest is computed
        self._is_awaited = False
        self._waiting.set_visibility(False)
        self._grey("trouble" in found)
        if turn != self._turn:
            background_tasks.create(self._await())
        if "trouble" not in found:
            self._found = found
        self._tell(found)
        self._draw()

    async def _curves_of(self, values: Mapping[str, float], key: str | None = None) -> Any:
        joint = self._rig_toml, self._changes(values), values["pretension_mm"], values["amplitude_deg"], _BAND_HZ
        return await unless_left(self._site.work.call("design_curves", *joint, key=key), self._client.disconnected())

    def _changes(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return what differs from the rig as built, as options of `sinew predict`."""
        sizes = {key: size for key, size in _SIZES.items() if size.key is not None and values[key] != self._built[key]}
        return {str(size.key): size.scale * values[key] for key, size in sizes.items()}

    def _draw(self) -> None:
        """Draw what is known of the joint and of the rig as built; it computes nothing."""
        joints = {"this joint": self._found, "as built": self._as_built}
        self._gain.marks = [(f["frequency_hz"], f["gain"], "fold") for f in (self._found or {"folds": []})["folds"]]
        for curves, what in ((self._gain, "gain"), (self._phase, "phase")):
            curves.draw(
                [
                    Curve(name, found["frequency_hz"], found[what], (), (), True, found["stable"], number)
                    for number, (name, found) in enumerate(joints.items())
                    if found is not None
                ]
            )

    def _tell(self, found: dict[str, Any]) -> None:
        trouble = found.get("trouble", "")
        said = ("",) * len(self._notes) if trouble else _sentences(found, self._as_built)
        for label, sentence in zip((self._trouble, *self._notes), (trouble, *said), strict=True):
            label.set_text(sentence)
            label.set_visibility(bool(sentence))
        if not trouble:
            self._checks.clear()
            with self._checks:
                for sentence in found["warnings"]:
                    ui.label(f"Mind: {sentence}").classes("sinew-warn")

    async def _rig(self) -> tuple[str, str] | None:
        """Return (name of its file, text) of the joint as a rig; None where it cannot be one, which is said."""
        name = (self._name.value or "").strip()
        if not is_run_name(name.replace(" ", "_")):
            self._saved.set_text(f"A rig's name takes {LIBRARY_NAME}.")
            return None
        try:
            text = await self._site.work.call("rig_text", self._rig_toml, self._changes(self._values), name)
        except SinewError as trouble:
            self._saved.set_text(str(trouble))
            return None
        return f"{name.removesuffix('.toml')}.toml", text

    async def _put_in_library(self) -> None:
        """Have the viewer's browser put the rig in the library; over another one only when asked a second time."""
        self._saved.set_text("The rig is being saved.")
        self._plan_it.set_visibility(False)
        if (made := await self._rig()) is None:
            return
        request = {"library": "rigs", "name": made[0], "text": made[1], "replace": made[0] == self._replacing}
        answer = await steer("store", request)
        self._replacing = made[0] if answer.get("exists") else None
        unknown = "Not saved." if answer else "Whether it is saved is not known; the page Plan lists the rigs."
        self._saved.set_text(answer.get("sentence") or unknown)
        self._plan_it.props(f'href="/plan?{urlencode({"rig": made[0]})}"')
        self._plan_it.set_visibility(bool(answer.get("ok")))
        await self._list_rigs()

    async def _download(self) -> None:
        self._saved.set_text("The rig is being made.")
        if (made := await self._rig()) is not None:
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
    }


def _sentences(found: dict[str, Any], built: dict[str, Any] | None) -> tuple[str, ...]:
    """Return what is to be said of a predicted curve: of its peak, its lag of 90°, its damping, its folds and its
    worth; empty where it has none. built: that of the rig as built, from which peak and lag differ."""

    def at(mark: str, key: str) -> str:
        value, other = found[mark][key], built and built[mark]
        off = f" ({100 * (value / other[key] - 1):+.1f} % against the rig as built)" if other else ""
        return f"{value:.3f}{' Hz' if key == 'frequency_hz' else ''}{off}"

    damping, folds = found["damping"], len(found["folds"])
    many = f"{folds} folds: between them a sweep up and one down differ"
    worth = f"{100 * found['error_estimate']:.2g} % of the curve's height"
    return (
        f"Largest gain {at('peak', 'gain')} at {at('peak', 'frequency_hz')}" if found["peak"] else "",
        f"Lag of 90° behind the lever at {at('phase_90', 'frequency_hz')}" if found["phase_90"] else "",
        f"Lehr's damping by the slope of the lag there: {damping:.3f}" if damping is not None else "",
        many if folds else "No fold: one motion at each frequency",
        f"Right to {worth}; what the parameters leave open is not in it",
    )
