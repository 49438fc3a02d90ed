"""A stretch of data to be identified: time, input, output, their units and what they are."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from sinew.analysis.decay.free_decay import Peaks, find_peaks, free_decay
from sinew.analysis.decay.samples import read_samples, unwrapped_angle
from sinew.identify.oscillator.track import LOCAL, Grid
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError, SpecError, UnitError
from sinew.measure.timing import choose_stretch
from sinew.measure.units import convert
from sinew.measure.validation import as_numbers, as_seconds
from sinew.mechanics.laws import Law, LossFactor
from sinew.mechanics.silicone import BAND_HZ, relaxation_times

Excitation = Literal["force", "torque", "base", "lever", "none"]

FEWEST = 16
"""Samples below which nothing is fitted."""
_ORDERS = {"rad/s": 1, "m/s": 1, "V/s": 1, "rad/s2": 2, "m/s2": 2}
_MOTIONS = {"rad/s": "rad", "rad/s2": "rad", "m/s": "m", "m/s2": "m", "V/s": "V"}


@dataclass(frozen=True)
class Record:
    """One stretch of one experiment.

    time_s: strictly increasing, shape (n,). output: shape (n,); input: shape (n,), or None for a free decay.
    excitation: what the input is: a force or torque on the moving part, the motion of its base, the motion of a lever
        on it (relative to it), or none.
    output_unit, input_unit: SI and radians. A rate or acceleration is fitted as such.
    output_delay_s: how much later than the input's the output's stamps are [s].
    group: name of the condition (a pretension, a length) that the stretch was recorded under.
    output_said, input_said: the units that people have them in, in which numbers are shown; "" where nobody said.
    """

    time_s: Array
    output: Array
    input: Array | None = None
    excitation: Excitation = "none"
    output_unit: str = "1"
    input_unit: str = "1"
    output_delay_s: float = 0.0
    group: str = ""
    notes: tuple[str, ...] = field(default=())
    output_said: str = ""
    input_said: str = ""

    @property
    def size(self) -> int:
        """Return the number of samples."""
        return self.time_s.size

    @property
    def step_s(self) -> float:
        """Return the median sampling step [s]."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def motion_unit(self) -> str:
        """Return the unit of the motion itself, whose rate or acceleration the output may be."""
        return _MOTIONS.get(self.output_unit, self.output_unit)

    @property
    def input_motion_unit(self) -> str:
        """Return the unit of the input, for a base or lever that of its motion."""
        moved = self.excitation in ("base", "lever")
        return _MOTIONS.get(self.input_unit, self.input_unit) if moved else self.input_unit

    @property
    def motion_said(self) -> str:
        """Return the unit that people have the motion in; "" where nobody said."""
        return _motion_said(self.output_said, self.output_unit)

    @property
    def input_motion_said(self) -> str:
        """Return the unit that people have the input in, for a base or lever its motion; "" where nobody said."""
        moved = self.excitation in ("base", "lever")
        return _motion_said(self.input_said, self.input_unit) if moved else self.input_said

    def cut(self, start: int, stop: int) -> "Record":
        """Return the samples start to stop - 1."""
        inside = slice(start, stop)
        given = None if self.input is None else self.input[inside]
        return replace(self, time_s=self.time_s[inside], output=self.output[inside], input=given)


def derivative_order(unit: str) -> int:
    """Return 0 for a motion, 1 for a rate, 2 for an acceleration, by its unit."""
    return _ORDERS.get(unit, 0)


def _motion_said(said: str, unit: str) -> str:
    """Return the unit of a motion by that of the motion, its rate or its acceleration: "mm" of "mm/s"."""
    if unit not in _MOTIONS:
        return said
    stem = said.partition("/s")[0].strip()
    try:
        convert(stem, _MOTIONS[unit])
    except UnitError:
        return ""
    return stem


