"""Motion of the joint under a lever that was measured: swings in recordings, the joint under them, their least squares.

The drive plays no part: its horn is wherever the encoder says it was. Everything else is `sinew.mechanics.joint`. The
residuals are whitened by the noise that a fit before has shown.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import signal
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_toeplitz
from scipy.ndimage import convolve1d

from sinew.identify.oscillator.least_squares import Problem
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import NORMAL_90, NORMAL_95, Estimate
from sinew.measure.recording import LIMITS_ATTRIBUTE, Segment, SegmentKind, iterate_segments
from sinew.measure.tasks import cores
from sinew.mechanics.joint import State, axial_omega, derivative, head_forces, state_at_rest
from sinew.mechanics.parameters import POSITION, TENDON_MODES, Parameters
from sinew.mechanics.tendons import total_tension
from sinew.plan.parameter import Parameter
from sinew.plan.rig import LIMIT_RESERVE_N, RigSpec
from sinew.plan.toml import parse_plan
from sinew.solve.programs import configure, program
from sinew.solve.rest import set_pretension
from sinew.twin.parameters import from_rig

# ---- swings in a rig's recordings: how the lever moved and what the sensors said

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
    _, slot = line_through(stamps)
    nearest = np.round(slot)
    on_line = np.abs(slot - nearest) * sample_s <= np.sqrt(2 * np.log(stamps.size)) * jitter_s
    _, which, count = np.unique(nearest[on_line], return_inverse=True, return_counts=True)
    on_line[on_line] = count[which] == 1
    return np.where(on_line, nearest, slot)


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
    slot = places_of(stamps, sample_s, rig.bus.stamp_jitter.value)
    grid = np.arange(round(slot[-1]) + 1)
    # A place between samples that are as far apart as if one were missing between them is not known.
    after = np.clip(np.searchsorted(slot, grid), 1, slot.size - 1)
    present = (np.round(slot[after] - slot[after - 1]) < 2) | (grid == slot[after]) | (grid == slot[after - 1])
    if np.mean(present) < 1 / (1 + _LARGEST_GAP):
        raise RecordingError(
            f"segment {number} at {segment.pretension_mm:g} mm lacks {np.sum(~present)} of {grid.size} "
            f"samples, expected at most {100 * _LARGEST_GAP:g} %; leave that segment out, or record it again"
        )
    read = np.asarray(recording["gyro_rad_s"].values[where, 0], dtype=float)
    gyro = np.where(present, CubicSpline(slot, read)(grid), np.interp(grid, slot, read))
    # The reading at stamp t is the lever's angle at t - late.
    time = slot * sample_s - rig.bus.drive_delay.value
    lever = CubicSpline(time, np.asarray(recording["drive_rad"].values[where], dtype=float), bc_type="natural")
    current, swing = np.nan, np.nan
    if "tendon_current_a" in recording:
        whole = np.asarray(recording["tendon_current_a"].values[begin : where.stop], dtype=float).mean(axis=1)
        current, swing = float(whole.mean()), 0.5 * float(np.ptp(whole))
    recorded = int(np.ceil(slot[begin - where.start]))
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
_SAMPLED_HZ = 50.0
_SIEVE_FEWEST = 16


@dataclass(frozen=True)
class Sieve:
    """The low-pass of one swing.

    taps: odd in number, symmetric. selected: samples of the swing that are compared, shape (k,). average: samples that
    the gyroscope's readings are the mean of.
    """

    taps: Array
    selected: NDArray[np.intp]
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
        return np.asarray(windows[self.selected] @ self.taps)


def make_sieve(swing: Swing, average: int) -> Sieve:
    """Return the sieve of a swing: of its segment what is not at an end or a gap of the record."""
    rate_hz = 1 / swing.sample_s
    every = max(1, int(rate_hz / _SAMPLED_HZ + 1e-6))
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
    return make_sieve(swing, average).selected.size >= _SIEVE_FEWEST


_STEP = 1e-5  # of a coordinate, for the slopes of `numbers_of`: their error is 1e-10 of them
_NINETY_FIVE = round(NORMAL_95, 2)  # the digits that the shipped rigs were calibrated with
_INSIDE = 1e-9  # share of the bounds by which the search stays inside them
_ACTING = ("silicone.", "inertia.", "tendons.", "imu.residual_delay", "imu.low_pass")
_NOT_ACTING = ("tendons.counts_per_turn", "tendons.current_lsb")


class Numbers(NamedTuple):
    """What the joint's motion and its sensors depend on.

    p: of the equations of motion. contact: tension of one tendon at first contact [N]. delay: of the gyroscope beyond
    its low-pass [s]. current_per_tension: of a tendon motor [A/N].
    """

    p: Parameters
    contact: jax.Array
    delay: jax.Array
    current_per_tension: jax.Array


def numbers_of(rig: RigSpec) -> Numbers:
    """Return the numbers of a rig."""
    tendons = rig.tendons
    return Numbers(
        from_rig(rig),
        np.asarray(tendons.first_contact_tension.value),  # type: ignore[arg-type]
        np.asarray(rig.imu.residual_delay.value),  # type: ignore[arg-type]
        np.asarray(tendons.current(1.0)),  # type: ignore[arg-type]
    )


@dataclass(frozen=True)
class Coordinates:
    """The free parameters of a rig, m of them, as a vector x that is zero at the rig's own values.

    names: dotted. origin: their values in the rig, SI. width: standard deviation that the rig's bounds allow, taken as
    95 % of a normal about the value, SI. low, high: bounds of x. A parameter whose lower bound is above zero is
    value = origin·exp(x); one that may be zero is value = origin + width·x.
    """

    rig: RigSpec
    names: tuple[str, ...]
    origin: Array
    width: Array
    logarithmic: Mask
    low: Array
    high: Array

    def values(self, x: Array) -> Array:
        """Return the parameters' values [SI], shape (m,)."""
        return np.where(self.logarithmic, self.origin * np.exp(x * self.logarithmic), self.origin + self.width * x)

    def slopes(self, x: Array) -> Array:
        """Return ∂value/∂x of each, shape (m,)."""
        return np.where(self.logarithmic, self.values(x), self.width)

    def prior(self, x: Array) -> tuple[Array, Array]:
        """Return (value - origin)/width and its slope over x, shape (m,) each: the rig's own statement of x."""
        return (self.values(x) - self.origin) / self.width, self.slopes(x) / self.width

    def estimates(self, x: Array, std: Array) -> dict[str, Estimate]:
        """Return the parameters at x by name, intervals from standard deviations of x, shape (m,)."""
        found = {}
        for k, (name, value, slope) in enumerate(zip(self.names, self.values(x), self.slopes(x), strict=True)):
            half = np.eye(x.size)[k] * NORMAL_90 * std[k]
            low, high = (float(self.values(x + side * half)[k]) for side in (-1, 1))
            found[name] = Estimate(float(value), float(slope * std[k]), low, high)
        return found

    def rig_at(self, x: Array) -> RigSpec:
        """Return the rig at x, what is tied moved along, without a look at the bounds."""
        there, values = dict(self.rig.parameters()), self._all_values(x)
        return replaced(self.rig, {name: there[name].model_copy(update={"value": v}) for name, v in values.items()})

    def fitted_rig(self, x: Array) -> RigSpec:
        """Return the rig at x, validated; what the fit moved is called calibrated."""
        everywhere = dict(self.rig.parameters())
        inside = {name: float(np.clip(v, *everywhere[name].bounds)) for name, v in self._all_values(x).items()}
        return self.rig.with_values(inside, origin="calibrated")

    def numbers(self, x: Array) -> Numbers:
        """Return the numbers at x."""
        return numbers_of(self.rig_at(x))

    def directions(self, x: Array) -> Numbers:
        """Return ∂numbers/∂x by central differences, each leaf with a leading axis (m,)."""
        steps = np.eye(len(self.names)) * _STEP
        rows = [jax.tree.map(_slope, self.numbers(x + step), self.numbers(x - step)) for step in steps]
        stacked: Numbers = jax.tree.map(lambda *leaves: np.stack(leaves), *rows)
        return stacked

    def _all_values(self, x: Array) -> dict[str, float]:
        values = dict(zip(self.names, self.values(x).tolist(), strict=True))
        tied: dict[str, float] = {}
        tendons, inertia = self.rig.tendons, self.rig.inertia
        if "tendons.head_radius" in values and "tendons.base_radius" not in values:
            ratio = tendons.base_radius.value / tendons.head_radius.value
            tied["tendons.base_radius"] = ratio * values["tendons.head_radius"]
        if "inertia.lever" in values and "inertia.head" not in values:
            tied["inertia.head"] = inertia.head.value + inertia.lever.value - values["inertia.lever"]
        return values | tied


