"""Nasty decays with a known truth: `python -m campaigns.decays --seeds 25`.

Eighteen kinds of free decay as others record them, N seeds of each: short and very long ones, several modes, a strike,
a pendulum, drag, dry friction, clipping, a sensor that freezes or wraps, a gyroscope, an accelerometer, whole numbers,
irregular stamps, gaps, a hold, a drive. The motions are closed forms, or `scipy.integrate.solve_ivp` at 1e-10; nothing
of them comes from the code that reads them.

What is true, settled before any result was seen:

- Of a linear motion: its frequency and damping ratio; of two modes those of the one with more energy.
- Where frequency and damping move with the amplitude (pendulum, drag, dry friction) the number that is stated refers to
  the whole window that the answer names: it is the mean of ω, and of λ, weighted by the amplitude (half the swing
  between turning points); ω is the slope of the phase through the zero crossings, λ that of the logarithm of the sizes
  at the turning points. The interval by noise alone should hold this mean.
- The stated interval, of noise and misfit together, promises more: that the oscillation had such a frequency, and such
  a damping ratio, while it was recorded. So its truth is the value at a moment of the window, drawn with a chance that
  goes with the amplitude. Where nothing moves with the amplitude the two are one.

Printed for every kind and in all: answers, refusals, tracebacks; the share of stated intervals that hold the truth, of
frequency and damping ratio together; the share of intervals by noise that hold the mean; reasons that are false. A
reason is what a refusal names, the verdict on the shape (a linear decay is no dry friction, drag no dry friction, a
pendulum does not harden), and a remark on the samples (clipped, frozen, wrapped, gaps) where nothing of it was done.
"""

import re
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from campaigns.options import TWO, asked_seeds, campaign_parser, conclude, spread_of, spread_trials
from sinew.analysis.decay.ring_down import RingDown, analyse_ring_down
from sinew.measure.arrays import Array
from sinew.measure.errors import SinewError
from sinew.measure.estimate import Estimate

TURN = 2.0 * np.pi
_GRID = 4001


@dataclass(frozen=True)
class AmplitudeHistory:
    """True λ and ω over time: constant, or from the turning points and zero crossings of a motion about zero.

    turning_s, size: shape (h,); crossing_s: shape (c,). rate, omega: where they are constant.
    """

    rate: float = 0.0
    omega: float = 0.0
    turning_s: Array = field(default_factory=lambda: np.zeros(0))
    size: Array = field(default_factory=lambda: np.zeros(0))
    crossing_s: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def is_constant(self) -> bool:
        return self.turning_s.size == 0

    def _followed(self, start_s: float, stop_s: float) -> tuple[Array, Array, Array]:
        """Return (amplitude, λ, ω) on an even grid of the window."""
        t = np.linspace(start_s, min(stop_s, float(self.turning_s[-1])), _GRID)
        omega = CubicSpline(self.crossing_s, np.pi * np.arange(self.crossing_s.size)).derivative()
        log = CubicSpline(self.turning_s, np.log(self.size))
        lag = np.arctan2(-log.derivative()(self.turning_s), omega(self.turning_s))  # a crest comes before its phase
        log = CubicSpline(self.turning_s, np.log(self.size / np.cos(lag)))
        return np.exp(log(t)), -log.derivative()(t), omega(t)

    def means(self, start_s: float, stop_s: float) -> tuple[float, float]:
        """Return (frequency [Hz], damping ratio) of the means over a window, weighted by the amplitude."""
        if self.is_constant:
            return self.omega / TURN, self.rate / np.hypot(self.rate, self.omega)
        size, rate, omega = self._followed(start_s, stop_s)
        means = np.array([np.sum(rate * size), np.sum(omega * size)]) / size.sum()
        return means[1] / TURN, means[0] / np.hypot(*means)

    def moment(self, start_s: float, stop_s: float, chance: float) -> tuple[float, float]:
        """Return (frequency [Hz], damping ratio) at the moment before which a share of the amplitude lies."""
        if self.is_constant:
            return self.means(start_s, stop_s)
        size, rate, omega = self._followed(start_s, stop_s)
        at = int(np.searchsorted(np.cumsum(size), chance * size.sum()))
        return omega[at] / TURN, rate[at] / np.hypot(rate[at], omega[at])


