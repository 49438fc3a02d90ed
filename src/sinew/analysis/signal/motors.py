"""What the motors' registers tell: power from duty, current and voltage, and whose current it is."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.harmonics import HARMONICS, NYQUIST_SHARE, multiples
from sinew.analysis.signal.signals import Signals
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, Estimate, number, span
from sinew.measure.recording import segment_slices
from sinew.measure.result import Detail, Field, Result, Rows
from sinew.plan.rig import RigSpec
from sinew.plan.servo import FULL_DUTY_COUNTS, SERVOS, VOLTAGE_LSB

# A periodic signal gets its mean over a cycle, from samples that hold no whole number of cycles.


def cycle_mean(time_s: Array, signal: Array, frequency_hz: Array) -> tuple[Array, Array]:
    """Return the means of q periodic signals of s records and their standard deviations, each (s, q).

    time_s: stamps as they are, (s, n). signal: (s, q, n). frequency_hz: at which the signals repeat, (s,); of a power
    that is twice the drive's.
    Least squares with a mean, a slope and up to five harmonics: a plain mean would keep what the last, broken cycle
    holds. The standard deviation is that of white noise of the residual's size, and of the slope over the record
    where it is more than three times its own noise.
    Records of fewer samples than coefficients give NaN.
    """
    records, samples = time_s.shape
    span = time_s[:, -1:] - time_s[:, :1]
    rate = samples / float(span.max())
    count = int(min(HARMONICS, NYQUIST_SHARE * rate / float(frequency_hz.max())))
    if samples < 2 * count + 3:
        return (np.full((records, signal.shape[1]), np.nan),) * 2
    elapsed = time_s - time_s.mean(axis=1, keepdims=True)
    design = multiples(2.0 * np.pi * frequency_hz[:, None] * elapsed, count, 2)
    design[:, 0], design[:, 1] = 1.0, elapsed / span
    normal = np.linalg.inv(design @ design.transpose(0, 2, 1))
    solution = (signal @ design.transpose(0, 2, 1)) @ normal
    residual = signal - solution @ design
    variance = np.square(residual, out=residual).sum(axis=2) / max(1, samples - design.shape[1])
    slope = solution[:, :, 1] ** 2
    drift = np.where(slope > 9.0 * variance * normal[:, 1:2, 1], slope, 0.0)
    return solution[:, :, 0], np.sqrt(variance * normal[:, :1, 0] + drift / 12.0)


def idle_power(rig: RigSpec) -> float:
    """Return what all servos draw with their torque off [W], by data sheet: no register tells it.

    Standby current times supply voltage, of the tendons' servos and the drive's.
    """
    models = [rig.wiring.tendon_model] * rig.tendons.count + [rig.wiring.drive_model]
    return sum(SERVOS[model].standby_current for model in models) * rig.drive.supply_voltage.value


def supply_uncertainty(supply_v: NDArray[Any] | None, rig: RigSpec) -> float:
    """Return the relative standard uncertainty of the voltage: of its register's unit, or of the rig's value.

    supply_v: as recorded, (n,); None where it was not. A rig's value without an interval counts as exact.
    """
    if supply_v is not None:
        return VOLTAGE_LSB / math.sqrt(12.0) / float(supply_v.mean())
    voltage = rig.drive.supply_voltage
    if voltage.interval90 is None:
        return 0.0
    return float(np.ptp(voltage.interval90)) / (2 * NORMAL_90) / voltage.value


@dataclass(frozen=True)
class Power:
    """Electrical power at every sample [W], (n,): the drive's, what of it warms the copper, and that of all tendon
    motors together, None without their currents.

    Duty times supply voltage times current, where Present Current is the motor's own: see docs/explanation/energy.md.
    Of tendon motors whose duty was not recorded it is resistance times squared current.
    """

    drive: Array
    copper: Array
    holding: Array | None


def read_power(signals: Signals, where: slice | NDArray[np.int64] = slice(None)) -> Power | None:
    """Return the power of the motors, at all samples or some, None without a rig and where duty or current of the drive
    was not recorded.

    where: samples, or their numbers in an array of any shape, which is that of the powers then.
    """
    rig, names = signals.rig, ("drive_pwm", "drive_current_a", "supply_v", "tendon_pwm", "tendon_current_a")
    columns = {name: signals.recorded[name] for name in names if name in signals.recorded}
    if isinstance(where, slice):
        recorded = {name: values[where].astype(float) for name, values in columns.items()}
    else:  # rows of all tendons are taken ten times as fast as they are indexed
        recorded = {name: values.take(where, axis=0).astype(float) for name, values in columns.items()}
    if rig is None or "drive_pwm" not in recorded or "drive_current_a" not in recorded:
        return None
    supply = recorded.get("supply_v", rig.drive.supply_voltage.value)
    current, holding = recorded["drive_current_a"], None
    if "tendon_current_a" in recorded:
        currents = recorded["tendon_current_a"]
        all_of = np.ones(currents.shape[-1])
        if "tendon_pwm" in recorded:
            holding = (recorded["tendon_pwm"] * currents) @ all_of * supply
        else:
            holding = SERVOS[rig.wiring.tendon_model].resistance * (currents**2 @ all_of)
    return Power(recorded["drive_pwm"] * supply * current, rig.drive.resistance * current**2, holding)


def rest_power(signals: Signals, rig: RigSpec) -> dict[tuple[float, int], tuple[float, float]]:
    """Return (mean, standard deviation) of all motors' electrical power in the idle segments [W].

    By (pretension [mm], repeat). Tendon motors hold, the lever stays at its zero. At rest the currents hardly move, so
    that rounding does not average out: the deviation is that of the registers' units. Empty where duty or current of
    the drive was not recorded.
    """
    found: dict[tuple[float, int], list[float]] = {}
    for segment, where in signals.of_kind("idle"):
        power = read_power(signals, where)
        if power is not None and math.isfinite(segment.pretension_mm):
            holding = 0.0 if power.holding is None else float(power.holding.mean())
            mean = float(power.drive.mean()) + holding
            found.setdefault((segment.pretension_mm, segment.repeat), []).append(mean)
    servo = SERVOS[rig.wiring.tendon_model]
    unit = rig.tendons.current_lsb.value / math.sqrt(12.0)

    def std(watts: float) -> float:
        # n equal motors at R i² each: d(n R i²) = 2 R i √n di, with n R i² = watts
        return 2.0 * math.sqrt(max(0.0, watts) * servo.resistance) * unit

    return {pair: (float(np.mean(means)), std(float(np.mean(means)))) for pair, means in found.items()}


def power_columns(
    signals: Signals, time_s: Array, samples: NDArray[np.int64], frequency_hz: Array
) -> dict[str, NDArray[Any]]:
    """Return the power columns of the result schema of steady segments of one length, each (s,), by name.

    time_s: stamps of the segments [s], (s, n). samples: their numbers, (s, n). frequency_hz: of their drive, (s,).
    Empty where no power is known. drive_mechanical_w is not among them: it comes from the motion.
    """
    power = read_power(signals, samples)
    if power is None:
        return {}
    powers = [power.drive, np.maximum(power.drive, 0.0), power.copper]
    powers += [] if power.holding is None else [power.holding]
    mean, std = cycle_mean(time_s, np.stack(powers, axis=1), 2.0 * frequency_hz)
    names = ("drive_power_w", "drive_drawn_w", "drive_copper_w", "holding_power_w")
    columns = dict(zip(names, mean.T, strict=False))
    return columns | {"drive_power_std_w": std[:, 0]}


# Whose current a register tells: the motor's, or that of its supply.


# A brushed motor on a full bridge sees the mean voltage u = δV and carries i = (δV - k ω - v sgn δ)/R, with v for what
# brushes and bridge drop. The supply then carries δ i. What is read is taken for
#
#     i_read = |δ|^s (δV - k ω - v sgn δ)/R,
#
# s = 0 for the motor's current and s = 1 for the supply's. At the same torque, hence the same i, the reading stays
# where the duty changes, or it goes with it: no torque need be known for that, since a motor's voltage tells its own
# current. R, k and v are fitted besides, so neither temperature nor data sheet is in s.

Whose = Literal["motor", "supply", "undetermined"]
"""Whose current it is."""

BLOCKS = 10
"""Stretches of the record; each is left out once, and how far s moves then is its uncertainty."""

NEAR = 0.25
"""How far from 0 or 1 the interval of s may reach for a verdict: a law in between is neither."""

_FEWEST = 200
_FEWEST_LOADS = 4
_MODEL_STD = 0.05  # of a motor that swings: on emulated benches s was off by 0.01 (motor's) and 0.06 (supply's)
_LEAST_COUNTS = 5.0  # a reading below so many counts tells little but its rounding
_EXPONENTS = np.linspace(-0.5, 1.5, 101)


@dataclass(frozen=True, repr=False)
class CurrentSense(Result):
    """Whose current a motor's register tells.

    motor: its name. whose: the verdict; why: its reason. exponent: s, 0 for the motor's current, 1 for the supply's.
    duty: from the smallest to the largest; of a motor that moves 5 % of the samples are left out on either side.
    misfit: root mean square of what is left over that of the readings. samples: of a motor that stands, loads.
    """

    motor: Annotated[str, Field("motor")]
    whose: Annotated[Whose, Field("current is of")]
    why: Annotated[str, Field("", "detail")]
    exponent: Annotated[Estimate, Field("exponent of the duty (90 %)", "interval")]
    duty: Annotated[tuple[float, float], Field("duty")]
    misfit: Detail
    samples: Annotated[int, Field("samples")]


@dataclass(frozen=True, repr=False)
class Currents(Result):
    """Whose current the register of each motor tells, the drive first, then the tendons in order."""

    motors: Annotated[
        Rows[CurrentSense], Field("whose current the register tells: exponent 0, the motor's; 1, the supply's")
    ]

    def closing(self) -> list[str]:
        """Return the reason of each verdict."""
        return [f"{one.motor}: {one.why}" for one in self.motors]


def sense_currents(recording: xr.Dataset, count_a: float) -> Currents:
    """Return whose current each motor's register tells.

    count_a: unit of the registers [A]. The speeds come from the encoders. Raises RecordingError where the recording
    has no duty or no current of any motor.
    """
    slices, kinds = segment_slices(recording), recording["kind"].values
    time = np.asarray(recording["time_s"].values, dtype=float)
    supply = recording["supply_v"].values.astype(float) if "supply_v" in recording else np.ones(time.size)
    resting = [where for where, kind in zip(slices, kinds, strict=True) if kind == "idle"]
    motors: dict[str, list[Array]] = {}
    for motor in ("drive", "tendon"):
        names = [f"{motor}_{column}" for column in ("current_a", "pwm", "rad")]
        if set(names) <= set(recording):
            columns = np.stack([recording[name].values.reshape(time.size, -1) for name in names]).astype(float)
            named = ["drive"] if motor == "drive" else [f"tendon {i + 1}" for i in range(columns.shape[2])]
            motors |= dict(zip(named, np.moveaxis(columns, 2, 0), strict=True))
    found = []
    for motor, (current, duty, angle) in motors.items():
        if motor == "drive":
            speed, inside = _speed(time, angle, slices)
            used = inside & (np.abs(current) >= _LEAST_COUNTS * count_a) & (duty != 0)
            found.append(sense_moving(motor, current[used], duty[used], speed[used], supply[used]))
        else:
            amps, share, volts = (
                np.array([column[where].mean() for where in resting]) for column in (current, duty, supply)
            )
            found.append(sense_standing(motor, amps, share, volts, count_a))
    if not found:
        raise RecordingError("found no motor with both current and duty, expected a recording of a bench; record one")
    return Currents(Rows(found))


def sense_moving(motor: str, current: Array, duty: Array, speed: Array, supply: Array) -> CurrentSense:
    """Return whose current the register of a motor that moves tells.

    current: as read [A]. duty: -1..1. speed: of the horn [rad/s]. supply [V]. All of shape (n,), in order of time.
    """
    count = current.size
    if count < _FEWEST:
        return _unknown(
            motor, count, f"{count} samples carry a current worth reading, expected {_FEWEST}; move it more"
        )
    products = _products(current, duty, speed, supply, BLOCKS)
    whole = products.sum(axis=1)
    s, misfit = _best(whole)
    left = [_best(whole - products[:, block])[0] for block in range(BLOCKS)]
    std = math.sqrt((BLOCKS - 1) / BLOCKS * float(np.sum((np.array(left) - np.mean(left)) ** 2)))
    exponent = Estimate.student(s, math.hypot(std, _MODEL_STD), BLOCKS - 1)
    low, high = (float(end) for end in np.quantile(np.abs(duty), (0.05, 0.95)))
    return CurrentSense(motor, *_verdict(exponent, (low, high)), exponent, (low, high), misfit, count)


def sense_standing(motor: str, current: Array, duty: Array, supply: Array, count_a: float) -> CurrentSense:
    """Return whose current the register of a motor that stands under several loads tells.

    current: as read [A], duty, supply [V]: means under each load, (loads,). count_a: unit of the current [A].
    Where nothing moves nothing dithers: what the registers round off stays, up to half a count of each. The interval
    holds every s with which some R and v explain all loads within that, or within twice the least that is left where
    the law itself leaves more.
    """
    pulls = np.abs(current) >= _LEAST_COUNTS * count_a
    current, duty, supply = current[pulls], duty[pulls], supply[pulls]
    loads = current.size
    if loads < _FEWEST_LOADS:
        return _unknown(motor, loads, f"it stood under {loads} loads worth reading, expected {_FEWEST_LOADS}; set more")
    _, misfit = _best(_products(current, duty, np.zeros(loads), supply, 1)[:, 0])
    left = np.array([_left_over(s, current, duty, supply, count_a) for s in _EXPONENTS])
    best = int(np.argmin(left))
    low, high = (float(end) for end in _EXPONENTS[left <= max(1.0, 2.0 * left[best])][[0, -1]])
    exponent = Estimate(float(_EXPONENTS[best]), (high - low) / (2 * NORMAL_90), low, high)
    ends = (float(np.abs(duty).min()), float(np.abs(duty).max()))
    return CurrentSense(motor, *_verdict(exponent, ends), exponent, ends, misfit, loads)


def _left_over(s: float, current: Array, duty: Array, supply: Array, count_a: float) -> float:
    """Return the largest part of a reading that R and v, as well as they can, leave unexplained with an exponent, in
    what the registers may have rounded off."""
    weight = np.abs(duty) ** s
    columns = weight[:, None] * np.stack([duty * supply, np.sign(duty)], axis=1)
    (slope, drop), *_ = np.linalg.lstsq(columns, current, rcond=None)
    by_duty = np.abs(weight * ((1 + s) * slope * supply + s * drop / np.abs(duty)))
    rounded = 0.5 * (count_a + by_duty / FULL_DUTY_COUNTS)
    sides = np.vstack([np.column_stack([columns, -rounded]), np.column_stack([-columns, -rounded])])
    free = [(None, None), (None, None), (0.0, None)]
    found = scipy.optimize.linprog([0.0, 0.0, 1.0], sides, np.concatenate([current, -current]), bounds=free)
    return math.inf if found.x is None else float(found.x[2])


def _unknown(motor: str, count: int, why: str) -> CurrentSense:
    nothing = Estimate(math.nan, math.nan, math.nan, math.nan)
    return CurrentSense(motor, "undetermined", why, nothing, (math.nan, math.nan), math.nan, count)


def _verdict(exponent: Estimate, duty: tuple[float, float]) -> tuple[Whose, str]:
    low, high = exponent.low, exponent.high
    ends = f"the exponent of the duty is {span(low, high)}"
    if low > -NEAR and high < NEAR:
        return "motor", f"{ends}: the reading stays where the duty changes at the same torque"
    if low > 1 - NEAR and high < 1 + NEAR:
        return "supply", f"{ends}: the reading goes with the duty at the same torque"
    if high - low >= 1:
        duties = f"{number(duty[0], 2)} to {number(duty[1], 2)}"
        return "undetermined", f"{ends}; duties of {duties} do not part the two, load the motor more differently"
    return "undetermined", f"{ends}, which is neither 0, the motor's, nor 1, the supply's"


def _products(current: Array, duty: Array, speed: Array, supply: Array, blocks: int) -> Array:
    """Return the products of the columns of the law and the reading, summed over each block, for every exponent.

    Shape (exponent, block, 4, 4); the last row and column are the reading's.
    """
    columns = np.stack([duty * supply, speed, np.sign(duty)], axis=1)
    columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    rows = np.concatenate([columns, current[:, None]], axis=1)
    weights = np.abs(duty)[:, None] ** _EXPONENTS
    found = np.empty((_EXPONENTS.size, blocks, 4, 4))
    for block, mine in enumerate(np.array_split(np.arange(current.size), blocks)):
        for index, weight in enumerate(weights[mine].T):
            weighed = rows[mine] * np.stack([weight] * 3 + [np.ones_like(weight)], axis=1)
            found[index, block] = weighed.T @ weighed
    return found


def _best(products: Array) -> tuple[float, float]:
    """Return (exponent s of the best fit, root mean square of what it leaves over that of the readings).

    products: of all samples that are used, for every exponent, (exponent, 4, 4).
    """
    design, mixed, square = products[:, :3, :3], products[:, :3, 3], products[0, 3, 3]
    explained = np.einsum("si,sij,sj->s", mixed, np.linalg.pinv(design, rcond=1e-10, hermitian=True), mixed)
    left = np.maximum(square - explained, 0.0)
    best = int(np.argmin(left))
    s = float(_EXPONENTS[best])
    if 0 < best < left.size - 1:  # the parabola through the three lowest
        before, here, after = left[best - 1 : best + 2]
        s += 0.5 * (before - after) / max(before - 2 * here + after, 1e-300) * float(_EXPONENTS[1] - _EXPONENTS[0])
    return s, math.sqrt(float(left[best]) / square)


def _speed(time: Array, angle: Array, slices: list[slice]) -> tuple[Array, Mask]:
    """Return the speed [rad/s] at every sample, and where it is known: by four neighbours at even steps.

    (θ₋₂ - 8 θ₋₁ + 8 θ₊₁ - θ₊₂)/12T, which errs by (ωT)⁴/30, at 12 Hz and 200 Hz 0.07 %.
    """
    speed, known = np.zeros_like(time), np.zeros(time.size, dtype=bool)
    for where in slices:
        if where.stop - where.start < 5:
            continue
        t, a = time[where], angle[where]
        step = (t[4:] - t[:-4]) / 4
        middle = slice(where.start + 2, where.stop - 2)
        speed[middle] = (a[:-4] - 8 * a[1:-3] + 8 * a[3:-1] - a[4:]) / (12 * step)
        known[middle] = np.abs(step / np.median(np.diff(t)) - 1) < 0.2
    return speed, known