def make_coordinates(rig: RigSpec, free: Sequence[str]) -> Coordinates:
    """Return the coordinates of the free parameters.

    Raises SpecError for a name that the rig has not, that does not act on the joint's motion, or that its bounds fix.
    """
    there = dict(rig.parameters())
    for name in free:
        if name not in there:
            raise SpecError(f"free parameter {name!r} is not in the rig; expected dotted names as tendons.head_radius")
        if not name.startswith(_ACTING) or name in _NOT_ACTING:
            raise SpecError(
                f"{name} has no part in the motion under a measured lever, so it cannot be free; leave it out"
            )
        if not there[name].bounds[0] < there[name].bounds[1]:
            raise SpecError(f"the bounds of {name} leave it no room; widen them, or leave it out")
    if not free or len(set(free)) != len(free):
        raise SpecError(f"found {len(free)} free parameters, {len(set(free))} of them different; list each once")
    origin = np.array([there[name].value for name in free])
    bounds = np.array([_bounds(rig, name, there[name], free) for name in free])
    width = np.array([there[name].bounds[1] - there[name].bounds[0] for name in free]) / (2 * _NINETY_FIVE)
    logarithmic = (bounds[:, 0] > 0) & (origin > 0)
    room = _INSIDE * (bounds[:, 1] - bounds[:, 0])
    low, high = bounds[:, 0] + room, bounds[:, 1] - room
    safe = np.where(logarithmic, origin, 1.0)
    ends = [
        np.where(logarithmic, np.log(np.where(logarithmic, end, 1.0) / safe), (end - origin) / width)
        for end in (low, high)
    ]
    return Coordinates(rig, tuple(free), origin, width, logarithmic, ends[0], ends[1])


