"""The guard: every cycle's readings against the limits of the rig."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sinew.bench.tilt import lean_from
from sinew.hardware.rig import MotorReading, Reading
from sinew.measure.attitude import gyro_share
from sinew.measure.errors import LimitError, LostError
from sinew.plan.rig import LoadCell, RigSpec

LOST_AFTER_S = 0.05
"""A device that has given no fresh reading for so long is lost [s], if it was asked often enough meanwhile."""

_ADVICE = {
    "damaged": "noise, or two devices at once: check ground, shield and termination of the cable, then `sinew doctor`",
    "stale": "check the adapter's latency timer and what else hangs on its USB port, then `sinew doctor`",
    "impossible": "check supply, cable and its id, then `sinew doctor`",
}
"""What to do where a device does answer, by why its answers do not count."""

_UNANSWERED = 5  # a pause of the computer is no silence of a device

_TORSION_MEMORY_S = 2.0  # the gyro's integral forgets; a swing of 1 Hz and more is kept to within 1 %
_READING_STANDS_S = 0.015  # three cycles
_FOLLOW_MM = 0.75
_FOLLOW_S = 0.3
_HEATING_S = 0.1  # a motor that is reversed at speed draws up to twice its stall current for some milliseconds
_SHARE_TOLERANCE = 0.35
_SHARE_MEMORY_S = 0.5
_CURRENT_TOLERANCE = 0.15


@dataclass(slots=True)
class Watch:
    """What the guard believes about the present stretch of the run.

    origin: horn angles of the tendon motors from which their travel counts [rad].
    goals: what they were set to: angles [rad] or, if `by_current`, currents [A]. limit: output limit of each [A]; none
    where empty. pose: tilt about y and z of frame B that is asked for [rad], from which limits.tilt_deg counts.
    resting: whether goals have stood still long enough that the motors must have followed.
    share: each tendon's part of the sum of currents when the pretension was set; None before.
    """

    origin: tuple[float, ...]
    goals: tuple[float, ...]
    by_current: bool = False
    limit: tuple[float, ...] = ()
    pose: tuple[float, float] = (0.0, 0.0)
    resting: bool = False
    share: tuple[float, ...] | None = None


class Guard:
    """Holds readings against the rig's limits.

    Raises LimitError or LostError with one sentence; the caller brings the rig to its safe state.
    imu_patience: how long the IMU may give nothing new [s]; who can do without it for a while may make it longer.
    """

    def __init__(self, spec: RigSpec, gyro_bias: float = 0.0) -> None:
        self._limits, self._sensors = spec.limits, [sensor.model for sensor in spec.sensors]
        self._cells = [f"tendon {s.tendon}" if isinstance(s, LoadCell) else "" for s in spec.sensors]
        self._radius = spec.tendons.pulley_radius.value
        self._force = spec.tendons.tension(1.0)  # N/A
        self._give = 1 / (spec.tendons.servo_stiffness.value * self._radius)  # rad/N
        self._lsb = spec.tendons.current_lsb.value
        self._seen: dict[str, float] = {}
        self._vain: dict[str, int] = {}
        self._counter: int | None = None
        self._astray: list[float] = []
        self._means: list[float] = []
        self._last = math.nan
        self.gyro_bias = gyro_bias
        self.imu_patience = LOST_AFTER_S
        self.torsion = 0.0
        self._unread = 0.0
        self._square = 0.0

    def check(self, reading: Reading, tilt: tuple[float, float], now: float, watch: Watch) -> None:
        """Check one cycle. tilt: of the head plate about y and z of frame H [rad], NaN where unknown. now: host time of
        the cycle [s]."""
        step = 0.0 if math.isnan(self._last) else max(0.0, now - self._last)
        self._last = now
        is_fresh = self._check_presence(reading, now)
        if reading.drive is not None:
            self._check_drive(reading.drive, step)
        for index, motor in enumerate(reading.tendons):
            if motor is not None:
                self._check_tendon(index, motor, watch)
        for name, newtons in zip(self._cells, reading.sensors, strict=True):
            if name and not math.isnan(newtons):
                _below(f"tension of {name}, by its load cell,", newtons, self._limits.tension_n, "N", "tension_n")
        self._check_following(reading.tendons, step, watch)
        self._check_shares(reading.tendons, step, watch)
        rate = reading.imu.gyro[0] if is_fresh and reading.imu is not None else None
        self._check_head(rate, tilt, step, watch.pose)
        self._check_climate(reading)

    def forget(self, now: float) -> None:
        """Start anew at a time [s], after a stretch in which nobody asked the devices."""
        self._seen, self._vain = dict.fromkeys(self._seen, now), {}
        self._last = now
        self._astray, self._means = [], []

    def _check_presence(self, reading: Reading, now: float) -> bool:
        """Raise if a device is lost; return whether the IMU brought a new sample."""
        present = {f"tendon {i + 1}": motor is not None for i, motor in enumerate(reading.tendons)}
        present["drive"] = reading.drive is not None
        present |= {
            name: not math.isnan(read_back) for name, read_back in zip(self._sensors, reading.sensors, strict=True)
        }
        fresh = reading.imu is not None and reading.imu.counter != self._counter
        self._counter = reading.imu.counter if reading.imu is not None else self._counter
        present["IMU"] = fresh
        gone: dict[str, float] = {}
        for name, here in present.items():
            if here:
                self._seen[name], self._vain[name] = now, 0
                continue
            self._vain[name] = self._vain.get(name, 0) + 1
            since = now - self._seen.setdefault(name, now)
            patience = self.imu_patience if name == "IMU" else LOST_AFTER_S
            if since > patience and self._vain[name] > _UNANSWERED:
                gone[name] = since
        if gone:
            self._say_who_is_gone(gone, reading)
        return fresh

    def _say_who_is_gone(self, gone: dict[str, float], reading: Reading) -> None:
        """Raise, naming the devices that gave nothing for so long [s], and why in the newest reading."""
        names, longest = list(gone), 1e3 * max(gone.values())
        if names == ["IMU"] and reading.imu is not None:
            raise LostError(
                f"IMU repeats one sample for {longest:.0f} ms, expected a fresh one every cycle; restart its board"
            )
        whys = {lack.why: lack.words for lack in reading.lacks if lack.name in gone}
        if len(whys) == 1 and (why := next(iter(whys))) in _ADVICE:
            who = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
            raise LostError(f"{who}: no reading that counts for {longest:.0f} ms, {whys[why]}; {_ADVICE[why]}")
        if len(names) == len(reading.tendons) + len(self._sensors) + 2:
            raise LostError(
                f"all devices at once have not answered for {longest:.0f} ms: their supply failed or dipped, or the "
                "line is cut behind the adapter; check both, then `sinew doctor`"
            )
        who = f"{names[0]} has" if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]} have"
        raise LostError(
            f"{who} not answered for {longest:.0f} ms, expected a fresh reading every cycle; "
            "check cables and supply, then `sinew doctor`"
        )

    def _check_drive(self, motor: MotorReading, step: float) -> None:
        self._check_alert("drive", motor)
        limits = self._limits
        weight = 1 - math.exp(-step / _HEATING_S)
        self._square += weight * (motor.current**2 - self._square)
        current = math.sqrt(self._square)
        _below("current of the drive, root mean square,", current, limits.drive_current_a, "A", "drive_current_a")
        _below("angle of the drive", abs(math.degrees(motor.angle)), limits.drive_window_deg, "°", "drive_window_deg")

    def _check_tendon(self, index: int, motor: MotorReading, watch: Watch) -> None:
        name = f"tendon {index + 1}"
        self._check_alert(name, motor)
        limits = self._limits
        _below(f"current of {name}", abs(motor.current), limits.tendon_current_a, "A", "tendon_current_a")
        _below(f"tension of {name}", motor.current * self._force, limits.tension_n, "N", "tension_n")
        travel = 1e3 * (motor.angle - watch.origin[index]) * self._radius
        low, high = limits.tendon_travel_mm
        if not low <= travel <= high:
            raise LimitError(
                f"{name} has travelled {travel:.1f} mm, expected {low:g} to {high:g} (tendon_travel_mm); "
                "is the cable off its pulley, or much slacker than the others, or wiring.tendon_pull of the wrong sign?"
            )

    @staticmethod
    def _check_alert(name: str, motor: MotorReading) -> None:
        if motor.alert:
            raise LostError(
                f"{name} raises its alert: overload, overheating, voltage or encoder; "
                "`sinew doctor` names it, a reboot of the motor clears it"
            )

    def _check_following(self, motors: Sequence[MotorReading | None], step: float, watch: Watch) -> None:
        """Raise if a tendon motor at rest stands elsewhere than it was told, longer than a moment."""
        self._astray = self._astray or [0.0] * len(motors)
        for index, motor in enumerate(motors):
            if motor is None or not watch.resting:
                self._astray[index] = 0.0
                continue
            if watch.by_current:
                off = abs(motor.current - watch.goals[index])
                astray = off > max(3 * self._lsb, _CURRENT_TOLERANCE * watch.goals[index])
                found = f"pulls with {1e3 * motor.current:.0f} mA, expected {1e3 * watch.goals[index]:.0f}"
            else:
                expected = watch.goals[index] - motor.current * self._force * self._give
                off = 1e3 * abs(motor.angle - expected) * self._radius
                astray = off > _FOLLOW_MM and (not watch.limit or abs(motor.current) < 0.9 * watch.limit[index])
                found = f"stands {off:.1f} mm from where it was told to be"
            self._astray[index] = self._astray[index] + step if astray else 0.0
            if self._astray[index] > _FOLLOW_S:
                raise LostError(f"tendon {index + 1} {found}; is it stuck, or has its watchdog stopped it?")

    def _check_shares(self, motors: Sequence[MotorReading | None], step: float, watch: Watch) -> None:
        """Raise if one tendon's part of the whole tension has changed since the pretension was set: a slip."""
        if watch.share is None:
            self._means = []  # of the pretension before; in a pose its parts are others
            return
        if any(motor is None for motor in motors):
            return
        currents = [motor.current for motor in motors if motor is not None]
        if not self._means:
            self._means = currents
        weight = 1 - math.exp(-step / _SHARE_MEMORY_S)
        self._means = [old + weight * (new - old) for old, new in zip(self._means, currents, strict=True)]
        whole = sum(self._means)
        if whole < 3 * self._lsb * len(motors):
            return
        for index, (mean, share) in enumerate(zip(self._means, watch.share, strict=True)):
            moved = mean / whole - share
            if abs(moved) > max(_SHARE_TOLERANCE / len(motors), 2 * self._lsb / whole):
                raise LostError(
                    f"tendon {index + 1} carries {100 * mean / whole:.0f} % of the tension, {100 * share:.0f} % when "
                    "the pretension was set; has a cable slipped or caught?"
                )

    def _check_head(
        self, rate: float | None, tilt: tuple[float, float], step: float, pose: tuple[float, float]
    ) -> None:
        """Check torsion and tilt. rate: a new one of the gyroscope about x [rad/s], which counts for the cycles
        without, too; on a bent head it reads less than the torsion's. pose: the tilt that is asked for."""
        self._unread = min(self._unread + step, _READING_STANDS_S)
        if rate is not None:
            self.torsion += (rate - self.gyro_bias) / gyro_share(math.hypot(*pose)) * self._unread
            self._unread = 0.0
        self.torsion *= math.exp(-step / _TORSION_MEMORY_S)
        limits = self._limits
        _below("torsion of the head", abs(math.degrees(self.torsion)), limits.torsion_deg, "°", "torsion_deg")
        lean = math.degrees(lean_from(tilt, self.torsion, pose))
        what = "tilt of the head plate" if pose == (0.0, 0.0) else "tilt of the head plate from its pose"
        if not math.isnan(lean):
            _below(what, lean, limits.tilt_deg, "°", "tilt_deg")

    def _check_climate(self, reading: Reading) -> None:
        climate = reading.climate
        if climate is None:
            return
        _below(f"temperature of {climate.name}", climate.temperature, self._limits.temperature_c, "°C", "temperature_c")
        low, high = self._limits.voltage_v
        if not low <= climate.voltage <= high:
            raise LimitError(
                f"supply at {climate.name} is {climate.voltage:.1f} V, expected {low:g} to {high:g} (voltage_v); "
                "check the power supply"
            )


def _below(what: str, value: float, limit: float, unit: str, key: str) -> None:
    if value > limit:
        raise LimitError(f"{what} is {value:.3g} {unit}, the rig allows {limit:g} ({key})")
