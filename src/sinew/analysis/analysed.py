"""What an analysis answers: results, the document of `sinew analyse`, and its tables."""

import json
import math
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import xarray as xr

from sinew.analysis.broadband.broadband import analyse_broadband, broadband_json, checked_count
from sinew.analysis.broadband.impact import analyse_impacts, impact_json
from sinew.analysis.decay.modes import fit_modes, modes_json
from sinew.analysis.decay.ring_down import (
    analyse_ring_down,
    analyse_ring_downs,
    ring_down_json,
    ring_downs_beside,
)
from sinew.analysis.doubts import doubt_decays, doubt_samples, doubts_of
from sinew.analysis.kinds import as_kind, find_kind, recorded_kind
from sinew.analysis.signal.attitude import tilting
from sinew.analysis.signal.groups import split_by_drive
from sinew.analysis.signal.repeats import combine_repeats, interval_rows
from sinew.analysis.signal.signals import Signals, drive_channel, read_signals, response_channel
from sinew.analysis.sweep.coupling import analyse_coupling, coupling_rows
from sinew.analysis.sweep.energy import estimate_energy
from sinew.analysis.sweep.resonance import RESONANCES, estimate_resonance, read_resonances
from sinew.analysis.sweep.response import estimate_response, response_dataset
from sinew.analysis.tracked import tracking_document, tracking_told
from sinew.measure.arrays import mean_of_known
from sinew.measure.doors import as_dataset
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import (
    Estimate,
    finite,
    number,
    pair,
    shown,
    shown_interval,
    span,
)
from sinew.measure.files.csv import refuse_bridge
from sinew.measure.files.netcdf import content_hash, load_part, load_recording, provenance
from sinew.measure.recording import FEWEST_FREQUENCIES, too_few_frequencies
from sinew.measure.schema import ENERGY_QUANTITIES, RESULTS_SCHEMA, ReadKind, companions, validate_results
from sinew.measure.tasks import with_one_blas_thread
from sinew.measure.told import Table, Told

if TYPE_CHECKING:
    from sinew.plan.rig import RigSpec


@dataclass(frozen=True, repr=False)
class Analysed(Told):
    """What a recording says of its oscillation.

    document: as `sinew analyse --json` prints it: every quantity with value, std and interval90. recording: as it was
    analysed, its groups cut. dataset: the results by the result schema; None for one foreign ring-down, for a record of
    many frequencies or of hammer blows and for a resonance that was tracked, which are in the document. notes: what was
    done with the recording, or could not be, a sentence each.
    """

    document: dict[str, Any]
    recording: xr.Dataset
    dataset: xr.Dataset | None = None
    notes: tuple[str, ...] = ()

    def told(self) -> list[Table | str]:
        """Return tables and sentences in the order of reading."""
        document = self.document
        told: list[Table | str] = [f"DOUBT: {one['sentence']}" for one in document.get("doubts", [])]
        if document["kind"] == "ring-down":
            return [*told, *_ring_down_told(document, self.recording)]
        if document["kind"] in ("broadband", "impact"):
            return _broadband_told(document)
        if document.get("pose"):
            told += _space_told(document)
        if document.get("response"):
            told.append(_response_table(document["response"]))
        if document.get("resonance"):
            told.append(_resonance_table(document["resonance"]))
        if document.get("energy"):
            told += _energy_told(document["energy"])
        if document.get("tracking"):
            told += tracking_told(document["tracking"])
        if document.get("ring_down"):
            rows = [
                [number(row["pretension_mm"]), *(shown(row.get(key)) for key in _DECAY_COLUMNS)]
                for row in document["ring_down"]
            ]
            columns = ("pretension/mm", *_DECAY_COLUMNS.values())
            told.append(Table(columns, rows, "ring-downs: mean ± standard deviation of it"))
            if moved := _misfit_of_decays(document["ring_down"]):
                told.append(moved)
        return told