def _bounds(rig: RigSpec, name: str, parameter: Parameter, free: Sequence[str]) -> tuple[float, float]:
    """Return the bounds of a parameter that keep what is tied to it inside its own, too."""
    low, high = parameter.bounds
    if name == "inertia.lever" and "inertia.head" not in free:
        whole, other = rig.inertia.head.value + rig.inertia.lever.value, rig.inertia.head.bounds
        low, high = max(low, whole - other[1]), min(high, whole - other[0])
    if name == "tendons.head_radius" and "tendons.base_radius" not in free:
        ratio, other = rig.tendons.base_radius.value / rig.tendons.head_radius.value, rig.tendons.base_radius.bounds
        low, high = max(low, other[0] / ratio), min(high, other[1] / ratio)
    return low, high


def _slope(up: Array, down: Array) -> Array:
    return np.zeros_like(up) if np.array_equal(up, down) else np.asarray((up - down) / (2 * _STEP))  # inf - inf


def replaced(rig: RigSpec, changed: Mapping[str, Parameter]) -> RigSpec:
    """Return the rig with whole parameters replaced, by dotted name, without a look at the bounds.

    `RigSpec.with_values` would drop the intervals of the others.
    """
    parts: dict[str, dict[str, Parameter]] = {}
    for dotted, one in changed.items():
        part, name = dotted.split(".")
        parts.setdefault(part, {})[name] = one
    return rig.model_copy(update={part: getattr(rig, part).model_copy(update=rows) for part, rows in parts.items()})


# Motion under a measured lever.

CHANNELS = ("gyro", "current")
"""What is simulated: the gyroscope's rate before its average over samples [rad/s]; a tendon motor's current [A]."""

_LANES = 16
_FEWEST_STEPS = 2
_LARGEST_PHASE = 1.8  # of the axial motion in a step of RK4 [rad]; it is unstable beyond 2.8
_FASTEST_TORSION = 30.0  # that guides are stepped for [rad/s]
_ROOM = 2048  # samples: few different ones, so that few are traced and compiled for
_OWN = 4  # deviations of a swing
_DIRECTIONS = 9  # fewer are filled up with zeros, for the same reason


class Seen(NamedTuple):
    """What the sensors of one swing would say, and how that changes.

    values: shape (n, channel). slopes: shape (k, n, channel), over the directions that were asked for, the last four
    being the deviations of `simulate_swings`; None if not asked for.
    """

    values: Array
    slopes: Array | None


