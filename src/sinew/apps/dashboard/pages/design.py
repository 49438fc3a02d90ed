"""The design page: sliders of a joint, and what the equations say of it at once."""

import asyncio
from typing import Any

from nicegui import ui

from sinew.apps.dashboard.pages.curves import Curve, Curves
from sinew.apps.dashboard.pages.frame import Site, card, empty, framed, heading, quantity
from sinew.measure.errors import SinewError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig

_THROTTLE_S = 0.05
_SETTLED_S = 0.4
_BAND_HZ = (1.0, 6.0)


def add_design_page(site: Site) -> None:
    """Serve the page for designing at /design."""

    @ui.page("/design")
    async def design() -> None:
        with framed(site, "Design", "/design"):
            heading("Design a joint")
            sliders = _Sliders(site)
            sliders.lay_out()
            await ui.context.client.connected()
            await sliders.change()
            site.work.warm_up()


class _Sliders:
    """One viewer's joint while it is designed."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._rig_toml = site.rig_text(site.rig)
        self._values = _sizes(parse_rig(self._rig_toml))
        self._turn = 0

    def lay_out(self) -> None:
        """Lay out sliders, curves and what is to know of them."""
        with ui.element("div").classes("sinew-grid"):
            with card("Joint", 4):
                for key, label, low, high, step in _SLIDERS:
                    self._slider(key, label, low, high, step)
                self._suggest = ui.button("Suggest a pretension", on_click=self._suggested).props(
                    "id=sinew-suggest no-caps unelevated color=primary"
                )
                self._suggestion = ui.label().props("id=sinew-suggestion role=status").classes("sinew-soft")
            with ui.element("div").classes("span-8 sinew-stack"):
                with card("Gain: torsion over commanded amplitude", 12):
                    self._gain = Curves("gain")
                    self._gain.element.props("id=sinew-design-gain")
                with card("Phase: lag of the torsion", 12):
                    self._phase = Curves("phase")
                with card("What it is worth", 12):
                    self._notes = ui.element("div").props("role=status").classes("sinew-stack")
                    with self._notes:
                        empty("The equations are being compiled; that takes some seconds once.")

    def _slider(self, key: str, label: str, low: float, high: float, step: float) -> None:
        with ui.element("div").classes("w-full"):
            said = ui.label().props(f"id=sinew-label-{key}")
            slider = ui.slider(min=low, max=high, step=step, value=self._values[key])
            slider.props(f'id=sinew-slider-{key} aria-label="{label}" dense')

        def write() -> None:
            said.set_text(f"{label.rpartition(' / ')[0]}: {self._values[key]:g} {label.rpartition(' / ')[2]}")

        async def moved(event: Any) -> None:
            value = float(event.args)
            if value == self._values[key]:
                return  # the last of a burst comes twice
            self._values[key] = value
            write()
            await self.change()

        slider.on("update:model-value", moved, throttle=_THROTTLE_S, leading_events=True, trailing_events=True)
        write()

    async def change(self) -> None:
        """Show the curves of the joint as it is now: a sketch at once, the fine ones when the sliders rest."""
        self._turn += 1
        turn = self._turn
        await self._compute(turn, fine=False)
        await asyncio.sleep(_SETTLED_S)
        if turn == self._turn:
            await self._compute(turn, fine=True)

    async def _compute(self, turn: int, *, fine: bool) -> None:
        changes = {key: self._values[key] for key, *_ in _SLIDERS if key not in _NOT_THE_RIG}
        values = self._values
        asked: list[Any] = [self._rig_toml, changes, values["pretension_mm"], values["amplitude_deg"], _BAND_HZ]
        name = "design_curves" if fine else "sketch_curves"
        try:
            found = await self._site.work.call(name, *asked, *([True] if fine else []), key=f"{name} {id(self)}")
        except SinewError as trouble:
            found = {"trouble": str(trouble)}
        if found is not None and (turn == self._turn or not fine):
            self._show(found, fine)

    def _show(self, found: dict[str, Any], fine: bool) -> None:
        self._notes.clear()
        with self._notes:
            if "trouble" in found:
                ui.label(found["trouble"]).classes("sinew-bad")
                return
            for sentence in _sentences(found, fine):
                ui.label(sentence).props("id=sinew-peak" if sentence.startswith("Largest") else "")
            for check in found["validity"]:
                if not check["holds"]:
                    ui.label(f"Mind: {check['sentence']}").classes("sinew-warn")
        marks = [(f["frequency_hz"], f["gain"], "fold") for f in found["folds"]]
        for curves, values, marked in ((self._gain, "gain", marks), (self._phase, "phase_deg", [])):
            curves.marked_hz, curves.marks = self._values["wanted_hz"], marked
            curves.draw([Curve("this joint", found["frequency_hz"], found[values], (), (), True, found["stable"], 0)])

    async def _suggested(self) -> None:
        self._suggestion.set_text("Looking for it; this takes some seconds.")
        changes = {key: self._values[key] for key, *_ in _SLIDERS if key not in _NOT_THE_RIG}
        try:
            found = await self._site.work.call(
                "suggest_pretension", self._rig_toml, changes, self._values["wanted_hz"], self._values["amplitude_deg"]
            )
        except SinewError as trouble:
            self._suggestion.set_text(str(trouble))
            return
        if found["pretension_mm"] is None:
            self._suggestion.set_text(found["sentence"])
            return
        self._suggestion.set_text(f"{quantity(found['pretension_mm'], 'mm')}: {found['sentence']}")


_NOT_THE_RIG = ("pretension_mm", "amplitude_deg", "wanted_hz")
_SLIDERS = (
    ("length_mm", "Length of the silicone / mm", 60.0, 150.0, 1.0),
    ("outer_mm", "Diameter of the silicone / mm", 40.0, 80.0, 0.5),
    ("tendon_circle_mm", "Radius of the guides' circle / mm", 15.0, 60.0, 0.5),
    ("lever_inertia_kg_m2", "Inertia of the lever / kg m²", 0.004, 0.02, 0.0002),
    ("pretension_mm", "Pretension / mm", 0.0, 12.0, 0.25),
    ("amplitude_deg", "Amplitude of the command / °", 2.0, 30.0, 0.5),
    ("wanted_hz", "Wanted resonance / Hz", 1.0, 6.0, 0.05),
)


def _sizes(rig: RigSpec) -> dict[str, float]:
    """Return where the sliders begin: at the rig that is offered first."""
    return {
        "length_mm": round(1e3 * rig.silicone.length.value, 1),
        "outer_mm": round(1e3 * rig.silicone.diameter.value * 2) / 2,
        "tendon_circle_mm": round(1e3 * rig.tendons.head_radius.value * 2) / 2,
        "lever_inertia_kg_m2": round(rig.inertia.lever.value, 4),
        "pretension_mm": 4.0,
        "amplitude_deg": 20.0,
        "wanted_hz": 3.6,
    }


def _sentences(found: dict[str, Any], fine: bool) -> list[str]:
    """Return what is to be said of a predicted curve."""
    peak, lag, folds = found["peak"], found["phase_90"], len(found["folds"])
    said = []
    if peak:
        said.append(f"Largest gain {peak['gain']:.3f} at {peak['frequency_hz']:.3f} Hz")
    if lag:
        said.append(f"Lag of 90° behind the lever at {lag['frequency_hz']:.3f} Hz")
    many = f"{folds} folds: between them a sweep up and one down differ"
    said.append(many if folds else "No fold: one motion at each frequency")
    worth = f"{100 * found['error_estimate']:.2g} % of the curve's height"
    how = f"Refined, to {worth}" if fine else f"A sketch while sliders move, right to {worth}"
    return [*said, f"{how}; sinew predict --bands tells what the parameters leave open"]