@with_one_blas_thread
def analyse(
    recording: xr.Dataset | str | Path,
    rig: "RigSpec | str | Path | None" = None,
    *,
    settle_s: float | None = None,
    kind: ReadKind | None = None,
    band_hz: tuple[float, float] | None = None,
    modes: int | None = None,
    segment_s: float | None = None,
) -> Analysed:
    """Return frequency and damping of a ring-down, or response, resonance, energy and ring-downs of a recording.

    Of a foreign record whose drive holds many frequencies (broadband: chirp, noise, multisine) or strikes (impact: one
    hammer blow or several): its frequency response (H1, H2, coherence), and the modes in it.

    recording: as `sn.read` or `sn.simulate` gives it, or the path of a NetCDF recording. rig: whose sensor delays and
    inertia count; else the recording's own. settle_s: of the sweep of a foreign file: how long each group settles
    before it is measured [s]; else its half. kind: what a foreign record holds; None for what it was read as, "auto" to
    find out, which puts the reason into the document (`kind_reason`) and the notes. band_hz, segment_s: of a broadband
    record or hammer blows, see `sinew.analysis.broadband.{broadband, impact}`. modes: how many are sought in them, or
    in a foreign ring-down, which else has those that stand out of its noise.

    A foreign ring-down is one record: its longest part is analysed. Raises RecordingError where there is nothing to
    analyse, SpecError where the recording does not take what is asked.

    >>> import numpy as np, pandas as pd
    >>> import sinew as sn
    >>> t = np.arange(0, 4, 0.01)
    >>> swing = pd.DataFrame({"t": t, "phi": 20 * np.exp(-1.2 * t) * np.cos(2 * np.pi * 3 * t)})
    >>> found = sn.analyse(sn.read(swing, time="t", response="phi:deg"))
    >>> round(found.document["frequency_hz"]["value"], 2)
    3.0
    """
    if isinstance(recording, (str, Path)):
        recording = load_recording(recording)
    if not isinstance(recording, xr.Dataset) or "kind" not in recording:
        raise RecordingError(
            f"found {type(recording).__name__} without segments, expected a recording as read, simulate and run give it"
        )
    if kind is not None and kind not in get_args(ReadKind):
        raise SpecError(f"found kind {kind!r}, expected one of {', '.join(get_args(ReadKind))}, or none")
    if recording.attrs.get("source") != "import":
        return _analyse_own(recording, rig, kind, (settle_s, band_hz, modes, segment_s))
    notes = str(recording.attrs.get("import_notes", "")).splitlines()
    asked = recorded_kind(recording) if kind is None else kind
    told: dict[str, Any] = {}
    if asked == "auto":
        found = find_kind(recording)
        asked, told = found.kind, {"kind_reason": found.reason}
        notes = [f"taken for {_KIND_WORDS[asked]}: {found.reason}; its kind can be said", *notes]
    if recording.attrs.get("import_gaps") == "bridge":
        refuse_bridge(asked)
    recording = as_kind(recording, asked)
    if asked in ("broadband", "impact"):
        if settle_s is not None or rig is not None:
            raise SpecError(f"a time to settle and a rig have no part in {_KIND_WORDS[asked]}; leave them out")
        if asked == "broadband":
            answer = analyse_broadband(recording, band_hz=band_hz, modes=modes, segment_s=segment_s)
            document = broadband_json(answer)
        else:
            impact = analyse_impacts(recording, band_hz=band_hz, modes=modes, segment_s=segment_s)
            answer, document = impact.found, impact_json(impact)
        return Analysed(document | told, recording, None, (*answer.notes, *notes))
    if band_hz is not None or segment_s is not None:
        raise SpecError("band and length of a segment are for a broadband record or hammer blows; leave them out")
    if asked == "ring-down":
        if settle_s is not None:
            raise SpecError("a time to settle is for a sweep, this is a ring-down; its decay is found by itself")
        document, cut = _foreign_ring_down(recording, rig, modes)
        return Analysed(document | told, recording, None, (*cut, *notes))
    if modes is not None:
        raise SpecError(_NO_MODES)
    recording = _grouped(recording, settle_s)
    results = analyse_with(recording, recording_rig(recording, rig))
    document = {"kind": "sweep", **told, **_sweep_part(results)}
    return Analysed(document, recording, results, (*_notes_of(document, results), *notes))