def make_record(
    time_s: ArrayLike,
    output: ArrayLike,
    input: ArrayLike | None = None,  # noqa: A002 - the field's word
    *,
    excitation: Excitation = "none",
    output_unit: str = "1",
    input_unit: str = "1",
    output_delay_s: float = 0.0,
    group: str = "",
) -> Record:
    """Return a record whose arrays are finite, equally long and in time order.

    Raises SpecError where excitation and input do not fit together, RecordingError where the samples are not usable.

    >>> import numpy as np
    >>> import sinew as sn
    >>> t = np.arange(0, 2, 0.01)
    >>> sn.make_record(t, np.cos(9 * t), np.sin(8 * t), excitation="torque", output_unit="rad", input_unit="N*m").size
    200
    """
    if excitation not in get_args(Excitation):
        raise SpecError(f"excitation is {excitation!r}, expected one of {', '.join(get_args(Excitation))}")
    if excitation == "none" and input is not None:
        raise SpecError(
            "an input is given and the excitation is none; say what the input is (force, torque, base, lever), or "
            "leave the input out to fit a free decay"
        )
    if excitation != "none" and input is None:
        raise SpecError(f"the excitation is {excitation} and no input is given; name its column, or choose none")
    arrays = {"time": time_s, "output": output} | ({} if input is None else {"input": input})
    checked = {
        name: as_seconds(values) if name == "time" else as_numbers(values, name) for name, values in arrays.items()
    }
    for name, values in checked.items():
        if values.ndim != 1 or values.shape != checked["time"].shape:
            raise RecordingError(
                f"time has shape {checked['time'].shape} and {name} {values.shape}; expected one column each"
            )
        if not np.isfinite(values).all():
            raise RecordingError(f"the {name} holds NaN or infinity at sample {int(np.argmin(np.isfinite(values)))}")
    if checked["time"].size < FEWEST:
        raise RecordingError(f"found {checked['time'].size} samples, expected at least {FEWEST}; record longer")
    if np.diff(checked["time"]).min() <= 0:
        raise RecordingError("time does not increase everywhere; sort the record or use its sample index")
    return Record(
        checked["time"],
        checked["output"],
        checked.get("input"),
        excitation,
        output_unit,
        input_unit,
        output_delay_s,
        group,
    )


# How a record swings.

_LEVEL, _STEADY, _SWITCHES = 0.1, 0.9, 6  # of a step's height; share of the samples at a level; jumps


_CREEPING = 4.0  # periods in the record, below which a decay's motion may be the creep of its rest position


