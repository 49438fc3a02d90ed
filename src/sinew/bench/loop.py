"""The bench's cycle: wait, read all devices, record, guard, and half a cycle later give the motors their goals."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sinew.bench.guard import Guard, Watch
from sinew.bench.record.sample import MISSING, Sample
from sinew.bench.tilt import TiltEstimator
from sinew.hardware.bus import Clock
from sinew.hardware.imu import ImuReading
from sinew.hardware.registers import WATCHDOG_TRIPPED
from sinew.hardware.rig import Reading, Rig
from sinew.measure.errors import LostError, PauseError, StoppedError
from sinew.plan.rig import Limits

WATCHDOG_S = 0.08
"""After so long without any instruction on the bus the motors stop themselves [s]: four units of their register."""

_OTHERS_MOST = 2  # instructions of another program; what noise makes of our own hardly passes a checksum even once
_STANDS_STILL_S = 0.012  # two samples of the IMU are due in that time
_MISSED_WINDOW = 200
MISSED_MOST = 0.25
"""Share of cycles that may begin too late before a run ends. A reading that lacks an answer makes the next cycle late:
where more than this share of readings is incomplete, `sinew doctor` reports a fault."""

Drive = Callable[[float], float]
Pull = Callable[[float], Sequence[float]]
"""How much further than its goal each tendon motor is to turn [rad], at a host time [s]."""


def at_zero(_: float) -> float:
    """Return the lever's angle while it rests: zero."""
    return 0.0


@dataclass(slots=True)
class LoopStatistics:
    """cycles: run. missed: deadlines that passed before a cycle could begin. incomplete: cycles with a missing answer.
    stale, impossible: answers left out because they were of an earlier time, or could not be true.
    worst_late_s: the latest begin of a cycle after its deadline. busy_s: sum of the times a cycle took, without its
    wait for the middle."""

    cycles: int = 0
    missed: int = 0
    incomplete: int = 0
    stale: int = 0
    impossible: int = 0
    worst_late_s: float = 0.0
    busy_s: float = 0.0


