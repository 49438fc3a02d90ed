"""Swings in a rig's recordings: how the lever moved and what the sensors said."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import signal
from scipy.interpolate import CubicSpline

from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError
from sinew.measure.recording import LIMITS_ATTRIBUTE, Segment, SegmentKind, iterate_segments
from sinew.mechanics.parameters import POSITION, TENDON_MODES
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan

_FEWEST = 40  # samples of a segment: below that its low-passed part is too short to be worth its simulation
_LARGEST_GAP = 0.05  # share of samples that may be missing


@dataclass(frozen=True)
class Swing:
    """One motion: a settle, if there was one, and the segment after it.

    recording, segment: indices; kind, pretension_mm, frequency_hz, repeat: of the segment.
    mode: of the tendon motors, as the twin numbers them. sample_s: time between samples [s].
    lever: angle of the lever against the head [rad] at sample n, n from 0, as a cubic spline over n·sample_s, the
        drive's delay taken out.
    gyro: rate about the joint's axis as read [rad/s], shape (n,); present: which samples were really there, shape (n,).
    recorded: number of samples before the segment. rests: whether it is known to begin at rest.
    current_a: mean current of the tendon motors over the segment [A],
        NaN where it was not recorded; current_swing_a: half of its range [A].
    limit_a: mean current at which the tendon motors yield, as a bench told them; NaN where their mode has no limit, and
        of the twin, whose motors yield `LIMIT_RESERVE_N` above what they hold at rest.
    """

    recording: int
    segment: int
    kind: SegmentKind
    pretension_mm: float
    frequency_hz: float
    repeat: int
    mode: float
    sample_s: float
    lever: CubicSpline
    gyro: Array
    present: Mask
    recorded: int
    rests: bool
    current_a: float
    current_swing_a: float
    limit_a: float = np.nan

    @property
    def size(self) -> int:
        """Return the number of samples, from rest on."""
        return self.gyro.size

    @property
    def pair(self) -> tuple[int, float, int]:
        """Return (recording, pretension, repeat): what shares one setting of the tendons."""
        return self.recording, self.pretension_mm, self.repeat

    def lever_acceleration(self, steps: int) -> Array:
        """Return the lever's acceleration [rad/s²] at begin, middle and end of every step, shape (2 steps n + 1,).

        steps: between samples. A cubic spline's second derivative is a broken line, which the simulation integrates
        back to the spline itself: rounding of the readings is passed on, not amplified.
        """
        time = np.arange(2 * steps * self.size + 1) * self.sample_s / (2 * steps)
        return np.asarray(self.lever(np.minimum(time, (self.size - 1) * self.sample_s), 2), dtype=float)


def swings_of(recordings: Sequence[xr.Dataset], rig: RigSpec) -> list[Swing]:
    """Return the swings of all steady and ring-down segments. Raises RecordingError where there are none."""
    found = [swing for index, recording in enumerate(recordings) for swing in _swings(index, recording, rig)]
    if not found:
        raise RecordingError(
            "the recordings hold neither steady segments nor ring-downs of at least "
            f"{_FEWEST} samples; the tendon joint needs a rig's sweep or its ring-downs"
        )
    return found


def _swings(index: int, recording: xr.Dataset, rig: RigSpec) -> list[Swing]:
    missing = [name for name in ("drive_rad", "gyro_rad_s") if name not in recording]
    if missing:
        raise RecordingError(
            f"recording {index} lacks {' and '.join(missing)}; the tendon joint is fitted to the lever's encoder and "
            "the gyroscope, so take a rig's recording, or another model"
        )
    text = str(recording.attrs.get("plan", ""))
    mode = TENDON_MODES[parse_plan(text, "the recording's plan").pretension.mode] if text.strip() else POSITION
    rows = list(iterate_segments(recording))
    if any(segment.is_spatial for _, segment, _ in rows):
        raise RecordingError(
            f"recording {index} is of a head that bends or sways; the tendon joint is fitted to an upright head that "
            "the lever turns, so take such a recording, or another model"
        )
    stamps = np.asarray(recording["time_s"].values, dtype=float)
    moving = [(row[0], row[1], _with_settle(rows, k)) for k, row in enumerate(rows) if _is_wanted(row)]
    if not moving:
        return []
    sample_s = float(np.median([line_through(stamps[where])[0] for _, _, where in moving]))
    return [_swing(recording, index, number, segment, rows[number][2].start, where, mode, sample_s, rig)
            for number, segment, where in moving]  # fmt: skip


def _is_wanted(row: tuple[int, Segment, slice]) -> bool:
    return row[1].kind in ("steady", "ring-down") and row[2].stop - row[2].start >= _FEWEST


def _with_settle(rows: Sequence[tuple[int, Segment, slice]], k: int) -> slice:
    """Return the samples of row k, and of the settle before it where that is of the same motion."""
    _, mine, where = rows[k]
    if k == 0:
        return where
    _, before, settle = rows[k - 1]
    alike = (before.pretension_mm, before.frequency_hz, before.repeat) == (
        mine.pretension_mm,
        mine.frequency_hz,
        mine.repeat,
    )
    return slice(settle.start, where.stop) if before.kind == "settle" and alike else where


def line_through(stamps: Array) -> tuple[float, Array]:
    """Return the time between samples by the line through the stamps, gaps left out, and each stamp's place on it.

    The place is counted in samples from the first one on the line. The median difference of jittering stamps is off by
    a thousandth, which over a thousand samples is one too many; so the count goes over ever longer differences.
    """
    slope, lag = float(np.median(np.diff(stamps))), 1
    while (lag := 4 * lag) < stamps.size:
        spans = stamps[lag:] - stamps[:-lag]
        slope = float(np.median(spans / np.maximum(np.round(spans / slope), 1)))
    turn = np.exp(2j * np.pi * (stamps - stamps[0]) / slope).mean()
    index = np.round((stamps - stamps[0]) / slope - np.angle(turn) / (2 * np.pi))
    slope, begin = np.polyfit(index, stamps, 1)
    return float(slope), (stamps - begin) / slope - index[0]


def places_of(stamps: Array, sample_s: float, jitter_s: float) -> Array:
    """Return when each sample was taken, in samples from the first [1], increasing, shape (n,).

    jitter_s: standard deviation of the stamps of samples that are taken at an even rate. A stamp that is no further
    from its place on the line through all of them than the largest of so many errors, sqrt(2 ln n) standard deviations
    (Donoho & Johnstone 1994), is taken for jitter, and its sample to be on the line. Another one, as of a cycle of the
    bench that began late, and two that would be in one place say when the sample was taken.
    """
    _, place = line_through(stamps)
    nearest = np.round(place)
    on_line = np.abs(place - nearest) * sample_s <= np.sqrt(2 * np.log(stamps.size)) * jitter_s
    _, which, count = np.unique(nearest[on_line], return_inverse=True, return_counts=True)
    on_line[on_line] = count[which] == 1
    return np.where(on_line, nearest, place)


def _swing(
    recording: xr.Dataset,
    index: int,
    number: int,
    segment: Segment,
    begin: int,
    where: slice,
    mode: float,
    sample_s: float,
    rig: RigSpec,
) -> Swing:
    stamps = np.asarray(recording["time_s"].values[where], dtype=float)
    place = places_of(stamps, sample_s, rig.bus.stamp_jitter.value)
    grid = np.arange(round(place[-1]) + 1)
    # A place between samples that are as far apart as if one were missing between them is not known.
    after = np.clip(np.searchsorted(place, grid), 1, place.size - 1)
    present = (np.round(place[after] - place[after - 1]) < 2) | (grid == place[after]) | (grid == place[after - 1])
    if np.mean(present) < 1 / (1 + _LARGEST_GAP):
        raise RecordingError(
            f"segment {number} at {segment.pretension_mm:g} mm lacks {np.sum(~present)} of {grid.size} "
            f"samples, expected at most {100 * _LARGEST_GAP:g} %; leave that segment out, or record it again"
        )
    read = np.asarray(recording["gyro_rad_s"].values[where, 0], dtype=float)
    gyro = np.where(present, CubicSpline(place, read)(grid), np.interp(grid, place, read))
    # The reading at stamp t is the lever's angle at t - late.
    time = place * sample_s - rig.bus.drive_delay.value
    lever = CubicSpline(time, np.asarray(recording["drive_rad"].values[where], dtype=float), bc_type="natural")
    current, swing = np.nan, np.nan
    if "tendon_current_a" in recording:
        whole = np.asarray(recording["tendon_current_a"].values[begin : where.stop], dtype=float).mean(axis=1)
        current, swing = float(whole.mean()), 0.5 * float(np.ptp(whole))
    recorded = int(np.ceil(place[begin - where.start]))
    limit = json.loads(recording.attrs.get(LIMITS_ATTRIBUTE, "{}")).get(f"{segment.pretension_mm:g}", np.nan)
    # The twin begins every group at rest. On a bench one goes over into the next, or begins after a wait that ends.
    rests = recording.attrs.get("source") == "twin"
    return Swing(
        index, number, segment.kind, segment.pretension_mm, segment.frequency_hz, segment.repeat, mode, sample_s,
        lever, gyro, present, recorded, rests, current, swing, limit,
    )  # fmt: skip


# Rates that were read and rates that were simulated are made comparable: averaged, low-passed, thinned.
#
# The lever's encoder rounds to 1.5 mrad, and its rounding reaches the simulated rate as noise that grows with
# frequency. What the joint does, it does below a few times the drive's frequency. So both rates pass one linear-phase
# low-pass, and every so many samples are kept; the same is done to the derivatives.

_PASS_HZ, _STOP_HZ, _STOPPED_DB = 15.0, 30.0, 60.0
_KEPT_HZ = 50.0
_SIEVE_FEWEST = 16


@dataclass(frozen=True)
class Sieve:
    """The low-pass of one swing.

    taps: odd in number, symmetric. kept: samples of the swing that are compared, shape (k,). average: samples that the
    gyroscope's readings are the mean of.
    """

    taps: Array
    kept: NDArray[np.intp]
    average: int

    def averaged(self, rate: Array) -> Array:
        """Return the causal mean over `average` samples along the first axis, as the twin's sensor takes it."""
        padded = np.concatenate([np.repeat(rate[:1], self.average - 1, axis=0), rate])
        total = np.cumsum(np.concatenate([np.zeros_like(padded[:1]), padded]), axis=0)
        return np.asarray((total[self.average :] - total[: -self.average]) / self.average)

    def passed(self, rate: Array) -> Array:
        """Return what is compared of a rate, (n, ...) to (k, ...); before its first sample the joint was at rest."""
        half = self.taps.size // 2
        ends = np.zeros((half, *rate.shape[1:]))
        windows = sliding_window_view(np.concatenate([ends, rate, ends]), self.taps.size, axis=0)
        return np.asarray(windows[self.kept] @ self.taps)


