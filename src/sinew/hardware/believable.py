"""What can be true of a reading: held against the last one, and against what motor and sensor can do at all.

A whole packet with a right CRC may still be false: a device that answers zeros, an answer under another's id, a motor
that has started anew and counts its turns again. Nobody can tell a false value that might be true; what cannot follow
the last one can be told, and is no reading. The bounds are wide: what a bench ever does lies far inside.
"""

import math
from collections.abc import Mapping

from sinew.hardware.registers import MODES, RegisterTable
from sinew.plan.rig import RigSpec
from sinew.plan.servo import FULL_DUTY_COUNTS, SERVOS

_FASTEST = 3.0  # times the no-load speed at the rig's supply: the gears let nothing turn a horn faster; assumed
_STRONGEST = 2.5  # times the stall current at the rig's supply: reversed at full speed a motor draws twice that
_FULLEST = 1.1  # of the whole duty
_FLICKER = 16  # counts: of an encoder at rest, and of what a horn may give
_LOWEST_SUPPLY, _HIGHEST_SUPPLY = 0.5, 2.5  # of the brown-out, below which none answers; of the nominal voltage
_COLDEST, _HOTTEST = -20.0, 150.0  # °C
_WARMS = (3.0, 200.0)  # °C, and °C/s
_SETTLED = 5  # readings that followed from one another; before that the first of them may be the false one
_BLOW = 5.0  # rad/s: that a hammer gives the head between two samples; assumed
_AHEAD_US = 2000  # µs by which a sample may be dated after the clock of its answer
_WRAP = 1 << 32

GOALS = ("goal_pwm", "goal_current", "goal_velocity", "profile_acceleration", "profile_velocity", "goal_position")
STATE = (
    "operating_mode", "pwm_limit", "current_limit", "velocity_limit", "torque_enable", "bus_watchdog",
    *GOALS, "present_current", "present_position",
)  # fmt: skip
"""The registers that say how a motor runs and where it stands, by address."""

_LIMITS = ("pwm_limit", "current_limit", "velocity_limit")
_MOVING = ("present_current", "present_position")  # of a state, without anybody's doing


def _state_objection(table: RegisterTable, counts: Mapping[str, int]) -> str:
    """Return why the registers of `STATE` cannot be those of a motor; empty where they can."""
    if counts["operating_mode"] not in MODES:
        return f"there is no operating_mode {counts['operating_mode']}"
    for name in (*_LIMITS, "torque_enable", *GOALS):
        row = table[name]
        if not row.lowest <= counts[name] <= row.highest:
            return f"{name} is {counts[name]}, expected {row.lowest} to {row.highest}"
    return "" if any(counts[name] for name in _LIMITS) else "all its limits are zero"


def contradiction(table: RegisterTable, before: Mapping[str, int], again: Mapping[str, int], passed_s: float) -> str:
    """Return why two answers about `STATE`, one a time [s] after the other, are not both true; empty where they may be.

    They must be a motor's, what it does not change by itself the same, and the horn where it can have come to.
    """
    if why := _state_objection(table, again):
        return why
    for name in STATE:
        if name not in _MOVING and before[name] != again[name]:
            return f"{name} is {before[name]} and then {again[name]}"
    moved = abs(again["present_position"] - before["present_position"])
    if moved > _FASTEST * SERVOS[table.model].no_load_speed / table["present_position"].scale * passed_s + _FLICKER:
        return f"present_position is {before['present_position']} and {1e3 * passed_s:.0f} ms later {moved} off"
    return ""


