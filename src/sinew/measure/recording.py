"""Recordings: their shape, written down and checked, how they are put together and taken apart; and that of results.

A recording is an `xarray.Dataset` of samples and segments, a contiguous ragged array in the CF sense: the
samples of segment i are the `row_size[i]` samples after those of the segments before it. Angles are in
radians, everything else in SI; the few columns that a person set are in the units they were set in, and every
name carries its unit.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from sinew.measure.errors import SchemaError, SpecError
from sinew.measure.timing import choose_stretch
from sinew.measure.validation import as_dataset, as_numbers, as_seconds

RECORDING_SCHEMA = "sinew-recording-1"
SPATIAL_SCHEMA = "sinew-recording-2"
"""The schema of a recording in which the head bends or sways; of an upright head that only turns it is the first."""

Excitation = Literal["lever", "pitch", "roll", "impulse-torsion", "impulse-pitch", "impulse-roll"]
"""What moves the head: the lever, the tendons in antagonism about y (pitch) or z (roll) of frame B, or a blow."""

SegmentKind = Literal["settle", "steady", "ring-down", "idle", "tracking"]

RecordKind = Literal["ring-down", "sweep", "broadband", "impact"]
"""What a foreign record holds: a free decay, stretches of steady frequency, many frequencies at once, hammer blows."""
ReadKind = Literal["auto", "ring-down", "sweep", "broadband", "impact"]
"""As what a table is read; "auto" leaves it to the analysis to find out."""
IMPORT_SEGMENTS: dict[str, SegmentKind] = {
    "auto": "ring-down",
    "ring-down": "ring-down",
    "sweep": "steady",
    "broadband": "steady",
    "impact": "steady",
}
"""The kind of the segments that a table of each kind becomes; a kind that they do not tell is in `import_kind`."""


@dataclass(frozen=True)
class Variable:
    """One row of the schema: dimensions, unit, meaning, whether a recording must have it, and whether it may be NaN."""

    dims: tuple[str, ...]
    unit: str
    meaning: str
    required: bool = False
    may_be_unknown: bool = False


SAMPLE_VARIABLES: dict[str, Variable] = {
    "time_s": Variable(("sample",), "s", "host time of the sample, strictly increasing inside a segment", True),
    "drive_command_rad": Variable(("sample",), "rad", "commanded lever angle relative to the head plate"),
    "drive_goal_rad": Variable(
        ("sample",),
        "rad",
        "lever angle in the drive's goal register when it was read, which its current belongs to",
    ),
    "drive_rad": Variable(("sample",), "rad", "measured lever angle relative to the head plate (encoder)"),
    "drive_current_a": Variable(("sample",), "A", "measured current of the drive motor, signed"),
    "drive_pwm": Variable(("sample",), "1", "measured duty of the drive motor, -1..1"),
    "tendon_rad": Variable(("sample", "tendon"), "rad", "measured position of the tendon motors; pulling is positive"),
    "tendon_current_a": Variable(
        ("sample", "tendon"), "A", "measured current of the tendon motors; pulling is positive"
    ),
    "tendon_pwm": Variable(("sample", "tendon"), "1", "measured duty of the tendon motors, -1..1; pulling is positive"),
    "supply_v": Variable(("sample",), "V", "supply voltage at the motors, mean over those that told it"),
    "load_cell_n": Variable(
        ("sample",), "N", "tension of one tendon, by a load cell in it; NaN where it was silent", may_be_unknown=True
    ),
    "gyro_rad_s": Variable(("sample", "axis"), "rad/s", "gyroscope on the head plate, axes of frame H"),
    "acceleration_m_s2": Variable(("sample", "axis"), "m/s2", "accelerometer on the head plate, axes of frame H"),
    "torsion_rad": Variable(("sample",), "rad", "torsion of the head, where an angle was measured directly"),
    "tilt_rad": Variable(("sample",), "rad", "tilt of the head plate against the base plate"),
    "orientation": Variable(
        ("sample", "quaternion"), "1", "orientation of the head H against the base B: unit quaternion w, x, y, z"
    ),
    "response": Variable(("sample",), "*", "response that is not an angle; its unit is the attribute `units`"),
    "drive": Variable(("sample",), "*", "drive that is not an angle; its unit is the attribute `units`"),
}

SEGMENT_VARIABLES: dict[str, Variable] = {
    "row_size": Variable(("segment",), "1", "number of samples in the segment", True),
    "kind": Variable(("segment",), "", "settle, steady, ring-down, idle or tracking", True),
    "pretension_mm": Variable(
        ("segment",),
        "mm",
        "commanded common shortening of the tendons from first contact; of tracking at its begin",
        True,
    ),
    "frequency_hz": Variable(
        ("segment",), "Hz", "commanded drive frequency; NaN where there is none or it moves", True
    ),
    "amplitude_deg": Variable(
        ("segment",), "deg", "commanded drive amplitude, of tracking the held one; NaN where there is none", True
    ),
    "repeat": Variable(("segment",), "1", "index of the repetition, from 0", True),
    "bend_deg": Variable(("segment",), "deg", "bend of the head in the pose that was asked for"),
    "azimuth_deg": Variable(("segment",), "deg", "direction of that bend, from y to z of frame B"),
    "excitation": Variable(
        ("segment",), "", "what moves the head: lever, pitch, roll, impulse-torsion, impulse-pitch or impulse-roll"
    ),
    "amplitude_mm": Variable(
        ("segment",), "mm", "commanded amplitude of the tendons' antagonism; NaN where they hold still"
    ),
    "impulse_n_m_s": Variable(
        ("segment",), "N*m*s", "angular impulse of the blow on the head; NaN where there is none"
    ),
}

SPATIAL_SEGMENTS = ("bend_deg", "azimuth_deg", "excitation", "amplitude_mm", "impulse_n_m_s")
"""What the segments of a recording say only where the head bends or sways, all of it or nothing."""

_RESPONSES = ("torsion_rad", "gyro_rad_s", "response")


def validate_recording(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording unchanged if it keeps the schema.

    Raises SchemaError with one sentence: what was found, what was expected.
    """
    schema = as_dataset(recording, "recording").attrs.get("schema")
    if schema not in (RECORDING_SCHEMA, SPATIAL_SCHEMA):
        raise SchemaError(
            f"this is not a recording of schema {RECORDING_SCHEMA!r} or {SPATIAL_SCHEMA!r} (found {schema!r})"
        )
    for name, variable in {**SAMPLE_VARIABLES, **SEGMENT_VARIABLES}.items():
        _check_variable(recording, name, variable)
    if not any(name in recording for name in _RESPONSES):
        raise SchemaError(f"recording has no response: expected one of {', '.join(_RESPONSES)}")
    _check_segments(recording)
    _check_space(recording)
    _check_times(recording)
    return recording


