"""What a recording says of its oscillation: `analyse` finds it, by what the recording holds."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import xarray as xr

from sinew.analysis.broadband import analyse_broadband, checked_count
from sinew.analysis.decay.modes import DecayMode, fit_modes
from sinew.analysis.decay.ring_down import RingDown, analyse_ring_down, analyse_ring_downs
from sinew.analysis.doubts import doubt_decays, doubt_samples, doubts_of
from sinew.analysis.impact import analyse_impacts
from sinew.analysis.kinds import as_kind, find_kind, recorded_kind
from sinew.analysis.results import (
    Analysed,
    BentPose,
    DecayRow,
    EnergyResult,
    EnergyRow,
    PaperMethod,
    RecordingResult,
    ResonanceRow,
    ResponseRow,
    RingDownResult,
    SweepResult,
)
from sinew.analysis.signal.attitude import tilting
from sinew.analysis.signal.harmonics import split_by_drive
from sinew.analysis.signal.repeats import combine_repeats, interval_rows
from sinew.analysis.signal.signals import Signals, read_signals
from sinew.analysis.sweep.coupling import analyse_coupling, coupling_rows
from sinew.analysis.sweep.energy import estimate_energy
from sinew.analysis.sweep.resonance import RESONANCES, estimate_resonance, read_resonances
from sinew.analysis.sweep.response import estimate_response, response_dataset
from sinew.analysis.tracked import find_tracking
from sinew.measure.arrays import mean_of_known
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import finite
from sinew.measure.files.netcdf import content_hash, load_part, load_recording, provenance
from sinew.measure.read import refuse_bridge
from sinew.measure.recording import (
    ENERGY_QUANTITIES,
    FEWEST_FREQUENCIES,
    RESULTS_SCHEMA,
    ReadKind,
    companions,
    too_few_frequencies,
    validate_results,
)
from sinew.measure.result import Rows, plain
from sinew.measure.tasks import with_one_blas_thread
from sinew.measure.validation import as_dataset
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_rig


@with_one_blas_thread
def analyse(
    recording: xr.Dataset | str | Path,
    rig: RigSpec | str | Path | None = None,
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
    record or hammer blows, see `sinew.analysis.broadband` and `sinew.analysis.impact`. modes: how many are sought in
    them, or in a foreign ring-down, which else has those that stand out of its noise.

    A foreign ring-down is one record: its longest part is analysed. Raises RecordingError where there is nothing to
    analyse, SpecError where the recording does not take what is asked.

    >>> import numpy as np, pandas as pd
    >>> import sinew as sn
    >>> t = np.arange(0, 4, 0.01)
    >>> swing = pd.DataFrame({"t": t, "phi": 20 * np.exp(-1.2 * t) * np.cos(2 * np.pi * 3 * t)})
    >>> found = sn.analyse(sn.read(swing, time="t", response="phi:deg"))
    >>> round(found.frequency_hz.value, 2)
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
    options = {"settle_s": settle_s, "band_hz": band_hz, "modes": modes, "segment_s": segment_s, "rig": rig}
    if recording.attrs.get("source") != "import":
        if kind not in (None, "auto"):
            raise SpecError(f"a kind, here {kind}, is of a table, this recording says what it holds; leave it out")
        _refuse_options("own", options)
        return _analyse_own(recording, rig)
    notes = str(recording.attrs.get("import_notes", "")).splitlines()
    holds = recorded_kind(recording) if kind is None else kind
    reason: str | None = None
    if holds == "auto":
        guess = find_kind(recording)
        holds, reason = guess.kind, guess.reason
        notes = [f"taken for {_TAKES[holds][0]}: {reason}; its kind can be said", *notes]
    if recording.attrs.get("import_gaps") == "bridge":
        refuse_bridge(holds)
    _refuse_options(holds, options)
    recording = as_kind(recording, holds)
    found: Analysed
    if holds == "broadband":
        found = analyse_broadband(recording, band_hz=band_hz, modes=modes, segment_s=segment_s)
    elif holds == "impact":
        found = analyse_impacts(recording, band_hz=band_hz, modes=modes, segment_s=segment_s)
    elif holds == "ring-down":
        found = _foreign_ring_down(recording, rig, modes)
    else:
        grouped = split_by_drive(recording, settle_s=settle_s)
        if settle_s is not None and grouped is recording:
            raise SpecError(
                "the time to settle comes too late, the groups of this recording are cut already; leave it out"
            )
        results = analyse_with(grouped, recording_rig(grouped, rig))
        swept = recording_result(results, grouped, SweepResult)
        found = replace(swept, notes=tuple(_notes_of(swept, results)))
    return replace(found, notes=(*found.notes, *notes), kind_reason=reason)


_OF_SPECTRA = ("band_hz", "modes", "segment_s")
_TAKES: dict[str, tuple[str, tuple[str, ...]]] = {
    "ring-down": ("a ring-down", ("modes", "rig")),
    "sweep": ("a sweep of steady stretches", ("settle_s", "rig")),
    "broadband": ("a broadband record", _OF_SPECTRA),
    "impact": ("a record of hammer blows", _OF_SPECTRA),
    "own": ("a recording of Sinew", ("rig",)),
}
"""What a record is in words, and which options its analysis takes."""

_OPTIONS = {
    "settle_s": "a time to settle is for the sweep of a table",
    "band_hz": "a band is for a broadband record or hammer blows",
    "segment_s": "a length of segments is for a broadband record or hammer blows",
    "modes": "a number of modes is for a ring-down of a table, a broadband record or hammer blows",
    "rig": "a rig is for sweeps and ring-downs",
}


def _refuse_options(kind: str, given: Mapping[str, object]) -> None:
    words, taken = _TAKES[kind]
    for name, value in given.items():
        if value is not None and name not in taken:
            raise SpecError(f"{_OPTIONS[name]}, this is {words}; leave it out")


def _analyse_own(recording: xr.Dataset, rig: RigSpec | str | Path | None) -> Analysed:
    used = recording_rig(recording, rig)
    notes = str(recording.attrs.get("import_notes", "")).splitlines()
    kinds = set(map(str, recording["kind"].values))
    tracking = None
    if "tracking" in kinds:
        if used is None:
            raise RecordingError("this recording tracks a resonance and names no rig, expected one; name it (--rig)")
        tracking = find_tracking(recording, used)
        if not kinds & {"steady", "ring-down"}:
            return RecordingResult(recording=recording, notes=tuple(notes), tracking=tracking)
    results = analyse_with(recording, used)
    found = replace(recording_result(results, recording), tracking=tracking)
    return replace(found, notes=(*notes, *_notes_of(found, results)))


def _notes_of(found: RecordingResult, results: xr.Dataset) -> list[str]:
    """Return why there is no resonance, no coupling and no decay in bending, where there is none."""
    reasons = [] if found.resonance is not None else [str(results.attrs["resonance_notes"])]
    reasons += [str(results.attrs.get(name, "")) for name in ("coupling_notes", "sway_notes")]
    return [reason for reason in reasons if reason]


# A whole recording: sweep, resonance, energy and ring-down in one dataset, with what speaks against it.


@with_one_blas_thread
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
    signals = everything = read_signals(split_by_drive(recording), rig)
    parts: list[xr.Dataset] = []
    sweep, notes, in_space = xr.Dataset(), "", {}
    if signals.pose is not None:
        signals = signals.moved_by("lever", "impulse-torsion")
        in_space = _in_space(everything, parts)
        kinds = {segment.kind for segment, _ in signals.segments}
    if "steady" in kinds:
        sweep, notes = _sweep(signals)
        parts.append(sweep)
    doubts = doubt_samples(sweep, signals)
    if "ring-down" in kinds:
        try:
            parts.append(analyse_ring_downs(signals, _inertia(rig)))
        except RecordingError as error:
            if not parts:
                raise
            parts[0].attrs["ring_down_notes"] = f"no ring-down could be analysed: {error}"
    if not parts:
        raise RecordingError(str(in_space["coupling_notes"] or in_space["sway_notes"]))
    results = join_parts(parts)
    attributes = {key: value for part in parts for key, value in part.attrs.items() if str(key).endswith(_NOTES)}
    results.attrs = {**_attributes(recording, signals), **attributes, **in_space, "resonance_notes": notes}
    doubts = sorted([*doubts, *doubt_decays(results, signals)], key=lambda doubt: -doubt.distance)
    results.attrs["doubts"] = json.dumps([doubt.to_dict() for doubt in doubts], ensure_ascii=False)
    return validate_results(results)


_NOTES = ("_notes", "idle_power_w", "coupling_drive")


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
    attributes = {"pose": json.dumps({"bend_deg": float(bend), "azimuth_deg": float(azimuth)})}
    attributes |= {"coupling_notes": "", "sway_notes": "", "sway_ring_downs": "[]"}
    if any(True for _ in signals.of_kind("steady")):
        try:
            parts.append(analyse_coupling(signals))
        except RecordingError as error:
            attributes["coupling_notes"] = f"no coupling could be analysed: {error}"
    rows: list[DecayRow] = []
    for excitation in ("pitch", "roll", "impulse-pitch", "impulse-roll"):
        decays = tilting(signals, excitation)
        if decays is not None:
            try:
                found = analyse_ring_downs(decays)
            except RecordingError as error:
                attributes["sway_notes"] = f"no decay in {excitation} could be analysed: {error}"
                continue
            rows += [replace(row, excitation=excitation) for row in decay_rows(found)]
            if not parts:
                parts.append(xr.Dataset(coords={"pretension_mm": found["pretension_mm"]}))
    return attributes | {"sway_ring_downs": json.dumps([row.to_dict() for row in rows])}


def _attributes(recording: xr.Dataset, signals: Signals) -> dict[str, Any]:
    """Return the provenance of results: what the recording says of itself, its hash, and this program's versions."""
    about = recording.attrs
    seed = int(about.get("seed", -1))
    return provenance(
        str(about.get("source", "import")),
        rig=str(about.get("rig", "")),
        plan=str(about.get("plan", "")),
        seed=None if seed < 0 else seed,
        schema=RESULTS_SCHEMA,
        recording_hash=str(about.get("content_hash") or content_hash(recording)),
        effects_off=str(about.get("effects_off", "")),
        recording_versions=str(about.get("versions", "")),
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


def response_rows(results: xr.Dataset) -> Rows[ResponseRow]:
    """Return the response table, one row per pretension and frequency that was measured.

    Numbers without an interval are means over repeats, and gain_std is the standard deviation of that of the gain; the
    phase lag has the delay budget's uncertainty in it. `settled` is true where every repeat had settled. Raises
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
        if repeats:
            rows.append(
                ResponseRow(
                    pretension_mm=pretension[p],
                    frequency_hz=frequency[f],
                    repeats=repeats,
                    gain_std=finite(float(scatter[p, f])),
                    gain_measured_drive=gain.at((p, f)),
                    phase_lag_deg=lag.at((p, f)).times(math.degrees(1.0)),
                    settled=bool(settled[p, f] == 1.0),
                    **{name: finite(float(mean[p, f])) for name, mean in plain.items()},
                )
            )
    return Rows(rows)


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


def recording_rig(recording: xr.Dataset, rig: RigSpec | str | Path | None) -> RigSpec | None:
    """Return the rig that was named, else the one in the recording, else None. Raises SpecError if it is bad."""
    if rig is not None:
        return load_rig(rig) if isinstance(rig, (str, Path)) else rig
    text = str(recording.attrs.get("rig", ""))
    return parse_rig(text, source="the recording's rig") if text.strip() else None


def analyse_with(recording: xr.Dataset, rig: RigSpec | None) -> xr.Dataset:
    """Return the results of a recording; their attribute `rig` is the rig they were made with.

    rig: whose inertia and sensor delays are used; None for perfect sensors and no inertia.
    """
    results = analyse_recording(recording, rig)
    return results if rig == recording_rig(recording, None) else results.assign_attrs(rig=dump_rig(rig) if rig else "")


def _inertia(rig: RigSpec | None) -> float | None:
    """Return the inertia of head and lever [kg m²]."""
    return None if rig is None else rig.inertia.head.value + rig.inertia.lever.value


def _foreign_ring_down(recording: xr.Dataset, named: RigSpec | str | Path | None, modes: int | None) -> RingDownResult:
    """Return what the longest part of a record says; gaps split a record into parts."""
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
    notes, several = result.remarks, result.modes
    if modes is not None:
        count = checked_count(modes)
        fitted = fit_modes(time, values, drive=drive, unit=response.unit, free_from_s=result.start_s, modes=count)
        several = fitted.modes
        notes = (*notes, fitted.message) if fitted.message else notes
    if len(signals.segments) > 1:
        notes = (
            *notes,
            f"gaps split the record into {len(signals.segments)} parts; the longest, {time[0]:g} to {time[-1]:g} s, is "
            "analysed; choose another with start and stop",
        )
    return ring_down_result(recording, result, several, notes)


def ring_down_result(
    recording: xr.Dataset, result: RingDown, modes: Sequence[DecayMode], notes: tuple[str, ...]
) -> RingDownResult:
    """Return a ring-down's answer. Amplitudes are in its `peak_unit`, `rest_drift` in its `unit`. `omega_rad_s` and
    `lehr_damping` of the paper's method use the damped frequency, as Eq. 7 does; `damping_ratio` the undamped one."""
    paper = result.paper
    believed = math.nan if result.withheld else 1.0
    names = ("frequency_hz", "damping_ratio", "decay_rate_per_s")
    return RingDownResult(
        recording=recording,
        notes=notes,
        frequency_hz=result.frequency_hz,
        damping_ratio=result.damping_ratio,
        decay_rate_per_s=result.decay_rate_per_s,
        interval_parts={name: result.parts[name] for name in names},
        misfit=result.misfit,
        paper_method=PaperMethod(
            finite(believed * paper.decay_rate_per_s),
            finite(believed * paper.omega_rad_s),
            finite(believed * paper.lehr_damping),
            result.withheld,
        ),
        exponential=result.shape.exponential,
        reason=result.shape.reason,
        rest_drift=result.rest_drift,
        amplitude_dependence=result.dependence,
        start_s=result.start_s,
        stop_s=result.stop_s,
        remarks=result.remarks,
        modes=Rows(modes) if modes else None,
        unit=result.unit,
    )


def recording_result(
    results: xr.Dataset, recording: xr.Dataset | None = None, kind: type[RecordingResult] = RecordingResult
) -> RecordingResult:
    """Return what results hold, part by part: doubts, pose, coupling, response, resonance, energy, decays."""
    parts: dict[str, Any] = {"doubts": doubts_of(results)}
    if "pose" in results.attrs:
        parts["pose"] = BentPose.from_dict(json.loads(results.attrs["pose"]))
        if "coupling_ratio" in results:
            parts["coupling_drive"] = str(results.attrs["coupling_drive"])
            parts["coupling"] = coupling_rows(results)
        decays = json.loads(results.attrs["sway_ring_downs"])
        parts["sway_ring_down"] = Rows(map(DecayRow.from_dict, decays)) if decays else None
    if "gain" in results:
        parts["response"] = response_rows(results)
    if "resonance_hz" in results:
        parts["resonance"] = Rows(ResonanceRow(**row) for row in interval_rows(results, RESONANCES))
    if "energy_reduction" in results:  # what a swing costs, and what the servos draw with their torque off
        rows = Rows(EnergyRow(**row) for row in interval_rows(results, ENERGY_QUANTITIES))
        parts["energy"] = EnergyResult(rows, finite(float(results.attrs.get("idle_power_w", math.nan))))
    if "decay_rate_per_s" in results:
        parts["ring_down"] = decay_rows(results)
    return kind(recording=xr.Dataset() if recording is None else recording, dataset=results, **parts)


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
    return plain(document), results


_CONSTANTS = ("paper_stiffness_n_m_rad", "paper_damping_n_m_s_rad")


def decay_rows(results: xr.Dataset) -> Rows[DecayRow]:
    """Return one row for each pretension: mean over the repeats, standard deviation and 90 % interval of that mean.

    Where one repeat is left, the direct fit's own standard deviation by noise and a normal interval. Decays of one plan
    begin alike, so their means are compared by scatter; what one number leaves out of each decay stands beside it, the
    root mean square over the repeats.
    """
    rows: list[dict[str, Any]] = [{"pretension_mm": float(p)} for p in results["pretension_mm"].values]
    for name, (own, misfit) in _DECAY.items():
        values = results[name].values
        mean = combine_repeats(values, results[own].values if own else np.full(values.shape, np.nan))
        beside = np.sqrt(mean_of_known(results[misfit].values ** 2)) if misfit in results else None
        for i in np.flatnonzero(np.isfinite(mean.value)):
            rows[i][name] = mean.at((int(i),))
            if beside is not None:
                rows[i][misfit] = finite(float(beside[i]))
    return Rows(DecayRow(**row) for row in rows)


_DECAY = {
    "decay_frequency_hz": ("decay_frequency_std_hz", "decay_frequency_misfit_hz"),
    "decay_rate_per_s": ("decay_rate_std_per_s", "decay_rate_misfit_per_s"),
    "damping_ratio": ("damping_ratio_std", "damping_ratio_misfit"),
    "paper_decay_rate_per_s": ("", ""),
}
