"""Start of a search: coefficients by linear regression on the equation of motion in its weak form.

Multiplied by a smooth bump w that is zero at both ends of a window, and integrated over it, the equation's derivatives
pass on to w: ∫w r'' = ∫w'' r. So stiffness, damping, friction, cubic and quadratic term and gain follow from one linear
regression over many windows, without a derivative of measured data.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import fftconvolve

from sinew.analysis.decay.modes import split_poles
from sinew.identify.oscillator.model import Model
from sinew.identify.oscillator.record import Frame, Record, derivative_order, input_derivative
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError

_AT_START = 0.12  # of a period: samples that tell position and rate at the start
_LEVEL, _STEADY, _SWITCHES = 0.1, 0.9, 6  # of a step's height; share of the samples at a level; jumps
_PENCIL_SAMPLES, _PENCIL_ORDER = 20, 6  # in a period; the oscillation, a harmonic, and two poles for the creep
_CREEPING = 4.0  # periods in the record, below which a decay's motion may be the creep of its rest position


def dominant_omega(record: Record) -> float:
    """Return the angular frequency at which the output has most of its motion [rad/s].

    Raises RecordingError where the output does not move, or has not even one period in the record.
    """
    even, y, given = _even(record)
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


def _even(record: Record) -> tuple[Array, Array, Array | None]:
    """Return time, output and input on an even grid."""
    t = record.time_s
    even = np.linspace(t[0], t[-1], t.size)
    given = None if record.input is None else np.interp(even - record.output_delay_s, t, record.input)
    return even, np.interp(even, t, record.output), given


def ringing(record: Record, omega: float) -> dict[str, float] | None:
    """Return stiffness, damping, offset and start of the one oscillation in a free decay that has most of its energy.

    omega: about its frequency, within a factor of three [rad/s]. By the matrix pencil, which separates it from the
    creep of its rest position; None where it finds none.
    """
    even, y, _ = _even(record)
    stride = max(1, int(2 * math.pi / omega / (even[1] - even[0]) / _PENCIL_SAMPLES))
    count = y.size // stride
    means = y[: count * stride].reshape(count, stride).mean(axis=1)
    found = split_poles(means - means[-count // 4 :].mean(), stride * (even[1] - even[0]), (_PENCIL_ORDER,))[0]
    if not found:
        return None
    pole = found[0][0]
    offset, real, imaginary = map(float, np.linalg.lstsq(_wave(even, pole), y, rcond=None)[0])
    amplitude = complex(real, imaginary) / pole ** derivative_order(record.output_unit)
    return {
        "stiffness": abs(pole) ** 2,
        "damping": -2 * pole.real,
        "loss_factor": -2 * pole.real / abs(pole),
        "offset": offset,
        "start": amplitude.real,
        "start_rate": (amplitude * pole).real,
    }


def ringing_misfit(record: Record, stiffness: float, damping: float) -> float:
    """Return the rms of what a linear oscillation with these mechanics, of any start, leaves of a free decay."""
    even, y, _ = _even(record)
    table = _wave(even, -0.5 * damping + 1j * math.sqrt(max(stiffness - 0.25 * damping**2, 0.0)))
    if not np.isfinite(table).all():
        return math.inf
    return float(np.std(y - table @ np.linalg.lstsq(table, y, rcond=None)[0]))


def _wave(even: Array, pole: complex) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        wave = np.exp(pole * (even - even[0]))
    return np.stack([np.ones(even.size), wave.real, -wave.imag], axis=1)


def regress_together(records: Sequence[Record], model: Model, omega: float, frame: Frame) -> list[dict[str, float]]:
    """Return coefficients of the model in SI units, by name of `LOCAL`, of every record; `offset` in its output's unit.

    All records have the same mechanics, and only a constant is each one's own.
    omega: a frequency of the motion, which sets the length of the windows [rad/s].
    A record of a single frequency tells neither stiffness from inertia nor the gain; several of them do.
    """
    equations = [_equation(record, model, omega, frame) for record in records]
    columns = list(equations[0].columns)
    rows = [np.stack([one.columns[name] for name in columns], axis=1) for one in equations]
    own = np.zeros((sum(row.shape[0] for row in rows), len(rows)))
    ends = np.cumsum([0, *(row.shape[0] for row in rows)])
    for i, one in enumerate(equations):
        own[ends[i] : ends[i + 1], i] = one.constant
    table = np.concatenate([np.concatenate(rows), own], axis=1)
    size = np.linalg.norm(table, axis=0)
    size[size == 0] = 1.0
    target = np.concatenate([one.target for one in equations])
    found = np.linalg.lstsq(table / size, target, rcond=1e-10)[0] / size
    shared = dict(zip(columns, map(float, found), strict=False))
    return [
        _finished(shared, float(constant), one, model, record)
        for constant, one, record in zip(found[len(columns) :], equations, records, strict=True)
    ]


class _Equation(NamedTuple):
    """The weak form of one record: columns by name of `LOCAL`, the constant's, the inertia's, and the motion."""

    columns: dict[str, Array]
    constant: Array
    target: Array
    motion: Array
    centre: float
    start: tuple[float, float]


def _equation(record: Record, model: Model, omega: float, frame: Frame) -> _Equation:
    even, y, given = _even(record)
    step = float(even[1] - even[0])
    half = max(4, int(0.6 * 2 * math.pi / omega / step))
    if 2 * half + 8 >= y.size:
        half = max(2, (y.size - 8) // 4)
    order = derivative_order(record.output_unit)
    motion = _integrated(y - y.mean() if order else y, step, order)
    centre = float(motion.mean())
    motion = motion - centre
    driving = None if given is None else _Weak(half, step).of(given, input_derivative(record))
    weak = _Weak(half, step)
    if frame == "absolute" and given is not None:
        motion = motion - _base_share(weak, motion, given, record) * _integrated(given, step, 0)
    few = max(3, int(_AT_START * 2 * math.pi / omega / step))
    line = np.polynomial.Polynomial.fit(even[:few] - even[0], motion[:few], 2 if few > 8 else 1).convert()
    start = float(line(0.0)), float(line.deriv()(0.0))
    centre = centre if order == 0 else float(y.mean())
    columns = _columns(weak, motion, driving, model, record)
    return _Equation(columns, weak.of(np.ones_like(motion), 0), weak.of(motion, 2), motion, centre, start)


def _integrated(y: Array, step: float, order: int) -> Array:
    for _ in range(order):
        y = cumulative_trapezoid(y, dx=step, initial=0)
        y = y - np.polynomial.Polynomial.fit(np.arange(y.size), y, 1)(np.arange(y.size))
    return np.asarray(y, dtype=float)


def _base_share(weak: "_Weak", motion: Array, given: Array, record: Record) -> float:
    """Return how much of the input is in the absolute motion; 1 where both have the same unit."""
    if record.input_unit == record.output_unit or derivative_order(record.input_unit):
        return 1.0 if record.input_unit == record.output_unit else 0.0
    columns = np.stack([-weak.of(motion, 0), -weak.of(motion, 1), weak.of(given, 0), weak.of(given, 1)], axis=1)
    found = np.linalg.lstsq(columns, weak.of(motion, 2), rcond=None)[0]
    return float(found[2] / found[0])


class _Weak:
    """Windows of half-length `half` samples, a quarter of it apart."""

    def __init__(self, half: int, step: float) -> None:
        x = np.linspace(-1.0, 1.0, 2 * half + 1)
        bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** 5
        self._weights = [bump.deriv(k)(x) * (-1.0) ** k / (half * step) ** k if k else bump(x) for k in range(3)]
        self._stride, self.step = max(1, half // 4), step

    def of(self, signal: Array, derivative: int) -> Array:
        """Return ∫ w · d^k signal/dt^k over every window."""
        whole = fftconvolve(signal, self._weights[derivative][::-1], mode="valid")
        return np.asarray(whole[:: self._stride], dtype=float)


def _columns(weak: _Weak, motion: Array, driving: Array | None, model: Model, record: Record) -> dict[str, Array]:
    rate = np.gradient(motion, weak.step)
    columns = {term.numbers[0].name: -weak.of(*term.regressor(motion, rate)) for term in model.law.terms}
    if driving is not None:
        columns["gain"] = driving if record.excitation not in ("base", "lever") else -driving
    return columns


def _finished(
    shared: dict[str, float], constant: float, equation: _Equation, model: Model, record: Record
) -> dict[str, float]:
    values, shift = dict(shared), 0.0
    if derivative_order(record.output_unit) == 0 and values["stiffness"] > 0:
        shift = float(constant / values["stiffness"])
        shift = shift if abs(shift) <= 0.5 * np.abs(equation.motion).max() else 0.0
    for term in model.law.terms:
        values |= term.started(values, float(np.abs(equation.motion).max()))
    position, rate = equation.start
    return values | {"offset": equation.centre + shift, "start": position - shift, "start_rate": rate}