def _check_variable(recording: xr.Dataset, name: str, variable: Variable) -> None:
    if name not in recording:
        if variable.required:
            raise SchemaError(f"recording lacks the variable {name!r} ({variable.meaning})")
        return
    found = recording[name]
    if found.dims != variable.dims:
        raise SchemaError(f"recording variable {name!r} has dimensions {found.dims}, expected {variable.dims}")
    unit = found.attrs.get("units", "")
    if variable.unit == "*":
        if not unit:
            raise SchemaError(f"recording variable {name!r} needs its unit in the attribute 'units'")
    elif unit != variable.unit:
        raise SchemaError(f"recording variable {name!r} has unit {unit!r}, expected {variable.unit!r}")
    if variable.unit and found.dtype.kind not in "fiu":
        raise SchemaError(f"recording variable {name!r} holds {found.dtype} values, expected numbers")
    if variable.dims[0] == "sample":
        fine = ~np.isinf(found.values) if variable.may_be_unknown else np.isfinite(found.values)
        if not fine.all():
            where = int(np.argmin(fine.reshape(found.shape[0], -1).all(axis=1)))
            raise SchemaError(f"recording variable {name!r} holds NaN or infinity (first at sample {where})")


def _check_segments(recording: xr.Dataset) -> None:
    sizes = recording["row_size"].values
    total = recording.sizes["sample"]
    if sizes.size == 0 or total == 0:
        raise SchemaError("recording is empty: it needs at least one segment with samples")
    if sizes.min() < 1 or int(sizes.sum()) != total:
        raise SchemaError(f"segments claim {int(sizes.sum())} samples (smallest {int(sizes.min())}), found {total}")
    unknown = sorted(set(map(str, recording["kind"].values)) - set(get_args(SegmentKind)))
    if unknown:
        raise SchemaError(f"unknown segment kind {unknown[0]!r}, expected one of {', '.join(get_args(SegmentKind))}")
    if not (recording["pretension_mm"].values >= 0).all():
        raise SchemaError("recording has a negative or missing pretension_mm; it counts from first contact, 0 mm")