class _Lane(NamedTuple):
    """One swing for the compiled code: pretension [m], mode, limit [A], its deviations, time step [s], lever
    acceleration."""

    pretension: jax.Array
    mode: jax.Array
    limit: jax.Array
    deviations: jax.Array
    step_s: jax.Array
    acceleration: jax.Array


def steps_per_sample(numbers: Numbers, sample_s: float) -> int:
    """Return how many steps of RK4 a sample needs: the head's fast axial motion and the guides have to stay stable."""
    p = numbers.p
    omega = axial_omega(len(p.guide_directions) * float(p.stiffness), p)
    bristles = float(p.guides.fastest(_FASTEST_TORSION))
    return max(_FEWEST_STEPS, math.ceil(max(omega, bristles) * sample_s / _LARGEST_PHASE))


def _step(state: State, push: jax.Array, step_s: jax.Array, p: Parameters) -> State:
    """Return the state a step of RK4 later; push: lever acceleration at its begin, middle and end, shape (3,).

    The stages are a loop, not the twin's four calls: with derivatives those take four times as long to compile.
    What a loop begins with depends on what is differentiated, if only by `0.0 *`, here and in `_set` and `_simulate`.
    Else JAX finds out by tracing a loop twice which of its numbers do, and so every loop inside it: 5.9 s, not 2.4.
    """
    share, weight = jnp.array([0.0, 0.5, 0.5, 1.0]), jnp.array([1.0, 2.0, 2.0, 1.0]) / 6
    which = jnp.array([0, 1, 1, 2])

    def stage(i: jax.Array, carry: tuple[State, State]) -> tuple[State, State]:
        before, after = carry
        at: State = jax.tree.map(lambda y, dy: y + share[i] * step_s * dy, state, before)
        slope = derivative(at, *head_forces(at, p), push[which[i]], p)
        return slope, jax.tree.map(lambda y, dy: y + weight[i] * step_s * dy, after, slope)

    still: State = jax.tree.map(lambda y: 0.0 * y, state)
    reached: State = jax.lax.fori_loop(0, 4, stage, (still, state))[1]
    return reached


def _observe(state: State, p: Parameters, numbers: Numbers) -> jax.Array:
    tension = total_tension(state.torsion, state.shortening, p) / len(p.guide_directions)
    return jnp.stack([state.gyro - numbers.delay * state.gyro_rate, tension * numbers.current_per_tension])


def _set(lane: _Lane, numbers: Numbers) -> tuple[Parameters, State]:
    moved, rougher, torsion, rate = lane.deviations
    p = numbers.p._replace(guides=numbers.p.guides.scaled(1 + rougher))
    reserve = jnp.asarray(LIMIT_RESERVE_N)
    held, shortening = set_pretension(p, lane.pretension + moved, numbers.contact, lane.mode, reserve)
    # A bench's limit is the one that it told its motors, whatever the joint that is sought holds at rest.
    limit = lane.limit / numbers.current_per_tension
    held = held._replace(held_tension=jnp.where(jnp.isnan(limit), held.held_tension, limit))
    rest: State = jax.tree.map(lambda y: y + 0.0 * moved, state_at_rest(shortening, held))
    return held, rest._replace(torsion=rest.torsion + torsion, torsion_rate=rest.torsion_rate + rate)


def _simulate(lanes: _Lane, numbers: Numbers, samples: jax.Array, steps: jax.Array, room: int) -> jax.Array:
    """Return what is seen of every lane, (room, lane, channel); only the first `samples` are filled."""
    p, begin = jax.vmap(_set, in_axes=(0, None))(lanes, numbers)
    acceleration = lanes.acceleration.T

    def substep(j: jax.Array, now: State) -> State:
        push = jax.lax.dynamic_slice_in_dim(acceleration, 2 * j, 3, axis=0)
        after: State = jax.vmap(_step, in_axes=(0, 1, 0, 0))(now, push, lanes.step_s, p)
        return after

    def sample(n: jax.Array, carry: tuple[State, jax.Array]) -> tuple[State, jax.Array]:
        now, outputs = carry
        seen = jax.vmap(_observe, in_axes=(0, 0, None))(now, p, numbers)
        outputs = jax.lax.dynamic_update_index_in_dim(outputs, seen, n, axis=0)
        return jax.lax.fori_loop(n * steps, (n + 1) * steps, substep, now), outputs

    outputs = jnp.zeros((room, 1, len(CHANNELS))) + 0.0 * lanes.deviations[:, :1]
    return jnp.asarray(jax.lax.fori_loop(0, samples, sample, (begin, outputs))[1])