_KIND_WORDS = {
    "ring-down": "a ring-down",
    "sweep": "a sweep of steady stretches",
    "broadband": "a broadband record",
    "impact": "a record of hammer blows",
}
_NO_MODES = "a number of modes is for a ring-down of a table, a broadband record or hammer blows; leave it out"


def _analyse_own(
    recording: xr.Dataset, rig: "RigSpec | str | Path | None", kind: str | None, of_others: tuple[Any, ...]
) -> Analysed:
    """Return what a recording of Sinew says, which takes none of (settle_s, band_hz, modes, segment_s)."""
    settle_s, band_hz, modes, segment_s = of_others
    if kind not in (None, "auto"):
        raise SpecError(f"a kind, here {kind}, is of a table; this recording says itself what it holds; leave it out")
    if band_hz is not None or segment_s is not None:
        raise SpecError("band and length of a segment are for a broadband record or hammer blows; leave them out")
    if modes is not None:
        raise SpecError(_NO_MODES)
    if settle_s is not None:
        raise SpecError(
            "a time to settle is for the sweep of a foreign file; this recording says itself where it settles"
        )
    used = recording_rig(recording, rig)
    notes = str(recording.attrs.get("import_notes", "")).splitlines()
    kinds = set(map(str, recording["kind"].values))
    tracking = {}
    if "tracking" in kinds:
        if used is None:
            raise RecordingError("this recording tracks a resonance and names no rig, expected one; name it (--rig)")
        tracking = {"tracking": tracking_document(recording, used)}
        if not kinds & {"steady", "ring-down"}:
            return Analysed({"kind": "recording", "doubts": [], **tracking}, recording, None, tuple(notes))
    results = analyse_with(recording, used)
    document = results_document(results) | tracking
    return Analysed(document, recording, results, (*notes, *_notes_of(document, results)))


def _notes_of(document: dict[str, Any], results: xr.Dataset) -> list[str]:
    """Return why there is no resonance, no coupling and no decay in bending, where there is none."""
    reasons = [] if "resonance" in document else [str(results.attrs["resonance_notes"])]
    reasons += [str(results.attrs.get(name, "")) for name in ("coupling_notes", "sway_notes")]
    return [reason for reason in reasons if reason]


# A whole recording: sweep, resonance, energy and ring-down in one dataset, with what speaks against it.


@with_one_blas_thread
def analyse_recording(recording: xr.Dataset, rig: "RigSpec | None" = None) -> xr.Dataset:
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
    signals = everything = read_signals(split_by_drive(recording), rig)
    parts: list[xr.Dataset] = []
    sweep, notes, in_space = xr.Dataset(), "", {}
    if signals.pose is not None:
        signals = signals.moved_by("lever", "impulse-torsion")
        in_space = _in_space(everything, parts)
        kinds = {segment.kind for segment, _ in signals.segments}
    beside = ring_downs_beside(signals, _inertia(rig)) if "ring-down" in kinds else nullcontext()
    with beside as decays:
        if "steady" in kinds:
            sweep, notes = _sweep(signals)
            parts.append(sweep)
        doubts = doubt_samples(sweep, signals)
        if decays is not None:
            try:
                parts.append(decays())
            except RecordingError as error:
                if not parts:
                    raise
                parts[0].attrs["ring_down_notes"] = f"no ring-down could be analysed: {error}"
        if not parts:
            raise RecordingError(str(in_space["coupling_notes"] or in_space["sway_notes"]))
        results = join_parts(parts)  # in here, for the other process ends meanwhile
        told = {key: value for part in parts for key, value in part.attrs.items() if str(key).endswith(_TOLD)}
        results.attrs = {**_attributes(recording, signals), **told, **in_space, "resonance_notes": notes}
        doubts = sorted([*doubts, *doubt_decays(results, signals)], key=lambda doubt: -doubt.distance)
        results.attrs["doubts"] = json.dumps([doubt.to_json() for doubt in doubts], ensure_ascii=False)
        return validate_results(results)


