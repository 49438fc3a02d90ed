"""This is where a rig's recording is cut into the records of one pretension and one repeat, ready for a fit."""

import numpy as np
import xarray as xr

from sinew.analysis.sensor import DelayBudget, delay_budget, torsion_chain, torsion_delay
from sinew.analysis.torsion import drive_channel, response_channel
from sinew.identify.record import FEWEST, Record, make_record
from sinew.measure.recording import Segment, iterate_segments
from sinew.plan.rig import RigSpec

__all__ = ["CAPPED", "records_by_repeat"]

CAPPED = 10
"""Most steady segments of one fit: what more of them tell is not worth their time."""
_SETTLED_HZ = 3.0  # of a decay that does not say its frequency, for the sensors' delay


def records_by_repeat(recording: xr.Dataset, rig: RigSpec | None = None) -> dict[float, dict[int, list[Record]]]:
    """Return the records of a recording by pretension [mm] and repeat.

    Steady segments under the measured lever, evenly thinned to `CAPPED`, those with the largest motion among them;
    where a pretension has none, its ring-downs, under the measured lever too (it recoils), or free where no drive was
    recorded. The sensors' delay and what they take off the amplitude are undone, by the rig's delay budget.
    Nothing is returned of a pretension whose segments cannot be used: a drive that is no angle, a steady segment
    without a drive.
    """
    drive = drive_channel(recording)
    budget = delay_budget(recording, rig)
    found: dict[float, dict[int, list[Record]]] = {}
    rows = list(iterate_segments(recording))
    for pretension in sorted({segment.pretension_mm for _, segment, _ in rows}):
        mine = [(segment, where) for _, segment, where in rows if segment.pretension_mm == pretension]
        steady = [row for row in mine if row[0].kind == "steady" and np.isfinite(row[0].frequency_hz)]
        lever = drive is not None and drive.unit == "rad"
        taken = steady if lever and steady else [row for row in mine if row[0].kind == "ring-down"]
        for repeat in sorted({segment.repeat for segment, _ in taken}):
            chosen = _thinned(recording, [row for row in taken if row[0].repeat == repeat])
            records = [_record(recording, segment, where, budget, lever=lever) for segment, where in chosen]
            if records:
                found.setdefault(float(pretension), {})[repeat] = records
    return found


def _thinned(recording: xr.Dataset, rows: list[tuple[Segment, slice]]) -> list[tuple[Segment, slice]]:
    """Return at most `CAPPED` rows: every second one down from the largest motion, the rest spread over the others."""
    rows = [row for row in rows if row[1].stop - row[1].start >= FEWEST]
    if len(rows) <= CAPPED:
        return rows
    response = response_channel(recording)
    size = [
        float(np.ptp(response.values[where])) / (segment.frequency_hz if response.is_rate else 1.0)
        for segment, where in rows
    ]
    largest = list(np.argsort(size)[::-1][: CAPPED // 2])
    others = [i for i in range(len(rows)) if i not in largest]
    spread = np.linspace(0, len(others) - 1, CAPPED - len(largest)).round().astype(int)
    return [rows[i] for i in sorted({*map(int, largest), *(others[k] for k in spread)})]


def _record(recording: xr.Dataset, segment: Segment, where: slice, budget: DelayBudget, *, lever: bool) -> Record:
    response, drive = response_channel(recording), drive_channel(recording)
    frequency = segment.frequency_hz if segment.frequency_hz > 0 else _SETTLED_HZ
    driven = lever and drive is not None
    return make_record(
        recording["time_s"].values[where],
        response.values[where] / float(abs(torsion_chain(budget, frequency))),
        drive.values[where] if driven and drive is not None else None,
        excitation="lever" if driven else "none",
        output_unit=response.unit,
        input_unit="rad" if driven else "1",
        output_delay_s=torsion_delay(budget, frequency) - budget.drive_delay_s,
        group=f"{segment.pretension_mm:g} mm",
    )
