"""Power from duty, current and voltage of the servos: the drive's, and what holding costs."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sinew.analysis.signal.harmonics import HARMONICS, multiples
from sinew.analysis.signal.signals import Signals
from sinew.measure.arrays import Array
from sinew.measure.estimate import NORMAL_90
from sinew.plan.servo import SERVOS, VOLTAGE_LSB

if TYPE_CHECKING:
    from sinew.plan.rig import RigSpec

# A periodic signal gets its mean over a cycle, from samples that hold no whole number of cycles.


_NYQUIST_SHARE = 0.45


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
    count = int(min(HARMONICS, _NYQUIST_SHARE * rate / float(frequency_hz.max())))
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


def idle_power(rig: "RigSpec") -> float:
    """Return what all servos draw with their torque off [W], by data sheet: no register tells it.

    Standby current times supply voltage, of the tendons' servos and the drive's.
    """
    models = [rig.wiring.tendon_model] * rig.tendons.count + [rig.wiring.drive_model]
    return sum(SERVOS[model].standby_current for model in models) * rig.drive.supply_voltage.value


def supply_uncertainty(supply_v: NDArray[Any] | None, rig: "RigSpec") -> float:
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


def rest_power(signals: Signals, rig: "RigSpec") -> dict[tuple[float, int], tuple[float, float]]:
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