_TOLD = ("_notes", "idle_power_w", "coupling_drive")


def _sweep(signals: Signals) -> tuple[xr.Dataset, str]:
    """Return the part of the results that steady segments make, and why a pretension has no resonance."""
    response = estimate_response(signals)
    sweep = response_dataset(response)
    if response.frequency_hz.size < FEWEST_FREQUENCIES:
        return sweep, too_few_frequencies(response.frequency_hz.size)
    readings = read_resonances(response)
    resonance = estimate_resonance(response, readings)
    sweep = sweep.assign(_variables(resonance))
    energy = estimate_energy(signals, response, readings.value["resonance_hz"])
    if energy is not None:
        sweep = sweep.assign(_variables(energy)).assign_attrs(energy.attrs)
    return sweep, str(resonance.attrs["resonance_notes"])


def _variables(part: xr.Dataset) -> dict[str, xr.Variable]:
    """Return what a part of the results holds, without its axes: a tenth of the time that arrays with axes take."""
    return {str(name): part.variables[name] for name in part.data_vars}


# A head that bends or sways has more to tell: the coupling of its steady segments, and decays that are no torsion's.


def _in_space(signals: Signals, parts: list[xr.Dataset]) -> dict[str, Any]:
    """Return the attributes that results of a bent or swaying head have further; adds its part, if there is one.

    `pose`, `sway_ring_downs` (JSON); `coupling_notes`, `sway_notes`: why there is none of it, where one was asked for.
    """
    assert signals.pose is not None
    bend, azimuth = np.degrees([signals.pose.bend, signals.pose.azimuth])
    told = {"pose": json.dumps({"bend_deg": float(bend), "azimuth_deg": float(azimuth)})}
    told |= {"coupling_notes": "", "sway_notes": "", "sway_ring_downs": "[]"}
    if any(True for _ in signals.of_kind("steady")):
        try:
            parts.append(analyse_coupling(signals))
        except RecordingError as error:
            told["coupling_notes"] = f"no coupling could be analysed: {error}"
    rows: list[dict[str, Any]] = []
    for excitation in ("pitch", "roll", "impulse-pitch", "impulse-roll"):
        decays = tilting(signals, excitation)
        if decays is not None:
            try:
                found = analyse_ring_downs(decays)
            except RecordingError as error:
                told["sway_notes"] = f"no decay in {excitation} could be analysed: {error}"
                continue
            rows += [{"excitation": excitation, **row} for row in decay_rows(found)]
            if not parts:
                parts.append(xr.Dataset(coords={"pretension_mm": found["pretension_mm"]}))
    return told | {"sway_ring_downs": json.dumps(rows)}


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

    Numbers without an interval are means over repeats, and gain_std is the standard deviation of that of the gain;
    gain_measured_drive and phase_lag_deg are `{"value", "std", "interval90"}` of that mean, the latter with the delay
    budget's uncertainty. `settled` is true where every repeat had settled. What was not measured is null. Raises
    RecordingError where there is no sweep.
    """
    if "gain" not in results:
        raise RecordingError("these results hold no sweep; analyse a recording with steady segments")
    columns = {str(name): variable.values for name, variable in results.variables.items()}
    delay = mean_of_known(columns["phase_delay_std_rad"])
    gain = combine_repeats(columns["gain_measured_drive"], columns["gain_measured_drive_std"])
    lag = combine_repeats(columns["phase_lag_rad"], columns["phase_std_rad"], np.inf, np.nan_to_num(delay))
    size = np.where(columns["amplitude_rad"] > 0, columns["amplitude_rad"], np.nan)
    scatter = combine_repeats(columns["gain"], columns["gain"] * columns["amplitude_std_rad"] / size).std_of_value
    plain, settled = {name: mean_of_known(columns[name]) for name in _PLAIN}, mean_of_known(columns["settled"])
    pretension, frequency = (results[axis].values.tolist() for axis in ("pretension_mm", "frequency_hz"))
    rows = []
    for p, f in np.ndindex(*delay.shape):
        repeats = int(np.isfinite(columns["distortion"][p, f]).sum())
        if not repeats:
            continue
        row: dict[str, Any] = {
            "pretension_mm": pretension[p],
            "frequency_hz": frequency[f],
            "repeats": repeats,
        }
        row |= {name: finite(float(mean[p, f])) for name, mean in plain.items()}
        row["gain_std"] = finite(float(scatter[p, f]))
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


def recording_rig(recording: xr.Dataset, rig: "RigSpec | str | Path | None") -> "RigSpec | None":
    """Return the rig that was named, else the one in the recording, else None. Raises SpecError if it is bad."""
    from sinew.plan.toml import load_rig, parse_rig  # no table needs it

    if rig is not None:
        return load_rig(rig) if isinstance(rig, (str, Path)) else rig
    text = str(recording.attrs.get("rig", ""))
    return parse_rig(text, source="the recording's rig") if text.strip() else None


def analyse_with(recording: xr.Dataset, rig: "RigSpec | None") -> xr.Dataset:
    """Return the results of a recording; their attribute `rig` is the rig they were made with.

    rig: whose inertia and sensor delays are used; None for perfect sensors and no inertia.
    """
    from sinew.plan.toml import dump_rig

    results = analyse_recording(recording, rig)
    return results if rig == recording_rig(recording, None) else results.assign_attrs(rig=dump_rig(rig) if rig else "")


def _inertia(rig: "RigSpec | None") -> float | None:
    """Return the inertia of head and lever [kg m²]."""
    return None if rig is None else rig.inertia.head.value + rig.inertia.lever.value


def _grouped(recording: xr.Dataset, settle_s: float | None) -> xr.Dataset:
    if drive_channel(recording) is None:
        raise RecordingError("a sweep needs the drive beside the response; name the column of its drive")
    if settle_s is None:
        return split_by_drive(recording)
    if not 0 <= settle_s < math.inf:
        raise SpecError(f"found {settle_s:g} s to settle, expected a time of 0 s or more")
    grouped = split_by_drive(recording, settle_s=settle_s)
    if grouped is recording:
        raise SpecError("the time to settle comes too late, the groups of this recording are cut already; leave it out")
    return grouped


def _foreign_ring_down(
    recording: xr.Dataset, named: "RigSpec | str | Path | None", modes: int | None
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the document of the longest part of a record, and which that is; gaps split a record into parts."""
    rig = None if named is None else recording_rig(recording, named)
    signals = read_signals(recording)
    longest = max((where for _, where in signals.segments), key=lambda where: where.stop - where.start)
    time, response = signals.time_s[longest], signals.response
    values, drive = response.values[longest], None if signals.drive is None else signals.drive.values[longest]
    result = analyse_ring_down(
        time,
        values,
        drive=drive,
        is_rate=response.is_rate,
        unit=response.unit,
        inertia_kg_m2=_inertia(rig),
    )
    document = dict(ring_down_json(result))
    notes = result.remarks
    if modes is not None:
        count = checked_count(modes)
        several = fit_modes(time, values, drive=drive, unit=response.unit, free_from_s=result.start_s, modes=count)
        document["modes"] = modes_json(several.modes)
        notes = (*notes, several.message) if several.message else notes
    if len(signals.segments) == 1:
        return document, notes
    return document, (
        *notes,
        f"gaps split the record into {len(signals.segments)} parts; the longest, {time[0]:g} to {time[-1]:g} s, is "
        "analysed; choose another with start and stop",
    )