@dataclass(frozen=True)
class Record:
    """A decay as it is handed in, and what is true of it.

    time_s, values: shape (n,); unit, is_rate: of the response. free_s: from where it is free; course: the truth.
    amplitude: at free_s; noise: standard deviation of a sample. gap_s: longest. done: to the samples (clipped, frozen,
    wrapped, gaps). moves: "", "dry", "drag", "pendulum", or "near mode".
    """

    time_s: Array
    values: Array
    course: AmplitudeHistory
    amplitude: float
    noise: float
    free_s: float = 0.0
    unit: str = "mm"
    is_rate: bool = False
    gap_s: float = 0.0
    done: tuple[str, ...] = ()
    moves: str = ""


@dataclass(frozen=True)
class Setting:
    """What is drawn for every record: natural frequency [Hz], samples a period, amplitude, noise by it, offset."""

    hz: float
    per_period: float
    size: float
    noise: float
    offset: float
    phase: float

    @staticmethod
    def drawn(rng: np.random.Generator) -> "Setting":
        size = 10.0 ** rng.uniform(-2, 2)
        return Setting(
            10.0 ** rng.uniform(-0.5, 1.5),
            10.0 ** rng.uniform(np.log10(18), np.log10(120)),
            size,
            size * 10.0 ** rng.uniform(-3, -1.7),
            size * rng.uniform(-2, 2),
            rng.uniform(0, TURN),
        )

    def times(self, periods: float, per_period: float | None = None) -> Array:
        return np.arange(round(periods * (per_period or self.per_period))) / (self.hz * (per_period or self.per_period))


def linear(t: Array, hz: float, damping: float, size: float, phase: float, order: int = 0) -> Array:
    """Return a linear decay, or a derivative of it, of natural frequency hz from t = 0 on."""
    pole = TURN * hz * complex(-damping, np.sqrt(1 - damping**2))
    return np.asarray((size * pole**order * np.exp(pole * t + 1j * phase)).real, dtype=float)


def course_of(hz: float, damping: float) -> AmplitudeHistory:
    return AmplitudeHistory(TURN * hz * damping, TURN * hz * np.sqrt(1 - damping**2))


def draw_damping(rng: np.random.Generator, least: float = 0.004, most: float = 0.12) -> float:
    return float(np.exp(rng.uniform(np.log(least), np.log(most))))


def periods_of(rng: np.random.Generator, damping: float, most: float = 120.0) -> float:
    """Return how long a record is: one to five time constants, four periods at least."""
    return float(np.clip(rng.uniform(1, 5) / (TURN * damping), 4.0, most))


Kind = Callable[[np.random.Generator, Setting], Record]


def _noisy(rng: np.random.Generator, one: Setting, x: Array, extra: float = 1.0) -> Array:
    return x + one.offset * extra + one.noise * extra * rng.standard_normal(x.size)


def _fading(
    rng: np.random.Generator,
    one: Setting,
    damping: float,
    periods: float | None = None,
    per_period: float | None = None,
) -> Record:
    """Return a linear decay with noise. periods: how long it lasts, drawn where it is None; per_period: samples."""
    t = one.times(periods_of(rng, damping) if periods is None else periods, per_period)
    x = linear(t, one.hz, damping, one.size, one.phase)
    return Record(t, _noisy(rng, one, x), course_of(one.hz, damping), one.size, one.noise)


def viscous(rng: np.random.Generator, one: Setting) -> Record:
    return _fading(rng, one, draw_damping(rng, most=0.25))


def short(rng: np.random.Generator, one: Setting) -> Record:
    damping = draw_damping(rng, 0.01, 0.1)
    return _fading(rng, one, damping, rng.uniform(2.5, 4.0))


def very_long(rng: np.random.Generator, one: Setting) -> Record:
    swings = rng.uniform(1000, 5000)
    damping = rng.uniform(2, 6) / (TURN * swings)
    return _fading(rng, one, damping, swings, rng.uniform(10.5, 14))