def dominant_omega(record: Record) -> float:
    """Return the angular frequency at which the output has most of its motion [rad/s].

    Raises RecordingError where the output does not move, or has not even one period in the record.
    """
    even, y, given = even_samples(record)
    y = y - y.mean()
    if not np.abs(y).max() > 0:
        raise RecordingError("the output is constant; is it the right column, and did the sensor run?")
    step = even[1] - even[0]
    size = 2 ** math.ceil(math.log2(4 * y.size))
    free = record.excitation == "none"
    if free:  # a window would take away the begin, where a decay is largest
        moving = y - np.median(y[-y.size // 4 :])
    elif given is not None and is_step(record):  # what swings about the position that the step leads to
        free, stepping = True, np.stack([np.ones_like(y), given], axis=1)
        moving = y - stepping @ np.linalg.lstsq(stepping, y, rcond=None)[0]
    else:
        moving = (y - np.polynomial.Polynomial.fit(even, y, 1)(even)) * np.hanning(y.size)
    power = np.abs(np.fft.rfft(moving, size)) ** 2
    frequency = np.fft.rfftfreq(size, step)
    lasts = even[-1] - even[0]
    power[frequency < 1.0 / lasts] = 0.0
    if free:
        power *= (frequency**2 / (frequency**2 + (_CREEPING / lasts) ** 2)) ** 2
    best = int(np.argmax(power))
    if best == 0:
        raise RecordingError("the record is shorter than one period of its oscillation; record longer")
    return float(2 * math.pi * frequency[best])


def is_step(record: Record) -> bool:
    """Return whether the input is a step or a few of them: a force or torque that is switched, or a base that jumps."""
    if record.input is None:
        return False
    low, high = float(record.input.min()), float(record.input.max())
    height = (record.input - low) / max(high - low, 1e-300)
    up = height > 0.5
    steady = (height < _LEVEL) | (height > 1 - _LEVEL)
    return bool(steady.mean() > _STEADY and 1 <= np.count_nonzero(up[1:] != up[:-1]) <= _SWITCHES)


def even_samples(record: Record) -> tuple[Array, Array, Array | None]:
    """Return time, output and input on an even grid."""
    t = record.time_s
    even = np.linspace(t[0], t[-1], t.size)
    given = None if record.input is None else np.interp(even - record.output_delay_s, t, record.input)
    return even, np.interp(even, t, record.output), given


# A record becomes the grid of a simulation: steps, inputs between the samples, and scales.

Frame = Literal["relative", "absolute"]

_STIFF = 1.5  # shortest relaxation times in a step of RK4, whose decay is then right to 2 %


@dataclass(frozen=True)
class Scales:
    """What makes the numbers of a simulation near one.

    omega: ω_r [rad/s]. amplitude: A [unit of the motion]. forcing: U, of the input's `input_derivative`.
    """

    omega: float
    amplitude: float
    forcing: float

    def physical(self, local: str) -> float:
        """Return what a number of `LOCAL` in normal form is multiplied by to be in SI units and radians."""
        if local == "gain":
            return self.omega**2 * self.amplitude / self.forcing
        fast, far = LOCAL[local].scale
        return float(self.omega**fast * self.amplitude**far)


def input_derivative(record: Record) -> int:
    """Return how often the input is differentiated to drive the motion: of a base or lever it is the acceleration."""
    return 2 - derivative_order(record.input_unit) if record.excitation in ("base", "lever") else 0


def frames_of(record: Record) -> tuple[Frame, ...]:
    """Return whether the output may be the motion relative to the base, the absolute one, or either."""
    if record.excitation != "base":
        return ("relative",)
    if derivative_order(record.output_unit) < derivative_order(record.input_unit):
        return ("relative",)
    return ("absolute", "relative")


def _spline(record: Record) -> BSpline | CubicSpline | None:
    if record.input is None:
        return None
    if record.excitation in ("base", "lever"):
        # Natural ends: the second derivative of any other spline is wild there, and would kick the motion.
        return CubicSpline(record.time_s, record.input, bc_type="natural")
    return make_interp_spline(record.time_s, record.input, k=5)


def grid_of(record: Record, scales: Scales, frame: Frame, law: Law) -> tuple[Grid, NDArray[np.intp]]:
    """Return the grid of a record and the indices of its samples on it.

    Between the samples a force is a quintic spline and a motion a cubic one. The second derivative of that, wild as it
    is where the samples are noisy, is integrated twice by the simulation, which gives the spline back.
    """
    steps = np.diff(record.time_s)
    relaxation = relaxation_of(scales.omega)
    parts = math.ceil(float(np.median(steps)) * scales.omega / law.phase)
    if law.has(LossFactor):
        parts = max(parts, math.ceil(float(np.median(steps)) / (_STIFF * float(relaxation.min()))))
    # A longer interval, where samples are missing, takes as many more steps.
    whole = parts * np.maximum(np.rint(steps / np.median(steps)), 1.0).astype(np.intp)
    edges = np.concatenate([[0.0], np.repeat(steps / whole, whole)]).cumsum() + record.time_s[0]
    samples = np.concatenate([[0], np.cumsum(whole)])
    edges[samples] = record.time_s
    count = edges.size - 1
    room = _room(count)
    forcing, carried = np.zeros((room, 3)), np.zeros(room + 1)
    spline = _spline(record)
    if spline is not None:
        # The output's stamps are late, so its motion at a stamp belongs to an earlier input.
        at = np.clip(edges - record.output_delay_s, record.time_s[0], record.time_s[-1])
        sign = -1.0 if record.excitation in ("base", "lever") else 1.0
        driving = spline.derivative(input_derivative(record)) if input_derivative(record) else spline
        ends = sign * driving(at) / scales.forcing
        middle = sign * driving(0.5 * (at[1:] + at[:-1])) / scales.forcing
        forcing[:count] = np.stack([ends[:-1], middle, ends[1:]], axis=1)
        if frame == "absolute":
            gap = derivative_order(record.output_unit) - derivative_order(record.input_unit)
            moving = spline.derivative(gap) if gap else spline
            # In normal form the gain is that of the acceleration: z counts in U/ω_r².
            order = derivative_order(record.output_unit)
            carried[: count + 1] = moving(at) * scales.omega ** (2 - order) / scales.forcing
    lengths = np.zeros(room)
    lengths[:count] = np.diff(edges) * scales.omega
    time = np.ones(room + 1)
    time[: count + 1] = (edges - edges[0]) / (edges[-1] - edges[0])
    grid = Grid(lengths, forcing, carried, time, relaxation * scales.omega, np.asarray(scales.amplitude))
    return grid, samples


def relaxation_of(omega: float) -> Array:
    """Return the relaxation times [s]: the twin's, moved along where the oscillation is not well inside its band."""
    centre = math.sqrt(BAND_HZ[0] * BAND_HZ[1])
    frequency = omega / (2 * math.pi)
    move = 1.0 if 0.2 * centre <= frequency <= 5 * centre else centre / frequency
    return relaxation_times() * move


def _room(count: int) -> int:
    """Return the padded number of steps: few different ones, so that few are compiled for.

    Below 2048 steps a compilation, even one that was kept, costs a fit more time than the steps that are added.
    """
    power = 1 << max(6, math.floor(math.log2(max(count, 1))))
    parts = 2 if power < 2048 else 8
    return next(room for part in range(parts, 2 * parts + 1) if (room := power * part // parts) >= count)


# ---- the stretch of a record that is fitted: between two times, an angle unwrapped, what no sensor saw left out, and
# of a free decay its free part.


_STRUCK = 3.0  # times the three swings before: a motion begun anew, which no beat does within one swing
_LARGE = 0.3  # of the largest swing
_CALM = 3  # swings before
_FEWEST_SWINGS = 5
_AT_ONCE = 1.25  # half periods: what begins free so soon begins with the record


def cut_to(record: Record, start_s: float | None, stop_s: float | None) -> Record:
    """Return the samples from start_s to stop_s. Raises TimeError where there are none, RecordingError for too few."""
    if start_s is None and stop_s is None:
        return record
    inside = np.flatnonzero(choose_stretch(record.time_s, start_s, stop_s, of="record"))
    if inside.size < FEWEST:
        raise RecordingError(
            f"found {inside.size} samples between start and stop, expected at least {FEWEST}; choose a longer stretch"
        )
    return record.cut(int(inside[0]), int(inside[-1]) + 1)


def unwrapped(record: Record) -> Record:
    """Return the record with angles that jump by a whole turn between two samples made continuous, and a note on it."""
    notes = []
    output, turns = unwrapped_angle(record.output, record.output_unit)
    if turns:
        notes.append(f"the output jumps by a whole turn {_times(turns)}; it was unwrapped")
    given = record.input
    if given is not None:
        given, turns = unwrapped_angle(given, record.input_unit)
        if turns:
            notes.append(f"the input jumps by a whole turn {_times(turns)}; it was unwrapped")
    return replace(record, output=output, input=given, notes=(*record.notes, *notes)) if notes else record


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def telling(record: Record, *, counted: bool = False) -> Record:
    """Return a free decay without samples that are clipped or frozen, as `analyse` leaves them out, and a note on them.

    counted: samples were asked for by their index, so none is left out and the note says that they are there.
    """
    if record.excitation != "none":
        return record
    try:
        samples = read_samples(record.time_s, record.output, None, record.output_unit)
    except RecordingError:
        return record
    if lost := record.size - samples.time_s.size:
        notes = [one for one in samples.remarks if one.endswith("left out")]
        if counted:
            notes = [f"{lost} samples are clipped or frozen, and fitted; without train and test they are left out"]
            return replace(record, notes=(*record.notes, *notes))
        return replace(record, time_s=samples.time_s, output=samples.values, notes=(*record.notes, *notes))
    return record


def free_part(record: Record) -> Record:
    """Return the free part of a free decay, found as `analyse` finds it, and a note where that is not all of it.

    Of several decays in one record it is the one with most swing. A record that begins free, within half a swing, and
    one in which no free decay is found stays as it is.
    """
    if record.excitation != "none":
        return record
    try:
        samples = read_samples(record.time_s, record.output, None, record.output_unit)
        decays = find_decays(samples.even_s, samples.even)
    except RecordingError:
        return record
    if not decays:
        return record
    best = max(range(len(decays)), key=lambda k: decays[k][2])
    first, last, _ = decays[best]
    notes = []
    if len(decays) > 1:
        listed = " and ".join(f"{a:.4g} to {b:.4g} s" for a, b, _ in decays)
        notes.append(
            f"the record holds {len(decays)} free decays, {listed}; that from {first:.4g} s was fitted: choose another "
            "by start and stop"
        )
    elif first > float(record.time_s[0]) + 0.5 * record.step_s:
        notes.append(f"the motion is free from {first:.4g} s on, and fitted from there; choose another by start")
    else:
        return record
    step = record.step_s
    inside = np.flatnonzero((record.time_s >= first - 0.5 * step) & (record.time_s <= last + 0.5 * step))
    if inside.size < FEWEST:
        return record
    part = record.cut(int(inside[0]), int(inside[-1]) + 1)
    return replace(part, notes=(*part.notes, *notes))


def find_decays(t: Array, x: Array) -> list[tuple[float, float, float]]:
    """Return begin [s], end [s] and sum of swings of every free decay in a record, in order of time.

    t, x: shape (n,), evenly sampled. The motion begins anew where one swing is three times as large as those before.
    A decay that begins within half a swing of the record begins with it, where the samples before it follow it.
    """
    peaks = find_peaks(t, x)
    struck = _struck(peaks)
    ends = [float(peaks.time_s[k]) for k in struck[1:]] + [float(t[-1])]
    begin, found = float(t[0]), []
    for end in ends:  # what is no decay, as a hold, belongs before the next one, whose start is sought behind it
        inside = (t >= begin) & (t <= end)
        try:
            fit, _, _, own = free_decay(t[inside], x[inside], None)
        except RecordingError:
            continue
        before = (t >= begin) & (t < fit.start_s)
        at_once = begin == t[0] and fit.start_s <= begin + _AT_ONCE * own.half_period_s
        if at_once and before.any():  # and no hold before a release, which the decay does not follow
            off = x[before] - fit.model(t[before])
            at_once = float(np.mean(off**2)) <= float(np.max(fit.residual**2))
        start = begin if at_once else fit.start_s
        found.append((start, end, float(own.swing.sum())))
        begin = end
    return found


def _struck(peaks: Peaks) -> Sequence[int]:
    """Return the peaks at which a motion begins: the first, and those that a new stroke leads away from."""
    swing = peaks.swing
    large = _LARGE * float(swing.max(initial=0.0))
    new = [
        k
        for k in range(_CALM, swing.size - _FEWEST_SWINGS)
        if swing[k] >= max(large, _STRUCK * float(swing[k - _CALM : k].max()))
    ]
    return [0, *new]