def results_document(results: xr.Dataset) -> dict[str, Any]:
    """Return the results of a recording as JSON holds them: response, resonance, energy, ring-downs, what there is."""
    document: dict[str, Any] = {"kind": "recording", "doubts": doubts_of(results), **_space_part(results)}
    document |= _sweep_part(results)
    if "decay_rate_per_s" in results:
        document["ring_down"] = decay_rows(results)
    return document


def _space_part(results: xr.Dataset) -> dict[str, Any]:
    """Return pose, coupling table and decays of a head that bends or sways; nothing of one that only turns."""
    if "pose" not in results.attrs:
        return {}
    part: dict[str, Any] = {"pose": json.loads(results.attrs["pose"])}
    if "coupling_ratio" in results:
        part |= {"coupling_drive": str(results.attrs["coupling_drive"]), "coupling": coupling_rows(results)}
    decays = json.loads(results.attrs["sway_ring_downs"])
    return part | ({"sway_ring_down": decays} if decays else {})


def _sweep_part(results: xr.Dataset) -> dict[str, Any]:
    """Return the response table, and the resonances where there were frequencies enough for them."""
    if "gain" not in results:
        return {}
    part: dict[str, Any] = {"response": response_table_json(results)}
    if "resonance_hz" in results:
        part["resonance"] = interval_rows(results, RESONANCES)
    if "energy_reduction" in results:  # what a swing costs, and what the servos draw with their torque off
        idle = finite(float(results.attrs.get("idle_power_w", math.nan)))
        part["energy"] = {"idle_power_w": idle, "pretensions": interval_rows(results, ENERGY_QUANTITIES)}
    return part