@program(static=("room",))
def _values(lanes: _Lane, numbers: Numbers, samples: jax.Array, steps: jax.Array, room: int) -> jax.Array:
    return _simulate(lanes, numbers, samples, steps, room)


@program(static=("room",))
def _values_and_slopes(
    lanes: _Lane, numbers: Numbers, directions: Numbers, samples: jax.Array, steps: jax.Array, room: int
) -> tuple[jax.Array, jax.Array]:
    """Return values (room, lane, channel) and slopes (k, room, lane, channel); directions: leaves with an axis k."""

    def seen(each: Numbers, deviations: jax.Array) -> jax.Array:
        return _simulate(lanes._replace(deviations=deviations), each, samples, steps, room)

    count, own = directions.contact.shape[0], lanes.deviations.shape[1]
    deviating = jnp.eye(count + own, own, -count)[:, None, :] * jnp.ones(lanes.deviations.shape)
    padded = jax.tree.map(lambda leaf: jnp.concatenate([leaf, jnp.zeros((own, *leaf.shape[1:]))]), directions)

    def along(direction: Numbers, deviations: jax.Array) -> tuple[jax.Array, jax.Array]:
        values, slopes = jax.jvp(seen, (numbers, lanes.deviations), (direction, deviations))
        return jnp.asarray(values), jnp.asarray(slopes)

    found: tuple[jax.Array, jax.Array] = jax.vmap(along, out_axes=(None, 0))(padded, deviating)
    return found


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=cores(), thread_name_prefix="sinew-joint")


def simulate_swings(
    swings: Sequence[Swing],
    numbers: Numbers,
    deviations: Array,
    steps: int,
    directions: Numbers | None = None,
) -> list[Seen]:
    """Return what the sensors would say of every swing, at its samples.

    deviations: of pretension [m] and guide friction [1], and torsion [rad] and its rate [rad/s] at the first sample,
    zero for a joint at rest, shape (swing, 4). steps: between samples.
    directions: along which slopes are wanted, a stack of numbers (k,) on each leaf; the deviations are added to them.

    Swings are sorted by length and cut into batches of `_LANES`, so that one compilation does for all.
    """
    configure()
    wanted = 0 if directions is None else directions.contact.shape[0]
    filled = None if directions is None else jax.tree.map(_filled, directions)
    order = np.argsort([swing.size for swing in swings], kind="stable")
    room = math.ceil((max(swing.size for swing in swings) + 1) / _ROOM) * _ROOM
    found: dict[int, Seen] = {}

    def run(mine: NDArray[np.intp]) -> None:
        padded = np.concatenate([mine, np.full(_LANES - mine.size, mine[-1])])
        lanes = _lanes([swings[i] for i in padded], deviations[padded], steps, room)
        longest = np.int64(max(swings[i].size for i in mine))
        slopes = None
        if filled is None:
            values = np.asarray(_values(lanes, numbers, longest, np.int64(steps), room))
        else:
            both = _values_and_slopes(lanes, numbers, filled, longest, np.int64(steps), room)
            values, slopes = np.asarray(both[0]), np.asarray(both[1])
        for column, i in enumerate(mine):
            size = swings[i].size
            own = None
            if slopes is not None:
                own = np.concatenate([slopes[:wanted, :size, column], slopes[-_OWN:, :size, column]])
            found[int(i)] = Seen(values[:size, column].copy(), own)

    for _ in _pool().map(run, [order[i : i + _LANES] for i in range(0, order.size, _LANES)]):
        pass
    return [found[i] for i in range(len(swings))]


def _filled(leaf: Array) -> Array:
    return np.concatenate([leaf, np.zeros((max(0, _DIRECTIONS - leaf.shape[0]), *leaf.shape[1:]))])


