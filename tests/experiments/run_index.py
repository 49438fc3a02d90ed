"""A folder of runs of a year: an oscillator whose resonance falls as it ages, drawn by chance.

Of a hundred runs the results of one are cut short, and one is a stranger's folder.
"""

import os
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sinew.measure import recording as schema
from sinew.measure.files.netcdf import provenance, save_dataset
from sinew.plan.toml import dump_rig, load_rig

FALLS_HZ = 0.012
"""By how much the resonance of the joint falls in a month."""

BEGAN = datetime(2026, 1, 5, 9, tzinfo=UTC)
PRETENSIONS_MM = (2.0, 6.0)
_FREQUENCIES_HZ = np.linspace(2.0, 5.0, 13)
_REPEATS = 3
_MONTHS = 12.0

_DAYS_OF_A_MONTH = 365.2425 / 12
_HASH, _PLAN = "0" * 64, 'name = "weekly"\n'


def make_runs(folder: Path, count: int, seed: int = 0) -> None:
    """Write the results of so many runs of a year into a folder."""
    random = np.random.default_rng(seed)
    for number in range(count):
        run = folder / f"run-{number:04d}"
        run.mkdir(parents=True)
        months = _MONTHS * number / max(1, count - 1)
        path = run / "results.nc"
        if number % 100 == 51:
            (run / "readme.txt").write_text("somebody else's folder\n", encoding="utf-8")
            continue
        plan = _PLAN.replace("weekly", "aged") if number % 10 == 0 else _PLAN
        save_dataset(synthetic_results(months, random, plan), path)
        if number % 100 == 50:
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        at = (BEGAN + timedelta(days=_DAYS_OF_A_MONTH * months)).timestamp()
        os.utime(path, (at, at))


@cache
def _rig() -> str:
    return dump_rig(load_rig("paper").model_copy(update={"name": "bench"}))


def synthetic_results(months: float, random: np.random.Generator, plan: str = _PLAN) -> xr.Dataset:
    """Return the results of a run of a joint of so many months, valid by the schema."""
    sizes = {"pretension_mm": len(PRETENSIONS_MM), "frequency_hz": _FREQUENCIES_HZ.size, "repeat": _REPEATS}
    axes = {
        "pretension_mm": np.array(PRETENSIONS_MM),
        "frequency_hz": _FREQUENCIES_HZ,
        "repeat": np.arange(1, _REPEATS + 1),
    }
    resonance = 2.9 + 0.08 * np.array(PRETENSIONS_MM) - FALLS_HZ * months + 0.01 * random.normal(size=2)
    damping = 0.09 + 0.004 * random.normal(size=(2, _REPEATS))
    ratio = _FREQUENCIES_HZ[None, :, None] / resonance[:, None, None]
    noise = 1 + 0.01 * random.normal(size=(2, _FREQUENCIES_HZ.size, _REPEATS))
    gain = noise / np.hypot(1 - ratio**2, 2 * damping.mean() * ratio)
    known = {
        "gain": gain,
        "amplitude_rad": 0.3 * gain,
        "amplitude_std_rad": 0.003 * gain,
        "gain_measured_drive": gain,
        "gain_measured_drive_std": 0.01 * gain,
        "phase_lag_rad": np.broadcast_to(np.arctan2(2 * 0.09 * ratio, 1 - ratio**2), gain.shape),
        "phase_std_rad": np.full(gain.shape, 0.01),
        "phase_delay_std_rad": np.full(gain.shape, 0.01),
        "settled": np.ones(gain.shape),
        "saturated_share": np.zeros(gain.shape),
        "damping_ratio": damping,
        "decay_frequency_hz": resonance[:, None] + 0.003 * np.array([-1.0, 0.0, 1.0]),
    }
    centres = {"resonance_hz": (resonance, 0.006), "gain_peak": (gain.mean(-1).max(1), 0.04)}
    for name, (value, std) in centres.items():
        own, low, high = schema.companions(name)
        known |= {
            name: value,
            own: np.full(2, std * np.sqrt(_REPEATS)),
            low: value - 1.69 * std,
            high: value + 1.69 * std,
        }
    rows = {
        name: row
        for name, row in schema.RESULT_VARIABLES.items()
        if row.dims and set(row.dims) <= set(axes) and name not in axes and name not in _LEFT_OUT
    }
    variables = {}
    for name, row in rows.items():
        values = known.get(name, np.full([sizes[dim] for dim in row.dims], np.nan))
        unit = "rad" if row.unit == "*" else row.unit
        variables[name] = (row.dims, values, {"units": unit, "long_name": row.meaning})
    made = xr.Dataset(variables, {name: schema.result_axis(name, values) for name, values in axes.items()})
    more: dict[str, Any] = {
        "schema": schema.RESULTS_SCHEMA,
        "recording_hash": _HASH,
        "response_unit": "rad",
        "drive_unit": "rad",
    }
    more |= {"resonance_notes": "", "doubts": "[]", "effects_off": "", "recording_versions": ""}
    return schema.validate_results(made.assign_attrs(provenance("bench", rig=_rig(), plan=plan, **more)))


_LEFT_OUT = {
    *schema.POWER_COLUMNS,
    *(column for name in schema.ENERGY_QUANTITIES for column in (name, *schema.companions(name))),
}
