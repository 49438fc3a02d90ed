"""What a servo's current register tells: the motor's current, or that of its supply."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy
import xarray as xr

from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, Estimate, finite, number, pair, span
from sinew.measure.recording import segment_slices
from sinew.measure.told import Table
from sinew.plan.servo import FULL_DUTY_COUNTS

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


@dataclass(frozen=True)
class CurrentSense:
    """Whose current a motor's register tells.

    motor: its name. exponent: s, 0 for the motor's current, 1 for the supply's. duty: from the smallest to the largest;
    of a motor that moves 5 % of the samples are left out on either side. samples: of one that stands, loads.
    misfit: root mean square of what is left over that of the readings.
    whose: the verdict. why: its reason.
    """

    motor: str
    exponent: Estimate
    duty: tuple[float, float]
    misfit: float
    samples: int
    whose: Whose
    why: str

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        return {
            "motor": self.motor,
            "whose": self.whose,
            "why": self.why,
            "exponent": self.exponent.to_json(),
            "duty": [finite(end) for end in self.duty],
            "misfit": finite(self.misfit),
            "samples": self.samples,
        }


def sense_currents(recording: xr.Dataset, count_a: float) -> list[CurrentSense]:
    """Return whose current each motor's register tells, the drive first, then the tendons in order.

    count_a: unit of the registers [A]. The speeds come from the encoders. Raises RecordingError where the recording
    has no duty or no current of any motor.
    """
    slices = segment_slices(recording)
    time = np.asarray(recording["time_s"].values, dtype=float)
    supply = recording["supply_v"].values.astype(float) if "supply_v" in recording else np.ones(time.size)
    kinds = recording["kind"].values
    resting = [where for where, kind in zip(slices, kinds, strict=True) if kind == "idle"]
    found = []
    for motor, columns in _motors(recording):
        current, duty, angle = (column.astype(float) for column in columns)
        speed, inside = _speed(time, angle, slices)
        if motor == "drive":
            rows = np.stack([current, duty, speed, supply])[:, inside]
            used = (np.abs(rows[0]) >= _LEAST_COUNTS * count_a) & (rows[1] != 0)
            found.append(sense_moving(motor, *rows[:, used]))
        else:
            amps, share, volts = (
                np.array([column[where].mean() for where in resting]) for column in (current, duty, supply)
            )
            found.append(sense_standing(motor, amps, share, volts, count_a))
    if not found:
        raise RecordingError("found no motor with both current and duty, expected a recording of a bench; record one")
    return found


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
    whose, why = _verdict(exponent, (low, high))
    return CurrentSense(motor, exponent, (low, high), misfit, count, whose, why)


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
    whose, why = _verdict(exponent, ends)
    return CurrentSense(motor, exponent, ends, misfit, loads, whose, why)


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
    return CurrentSense(motor, nothing, (math.nan, math.nan), math.nan, count, "undetermined", why)


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
        for place, weight in enumerate(weights[mine].T):
            weighed = rows[mine] * np.stack([weight] * 3 + [np.ones_like(weight)], axis=1)
            found[place, block] = weighed.T @ weighed
    return found


def _best(products: Array) -> tuple[float, float]:
    """Return (exponent s of the best fit, root mean square of what it leaves over that of the readings).

    products: of all samples that are used, for every exponent, (exponent, 4, 4).
    """
    design, mixed, square = products[:, :3, :3], products[:, :3, 3], products[0, 3, 3]
    explained = np.einsum("si,sij,sj->s", mixed, np.linalg.pinv(design, rcond=1e-10, hermitian=True), mixed)
    left = np.maximum(square - explained, 0.0)
    place = int(np.argmin(left))
    s = float(_EXPONENTS[place])
    if 0 < place < left.size - 1:  # the parabola through the three lowest
        before, here, after = left[place - 1 : place + 2]
        s += 0.5 * (before - after) / max(before - 2 * here + after, 1e-300) * float(_EXPONENTS[1] - _EXPONENTS[0])
    return s, math.sqrt(float(left[place]) / square)


def _motors(recording: xr.Dataset) -> list[tuple[str, tuple[Array, Array, Array]]]:
    """Return (name, (current, duty, angle)) of every motor of which all three were recorded."""
    found = []
    names = ("drive_current_a", "drive_pwm", "drive_rad")
    if all(name in recording for name in names):
        current, duty, angle = (recording[name].values for name in names)
        found.append(("drive", (current, duty, angle)))
    names = ("tendon_current_a", "tendon_pwm", "tendon_rad")
    if all(name in recording for name in names):
        for i in range(recording.sizes["tendon"]):
            current, duty, angle = (recording[name].values[:, i] for name in names)
            found.append((f"tendon {i + 1}", (current, duty, angle)))
    return found


def _speed(time: Array, angle: Array, slices: list[slice]) -> tuple[Array, Array]:
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


def currents_told(found: list[CurrentSense]) -> list[Table | str]:
    """Return the verdicts as a table and, of each motor, its reason."""
    rows = [
        (
            one.motor,
            one.whose,
            pair(finite(one.exponent.value), finite(one.exponent.std)),
            span(one.exponent.low, one.exponent.high) if math.isfinite(one.exponent.low) else "-",
            f"{number(finite(one.duty[0]), 2)} to {number(finite(one.duty[1]), 2)}",
            str(one.samples),
        )
        for one in found
    ]
    head = ("motor", "current is of", "exponent of the duty", "90 %", "duty", "samples")
    title = "whose current the register tells: exponent 0, the motor's; 1, the supply's"
    return [Table(head, rows, title), *(f"{one.motor}: {one.why}" for one in found)]