def _lanes(swings: Sequence[Swing], deviations: Array, steps: int, room: int) -> _Lane:
    acceleration = np.zeros((len(swings), 2 * steps * room + 1))
    for row, swing in zip(acceleration, swings, strict=True):
        given = swing.lever_acceleration(steps)
        row[: given.size] = given
    return _Lane(
        np.array([swing.pretension_mm * 1e-3 for swing in swings]),  # type: ignore[arg-type]
        np.array([swing.mode for swing in swings]),  # type: ignore[arg-type]
        np.array([swing.limit_a for swing in swings]),  # type: ignore[arg-type]
        deviations,  # type: ignore[arg-type]
        np.array([swing.sample_s / steps for swing in swings]),  # type: ignore[arg-type]
        acceleration,  # type: ignore[arg-type]
    )


# The joint fit as a least-squares problem: rows of the gyroscope, of the currents, and of what is known.
#
# The coordinates are the shared parameters (`sinew.identify.joint.motion`), then for every repetition at a
# pretension its two deviations, in units of the rig's stated repeatability, then for every swing that need not begin at
# rest its torsion and rate at the first sample, in units of what the swing itself has. Their rows, and those of the
# rig's bounds, are priors.

Pair = tuple[int, float, int]

_ROUGH = 0.2  # share of a swing's rate that a first search takes for noise
_ORDER = 6
_ROUNDING = 0.289  # LSB: standard deviation of what rounding does to a constant
_DITHERED = 0.0716  # LSB: the same of the mean over a sine of so many LSB, times the root of that


@dataclass(frozen=True)
class Whitening:
    """How the residuals of one swing become independent draws of variance one.

    coefficients: a of e_n + Σ a_k e_{n-k}, shape (order,). std: of that sum [rad/s].
    """

    coefficients: Array
    std: float

    def applied(self, rows: Array) -> Array:
        """Return whitened rows, (k, ...) to (k - order, ...), less their mean, as the gyroscope may have any bias."""
        order = self.coefficients.size
        white = rows[order:].copy()
        for k, a in enumerate(self.coefficients, start=1):
            white += a * rows[order - k : -k]
        return np.asarray((white - white.mean(axis=0)) / self.std)