def figures_document(path: str | Path) -> tuple[dict[str, Any], xr.Dataset]:
    """Return the resonance, energy and ring-down rows of a file of results, and the part of it that was read for them.

    Its curves are not read, and its content hash not checked: a hundredth of the time that all of it takes, for an
    index of many. Raises FileError where the file is damaged.
    """
    names = ["pretension", "pretension_mm", "frequency", "frequency_hz", "gain", *_CONSTANTS]
    for name in (*RESONANCES, "energy_reduction"):
        names += [name, *companions(name)]
    names += [column for name, beside in _DECAY.items() for column in (name, *beside) if column]
    results = load_part(path, names)
    document: dict[str, Any] = {}
    if "resonance_hz" in results:
        document["resonance"] = interval_rows(results, [name for name in RESONANCES if name in results])
    if "energy_reduction" in results:
        document["energy"] = {"pretensions": interval_rows(results, ("energy_reduction",))}
    if "decay_rate_per_s" in results:
        document["ring_down"] = decay_rows(results)
    return document, results


_CONSTANTS = ("paper_stiffness_n_m_rad", "paper_damping_n_m_s_rad")


def decay_rows(results: xr.Dataset) -> list[dict[str, Any]]:
    """Return one row for each pretension: mean over the repeats, standard deviation and 90 % interval of that mean.

    Where one repeat is left, the direct fit's own standard deviation by noise and a normal interval. Decays of one plan
    begin alike, so their means are compared by scatter; what one number leaves out of each decay stands beside it, as
    `misfit_std`, the root mean square over the repeats.
    """
    rows: list[dict[str, Any]] = [{"pretension_mm": float(p)} for p in results["pretension_mm"].values]
    for name, (own, misfit) in _DECAY.items():
        values = results[name].values
        mean = combine_repeats(values, results[own].values if own else np.full(values.shape, np.nan))
        beside = np.sqrt(mean_of_known(results[misfit].values ** 2)) if misfit in results else None
        for i, numbers in enumerate(zip(mean.value, mean.std_of_value, mean.low, mean.high, strict=True)):
            if np.isfinite(numbers[0]):
                rows[i][name] = Estimate(*map(float, numbers)).to_json()
                rows[i][name] |= {} if beside is None else {"misfit_std": finite(float(beside[i]))}
    return rows


_DECAY = {
    "decay_frequency_hz": ("decay_frequency_std_hz", "decay_frequency_misfit_hz"),
    "decay_rate_per_s": ("decay_rate_std_per_s", "decay_rate_misfit_per_s"),
    "damping_ratio": ("damping_ratio_std", "damping_ratio_misfit"),
    "paper_decay_rate_per_s": ("", ""),
}


_DECAY_COLUMNS = {
    "decay_frequency_hz": "frequency/Hz",
    "decay_rate_per_s": "decay rate/(1/s)",
    "damping_ratio": "damping ratio",
    "paper_decay_rate_per_s": "paper's rate/(1/s)",
}