class MotorBounds:
    """What one motor may tell, in counts of its registers.

    Until five readings have followed from one another, one that does not becomes the new first: a false one at the
    start then costs two readings and not all.
    """

    def __init__(self, table: RegisterTable, spec: RigSpec) -> None:
        servo = SERVOS[table.model]
        share = servo.supply_share(spec.drive.supply_voltage.value)
        fastest = _FASTEST * servo.no_load_speed * share
        self._turn = 360.0 * table["present_position"].scale / math.tau  # degrees of a count
        self._travel = fastest / table["present_position"].scale  # counts/s
        self._speed = fastest / table["present_velocity"].scale
        self._ampere = table["present_current"].scale
        self._current = _STRONGEST * servo.stall_current * share / self._ampere
        self._duty = _FULLEST * FULL_DUTY_COUNTS
        self._volts = _LOWEST_SUPPLY * servo.brown_out, _HIGHEST_SUPPLY * servo.nominal_voltage
        self.forget()

    def forget(self) -> None:
        """Begin anew: the next position may be any."""
        self._position, self._time, self._followed = 0, math.nan, 0
        self._warmth, self._warm_at = 0.0, math.nan

    def begin(self, position: int, time: float) -> None:
        """Hold the next position against one that was seen twice, at a host time [s]."""
        self.forget()
        self._position, self._time, self._followed = position, time, _SETTLED

    def objection(self, duty: int, current: int, speed: int, position: int, time: float) -> str:
        """Return why counts of the present registers at a host time [s] cannot be true; empty where they can."""
        if abs(duty) > self._duty:
            return f"its duty is {100 * duty / FULL_DUTY_COUNTS:.0f} % of the supply"
        if abs(current) > self._current:
            return f"its current is {current * self._ampere:.3g} A, more than it can draw"
        if abs(speed) > self._speed:
            return "it turns faster than its gears allow"
        passed = time - self._time
        moved = abs(position - self._position)
        if moved > self._travel * passed + _FLICKER:
            if self._followed < _SETTLED:
                self._position, self._time, self._followed = position, time, 0
            return f"its position jumps by {moved * self._turn:.0f}° in {1e3 * passed:.0f} ms"
        self._position, self._time = position, time
        self._followed += 1
        return ""

    def climate_objection(self, voltage: float, temperature: float, time: float) -> str:
        """Return why a supply [V] and a temperature [°C] at a host time [s] cannot be true; empty where they can."""
        low, high = self._volts
        if not low <= voltage <= high:
            return f"it tells a supply of {voltage:.1f} V, with which none answers"
        step, rate = _WARMS
        jumps = abs(temperature - self._warmth) > step + rate * (time - self._warm_at)
        if jumps or not _COLDEST <= temperature <= _HOTTEST:
            return f"it tells {temperature:.0f} °C"
        self._warmth, self._warm_at = temperature, time
        return ""


class SensorBounds:
    """What the head's sensor may tell: rates [rad/s], accelerations in counts, and its own time of the sample [µs].

    Its rate changes by what twice the drive's stall torque gives the bare head, and by a blow.
    """

    def __init__(self, spec: RigSpec) -> None:
        drive = spec.drive
        torque = drive.stall_torque.value * drive.supply_voltage.value / drive.nominal_voltage.value
        self._quickest = 2.0 * torque / spec.inertia.head.value  # rad/s²
        self.forget()

    def forget(self) -> None:
        """Begin anew: the next sample may be any."""
        self._counter: int | None = None
        self._rates = (0.0, 0.0, 0.0)
        self._followed = 0

    def objection(
        self, rates: tuple[float, float, float], forces: tuple[int, int, int], counter: int, clock: int
    ) -> str:
        """Return why a sample cannot be true; empty where it can. clock: of the board as it answered [µs]."""
        if forces == (0, 0, 0) and (counter or self._counter):  # a board that has no sample yet tells nothing but zeros
            return "it tells no acceleration at all, as in free fall"
        if self._counter is not None:
            since = (counter - self._counter) % _WRAP
            if since > (clock - self._counter) % _WRAP + _AHEAD_US:
                return self._not_after("its sample is dated before the last one, or after its answer", counter, rates)
            allowed = _BLOW + self._quickest * 1e-6 * since if since else 0.0
            if any(abs(now - before) > allowed for now, before in zip(rates, self._rates, strict=True)):
                what = "its rates jump" if since else "two different samples have one time"
                return self._not_after(what, counter, rates)
        elif (clock - counter + _AHEAD_US) % _WRAP > _WRAP >> 1:
            return "its sample is dated after its answer"
        self._counter, self._rates = counter, rates
        self._followed += 1
        return ""

    def _not_after(self, why: str, counter: int, rates: tuple[float, float, float]) -> str:
        if self._followed < _SETTLED:
            self._counter, self._rates, self._followed = counter, rates, 0
        return why