@dataclass(frozen=True)
class JointProblem:
    """Everything that a search needs.

    measured: what is compared of the gyroscope's rate, for each swing. pairs: of recording, pretension and repeat.
    repeatability: standard deviations of pretension [m] and guide friction [1]; where one is zero the pair has no such
    deviation. current_std: of each swing's mean current [A].
    """

    swings: tuple[Swing, ...]
    coordinates: Coordinates
    sieves: tuple[Sieve, ...]
    measured: tuple[Array, ...]
    pairs: tuple[Pair, ...]
    repeatability: tuple[float, float]
    current_std: Array
    steps: int
    whitenings: tuple[Whitening, ...]

    @property
    def shared(self) -> int:
        """Return the number of shared parameters."""
        return len(self.coordinates.names)

    @property
    def size(self) -> int:
        """Return the number of coordinates."""
        return self.shared + 2 * len(self.pairs) + 2 * sum(not swing.rests for swing in self.swings)

    @property
    def of_settings(self) -> slice:
        """Return the coordinates of the deviations of pretension and guide friction."""
        return slice(self.shared, self.shared + 2 * len(self.pairs))

    @property
    def repeats(self) -> int:
        """Return how often a pretension was set, at most."""
        return max(Counter(pretension for _, pretension, _ in self.pairs).values())

    def columns(self, number: int) -> NDArray[np.intp]:
        """Return the coordinates of a swing's deviations: those that its setting has, and those of its beginning."""
        swing = self.swings[number]
        setting = self.shared + 2 * self.pairs.index(swing.pair)
        begin = self.of_settings.stop + 2 * sum(not before.rests for before in self.swings[:number])
        return np.array([setting, setting + 1, *(() if swing.rests else (begin, begin + 1))], dtype=np.intp)

    def deviations(self, x: Array) -> Array:
        """Return the deviations of every swing as `simulate_swings` takes them, shape (swing, 4)."""
        rows = np.zeros((len(self.swings), _OWN))
        for number, swing in enumerate(self.swings):
            own = x[self.columns(number)]
            rows[number, : own.size] = own * self._units(swing)[: own.size]
        return rows

    def simulated(self, x: Array, *, slopes: bool = False) -> list[Seen]:
        """Return what every swing would look like."""
        shared = x[: self.shared]
        directions = self.coordinates.directions(shared) if slopes else None
        numbers = self.coordinates.numbers(shared)
        return simulate_swings(self.swings, numbers, self.deviations(x), self.steps, directions)

    def predicted(self, x: Array) -> list[tuple[Array, float]]:
        """Return the gyroscope's readings of every swing [rad/s], (n,), and the mean current over its segment [A]."""
        found = []
        for swing, sieve, seen in zip(self.swings, self.sieves, self.simulated(x), strict=True):
            current = float(seen.values[swing.recorded :, 1].mean())
            found.append((sieve.averaged(seen.values[:, 0]), current))
        return found

    def residuals(self, x: Array) -> list[Array]:
        """Return simulated less measured of every swing, low-passed and thinned [rad/s]."""
        rows = zip(self.sieves, self.measured, self.predicted(x), strict=True)
        return [sieve.passed(rate) - measured for sieve, measured, (rate, _) in rows]

    def problem(self) -> Problem:
        """Return the least-squares problem over the coordinates."""
        return Problem(self._residual, self._jacobian)

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of the coordinates."""
        far = np.full(self.size - self.shared, 20.0)
        return np.concatenate([self.coordinates.low, -far]), np.concatenate([self.coordinates.high, far])

    def read_again(self, rng: np.random.Generator) -> "JointProblem":
        """Return the problem with errors added to the lever's angle that are as likely as those its encoder made."""
        lsb = 2 * np.pi / self.coordinates.rig.drive.counts_per_turn.value
        swings = [
            lever_read_again(swing, sieve, lsb, rng) for swing, sieve in zip(self.swings, self.sieves, strict=True)
        ]
        return replace(self, swings=tuple(swings))

    def settings(self) -> list[tuple[tuple[float, str, float], slice]]:
        """Return of every swing its setting (pretension, kind, frequency), and its rows in residual and Jacobian."""
        found: list[tuple[tuple[float, str, float], slice]] = []
        begin = 0
        for swing, measured, whitening in zip(self.swings, self.measured, self.whitenings, strict=True):
            end = begin + measured.size - whitening.coefficients.size
            found.append(((swing.pretension_mm, swing.kind, swing.frequency_hz), slice(begin, end)))
            begin = end
        return found

    def data_rows(self, jacobian: Array) -> Array:
        """Return those rows of a Jacobian that are data or deviations, without what the rig's bounds say."""
        return np.asarray(jacobian[: -self.shared] if self.shared else jacobian)

    def _residual(self, x: Array) -> Array:
        rows, currents = [], []
        for i, (rate, current) in enumerate(self.predicted(x)):
            rows.append(self.whitenings[i].applied(self.sieves[i].passed(rate) - self.measured[i]))
            currents.append((current - self.swings[i].current_a) / self.current_std[i])
        prior, _ = self.coordinates.prior(x[: self.shared])
        known = np.isfinite(self.current_std)
        return np.concatenate([*rows, np.array(currents)[known], x[self.shared :], prior])

    def _jacobian(self, x: Array) -> Array:
        rows, currents = [], []
        for i, (swing, seen) in enumerate(zip(self.swings, self.simulated(x, slopes=True), strict=True)):
            assert seen.slopes is not None
            own = np.concatenate([np.arange(self.shared), self.columns(i)])
            slopes = (
                seen.slopes[: own.size]
                * np.concatenate([np.ones(self.shared), self._units(swing)])[: own.size, None, None]
            )
            rate = self.sieves[i].averaged(slopes[:, :, 0].T)
            rows.append(_spread(self.whitenings[i].applied(self.sieves[i].passed(rate)), own, self.size))
            current = slopes[:, swing.recorded :, 1].mean(axis=1)
            currents.append(_spread(current[None] / self.current_std[i], own, self.size))
        _, slope = self.coordinates.prior(x[: self.shared])
        known = np.isfinite(self.current_std)
        free = np.eye(self.size)[self.shared :]
        stated = np.hstack([np.diag(slope), np.zeros((self.shared, self.size - self.shared))])
        return np.concatenate([*rows, np.concatenate(currents)[known], free, stated])

    def _units(self, swing: Swing) -> Array:
        """Return what the coordinates of a swing's deviations count in: for its beginning, what it reaches."""
        rate = float(np.sqrt(np.mean(swing.gyro**2)))
        return np.array([*self.repeatability, rate / (2 * np.pi * swing.frequency_hz), rate])