_UNIT_WITHIN = 1e-3


def _check_space(recording: xr.Dataset) -> None:
    """Check what only a head that bends or sways has: pose and excitation of each segment, orientation."""
    here = [name for name in SPATIAL_SEGMENTS if name in recording]
    if 0 < len(here) < len(SPATIAL_SEGMENTS):
        missing = next(name for name in SPATIAL_SEGMENTS if name not in recording)
        raise SchemaError(f"recording lacks the variable {missing!r}, which belongs beside {here[0]!r}")
    new = [*here, *(name for name in ("orientation",) if name in recording)]
    if new and recording.attrs["schema"] != SPATIAL_SCHEMA:
        raise SchemaError(
            f"recording of schema {RECORDING_SCHEMA!r} has {new[0]!r}, expected schema {SPATIAL_SCHEMA!r}"
        )
    if here:
        for name in ("bend_deg", "azimuth_deg"):
            if not np.isfinite(recording[name].values).all():
                raise SchemaError(f"recording variable {name!r} holds NaN or infinity; a straight pose is 0")
        bend = recording["bend_deg"].values
        if not ((bend >= 0) & (bend < 180)).all():
            raise SchemaError(f"recording has a bend of {bend[np.argmax(np.abs(bend - 90))]:g}°, expected 0° to 180°")
        unknown = sorted(set(map(str, recording["excitation"].values)) - set(get_args(Excitation)))
        if unknown:
            expected = ", ".join(get_args(Excitation))
            raise SchemaError(f"unknown excitation {unknown[0]!r}, expected one of {expected}")
    if "orientation" in recording:
        size = np.linalg.norm(recording["orientation"].values.astype(float), axis=-1)
        if recording.sizes["quaternion"] != 4 or np.abs(size - 1.0).max() > _UNIT_WITHIN:
            worst = float(size[np.argmax(np.abs(size - 1.0))])
            raise SchemaError(
                f"recording variable 'orientation' has {recording.sizes['quaternion']} components and a length of "
                f"{worst:g}, expected unit quaternions w, x, y, z"
            )


def _check_times(recording: xr.Dataset) -> None:
    steps = np.diff(recording["time_s"].values)
    ends = np.cumsum(recording["row_size"].values)[:-1]
    inside = np.ones(steps.size, dtype=bool)
    inside[ends - 1] = False
    bad = np.flatnonzero(inside & (steps <= 0))
    if bad.size:
        raise SchemaError(f"time_s does not increase at sample {int(bad[0]) + 1}")


# The shape of analysed results: what it holds, its check, and how results of the older shape are brought to it.
#
# Results are an `xarray.Dataset` over the axes `pretension_mm` (p), `frequency_hz` (f) and `repeat` (r), each of them
# an index coordinate of its own name: `results.sel(pretension_mm=1)` is 1 mm, whatever its position. A part that a
# recording cannot give (no sweep, no ring-down) is absent as a whole; a single missing measurement is NaN. A quantity
# `q` with an interval has the companions `q_std`, `q_low`, `q_high` (standard deviation of the value over repeats,
# and ends of the 90 % interval), the suffix standing before the unit: `resonance_std_hz`.

RESULTS_SCHEMA = "sinew-results-2"

_P, _PR, _PFR = ("pretension_mm",), ("pretension_mm", "repeat"), ("pretension_mm", "frequency_hz", "repeat")
_PRW = ("pretension_mm", "repeat", "window_start_periods")
_PFRC = (*_PFR, "channel")

CHANNELS = ("torsion", "in-plane", "out-of-plane")
"""What a bent head does: its torsion, and its tilt away from the pose in the plane of the bend and out of it."""

_COORDINATES = {
    "pretension_mm": Variable(_P, "mm", "commanded pretension"),
    "frequency_hz": Variable(("frequency_hz",), "Hz", "commanded drive frequency"),
    "repeat": Variable(("repeat",), "1", "number of the repetition, from 1; the segments of a recording count from 0"),
    "window_start_periods": Variable(
        ("window_start_periods",), "1", "start of the decay after the stop, in periods of the drive"
    ),
    "channel": Variable(("channel",), "", f"motion of the head: {', '.join(CHANNELS)}"),
}