def two_modes(rng: np.random.Generator, one: Setting) -> Record:
    damping = draw_damping(rng, 0.005, 0.05)
    t = one.times(periods_of(rng, damping), 60.0)
    ratio = rng.uniform(1.08, 1.5) if rng.random() < 0.25 else rng.uniform(1.5, 7.0)
    ratio = ratio ** rng.choice([-1, 1])
    other = linear(
        t, one.hz * ratio, damping * rng.uniform(0.5, 2), one.size * rng.uniform(0.1, 0.55), rng.uniform(0, 6)
    )
    x = linear(t, one.hz, damping, one.size, one.phase) + other * min(ratio, 1.0)
    near = "near mode" if 0.6 < ratio < 1.6 else ""
    return Record(t, _noisy(rng, one, x), course_of(one.hz, damping), one.size, one.noise, moves=near)


def strike(rng: np.random.Generator, one: Setting) -> Record:
    damping = draw_damping(rng, 0.005, 0.08)
    t = one.times(periods_of(rng, damping), 120.0)
    ratio = rng.uniform(6, 15)
    burst = linear(t, one.hz * ratio, rng.uniform(0.03, 0.15), one.size * rng.uniform(0.3, 1.2), rng.uniform(0, TURN))
    x = linear(t, one.hz, damping, one.size, -0.5 * np.pi) + burst
    return Record(t, _noisy(rng, one, x), course_of(one.hz, damping), one.size, one.noise)


def _followed(force: Callable[[float, float], float], start: float, t: Array) -> tuple[Array, AmplitudeHistory]:
    """Return x(t) of x'' = force(x, x') from rest at start, and its course, which goes on after the record's end."""
    end = 1.1 * float(t[-1])

    def turning(_: float, y: Array) -> float:
        return float(y[1])

    def crossing(_: float, y: Array) -> float:
        return float(y[0])

    found = solve_ivp(
        lambda _, y: [y[1], force(y[0], y[1])],
        (0.0, end),
        [start, 0.0],
        t_eval=t,
        rtol=1e-10,
        atol=1e-12 * abs(start),
        events=[turning, crossing],
    )
    assert found.t_events is not None
    assert found.y_events is not None
    (turns, crossings), turned = found.t_events, found.y_events[0]
    size = np.abs(turned[:, 0])
    if turns[0] > 0.0:
        turns, size = np.r_[0.0, turns], np.r_[abs(start), size]
    return found.y[0], AmplitudeHistory(turning_s=turns, size=size, crossing_s=crossings)


def pendulum(rng: np.random.Generator, one: Setting) -> Record:
    damping, omega = draw_damping(rng, 0.004, 0.03), TURN * one.hz
    t = one.times(periods_of(rng, damping))
    start = np.deg2rad(rng.uniform(50, 110))
    x, course = _followed(lambda a, v: -(omega**2) * np.sin(a) - 2 * damping * omega * v, start, t)
    noise = start * one.noise / one.size
    values = x + noise * rng.standard_normal(t.size) + 0.1 * rng.standard_normal()
    return Record(t, values, course, start, noise, unit="rad", moves="pendulum")


def drag(rng: np.random.Generator, one: Setting) -> Record:
    omega, damping = TURN * one.hz, draw_damping(rng, 0.002, 0.01)
    # a swing of A loses (8/3) c A of its amplitude in a cycle
    c = rng.uniform(0.01, 0.12) / one.size
    t = one.times(rng.uniform(8, 60))
    x, course = _followed(lambda a, v: -(omega**2) * a - c * v * abs(v) - 2 * damping * omega * v, one.size, t)
    return Record(t, _noisy(rng, one, x), course, one.size, one.noise, moves="drag")


def dry(rng: np.random.Generator, one: Setting) -> Record:
    """Dry and viscous friction in closed form: each half cycle swings about ±step until it sticks."""
    damping, step = draw_damping(rng, 0.001, 0.01), one.size / rng.uniform(15, 80)
    t = one.times(rng.uniform(8, 50))
    omega, rate = TURN * one.hz * np.sqrt(1 - damping**2), damping * TURN * one.hz
    half, x, start, k = np.pi / omega, np.zeros_like(t), one.size, 0
    turns, size, crossings = [0.0], [one.size], []
    while k * half <= 1.1 * t[-1]:
        centre = step * np.sign(start)
        inside = (t >= k * half) & (t < (k + 1) * half)
        fine = np.linspace(0.0, half, 2001)
        for s, into in ((t[inside] - k * half, True), (fine, False)):
            swing = centre + (start - centre) * np.exp(-rate * s) * (
                np.cos(omega * s) + rate / omega * np.sin(omega * s)
            )
            if into:
                x[inside] = swing
        change = np.flatnonzero(np.diff(np.sign(swing)))
        following = float(swing[-1])
        k += 1
        if change.size:
            crossings.append((k - 1) * half + float(fine[change[0]]))
        if abs(following) <= step:
            x[t >= k * half] = following
            break
        turns.append(k * half)
        size.append(abs(following))
        start = following
    course = AmplitudeHistory(turning_s=np.array(turns), size=np.array(size), crossing_s=np.array(crossings))
    return Record(t, _noisy(rng, one, x), course, one.size, one.noise, done=("frozen",), moves="dry")