def make_sieve(swing: Swing, average: int) -> Sieve:
    """Return the sieve of a swing: of its segment what is not at an end or a gap of the record."""
    rate_hz = 1 / swing.sample_s
    every = max(1, int(rate_hz / _KEPT_HZ + 1e-6))
    taps = np.ones(1)
    if rate_hz > 2.2 * _STOP_HZ:
        width = 2 * np.pi * (_STOP_HZ - _PASS_HZ) / rate_hz
        count = int(np.ceil((_STOPPED_DB - 7.95) / (2.285 * width))) // 2 * 2 + 1
        window = ("kaiser", signal.kaiser_beta(_STOPPED_DB))
        taps = signal.firwin(count, 0.5 * (_PASS_HZ + _STOP_HZ), window=window, fs=rate_hz)
    half = taps.size // 2
    # A sample that is not there spoils the lever's motion beside it and every window that it lies in.
    near = np.convolve(~swing.present, np.ones(2 * half + 9), mode="same")[: swing.size] > 0.5
    index = np.arange(swing.recorded, swing.size - half)[::every]
    return Sieve(np.asarray(taps, dtype=float), index[~near[index]], average)


def is_enough(swing: Swing, average: int) -> bool:
    """Return whether a swing keeps enough samples behind its sieve to be compared."""
    return make_sieve(swing, average).kept.size >= _SIEVE_FEWEST