_RESPONSE = {
    "amplitude_rad": Variable(_PFR, "rad", "torsion amplitude, fundamental by least squares"),
    "amplitude_std_rad": Variable(_PFR, "rad", "standard deviation of the fundamental"),
    "amplitude_peaks_rad": Variable(_PFR, "rad", "torsion amplitude, mean of both-sided peaks (paper)"),
    "drive_amplitude_rad": Variable(_PFR, "rad", "measured drive amplitude, fundamental"),
    "drive_amplitude_std_rad": Variable(_PFR, "rad", "standard deviation of the drive amplitude"),
    "gain": Variable(_PFR, "1", "mean of peaks over nominal drive amplitude (paper Eq. 6)"),
    "gain_harmonic": Variable(_PFR, "1", "fundamental over nominal drive amplitude"),
    "gain_measured_drive": Variable(_PFR, "1", "fundamental over measured drive amplitude"),
    "gain_measured_drive_std": Variable(_PFR, "1", "standard deviation of the gain by measured drive"),
    "phase_lag_rad": Variable(_PFR, "rad", "lag of the torsion behind the drive, delay budget corrected, positive lag"),
    "phase_std_rad": Variable(_PFR, "rad", "standard deviation of the lag from noise"),
    "phase_delay_std_rad": Variable(_PFR, "rad", "standard uncertainty of the lag from the delay budget"),
    "lissajous_phase_rad": Variable(_PFR, "rad", "lag from the area and extent of the Lissajous ellipse"),
    "distortion": Variable(_PFR, "1", "harmonics 2 to 5 over fundamental of the torsion"),
    "drive_distortion": Variable(_PFR, "1", "harmonics 2 to 5 over fundamental of the drive"),
    "settled": Variable(_PFR, "1", "1 where the amplitude had stopped changing, else 0"),
    "drift_per_period": Variable(_PFR, "1", "relative change of amplitude per period inside the group"),
    "saturated_share": Variable(_PFR, "1", "share of samples with the drive's duty at its limit"),
    "drive_current_rms_a": Variable(_PFR, "A", "root mean square of the drive current"),
}

_COUPLING = {
    "channel_amplitude_rad": Variable(_PFRC, "rad", "amplitude of the channel, fundamental"),
    "channel_amplitude_std_rad": Variable(_PFRC, "rad", "standard deviation of the channel's amplitude"),
    "channel_gain": Variable(_PFRC, "*", "fundamental over that of the drive: 1 by the lever, rad/mm by the tendons"),
    "channel_gain_std": Variable(_PFRC, "*", "standard deviation of the channel's gain"),
    "channel_lag_rad": Variable(_PFRC, "rad", "lag of the channel behind the drive, delay budget corrected"),
    "channel_lag_std_rad": Variable(_PFRC, "rad", "standard deviation of that lag"),
    "coupling_ratio": Variable(_PFRC, "1", "fundamental over that of the torsion"),
    "coupling_ratio_std": Variable(_PFRC, "1", "standard deviation of the coupling ratio"),
    "coupling_lag_rad": Variable(_PFRC, "rad", "lag of the channel behind the torsion"),
    "coupling_lag_std_rad": Variable(_PFRC, "rad", "standard deviation of that lag"),
    "second_harmonic_rad": Variable(_PFRC, "rad", "amplitude of the channel at twice the drive's frequency"),
    "second_harmonic_lag_rad": Variable(_PFRC, "rad", "lag of that behind twice the drive's phase"),
    "second_harmonic_std_rad": Variable(_PFRC, "rad", "standard deviation of the second harmonic"),
    "channel_mean_rad": Variable(_PFRC, "rad", "mean of the channel; of the torsion zero where a filter told it"),
}

_POWER = {
    "drive_power_w": Variable(_PFR, "W", "electrical power of the drive, mean over whole cycles"),
    "drive_power_std_w": Variable(_PFR, "W", "standard deviation of that mean, from what is not periodic"),
    "drive_drawn_w": Variable(_PFR, "W", "the same with what the motor gives back counted as lost"),
    "drive_copper_w": Variable(_PFR, "W", "of it: lost in winding and bridge, R i²"),
    "drive_mechanical_w": Variable(_PFR, "W", "of it: mechanical power into the joint, from the motion"),
    "holding_power_w": Variable(_PFR, "W", "electrical power of all tendon motors"),
}

POWER_COLUMNS = frozenset(_POWER)
"""What results hold only where duty and current of the drive were recorded and a rig is known."""