def _misfit_of_decays(rows: list[dict[str, Any]]) -> str:
    """Return a sentence on how far one frequency and one damping ratio describe the decays; empty where they do."""
    told = []
    for name, words, unit in (("damping_ratio", "damping ratio", ""), ("decay_frequency_hz", "frequency", " Hz")):
        parts = [row[name]["misfit_std"] or 0.0 for row in rows if "misfit_std" in row.get(name, {})]
        if max(parts, default=0.0) > 0:
            told.append(f"{words} by up to ±{number(max(parts), 2)}{unit}")
    if not told:
        return ""
    return (
        f"within a decay it is not one number: {' and '.join(told)} (standard deviation); these means are over windows "
        "that begin alike, and compare with one another"
    )


def _response_table(rows: list[dict[str, Any]]) -> Table:
    """Return the essential columns of a sweep; all others are in the JSON document."""
    cells = [
        (
            number(row["pretension_mm"]),
            number(row["frequency_hz"]),
            pair(row["gain"], row["gain_std"]),
            shown(row["gain_measured_drive"]),
            shown(row["phase_lag_deg"]),
            "yes" if row["settled"] else "no",
        )
        for row in rows
    ]
    names = ("pretension/mm", "frequency/Hz", "gain", "gain, measured drive", "phase lag/°", "settled")
    return Table(names, cells, "sweep: mean over repeats ± standard deviation of it (everything: --json)")


def _space_told(document: dict[str, Any]) -> list[Table | str]:
    """Return the pose, the essential columns of the coupling table, and the decays in bending."""
    pose = document["pose"]
    told: list[Table | str] = [f"pose: a bend of {pose['bend_deg']:.4g}° towards {pose['azimuth_deg']:.4g}°"]
    if rows := document.get("coupling"):
        at: dict[tuple[float, float], dict[str, dict[str, Any]]] = {}
        for row in rows:
            at.setdefault((row["pretension_mm"], row["frequency_hz"]), {})[row["channel"]] = row
        cells = [
            (
                *map(number, where),
                *(shown(of[name]["amplitude_deg"]) for name in ("torsion", "out-of-plane")),
                shown(of["out-of-plane"]["coupling_ratio"]),
                shown(of["out-of-plane"]["lag_behind_torsion_deg"]),
                shown(of["in-plane"]["second_harmonic_deg"]),
            )
            for where, of in at.items()
        ]
        names = ("p/mm", "f/Hz", "torsion/°", "across/°", "across/torsion", "lag/°", "in plane, 2f/°")
        title = f"coupling, driven by {document['coupling_drive']}: torsion, tilt across the bend, in its plane at 2f"
        told.append(Table(names, cells, title))
    if decays := document.get("sway_ring_down"):
        cells = [
            (
                row["excitation"],
                number(row["pretension_mm"]),
                *(shown(row.get(key)) for key in list(_DECAY_COLUMNS)[:3]),
            )
            for row in decays
        ]
        columns = ("excitation", "pretension/mm", *list(_DECAY_COLUMNS.values())[:3])
        told.append(Table(columns, cells, "decays in bending: mean ± standard deviation of it"))
    return told


def _resonance_table(rows: list[dict[str, Any]]) -> Table:
    cells = [
        (
            number(row["pretension_mm"]),
            shown_interval(row["resonance_hz"]),
            *(shown(row[name]) for name in ("gain_peak", "phase_90_hz", "half_power_width_hz")),
        )
        for row in rows
    ]
    names = ("pretension/mm", "resonance/Hz (90 %)", "peak gain", "lag of 90°/Hz", "half-power/Hz")
    return Table(names, cells, "resonance: frequency of the largest fundamental, lag of 90°, half-power width")