def clipped(rng: np.random.Generator, one: Setting) -> Record:
    damping = draw_damping(rng, 0.01, 0.06)
    t = one.times(max(periods_of(rng, damping), 10.0))
    x = linear(t, one.hz, damping, one.size, one.phase) + one.noise * rng.standard_normal(t.size)
    limit = one.size * rng.uniform(0.5, 0.9)
    values = np.clip(x, -limit, limit if rng.random() < 0.5 else np.inf)
    return Record(t, values, course_of(one.hz, damping), one.size, one.noise, done=("clipped",))


def frozen(rng: np.random.Generator, one: Setting) -> Record:
    base = viscous(rng, one)
    values, n = base.values.copy(), base.values.size
    length = int(rng.uniform(0.3, 1.5) * one.per_period)
    first = int(rng.uniform(0.1, 0.5) * n)
    values[first : first + length] = values[first]
    return Record(base.time_s, values, base.course, one.size, one.noise, done=("clipped", "frozen"))


def wrapped(rng: np.random.Generator, one: Setting) -> Record:
    damping = draw_damping(rng, 0.01, 0.1)
    t = one.times(periods_of(rng, damping))
    size, noise = rng.uniform(20, 80), rng.uniform(0.05, 0.5)
    x = linear(t, one.hz, damping, size, one.phase) + rng.uniform(170, 190) + noise * rng.standard_normal(t.size)
    values = (x + 180.0) % 360.0 - 180.0
    return Record(t, values, course_of(one.hz, damping), size, noise, unit="deg", done=("wrapped",))


def _derived(rng: np.random.Generator, one: Setting, order: int) -> Record:
    """Return a derivative of a linear decay, with noise and (of acceleration) gravity."""
    damping = draw_damping(rng)
    t = one.times(periods_of(rng, damping))
    scale = (TURN * one.hz) ** order
    x, noise = linear(t, one.hz, damping, one.size, one.phase, order), one.noise * scale
    values = _noisy(rng, one, x, scale) if order == 1 else x + 9.81 + noise * rng.standard_normal(t.size)
    unit = "deg/s" if order == 1 else "m/s^2"
    return Record(t, values, course_of(one.hz, damping), one.size * scale, noise, unit=unit, is_rate=order == 1)


def gyroscope(rng: np.random.Generator, one: Setting) -> Record:
    return _derived(rng, one, 1)


def accelerometer(rng: np.random.Generator, one: Setting) -> Record:
    return _derived(rng, one, 2)


def integers(rng: np.random.Generator, one: Setting) -> Record:
    damping, counts = draw_damping(rng, 0.005, 0.1), 10.0 ** rng.uniform(1.0, 2.5)
    t = one.times(periods_of(rng, damping))
    x = linear(t, one.hz, damping, counts, one.phase) + rng.uniform(-100, 100) + 0.1 * rng.standard_normal(t.size)
    return Record(t, np.round(x), course_of(one.hz, damping), counts, 0.3)


def irregular(rng: np.random.Generator, one: Setting) -> Record:
    base = one.times(periods_of(rng, damping := draw_damping(rng)))
    t = np.sort(rng.uniform(0.0, base[-1], base.size))
    t = t[np.r_[True, np.diff(t) > 1e-6 * base[1]]]
    x = linear(t, one.hz, damping, one.size, one.phase)
    gap = float(np.diff(t).max())
    return Record(t, _noisy(rng, one, x), course_of(one.hz, damping), one.size, one.noise, gap_s=gap, done=("gap",))