_RING_DOWN = {
    "paper_decay_rate_per_s": Variable(_PR, "1/s", "λ of the peak envelope (paper)"),
    "paper_omega_rad_s": Variable(_PR, "rad/s", "mean angular frequency ⟨ω⟩ of the decay (paper)"),
    "paper_lehr_damping": Variable(_PR, "1", "λ/⟨ω⟩ (paper Eq. 7)"),
    "paper_quality": Variable(_PR, "1", "quality factor 1/(2 D) (paper Eq. 8)"),
    "paper_damping_n_m_s_rad": Variable(_PR, "N*m*s/rad", "d = 2 λ I (paper Eq. 9)"),
    "paper_stiffness_n_m_rad": Variable(_PR, "N*m/rad", "k = ω² I (paper Eq. 10)"),
    "decay_start_s": Variable(_PR, "s", "start of the decay that was fitted, from the start of its segment"),
    "decay_rate_per_s": Variable(_PR, "1/s", "λ of the time-domain fit"),
    "decay_rate_std_per_s": Variable(_PR, "1/s", "standard deviation of λ by noise"),
    "decay_rate_misfit_per_s": Variable(_PR, "1/s", "the same by what one λ leaves out of the decay"),
    "decay_frequency_hz": Variable(_PR, "Hz", "damped frequency of the time-domain fit"),
    "decay_frequency_std_hz": Variable(_PR, "Hz", "standard deviation of the damped frequency by noise"),
    "decay_frequency_misfit_hz": Variable(_PR, "Hz", "the same by what one frequency leaves out of the decay"),
    "damping_ratio": Variable(_PR, "1", "λ/sqrt(ω_d² + λ²) of the time-domain fit"),
    "damping_ratio_std": Variable(_PR, "1", "standard deviation of the damping ratio by noise"),
    "damping_ratio_misfit": Variable(_PR, "1", "the same by what one damping ratio leaves out of the decay"),
    "rest_drift": Variable(_PR, "*", "drift of the rest position over the decay, unit of the response"),
    "exponential": Variable(_PR, "1", "1 where the decay is exponential within its noise, else 0"),
}

_WINDOWS = {
    "window_decay_rate_per_s": Variable(_PRW, "1/s", "λ of the peak envelope from that start on"),
    "window_omega_rad_s": Variable(_PRW, "rad/s", "⟨ω⟩ of the peaks from that start on"),
    "window_lehr_damping": Variable(_PRW, "1", "λ/⟨ω⟩ (paper Eq. 7) from that start on"),
}


_SUFFIXES = {"1": "", "Hz": "_hz", "rad": "_rad", "W": "_w", "J": "_j", "A": "_a", "J/rad2": "_j_rad2"}


def _with_interval(name: str, unit: str, meaning: str) -> dict[str, Variable]:
    suffix = _SUFFIXES[unit]
    stem = name.removesuffix(suffix)
    rows = {name: Variable(_P, unit, meaning)}
    for extra, text in (("std", "standard deviation over repeats"), ("low", "low end"), ("high", "high end")):
        rows[f"{stem}_{extra}{suffix}"] = Variable(_P, unit, f"{meaning}: {text}")
    return rows


_RESONANCE = {
    **_with_interval("paper_resonance_hz", "Hz", "frequency of the largest mean of peaks by nominal drive (Eq. 6)"),
    **_with_interval("paper_gain_peak", "1", "largest mean of peaks over nominal drive (Eq. 6)"),
    **_with_interval("resonance_hz", "Hz", "frequency of the largest fundamental by nominal drive"),
    **_with_interval("gain_peak", "1", "largest fundamental by nominal drive, scaled to the mean of peaks there"),
    **_with_interval("gain_peak_measured_drive", "1", "largest gain by measured drive"),
    **_with_interval("resonance_measured_drive_hz", "Hz", "frequency of the largest gain by measured drive"),
    **_with_interval("phase_90_hz", "Hz", "frequency at which the lag passes 90°"),
    **_with_interval("half_power_width_hz", "Hz", "width of the gain by measured drive at peak/sqrt(2)"),
    **_with_interval("drive_amplitude_at_resonance_rad", "rad", "measured drive amplitude at resonance_hz"),
}

