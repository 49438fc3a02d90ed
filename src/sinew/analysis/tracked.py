"""A tracked swing looked at afterwards, turn by turn: frequency, phase, amplitudes, pretension; and how it is told."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
import xarray as xr

from sinew.analysis.signal.signals import DelayBudget, Signals, drive_chain, read_signals, torsion_chain
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.measure.result import Field, Result, Rows
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan

_ORDERS = (1, 3)
_FEWEST_ROWS = 16
_MOST_GAP = 0.15  # of a turn
_BLOCKS = 5
_FIRST_ROWS = 4  # the pretension may move from the begin on


@dataclass(frozen=True, repr=False)
class TrackedPoint(Result):
    """Where a joint resonated while it was tracked: a point of its backbone.

    frequency_hz: at which the torsion's fundamental lags the measured lever by 90°; predicted_hz: there by the backbone
    that was predicted before, NaN without one. torsion_deg, lever_deg: amplitudes of the fundamentals. phase_error_deg:
    root mean square over the turns of the lag less 90°. damping_ratio: Lehr's, of the equivalent linear joint, which at
    that phase is I_l θ/(2 I φ). pretension_mm: mean. turns: how many were used.
    """

    pretension_mm: Annotated[float, Field("", "detail")]
    frequency_hz: Annotated[Estimate, Field("resonance")]
    torsion_deg: Annotated[Estimate, Field("torsion")]
    lever_deg: Annotated[Estimate, Field("lever")]
    damping_ratio: Annotated[Estimate, Field("damping")]
    phase_error_deg: Annotated[float, Field("error")]
    turns: Annotated[int, Field("", "detail")]
    predicted_hz: Annotated[float, Field("predicted")] = math.nan


@dataclass(frozen=True, repr=False)
class Follow(Result):
    """How far the resonance was from the frequency that was wanted while that moved."""

    from_hz: Annotated[float, Field("followed from")]
    to_hz: Annotated[float, Field("to")]
    begin_s: Annotated[float, Field("", "detail")]
    duration_s: Annotated[float, Field("in")]
    rms_error_hz: Annotated[float, Field("error, rms")]
    largest_error_hz: Annotated[float, Field("at most")]


@dataclass(frozen=True, repr=False)
class Track(Result):
    """One motion that was tracked. lock_cycles: after how many turns it was locked, None for never; lock_losses: how
    often it was lost. phase_error_deg: rms once it was locked. point: at one pretension; follow: where that moved.
    turns: turn by turn, columns by name."""

    pretension_mm: Annotated[float, Field("pretension")]
    amplitude_deg: Annotated[float, Field("held")]
    lock_cycles: Annotated[float | None, Field("locked after turns")]
    lock_losses: Annotated[int, Field("lost")]
    phase_error_deg: Annotated[float | None, Field("phase error")]
    turns: Annotated[Mapping[str, Sequence[float]], Field("", "detail")]
    point: Annotated[TrackedPoint | None, Field("")]
    follow: Annotated[Follow | None, Field("")]


@dataclass(frozen=True, repr=False)
class Tracking(Result):
    """Every motion of a recording that was tracked. held: which amplitude; expected: the backbones predicted before."""

    held: Annotated[str | None, Field("amplitude held", "sentence")]
    expected: Annotated[tuple[Mapping[str, Any], ...], Field("", "detail")]
    tracks: Annotated[Rows[Track], Field("the torsion lags the lever by 90°")]


def tracked_turns(recording: xr.Dataset, segment: int, rig: RigSpec) -> xr.Dataset:
    """Return a tracking segment turn by turn, over `turn`: time_s (middle, since the segment's begin), frequency_hz,
    phase_error_rad (lag less 90°), lever_rad, torsion_rad (amplitudes), pretension_mm, number (how often the drive has
    turned by its end).

    Turns are counted by the rising zeros of the command. Lever and rate are fitted in each by offset and harmonics 1
    and 3; the delays of both sensors are undone. A turn with a hole in it is left out.
    Raises RecordingError where the segment is not tracking, lacks a channel, or holds no whole turn.
    """
    signals = read_signals(recording, rig)
    (planned, where), lever, rate = signals.segments[segment], signals.drive, signals.response
    command = signals.recorded.get("drive_command_rad")
    if planned.kind != "tracking" or command is None or lever is None or not rate.is_rate:
        raise RecordingError(
            f"segment {segment} is {planned.kind}, expected tracking with command, lever and gyroscope"
        )
    time = signals.time_s[where]
    both = np.stack([lever.values[where], rate.values[where]], axis=1)
    pretension = _pretension(signals, where, planned.pretension_mm, rig)
    zeros = _rising_zeros(time, command[where].astype(float))
    rows = []
    for turn, (begin, end) in enumerate(pairwise(zeros.tolist()), start=2):  # the first zero ends the first turn
        mine = slice(*np.searchsorted(time, (begin, end)))
        found = _turn(time[mine], both[mine], begin, end, signals.budget)
        if found is not None:
            middle, there = 0.5 * (begin + end) - time[0], float(pretension[mine].mean())
            rows.append((middle, 1 / (end - begin), *found, there, float(turn)))
    if not rows:
        raise RecordingError(f"segment {segment} holds no whole turn of the drive; track longer")
    names = ("time_s", "frequency_hz", "phase_error_rad", "lever_rad", "torsion_rad", "pretension_mm", "number")
    return xr.Dataset({name: ("turn", column) for name, column in zip(names, np.array(rows).T, strict=True)})


def _rising_zeros(time: Array, command: Array) -> Array:
    at = np.flatnonzero((command[:-1] < 0) & (command[1:] >= 0))
    share = -command[at] / (command[at + 1] - command[at])
    return np.asarray(time[at] + share * (time[at + 1] - time[at]))


def _turn(
    time: Array, signals: Array, begin: float, end: float, budget: DelayBudget
) -> tuple[float, float, float] | None:
    """Return (phase error [rad], amplitudes of lever and torsion [rad]) of one turn; None where it has holes."""
    longest = float(np.diff(time, prepend=begin, append=end).max())
    if time.size < _FEWEST_ROWS or longest > _MOST_GAP * (end - begin):
        return None
    hertz = 1 / (end - begin)
    phase = math.tau * hertz * (time - begin)
    waves = [wave(order * phase) for order in _ORDERS for wave in (np.cos, np.sin)]
    found = np.linalg.lstsq(np.stack([np.ones_like(phase), *waves], axis=1), signals, rcond=None)[0]
    lever, rate = found[1] - 1j * found[2]
    lever = lever / complex(drive_chain(budget, hertz))
    torsion = rate / (1j * math.tau * hertz * complex(torsion_chain(budget, hertz)))
    lag = float(np.angle(lever * np.conj(torsion)))
    return math.remainder(lag - 0.5 * math.pi, math.tau), abs(lever), abs(torsion)


def _pretension(signals: Signals, where: slice, begin: float, rig: RigSpec) -> Array:
    """Return the pretension of every row [mm]: that of the begin, and what the motors took up since its begin.

    What their position loops give way under load is added, as the plan counts by goals.
    """
    recorded = signals.recorded
    if "tendon_rad" not in recorded:
        return np.full(where.stop - where.start, begin)
    tendons = rig.tendons
    horn = recorded["tendon_rad"][where].astype(float).mean(axis=1) * tendons.pulley_radius.value
    current = recorded["tendon_current_a"][where].astype(float).mean(axis=1)
    give = current * tendons.tension(1.0) / tendons.servo_stiffness.value
    goal = horn + give
    rest = goal[:_FIRST_ROWS].mean()
    return np.asarray(begin + 1e3 * (goal - rest))


def tracked_point(turns: xr.Dataset, rig: RigSpec, share: float = 0.5) -> TrackedPoint:
    """Return the point of the backbone that a stretch of turns at one pretension holds.

    turns: of `tracked_turns`. share: of them, the last ones, that are used; the others belong to the start.
    Neighbouring turns are not independent, so standard deviations are of the means of five blocks, and Student's
    interval has four degrees of freedom. The frequency's has the uncertainty of the delay budget in it: a phase wrong
    by ε moves it by ε D f.
    Raises RecordingError where fewer than ten turns are left.
    """
    count = int(share * turns.sizes["turn"])
    if count < 2 * _BLOCKS:
        raise RecordingError(f"{count} turns are left to measure, expected {2 * _BLOCKS} or more; track longer")
    mine = turns.isel(turn=slice(-count, None))
    hertz, torsion, lever = (mine[name].values for name in ("frequency_hz", "torsion_rad", "lever_rad"))
    half = rig.inertia.lever.value / (rig.inertia.head.value + rig.inertia.lever.value) / 2
    damping = _mean(half * lever / torsion)
    frequency = _mean(hertz)
    delay = math.tau * frequency.value * rig.imu.delay_std.value * damping.value * frequency.value
    return TrackedPoint(
        pretension_mm=float(mine["pretension_mm"].mean()),
        frequency_hz=_widened(frequency, delay),
        torsion_deg=_mean(np.degrees(torsion)),
        lever_deg=_mean(np.degrees(lever)),
        damping_ratio=damping,
        phase_error_deg=float(np.degrees(np.sqrt(np.mean(mine["phase_error_rad"].values ** 2)))),
        turns=count,
    )


def _mean(values: Array) -> Estimate:
    means = np.array([block.mean() for block in np.array_split(values, _BLOCKS)])
    return Estimate.student(float(values.mean()), float(means.std(ddof=1) / math.sqrt(_BLOCKS)), _BLOCKS - 1)


def _widened(estimate: Estimate, std: float) -> Estimate:
    """Return an estimate with another, normal uncertainty added in squares, to its interval as well."""
    half = math.hypot(estimate.high - estimate.value, NORMAL_90 * std)
    value = estimate.value
    return Estimate(value, math.hypot(estimate.std, std), value - half, value + half)


# What a recording says of every tracked motion.

BACKBONES_ATTRIBUTE = "backbones"
"""Attribute of a recording: JSON, the backbone that was predicted at each pretension before it was tracked."""

ENTER_DEG, LEAVE_DEG, PATIENCE = 6.0, 30.0, 4.0
"""Locked is a phase error below the first; lost, one above the second, or so many turns without one."""

_STOOD_MM = 0.2
_DIGITS = {"time_s": 4, "frequency_hz": 5, "phase_error_deg": 3, "lever_deg": 3, "torsion_deg": 3, "pretension_mm": 3}


def frequency_on_backbone(torsion: Array, frequency_hz: Array, amplitude: float) -> float:
    """Return the frequency [Hz] of a predicted backbone at an amplitude of the torsion; NaN beyond the curve.

    torsion: along the curve, growing, in the unit of the amplitude. frequency_hz: there.
    """
    inside = torsion[0] <= amplitude <= torsion[-1] * 1.02
    return float(np.interp(amplitude, torsion, frequency_hz)) if inside else math.nan


def turns_to_lock(turns: xr.Dataset) -> tuple[float | None, int]:
    """Return (after how many turns of the drive it was locked, None for never; how often the lock was lost).

    Locked is the second of two turns in a row with an error below `ENTER_DEG`.
    """
    error, count = np.degrees(np.abs(turns["phase_error_rad"].values)), turns["number"].values
    first: float | None = None
    is_locked, losses = False, 0
    for i in range(1, error.size):
        follows = count[i] - count[i - 1] == 1
        if is_locked:
            is_lost = error[i] > LEAVE_DEG or count[i] - count[i - 1] > PATIENCE
            is_locked, losses = not is_lost, losses + int(is_lost)
        elif follows and max(error[i - 1], error[i]) < ENTER_DEG:
            is_locked, first = True, float(count[i]) if first is None else first
    return first, losses


def find_tracking(recording: xr.Dataset, rig: RigSpec) -> Tracking:
    """Return what a recording says of every motion that was tracked.

    Raises RecordingError where a tracked motion cannot be read.
    """
    text = str(recording.attrs.get("plan", ""))
    plan = parse_plan(text) if text.strip() else None
    expected = json.loads(str(recording.attrs.get(BACKBONES_ATTRIBUTE, "[]")))
    segments = np.flatnonzero(recording["kind"].values == "tracking").tolist()
    tracks = Rows(_track(recording, segment, rig, plan, expected) for segment in segments)
    held = plan.track.held if plan is not None and plan.track is not None else None
    return Tracking(held, tuple(expected), tracks)


def _track(
    recording: xr.Dataset, segment: int, rig: RigSpec, plan: Plan | None, expected: Sequence[Mapping[str, Any]]
) -> Track:
    turns = tracked_turns(recording, segment, rig)
    locked, losses = turns_to_lock(turns)
    columns = {str(name): turns[name].values for name in turns}
    for name in ("phase_error", "lever", "torsion"):
        columns[f"{name}_deg"] = np.degrees(columns.pop(f"{name}_rad"))
    error = columns["phase_error_deg"][columns["number"] >= (math.inf if locked is None else locked)]
    planned = plan.track if plan is not None else None
    moves = np.ptp(columns["pretension_mm"]) > _STOOD_MM if planned is None else planned.pretension_to_mm is not None
    return Track(
        pretension_mm=float(recording["pretension_mm"].values[segment]),
        amplitude_deg=float(recording["amplitude_deg"].values[segment]),
        lock_cycles=locked,
        lock_losses=losses,
        phase_error_deg=float(np.sqrt(np.mean(error**2))) if error.size else None,
        turns={name: np.round(columns[name], digits).tolist() for name, digits in _DIGITS.items()},
        point=None if moves else _point(turns, rig, expected),
        follow=_followed(columns, plan) if plan is not None and moves else None,
    )


def _point(turns: xr.Dataset, rig: RigSpec, expected: Sequence[Mapping[str, Any]]) -> TrackedPoint | None:
    try:
        point = tracked_point(turns, rig)
    except RecordingError:
        return None
    if not expected:
        return point
    near = min(expected, key=lambda one: abs(one["pretension_mm"] - point.pretension_mm))
    curve = (np.array(near["torsion_deg"]), np.array(near["frequency_hz"]))
    return replace(point, predicted_hz=frequency_on_backbone(*curve, point.torsion_deg.value))


def _followed(columns: dict[str, Array], plan: Plan) -> Follow | None:
    """Return how far the resonance was from the wanted frequency while that moved; None where none was wanted."""
    track = plan.track
    if track is None or track.wanted_hz is None:
        return None
    times = (track.lead_s, track.lead_s + track.duration_s)
    time, hertz = columns["time_s"], columns["frequency_hz"]
    moving = (time >= times[0]) & (time <= times[1])
    off = (hertz - np.interp(time, times, track.wanted_hz))[moving]
    return Follow(
        from_hz=track.wanted_hz[0],
        to_hz=track.wanted_hz[1],
        begin_s=track.lead_s,
        duration_s=track.duration_s,
        rms_error_hz=float(np.sqrt(np.mean(off**2))),
        largest_error_hz=float(np.abs(off).max()),
    )
