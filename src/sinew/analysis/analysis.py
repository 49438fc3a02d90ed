"""Analysis of a whole recording: sweep, resonance, energy and ring-down in one dataset, with what speaks against it."""

import json
from typing import Any

import numpy as np
import xarray as xr

from sinew.analysis.decay.ring_down import ring_downs_of
from sinew.analysis.doubts import find_doubts
from sinew.analysis.signal.groups import split_by_drive
from sinew.analysis.signal.repeats import combine_repeats
from sinew.analysis.signal.signals import Signals, read_signals
from sinew.analysis.sweep.energy import estimate_energy
from sinew.analysis.sweep.resonance import FEWEST_FREQUENCIES, estimate_resonance, read_resonances
from sinew.analysis.sweep.response import response_dataset, response_of
from sinew.measure.arrays import mean_of_known
from sinew.measure.doors import as_dataset
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate, finite
from sinew.measure.files.netcdf import content_hash, provenance
from sinew.measure.schema import RESULTS_SCHEMA, validate_results
from sinew.plan.rig import RigSpec


def analyse_recording(recording: xr.Dataset, rig: RigSpec | None = None) -> xr.Dataset:
    """Return the results of a recording, valid by the result schema, with provenance in the attributes.

    rig: whose sensor chain and inertia are used; None for a foreign recording (perfect sensors, no k and d).
    The sweep part is there if the recording has steady segments (those without a frequency are first split by their
    drive), the resonance part if these hold six frequencies or more, the ring-down part if there are ring-downs.
    Attributes: `recording_hash`, `response_unit`, `drive_unit`, `effects_off` (of the twin, names with spaces between,
    empty for none), `resonance_notes`, `ring_down_notes`, `idle_power_w` (beside the energy part; by data sheet),
    `doubts` (JSON, see `sinew.analysis.doubts`) and those of `provenance`.
    Raises RecordingError where the recording holds neither a steady segment nor a ring-down, or cannot be analysed.
    """
    as_dataset(recording, "recording")
    kinds = set(map(str, recording["kind"].values))
    if not kinds & {"steady", "ring-down"}:
        found = ", ".join(sorted(kinds))
        raise RecordingError(f"nothing to analyse: found only {found} segments, expected steady ones or ring-downs")
    signals = read_signals(split_by_drive(recording), rig)
    parts: list[xr.Dataset] = []
    notes = ""
    if "steady" in kinds:
        response = response_of(signals)
        sweep = response_dataset(response)
        if response.frequency_hz.size >= FEWEST_FREQUENCIES:
            readings = read_resonances(response)
            resonance = estimate_resonance(response, readings)
            notes = str(resonance.attrs["resonance_notes"])
            sweep = sweep.assign(resonance.data_vars)
            energy = estimate_energy(signals, response, readings.value["resonance_hz"])
            if energy is not None:
                sweep = sweep.assign(energy.data_vars).assign_attrs(energy.attrs)
        else:
            count = response.frequency_hz.size
            notes = (
                f"too few frequencies for a resonance: found {count}, expected at least {FEWEST_FREQUENCIES}; "
                "measure more"
            )
        parts.append(sweep)
    if "ring-down" in kinds:
        inertia = None if rig is None else rig.inertia.head.value + rig.inertia.lever.value
        try:
            parts.append(ring_downs_of(signals, inertia))
        except RecordingError as error:
            if not parts:
                raise
            parts[0].attrs["ring_down_notes"] = f"no ring-down could be analysed: {error}"
    results = join_parts(parts)
    told = {key: value for part in parts for key, value in part.attrs.items() if str(key).endswith(_TOLD)}
    results.attrs = {**_attributes(recording, signals), **told, "resonance_notes": notes}
    doubts = [doubt.to_json() for doubt in find_doubts(results, signals)]
    results.attrs["doubts"] = json.dumps(doubts, ensure_ascii=False)
    return validate_results(results)


_TOLD = ("_notes", "idle_power_w")


def _attributes(recording: xr.Dataset, signals: Signals) -> dict[str, Any]:
    """Return the provenance of results: what the recording says of itself, its hash, and this program's versions."""
    kept = recording.attrs
    seed = int(kept.get("seed", -1))
    return provenance(
        str(kept.get("source", "import")),
        rig=str(kept.get("rig", "")),
        plan=str(kept.get("plan", "")),
        seed=None if seed < 0 else seed,
        schema=RESULTS_SCHEMA,
        recording_hash=str(kept.get("content_hash") or content_hash(recording)),
        effects_off=str(kept.get("effects_off", "")),
        recording_versions=str(kept.get("versions", "")),
        response_unit="rad" if signals.response.is_rate else signals.response.unit,
        drive_unit="" if signals.drive is None else signals.drive.unit,
    )


def join_parts(parts: list[xr.Dataset]) -> xr.Dataset:
    """Return the parts on one pretension axis and one repeat axis, NaN where a part has nothing there.

    A number stays at its pretension and at its repeat, by their coordinates.
    """
    if len(parts) == 1:
        return parts[0]
    return xr.merge(parts, join="outer", compat="no_conflicts", combine_attrs="override")


def response_table_json(results: xr.Dataset) -> list[dict[str, Any]]:
    """Return the response table, one row per pretension and frequency that was measured, ready for JSON.

    Numbers without an interval are means over repeats; gain_measured_drive and phase_lag_deg are
    `{"value", "std", "interval90"}` of that mean, the latter with the delay budget's uncertainty. `settled` is true
    where every repeat had settled. What was not measured is null. Raises RecordingError where there is no sweep.
    """
    if "gain" not in results:
        raise RecordingError("these results hold no sweep; analyse a recording with steady segments")
    columns = {str(name): results[name].values for name in results.data_vars}
    delay = mean_of_known(columns["phase_delay_std_rad"])
    gain = combine_repeats(columns["gain_measured_drive"], columns["gain_measured_drive_std"])
    lag = combine_repeats(columns["phase_lag_rad"], columns["phase_std_rad"], np.inf, np.nan_to_num(delay))
    plain, settled = {name: mean_of_known(columns[name]) for name in _PLAIN}, mean_of_known(columns["settled"])
    rows = []
    for p, f in np.ndindex(*delay.shape):
        repeats = int(np.isfinite(columns["distortion"][p, f]).sum())
        if not repeats:
            continue
        row: dict[str, Any] = {
            "pretension_mm": float(results["pretension_mm"].values[p]),
            "frequency_hz": float(results["frequency_hz"].values[f]),
            "repeats": repeats,
        }
        row |= {name: finite(float(mean[p, f])) for name, mean in plain.items()}
        for name, part, scale in (("gain_measured_drive", gain, 1.0), ("phase_lag_deg", lag, 180.0 / np.pi)):
            numbers = (part.value[p, f], part.std_of_value[p, f], part.low[p, f], part.high[p, f])
            row[name] = Estimate(*(float(number) * scale for number in numbers)).to_json()
        row["settled"] = bool(settled[p, f] == 1.0)
        rows.append(row)
    return rows


_PLAIN = (
    "gain",
    "gain_harmonic",
    "amplitude_rad",
    "amplitude_peaks_rad",
    "drive_amplitude_rad",
    "distortion",
    "drive_distortion",
    "drift_per_period",
    "saturated_share",
    "drive_current_rms_a",
)