_ENERGY = {
    **_with_interval("drive_power_at_resonance_w", "W", "electrical power of the drive at resonance_hz"),
    **_with_interval("copper_at_resonance_w", "W", "of it: copper"),
    **_with_interval("gear_at_resonance_w", "W", "of it: gear and friction, what copper and mechanical power leave"),
    **_with_interval("mechanical_at_resonance_w", "W", "of it: mechanical power into the joint"),
    **_with_interval("holding_at_resonance_w", "W", "electrical power of all tendon motors at resonance_hz"),
    **_with_interval("rest_power_w", "W", "electrical power of all motors while the lever rests at its zero"),
    **_with_interval("energy_per_cycle_at_resonance_j", "J", "energy of the drive per cycle at resonance_hz"),
    **_with_interval("swing_cost_at_resonance_j_rad2", "J/rad2", "energy per cycle over squared torsion amplitude"),
    **_with_interval("trend_cost_at_resonance_j_rad2", "J/rad2", "the same without what spring and inertia save"),
    **_with_interval("energy_reduction", "1", "reduction of the energy per cycle at resonance_hz against the trend"),
    **_with_interval("energy_reduction_with_holding", "1", "the same with the tendon motors' power added"),
    **_with_interval("current_reduction", "1", "reduction of the drive's current at resonance_hz against the trend"),
    **_with_interval("break_even_rad", "rad", "torsion amplitude at which the reduction pays for the tendon motors"),
    **_with_interval("cheapest_hz", "Hz", "frequency of the least energy per cycle and squared torsion amplitude"),
    **_with_interval("swing_cost_at_cheapest_j_rad2", "J/rad2", "that least energy"),
    **_with_interval("cheapest_reduction", "1", "reduction of the energy per cycle at cheapest_hz"),
    **_with_interval("line_current_a", "A", "current at resonance_hz on a line through those off resonance (paper)"),
    **_with_interval("line_reduction", "1", "reduction of the current against that line (paper); negative: more"),
}

ENERGY_QUANTITIES = tuple(list(_ENERGY)[::4])
"""The quantities of the energy part, without their companions."""

RESULT_VARIABLES: dict[str, Variable] = {
    **_COORDINATES,
    **_RESPONSE,
    **_COUPLING,
    **_POWER,
    **_RESONANCE,
    **_ENERGY,
    **_RING_DOWN,
    **_WINDOWS,
}


def companions(name: str) -> tuple[str, str, str]:
    """Return the names of a quantity's standard deviation and of the ends of its interval."""
    suffix = _SUFFIXES[RESULT_VARIABLES[name].unit]
    stem = name.removesuffix(suffix)
    return f"{stem}_std{suffix}", f"{stem}_low{suffix}", f"{stem}_high{suffix}"


def result_axis(name: str, values: ArrayLike) -> tuple[tuple[str, ...], ArrayLike, dict[str, str]]:
    """Return an axis of results, by its name in the schema, as what `xr.Dataset` takes for a coordinate.

    values: its marks in the axis' unit, finite and each once.
    """
    row = _COORDINATES[name]
    return row.dims, values, {"units": row.unit, "long_name": row.meaning}


def validate_results(results: xr.Dataset) -> xr.Dataset:
    """Return the results unchanged if they keep the schema. Raises SchemaError with one sentence."""
    schema = as_dataset(results, "results").attrs.get("schema")
    if schema != RESULTS_SCHEMA:
        raise SchemaError(f"these are not results of schema {RESULTS_SCHEMA!r} (found {schema!r})")
    for name in map(str, results.dims):
        if name not in results.indexes:
            raise SchemaError(
                f"the axis {name!r} of these results has no coordinate, so that no place in it has a name"
            )
        marks = results[name].values
        known = set(map(str, marks)) <= set(CHANNELS) if name == "channel" else np.isfinite(marks).all()
        if not known or np.unique(marks).size != marks.size:
            raise SchemaError(f"the axis {name!r} of these results holds a mark twice, NaN or infinity: {marks}")
    for name, variable in ((str(name), variable) for name, variable in results.variables.items()):
        row = RESULT_VARIABLES.get(name)
        if row is None:
            raise SchemaError(f"unknown result variable {name!r}")
        if variable.dims != row.dims:
            raise SchemaError(f"result variable {name!r} has dimensions {variable.dims}, expected {row.dims}")
        unit = variable.attrs.get("units", "")
        if row.unit not in ("*", unit):
            raise SchemaError(f"result variable {name!r} has unit {unit!r}, expected {row.unit!r}")
    for part in (_RESPONSE, _COUPLING, _POWER, _RESONANCE, _ENERGY, _RING_DOWN, _WINDOWS):
        missing = [name for name in part if name not in results]
        if missing and len(missing) < len(part):
            raise SchemaError(
                f"results lack {missing[0]!r}, which belongs beside {next(n for n in part if n in results)!r}"
            )
    return results


