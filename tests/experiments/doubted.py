"""Doubts under trial: good recordings of the twin raise none, and recordings of a spoiled bench raise theirs.

Good: every tendon mode, several joints (the paper's, a short one, one without guide friction, a stiff one), all
effects and noise, with and without what the twin foretold. Spoiled: the same with one thing wrong that the rig file
does not know of.
"""

from typing import Any

import numpy as np
import xarray as xr

from sinew.analysis.analysed import analyse_recording
from sinew.analysis.doubts import doubts_of, expected_text
from sinew.measure.recording import iterate_segments
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan
from sinew.twin.parameters import Effects
from sinew.twin.simulate import simulate

PLAN = """
name = "doubted"
sample_hz = 200
[pretension]
pretension_mm = [2, 9]
mode = "{mode}"
rest_s = 1
[sweep]
frequency_hz = [1.6, 2.2, 2.8, 3.2, 3.6, 4.0, 4.4, 5.0]
amplitude_deg = {amplitude}
settle_s = 3
periods = 5
repeats = 1
[ring_down]
frequency_hz = [3, 4]
amplitude_deg = {amplitude}
drive_s = 3
record_s = 3
repeats = 1
"""


def the_plan(mode: str = "position", amplitude: float = 20.0) -> Plan:
    return parse_plan(PLAN.format(mode=mode, amplitude=amplitude))


def scaled_gyro(recording: xr.Dataset, factor: float) -> xr.Dataset:
    return recording.assign(gyro_rad_s=recording["gyro_rad_s"] * factor)


def swapped_axes(recording: xr.Dataset) -> xr.Dataset:
    gyro = recording["gyro_rad_s"]
    return recording.assign(gyro_rad_s=gyro.copy(data=gyro.values[:, [2, 1, 0]]))


def frozen(recording: xr.Dataset, name: str, for_s: float = 0.6) -> xr.Dataset:
    """Return the recording with one channel standing still in the middle of a steady segment."""
    rate = 1.0 / float(np.median(np.diff(recording["time_s"].values[:50])))
    values = recording[name].values.copy()
    _, _, where = next(one for one in iterate_segments(recording, "steady"))
    first = where.start + (where.stop - where.start) // 4
    values[first : first + round(for_s * rate)] = values[first]
    return recording.assign({name: recording[name].copy(data=values)})


def changed(rig: RigSpec, **factors: float) -> RigSpec:
    """Return a rig with some parameters (`part__name`) times a factor, its bounds notwithstanding."""
    for name, factor in factors.items():
        part, row = (getattr(rig, name.split("__")[0]), name.split("__")[1])
        parameter = getattr(part, row).model_copy(update={"value": getattr(part, row).value * factor})
        rig = rig.model_copy(update={name.split("__")[0]: part.model_copy(update={row: parameter})})
    return rig


def expected_of(plan: Plan, rig: RigSpec) -> str:
    quiet = Effects().without("sensor_noise", "stamp_jitter", "repeatability")
    return expected_text(analyse_recording(simulate(plan, rig, effects=quiet), rig))


def doubts(recording: xr.Dataset, rig: RigSpec) -> list[dict[str, Any]]:
    return [one.to_dict() for one in doubts_of(analyse_recording(recording, rig))]