def gaps(rng: np.random.Generator, one: Setting) -> Record:
    base = viscous(rng, one)
    kept = rng.random(base.time_s.size) > 0.05
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.uniform(0.05, 0.95) * kept.size)
        kept[at : at + int(rng.uniform(0.1, 0.45) * one.per_period)] = False
    t = base.time_s[kept]
    gap = float(np.diff(t).max())
    return Record(t, base.values[kept], base.course, one.size, one.noise, gap_s=gap, done=("gap",))


def held(rng: np.random.Generator, one: Setting) -> Record:
    damping = draw_damping(rng)
    free, before = one.times(periods_of(rng, damping)), one.times(rng.uniform(0.5, 10))
    omega, rate = TURN * one.hz * np.sqrt(1 - damping**2), TURN * one.hz * damping
    out = one.size * np.exp(-rate * free) * (np.cos(omega * free) + rate / omega * np.sin(omega * free))
    x = np.concatenate([np.full(before.size, one.size), out])
    t = np.arange(x.size) * free[1]
    return Record(t, _noisy(rng, one, x), course_of(one.hz, damping), one.size, one.noise, float(t[before.size]))


def driven(rng: np.random.Generator, one: Setting) -> Record:
    damping = draw_damping(rng, 0.01, 0.12)
    free, before = one.times(periods_of(rng, damping)), one.times(rng.uniform(3, 12))
    steady = one.size * np.cos(TURN * one.hz * (before - before[-1] - before[1]) + one.phase)
    x = np.concatenate([steady, linear(free, one.hz, damping, one.size, one.phase)])
    t = np.arange(x.size) * free[1]
    return Record(t, _noisy(rng, one, x), course_of(one.hz, damping), one.size, one.noise, float(t[before.size]))


KINDS: dict[str, Kind] = {
    "viscous": viscous,
    "2.5 to 4 swings": short,
    "1000 to 5000 swings": very_long,
    "two modes": two_modes,
    "strike": strike,
    "pendulum": pendulum,
    "quadratic drag": drag,
    "dry friction": dry,
    "clipped": clipped,
    "frozen sensor": frozen,
    "wrapped angle": wrapped,
    "gyroscope": gyroscope,
    "accelerometer": accelerometer,
    "whole numbers": integers,
    "irregular stamps": irregular,
    "gaps": gaps,
    "held before": held,
    "driven before": driven,
}