# Recordings are put together, and taken apart into segments.


REGISTERS_ATTRIBUTE = "registers"
"""Attribute of a recording from a bench: the motors' registers as they were read back, as JSON."""
LIMITS_ATTRIBUTE = "tendon_limit_a"
"""Attribute of one whose tendon motors yield at a current: mean of their limits by pretension [mm], as JSON."""

SOURCES = {
    "twin": "simulated by the physics twin",
    "emulator": "recorded on the emulated bench: no motor moved",
    "bench": "recorded on the bench",
    "import": "an imported recording",
}
"""What a recording's attribute `source` says, in words."""


FEWEST_FREQUENCIES = 6
"""So many a sweep needs for a resonance to be read off its curve."""


def too_few_frequencies(count: int) -> str:
    """Return why a sweep of so many frequencies has no resonance."""
    return f"too few frequencies for a resonance: found {count}, expected at least {FEWEST_FREQUENCIES}; measure more"


@dataclass(frozen=True)
class Segment:
    """What was asked for in one stretch of a recording.

    kind: settle, steady, ring-down or idle.
    pretension_mm: common shortening of the tendons from first contact [mm].
    frequency_hz, amplitude_deg: of the drive; NaN where there is none (idle, foreign ring-down). Tracking has no
    frequency of its own, and its amplitude is the one that was to be held.
    repeat: index of the repetition, from 0.
    bend_deg, azimuth_deg: the pose; see `sinew.plan.plan`. excitation: what moves the head. amplitude_mm: of tendons
    that drive it, NaN where they hold still. impulse_n_m_s: of a blow; NaN where there is none.
    """

    kind: SegmentKind
    pretension_mm: float
    frequency_hz: float
    amplitude_deg: float
    repeat: int
    bend_deg: float = 0.0
    azimuth_deg: float = 0.0
    excitation: Excitation = "lever"
    amplitude_mm: float = math.nan
    impulse_n_m_s: float = math.nan

    @property
    def is_spatial(self) -> bool:
        """Whether the head is bent, or moved by something else than the lever."""
        return self.bend_deg != 0.0 or self.excitation != "lever"