_APART = 0.02  # of the lever's angle: several LSB at most of what a swing passes through


def lever_read_again(swing: Swing, sieve: Sieve, lsb: float, rng: np.random.Generator) -> Swing:
    """Return a swing whose lever has errors of rounding beside its own: those of a motion larger or smaller by a hair.

    A motion that repeats at whole samples has the same errors in every period, and one that is the same to both sides
    of the encoder's zero the opposite ones in each half. So the low-passed motion is rounded, and not each sample for
    itself; where samples are too few to be low-passed that has to do.
    """
    time = swing.lever.x
    read = np.asarray(swing.lever(time))
    smooth = convolve1d(read, sieve.taps, mode="nearest")
    at = smooth / lsb * (1 + rng.uniform(-_APART, _APART)) if sieve.taps.size > 1 else rng.random(read.size)
    return replace(swing, lever=CubicSpline(time, read + lsb * (np.round(at) - at), bc_type="natural"))


def _spread(rows: Array, columns: NDArray[np.intp], size: int) -> Array:
    wide = np.zeros((rows.shape[0], size))
    wide[:, columns] = rows
    return wide


def stated_repeatability(rig: RigSpec) -> tuple[float, float]:
    """Return the standard deviations of pretension [m] and guide friction [1] between repeats, as the rig has them."""
    return rig.repeatability.pretension.value, rig.repeatability.guide_friction.value


def make_problem(swings: Sequence[Swing], coordinates: Coordinates, steps: int) -> JointProblem:
    """Return the problem of a first search: a fifth of every swing's rate counts as noise."""
    rig = coordinates.rig
    sieves = tuple(make_sieve(swing, rig.imu.average_samples) for swing in swings)
    measured = tuple(sieve.passed(swing.gyro) for sieve, swing in zip(sieves, swings, strict=True))
    floor = max(rig.imu.gyro_noise.value, 1e-4)
    rough = [Whitening(np.zeros(0), _ROUGH * float(np.sqrt(np.mean(m**2))) + floor) for m in measured]
    repeatability = stated_repeatability(rig)
    pairs = tuple(dict.fromkeys(swing.pair for swing in swings))
    currents = _current_std(swings, rig.tendons.current_lsb.value)
    return JointProblem(
        tuple(swings), coordinates, sieves, measured, pairs, repeatability, currents, steps, tuple(rough)
    )


def _current_std(swings: Sequence[Swing], lsb: float) -> Array:
    """Return the standard deviation of every swing's mean current [A], infinite where there is none.

    Rounding of a constant errs by up to half an LSB, and by the same in all swings of a pair; over a sine of a LSB its
    mean is J₀(2πa)/π, which falls with the root of a. Counted as one common error per pair.
    """
    found = []
    for swing in swings:
        if not np.isfinite(swing.current_a):
            found.append(np.inf)
            continue
        amplitude = max(swing.current_swing_a / lsb, 1e-6)
        alike = sum(other.pair == swing.pair for other in swings)
        found.append(lsb * min(_ROUNDING, _DITHERED / np.sqrt(amplitude)) * np.sqrt(alike))
    return np.array(found)


def whitening_of(residuals: Sequence[Array], floor: float) -> tuple[Whitening, ...]:
    """Return the whitening of every swing from the residuals of a fit: one autoregression for all, a size for each.

    floor: smallest standard deviation of a whitened residual [rad/s].
    """
    centred = [r - r.mean() for r in residuals]
    sizes = [max(float(np.sqrt(np.mean(r**2))), 1e-12) for r in centred]
    count = sum(r.size for r in centred)
    lags = np.array(
        [
            sum(float(r[: r.size - k] @ r[k:]) / s**2 for r, s in zip(centred, sizes, strict=True))
            for k in range(_ORDER + 1)
        ]
    )
    lags[0] *= 1 + 1e-6
    coefficients = -solve_toeplitz(lags[:-1], lags[1:]) if count > 20 * _ORDER else np.zeros(0)
    plain = Whitening(np.asarray(coefficients, dtype=float), 1.0)
    stds = [float(np.sqrt(np.mean(plain.applied(r) ** 2))) for r in centred]
    return tuple(Whitening(plain.coefficients, max(std, floor)) for std in stds)