def _energy_told(energy: dict[str, Any]) -> list[Table | str]:
    def percent(estimate: dict[str, Any]) -> str:
        value, std = (None if estimate[key] is None else 100 * estimate[key] for key in ("value", "std"))
        return pair(value, std)

    names = ("p/mm", "drive/W", "tendons/W", "J/rad²", "reduction/%", "with tendons/%", "cheapest/Hz")
    cells = [
        [
            number(row["pretension_mm"]),
            shown(row["drive_power_at_resonance_w"]),
            shown(row["holding_at_resonance_w"]),
            shown(row["swing_cost_at_resonance_j_rad2"]),
            percent(row["energy_reduction"]),
            percent(row["energy_reduction_with_holding"]),
            shown(row["cheapest_hz"]),
        ]
        for row in energy["pretensions"]
    ]
    title = "energy at resonance, per cycle and squared swing; its reduction against the trend"
    told: list[Table | str] = [Table(names, cells, title)]
    if energy["idle_power_w"] is not None:
        idle = number(energy["idle_power_w"], unit="W")
        told.append(f"servos with their torque off: {idle} by data sheet, in none of these numbers")
    return told


def _ring_down_told(document: dict[str, Any], recording: xr.Dataset) -> list[Table | str]:
    rows = []
    for label, key in (
        ("frequency/Hz", "frequency_hz"),
        ("damping ratio", "damping_ratio"),
        ("decay rate/(1/s)", "decay_rate_per_s"),
    ):
        one = document[key]
        rows.append((label, shown(one), span(*one["interval90"])))
    withheld = document["paper_method"]["withheld"]
    paper = [(key, number(value)) for key, value in document["paper_method"].items() if key != "withheld"]
    unit = response_channel(recording).unit
    modes = [
        (str(k), *(shown(mode[key]) for key in ("frequency_hz", "damping_ratio", "decay_rate_per_s", "amplitude")))
        for k, mode in enumerate(document.get("modes", []), start=1)
    ]
    names = ("mode", "frequency/Hz", "damping ratio", "decay rate/(1/s)", f"amplitude/{unit}")
    return [
        Table(("ring-down, direct fit", "value ± std", "90 % interval"), rows),
        f"the paper's method (Eq. 7) is withheld: {withheld}"
        if withheld
        else Table(("paper's method (Eq. 7)", "value"), paper),
        *([f"of these intervals {document['misfit']}"] if document["misfit"] else []),
        f"exponential: {'yes' if document['exponential'] else 'no'}. {document['reason']}",
        f"drift of the rest position: {number(document['rest_drift'])} {unit}",
        *([Table(names, modes, "modes of the decay, fitted together, the strongest first")] if modes else []),
    ]


def _broadband_told(document: dict[str, Any]) -> list[Table | str]:
    low, high = document["band_hz"]
    inside = [row["coherence"] for row in document["frequency_response"] if low <= row["frequency_hz"] <= high]
    known = [one for one in inside if one is not None]
    of = "averages" if document["kind"] == "broadband" else "hits" if document["averages"] > 1 else "hit"
    average = f"{number(document['averages'])} {of} of {number(document['segment_s'], unit='s')}"
    coherent = f"median coherence {number(float(np.median(known)))}" if known else "no coherence of a single hit"
    told: list[Table | str] = [
        f"frequency response H1: {len(document['frequency_response'])} lines, {average} (all of it: --json)",
        f"band of the modes: {number(low)} to {number(high)} Hz, {coherent}",
    ]
    if hits := document.get("hits"):
        unit = "" if document["drive_unit"] == "1" else f"/({document['drive_unit']})"
        cells = [
            (
                number(hit["time_s"]),
                number(hit["force"], 3),
                number(1000 * hit["width_s"], 2),
                "yes" if hit["used"] else "no",
            )
            for hit in hits
        ]
        told.append(Table(("hit at/s", f"force{unit}", "width/ms", "used"), cells, "hits"))
    rows = [
        (str(k), shown_interval(mode["natural_frequency_hz"]), shown_interval(mode["damping_ratio"]))
        for k, mode in enumerate(document["modes"], start=1)
    ]
    names = ("mode", "natural frequency/Hz (90 %)", "damping ratio (90 %)")
    return [*told, Table(names, rows, "modes, by the poles of H1")] if rows else told