def build_recording(
    samples: Mapping[str, ArrayLike],
    segments: Sequence[Segment],
    row_size: Sequence[int],
    attrs: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Return a valid recording.

    samples: arrays by schema name, all of the same first length; see `SAMPLE_VARIABLES`.
    segments, row_size: what was asked for, and how many samples it got, in order.
    attrs: provenance; see `sinew.measure.files.netcdf`.
    units: units of `response` and `drive`, which the schema leaves open.
    Raises SchemaError where the parts do not fit together.
    """
    variables: dict[str, tuple[tuple[str, ...], ArrayLike, dict[str, str]]] = {}
    for name, values in samples.items():
        if name not in SAMPLE_VARIABLES:
            raise SchemaError(f"unknown sample variable {name!r}, expected one of {', '.join(SAMPLE_VARIABLES)}")
        row = SAMPLE_VARIABLES[name]
        unit = (units or {}).get(name, "") if row.unit == "*" else row.unit
        given = as_seconds(values, name) if name == "time_s" else _numbers(values, name)
        variables[name] = (row.dims, given, {"units": unit, "long_name": row.meaning})
    columns: dict[str, ArrayLike] = {
        "row_size": np.asarray(row_size, dtype=np.int64),
        "kind": np.asarray([s.kind for s in segments], dtype=object),
        "pretension_mm": np.asarray([s.pretension_mm for s in segments], dtype=float),
        "frequency_hz": np.asarray([s.frequency_hz for s in segments], dtype=float),
        "amplitude_deg": np.asarray([s.amplitude_deg for s in segments], dtype=float),
        "repeat": np.asarray([s.repeat for s in segments], dtype=np.int64),
    }
    spatial = any(s.is_spatial for s in segments)
    if spatial:
        for name in SPATIAL_SEGMENTS:
            kind: Any = object if name == "excitation" else float
            columns[name] = np.asarray([getattr(s, name) for s in segments], dtype=kind)
    for name, values in columns.items():
        row = SEGMENT_VARIABLES[name]
        variables[name] = (row.dims, values, {"units": row.unit, "long_name": row.meaning})
    try:
        dataset = xr.Dataset(variables)
    except ValueError as error:
        raise SchemaError(f"samples do not fit together: {error}") from error
    dataset["row_size"].attrs["sample_dimension"] = "sample"
    # A straight recording without an orientation is what it always was: readers of the first schema read it.
    schema = SPATIAL_SCHEMA if spatial or "orientation" in samples else RECORDING_SCHEMA
    dataset.attrs = {"Conventions": "CF-1.11", "featureType": "timeSeries", **attrs, "schema": schema}
    return validate_recording(dataset)


def _numbers(values: ArrayLike, name: str) -> ArrayLike:
    """Return samples in the precision they have where they are a plain array of numbers, else as float64."""
    if type(values) is np.ndarray and values.dtype.kind in "fiu":
        return values
    return as_numbers(values, name)


def segment_slices(recording: xr.Dataset) -> list[slice]:
    """Return the sample slice of every segment, in order."""
    ends = map(int, np.cumsum(recording["row_size"].values))
    return [slice(*edges) for edges in pairwise([0, *ends])]


def iterate_segments(recording: xr.Dataset, kind: SegmentKind | None = None) -> Iterator[tuple[int, Segment, slice]]:
    """Yield (index, segment, sample slice) of every segment, or of those of one kind."""
    names = ["kind", "pretension_mm", "frequency_hz", "amplitude_deg", "repeat"]  # in the order of Segment's fields
    if all(name in recording for name in SPATIAL_SEGMENTS):
        names += SPATIAL_SEGMENTS
    columns = [recording[name].values.tolist() for name in names]
    columns[names.index("repeat")] = list(map(int, columns[names.index("repeat")]))
    for index, (where, row) in enumerate(zip(segment_slices(recording), zip(*columns, strict=True), strict=True)):
        if kind is None or row[0] == kind:
            yield index, Segment(*row), where


def read_registers(recording: xr.Dataset) -> list[dict[str, Any]]:
    """Return with which registers the motors measured, one mapping for each run that wrote to the recording.

    run: its number, from 1. tendon_mode: position, position-with-current-limit or current. motors: by name ("tendon 1",
    "drive"), each with its id, its model, and registers: counts by the name in the control table, as they were read
    back after the plan's mode was set. Empty for a recording of the twin, an import, and one older than this attribute.
    Raises SchemaError where the attribute is not of that form.
    """
    text = recording.attrs.get(REGISTERS_ATTRIBUTE, "[]")
    try:
        runs = json.loads(text)
    except (TypeError, ValueError) as error:
        raise SchemaError(f"attribute {REGISTERS_ATTRIBUTE!r} is not JSON ({error}); was the file edited?") from error
    if not isinstance(runs, list) or not all(isinstance(run, dict) and "motors" in run for run in runs):
        raise SchemaError(f"attribute {REGISTERS_ATTRIBUTE!r} holds no list of runs with motors; was the file edited?")
    return runs


# An imported recording is cut to the stretch of time that the user names.


def cut_recording(recording: xr.Dataset, start_s: float | None, stop_s: float | None) -> xr.Dataset:
    """Return the samples of an imported recording from start_s to stop_s, both included [s]; None leaves an end open.

    The times are those of the recording, as in the file it came from. Segments without a sample left are dropped, and
    `import_notes` tells of the cut. Raises SpecError for a recording that was not imported, whose segments mean
    something, and TimeError where start is not before stop or nothing is left.
    """
    if start_s is None and stop_s is None:
        return recording
    if recording.attrs.get("source") != "import":
        raise SpecError(
            "start and stop choose a stretch of a CSV file or of an imported recording; this one is a campaign whose "
            "segments are analysed whole; leave them out"
        )
    time = recording["time_s"].values
    retained = choose_stretch(time, start_s, stop_s, "recording")
    sizes = np.array([int(retained[where].sum()) for where in segment_slices(recording)], dtype=np.int64)
    cut = recording.isel(sample=np.flatnonzero(retained), segment=np.flatnonzero(sizes))
    cut["row_size"] = ("segment", sizes[sizes > 0], recording["row_size"].attrs)
    note = f"cut to {time[retained].min():g} to {time[retained].max():g} s"
    before = str(recording.attrs.get("import_notes", ""))
    cut.attrs = {k: v for k, v in recording.attrs.items() if k != "content_hash"} | {
        "import_notes": f"{before}\n{note}" if before else note
    }
    return validate_recording(cut)