def record_of(kind: str, seed: int) -> tuple[Record, float]:
    """Return the record of a kind and seed, and the chance that draws its moment."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    return KINDS[kind](rng, Setting.drawn(rng)), float(rng.random())


@dataclass(frozen=True)
class Outcome:
    """What became of one record.

    refusal: its sentence, else empty; fault: the last line of a traceback. stated, mean: whether the stated intervals
    of frequency and damping ratio hold the moment's values, those by noise the means. false: reasons that are not so.
    """

    kind: str
    seed: int
    refusal: str = ""
    fault: str = ""
    stated: tuple[bool, ...] = ()
    mean: tuple[bool, ...] = ()
    off: tuple[float, ...] = ()
    false: tuple[str, ...] = ()
    wall_s: float = 0.0


def try_one(task: tuple[str, int]) -> Outcome:
    """Return what becomes of the record of a kind and seed."""
    kind, seed = task
    record, chance = record_of(kind, seed)
    began = time.perf_counter()
    try:
        found = analyse_ring_down(record.time_s, record.values, unit=record.unit, is_rate=record.is_rate)
    except SinewError as error:
        false = () if _is_true(str(error), record) else (str(error),)
        return Outcome(kind, seed, refusal=str(error), false=false, wall_s=time.perf_counter() - began)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        return Outcome(kind, seed, fault=text, wall_s=time.perf_counter() - began)
    lasted = time.perf_counter() - began
    mean = record.course.means(found.start_s, found.stop_s)
    moment = record.course.moment(found.start_s, found.stop_s, chance)
    names = ("frequency_hz", "damping_ratio")
    stated = tuple(_holds(getattr(found, name), value) for name, value in zip(names, moment, strict=True))
    by_noise = tuple(_holds(found.parts[name].noise, value) for name, value in zip(names, mean, strict=True))
    off = tuple((getattr(found, n).value - v) / getattr(found, n).std for n, v in zip(names, mean, strict=True))
    return Outcome(kind, seed, "", "", stated, by_noise, off, _false_reasons(found, record), lasted)


def _holds(one: Estimate, value: float) -> bool:
    return bool(one.low <= value <= one.high)


def _is_true(said: str, record: Record) -> bool:
    """Return whether the reason that a refusal names is so."""
    course = record.course
    hz = course.means(record.free_s, float(record.time_s[-1]))[0]
    lasts = (float(record.time_s[-1]) - record.free_s) * 2.0 * hz  # half cycles of free decay
    rate = course.rate if course.is_constant else float(np.log(course.size[0] / course.size[-1]) / course.turning_s[-1])
    standing = np.log(max(record.amplitude / (5.0 * record.noise), 1.0)) / max(rate, 1e-12) * 2.0 * hz
    if "what is left of the samples" in said:
        return bool(record.done)
    if "too short" in said or "no oscillation" in said:
        return lasts < 4.0
    if "dies out too fast" in said or "too few peaks" in said:
        return bool(min(standing, np.log(50.0) / max(rate, 1e-12) * 2.0 * hz) < 4.0)
    if "no decay found" in said or "no frequency can be told" in said:
        return rate * lasts / (2.0 * hz) < 10.0 * record.noise / record.amplitude
    if "gap" in said:
        return record.gap_s > 0.45 / hz
    return False


_REMARKS = {"clipped": "clipped", "stands still": "frozen", "wraps": "wrapped", "gap": "gap"}


def _false_reasons(found: RingDown, record: Record) -> tuple[str, ...]:
    """Return what an answer says of its record that is not so."""
    reason, false = found.shape.reason, []
    blamed = {"dry friction": "dry", "losses that grow": "drag", "softening": "pendulum", "hardening": ""}
    for words, moves in blamed.items():
        if "second mode near by" in reason and record.moves == "near mode":
            continue
        if words in reason and moves != record.moves and not (record.moves == "dry" and words == "softening"):
            false.append(f"verdict: {reason}")
    for remark in found.remarks:
        for words, done in _REMARKS.items():
            if words in remark and done not in record.done:
                false.append(f"remark: {remark}")
    return tuple(false)


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the table of kinds, and what went wrong."""
    rows = {}
    for kind in [*dict.fromkeys(one.kind for one in outcomes), "all"]:
        mine = [one for one in outcomes if kind in (one.kind, "all")]
        held = {name: [hit for one in mine for hit in getattr(one, name)] for name in ("stated", "mean")}
        rows[kind] = {
            "records": len(mine),
            "answers": sum(bool(one.stated) for one in mine),
            "refusals": sum(bool(one.refusal) for one in mine),
            "tracebacks": sum(bool(one.fault) for one in mine),
            "stated holds/%": 100 * np.mean(held["stated"]) if held["stated"] else np.nan,
            "noise holds mean/%": 100 * np.mean(held["mean"]) if held["mean"] else np.nan,
            "false": sum(bool(one.false) for one in mine),
            "s": np.mean([one.wall_s for one in mine]),
        }
    lines = [pd.DataFrame.from_dict(rows, orient="index").round(2).to_string(na_rep="-")]
    wrong = [one for one in outcomes if one.fault or one.false]
    lines += [f"{one.kind} {one.seed}: {one.fault or '; '.join(one.false)}" for one in wrong]
    refusals = sorted({re.sub(r"[-+]?\d[\d.e+-]*", "#", one.refusal) for one in outcomes if one.refusal})
    return "\n".join([*lines, *(f"refused: {one}" for one in refusals)])


def main() -> None:
    """Run the campaign and print its table."""
    parser = campaign_parser("decays", __doc__, count=25, of="seeds", numbered=True, workers=TWO, verbose=True)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), help="which kinds")
    asked = parser.parse_args()
    tasks = [(kind, seed) for kind in asked.kinds for seed in asked_seeds(asked)]
    outcomes: list[Outcome] = []
    for one in spread_trials(try_one, tasks, spread=spread_of(asked)):
        outcomes.append(one)
        print(f"\r{len(outcomes)} of {len(tasks)}", end="", flush=True)
        if asked.verbose and (one.refusal or one.fault or not all(one.stated)):
            print(f"\r{one.kind} {one.seed}: {one.refusal or one.fault or one.off}")
    conclude(asked.out, "\r" + table(outcomes), list(map(asdict, outcomes)))


if __name__ == "__main__":
    main()