class Loop:
    """Runs cycles at a fixed rate.

    rig, clock: the seams. guard: raises where a limit is passed. record: takes every sample. period: of a cycle [s].
    check: raises StoppedError, before a cycle, where the run is to end.
    lever: where the lever rests [rad], its middle if not set otherwise.
    paused: whether the computer paused for as long as the motors' watchdogs wait, since deadlines were counted anew.
    Goals go out half a cycle after the devices are read, so that a reading comes in the middle of the time for which
    the motors keep a goal. A position loop sees a staircase of goals: just after a step its duty and current are those
    of a command half a cycle later, just before it of one half a cycle earlier, and which of the two is read would
    depend on some tenths of a millisecond. In the middle they are those of the command. The goal is the command at
    that time: the staircase has the command's phase.
    """

    def __init__(
        self,
        rig: Rig,
        clock: Clock,
        guard: Guard,
        tilt: TiltEstimator,
        period: float,
        record: Callable[[Sample], None],
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self._rig, self._clock, self._guard, self._tilt = rig, clock, guard, tilt
        self.period = period
        self._record, self._check = record, check
        rig.pace(period)
        self._stamp_delay = rig.spec.bus.drive_delay.value
        self._average = rig.spec.imu.average_samples
        self._counter: int | None = None
        self._mixed = 0
        self._is_mixed = False
        self.late_s, self.paused = 0.0, False
        self._volts: dict[str, float] = {}
        self._goals_sent: tuple[float, ...] | None = None
        self._due = self._stepped = math.nan
        self._late: deque[bool] = deque(maxlen=_MISSED_WINDOW)
        self._after_hole = False
        self._waited: deque[bool] = deque(maxlen=_MISSED_WINDOW)
        self.statistics = LoopStatistics()
        self.watch = Watch((0.0,) * len(rig.tendons), (0.0,) * len(rig.tendons))
        self.last: Reading | None = None
        self._others = rig.bus.others
        self.lever: Drive = at_zero

    @property
    def limits(self) -> Limits:
        """The rig's limits."""
        return self._rig.spec.limits

    @property
    def pulley_radius(self) -> float:
        """The pulleys' radius on the tendon motors [m]."""
        return self._rig.spec.tendons.pulley_radius.value

    def tension(self, current: float) -> float:
        """Return the tension [N] that a tendon's motor holds with a current [A]."""
        return self._rig.spec.tendons.tension(current)

    @property
    def due(self) -> float:
        """When the next cycle begins [s, host time]."""
        if math.isnan(self._due):
            self.restart()
        return self._due

    def restart(self) -> None:
        """Begin to count deadlines anew, after a stretch without cycles."""
        self._due, self.paused, self._goals_sent = self._clock.now(), False, None
        self._guard.forget(self._due)

    def begin_steps(self) -> None:
        """Begin a stretch of steps that have no cycle."""
        self._stepped = self._clock.now()

    def step(self) -> None:
        """Look, between two such steps, whether the run is to end, and whether the computer paused in the last one."""
        self._check()
        if (took := self._clock.now() - self._stepped) > WATCHDOG_S:
            self.refuse_stopped(took)
        self._stepped = self._clock.now()

    def set_goals(
        self, goals: Sequence[float], *, resting: bool = False, pose: tuple[float, float] | None = None
    ) -> None:
        """Tell the tendon motors something else from the next cycle on: angles [rad] or currents [A], by their mode.

        pose: the tilt that belongs to it, about y and z of frame B [rad]; None: the same as before.
        """
        pose = self.watch.pose if pose is None else pose
        self.watch = replace(self.watch, goals=tuple(goals), resting=resting, pose=pose)

    def cycle(self, drive: Drive | None = None, pull: Pull | None = None) -> Sample:
        """Run one cycle and return its sample. drive: commanded lever angle [rad] at a host time [s]; None: where
        it rests. pull: moves the
        tendon motors about their goals, where they hold positions.

        Raises StoppedError, LimitError or LostError, and PortError where the port is gone.
        """
        self._check()
        drive = drive or self.lever
        began = self._wait()
        reading = self._rig.read()
        self.last = reading
        sample = self._sample(reading, drive, self._goals_sent or self.watch.goals)
        statistics = self.statistics
        statistics.cycles += 1
        self._after_hole = bool(reading.faults)
        statistics.incomplete += self._after_hole
        if reading.lacks:
            statistics.stale += len(reading.stale)
            statistics.impossible += len(reading.impossible)
        self._record(sample)
        tilt = (MISSING, MISSING) if math.isnan(sample.tilt_rad) else self._tilt.components
        watch = self.watch if pull is None else replace(self.watch, resting=False)
        self._guard.check(reading, tilt, began, watch)
        if reading.altered:
            self.read_registers("the run set it")
            raise LostError(f"{reading.altered}, which this program has not told it; end the other software")
        if (others := self._rig.bus.others - self._others) >= _OTHERS_MOST:
            raise LostError(
                f"{others} instructions of another program came on the line, expected none: two programs would move "
                "the motors in turn; end the other one, or unplug its adapter"
            )
        statistics.busy_s += self._clock.now() - began
        self._clock.wait_until(began + 0.5 * self.period)
        self._write_goals(drive, pull)
        return sample

    def _write_goals(self, drive: Drive, pull: Pull | None) -> None:
        """Send the motors what they are to keep for a cycle from now on."""
        began = self._clock.now()
        middle = began + self._rig.goals_s + 0.5 * self.period  # of the time for which they keep it
        goals = self.watch.goals
        if pull is not None:
            goals = tuple([goal + more for goal, more in zip(goals, pull(middle), strict=True)])
        self._rig.write_goals(drive(middle), goals)
        self._goals_sent = goals
        self.statistics.busy_s += self._clock.now() - began

    def run(self, duration: float, drive: Drive | None = None) -> list[Sample]:
        """Run cycles for a time [s] and return their samples."""
        return [self.cycle(drive) for _ in range(max(1, round(duration / self.period)))]

    def _wait(self) -> float:
        """Wait for the next deadline; return when the cycle began [s]."""
        self._clock.wait_until(self.due)
        began = self._clock.now()
        late = began - self._due
        self.statistics.worst_late_s = max(self.statistics.worst_late_s, late)
        skipped = int(late // self.period)
        self._late.append(skipped > 0)
        self._waited.append(skipped > 0 and self._after_hole)
        self.late_s = late
        self.paused |= late > WATCHDOG_S - self.period
        if skipped:
            self.statistics.missed += skipped
            self._check_pace(late)
        self._due += (1 + skipped) * self.period
        return began

    def read_registers(self, since: str) -> dict[str, dict[str, int]]:
        """Return the motors' registers, by name. Raises LostError where one is not as the run set it, PauseError where
        the computer paused for so long that a motor stopped itself. since: what came before."""
        found = self._rig.read_registers()
        stopped = [name for name, counts in found.items() if counts["bus_watchdog"] == WATCHDOG_TRIPPED]
        if stopped:
            kind, advice = (
                (PauseError, "the computer paused") if self.paused else (LostError, "check cables and ground")
            )
            raise kind(
                f"the bus watchdog has stopped {', '.join(stopped)}, which heard nothing for "
                f"{1e3 * WATCHDOG_S:.0f} ms; {advice}"
            )
        if changed := self._rig.changed_registers(found):
            raise LostError(
                f"{'; '.join(changed)}: a motor started anew, or other software wrote to it, since {since}; what was "
                "recorded since does not count; end the other software, or check the supply, then go on"
            )
        return found

    def refuse_stopped(self, paused: float) -> None:
        """Raise PauseError if motors were stopped by their watchdogs while the computer paused for some time [s]."""
        stopped = [motor.name for motor in self._rig.motors if motor.watchdog_tripped()]
        if stopped:
            raise PauseError(
                f"the computer paused for {1e3 * paused:.0f} ms, longer than the bus watchdog allows, and "
                f"{', '.join(stopped)} stopped; end other programs, or lower sample_hz"
            )

    def _check_pace(self, late: float) -> None:
        if late > WATCHDOG_S - self.period:
            self.refuse_stopped(late)
        share = sum(self._late) / len(self._late)
        if len(self._late) < _MISSED_WINDOW or share <= MISSED_MOST:
            return
        if sum(self._waited) > 0.5 * sum(self._late):
            raise LostError(
                f"answers are missing or damaged so often that {100 * share:.0f} % of the last {_MISSED_WINDOW} cycles "
                "began too late; check cables, ground and supply, then `sinew doctor`"
            )
        raise StoppedError(
            f"{100 * share:.0f} % of the last {_MISSED_WINDOW} cycles began too late, expected less than "
            f"{100 * MISSED_MOST:.0f} %; run `sinew doctor` (return delay, latency timer, baud) or lower sample_hz"
        )

    def _sample(self, reading: Reading, drive: Drive, goals: tuple[float, ...]) -> Sample:
        none3 = (MISSING, MISSING, MISSING)
        imu, lever = self._unmixed(reading), reading.drive
        if reading.climate is not None:
            self._volts[reading.climate.name] = reading.climate.voltage
        tilt = self._tilt.update(imu.gyro, imu.acceleration, imu.time) if imu is not None else MISSING
        return Sample(
            time_s=reading.time,
            imu_time_s=imu.time if imu is not None else MISSING,
            drive_command_rad=drive(reading.time + self._stamp_delay),
            drive_rad=lever.angle if lever is not None else MISSING,
            drive_current_a=lever.current if lever is not None else MISSING,
            drive_pwm=lever.duty if lever is not None else MISSING,
            tendon_goal=goals,
            tendon_rad=tuple(motor.angle if motor is not None else MISSING for motor in reading.tendons),
            tendon_current_a=tuple(motor.current if motor is not None else MISSING for motor in reading.tendons),
            gyro_rad_s=imu.gyro if imu is not None else none3,
            acceleration_m_s2=imu.acceleration if imu is not None else none3,
            tilt_rad=tilt,
            late_s=self.late_s,
            imu_counter_s=1e-6 * imu.counter if imu is not None else MISSING,
            tendon_pwm=tuple(motor.duty if motor is not None else MISSING for motor in reading.tendons),
            supply_v=sum(self._volts.values()) / len(self._volts) if self._volts else MISSING,
            sensors=reading.sensors,
            drive_goal_rad=lever.goal if lever is not None else MISSING,
        )

    def _unmixed(self, reading: Reading) -> ImuReading | None:
        """Return the IMU's reading, but not one whose average holds samples from before the sensor stood still."""
        imu = reading.imu
        if imu is None:
            return None
        if imu.counter != self._counter:
            self._counter, self._is_mixed = imu.counter, self._mixed > 0
            self._mixed = max(0, self._mixed - 1)
        if reading.time - imu.time > _STANDS_STILL_S:
            self._mixed = self._average - 1
        return None if self._is_mixed else imu
