"""The growing curve of a run: each recorded group analysed, beside what was predicted for the plan."""

import asyncio
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.hub import Hub, Live
from sinew.apps.dashboard.worker import Work
from sinew.measure.errors import SinewError
from sinew.plan.toml import parse_plan

_LOOK_S = 0.5
_DRAWS = 40
_BAND = "Points: mean and 90 % interval over repeats. Band: 90 %, from what the rig's calibration leaves open."
_COMING = "Points: mean and 90 % interval over repeats. The band of the prediction is being computed."
_NO_BAND = (
    "Points: mean and 90 % interval over repeats. The prediction has no band: nothing is known of how certain this "
    "rig's parameters are; sinew calibrate finds out."
)


@dataclass
class Results:
    """What is known of the run that the hub follows.

    predicted: for each pretension `pretension_mm`, `frequency_hz`, `gain`, `phase` [deg], and where the rig knows how
    certain it is `gain_low`, `gain_high`, `phase_low`, `phase_high` of the 90 % band. measured: for each pretension
    `pretension_mm`, `frequency_hz`, and `gain`, `phase` as {"value", "std", "interval90"}. damping: of ring-downs.
    remark: what is to be said of the prediction and its band. notes: on groups that could not be analysed. trouble: why
    something is missing. version: rises with every change.
    """

    hub: Hub
    work: Work
    runs: Path
    predicted: list[dict[str, Any]] = field(default_factory=list)
    measured: list[dict[str, Any]] = field(default_factory=list)
    damping: list[dict[str, Any]] = field(default_factory=list)
    remark: str = ""
    notes: list[str] = field(default_factory=list)
    version: int = 0
    trouble: str = ""

    async def run(self) -> None:
        """Follow the hub until cancelled."""
        epoch, done = 0, -1
        predicting: asyncio.Task[None] | None = None
        while True:
            live = self.hub.live
            if live is not None and live.epoch != epoch:
                epoch, done = live.epoch, -1
                self.predicted, self.measured, self.damping, self.remark = [], [], [], ""
                self.notes, self.trouble = [], ""
                self.version += 1
                if predicting is not None:
                    predicting.cancel()
                predicting = asyncio.create_task(self._predict(live))
            if live is not None and live.groups_done != done:
                done = live.groups_done if await self._measure(live) else -1
            await asyncio.sleep(_LOOK_S)

    async def _predict(self, live: Live) -> None:
        """Predict the curves first, then their bands, which take longer."""
        for draws in (0, _DRAWS):
            try:
                found = await self.work.call("prediction_for_plan", live.plan_toml, live.rig_toml, draws)
            except SinewError as trouble:
                self._complain(f"There is no prediction: {trouble}")
                return
            self.predicted = numbered(found["curves"], live)
            has_bands, can_have = "gain_low" in found["curves"][0], found["can_have_bands"]
            self.remark = _BAND if has_bands else _COMING if can_have else _NO_BAND
            self.version += 1
            if not can_have:
                return

    async def _measure(self, live: Live) -> bool:
        """Analyse what is new; return whether that went well."""
        pending = 1
        while pending:
            try:
                found = await self.work.call("measured_so_far", str(self.runs / live.name / JOURNAL))
            except SinewError as trouble:
                self._complain(f"What was measured cannot be analysed: {trouble}")
                return False
            self._show(found, live)
            pending = found["pending"]
        return True

    def _complain(self, sentence: str) -> None:
        if sentence != self.trouble:
            self.trouble = sentence
            self.version += 1

    def _show(self, found: dict[str, Any], live: Live) -> None:
        self.measured, self.damping = numbered(found["curves"], live), found["damping"]
        self.notes = found["notes"]
        self.version += 1


def numbered(curves: list[dict[str, Any]], live: Live) -> list[dict[str, Any]]:
    """Return curves with the number of their colour, the place of their pretension in the plan."""
    order = list(parse_plan(live.plan_toml).pretension.pretension_mm)
    return [{**curve, "number": order.index(curve["pretension_mm"])} for curve in curves]
