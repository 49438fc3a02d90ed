"""One run of a plan on a rig: pull, pretension, groups, and always an end in the declared safe state."""

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field

import numpy as np

from sinew.analysis.doubts import group_doubts
from sinew.bench.group import DriveLaw, Levelled, Mover, SettleRule, pause, run_group, run_tracking
from sinew.bench.guard import LOST_AFTER_S, Guard, Watch
from sinew.bench.loop import WATCHDOG_S, Loop, LoopStatistics, at_zero
from sinew.bench.preflight import refuse_unready
from sinew.bench.pretension import (
    CHANGE_SPEED,
    Contact,
    Held,
    MotorMap,
    pull_to_contact,
    refuse_wrong_drive_sign,
    set_pretension,
)
from sinew.bench.record.conversion import group_is_whole
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import Listener, Sample
from sinew.bench.stops import Steering, StopReport, stop
from sinew.bench.tilt import TiltEstimator
from sinew.hardware.bus import Bus, Clock
from sinew.hardware.configuration import prepare_goal
from sinew.hardware.motor import Motor
from sinew.hardware.rig import Reads, Rig
from sinew.measure import events
from sinew.measure.errors import (
    TROUBLES,
    BenchError,
    FileError,
    HardwareError,
    LostError,
    PauseError,
    SpecError,
    StartError,
    StoppedError,
)
from sinew.measure.recording import Segment
from sinew.measure.schema import SegmentKind
from sinew.plan.plan import Group, Plan
from sinew.plan.rig import LIMIT_RESERVE_N

# It is told once a second how a run fares: cycles, bus, temperatures, progress.

HEALTH_S = 1.0
"""Time between two reports [s]."""


class Progress:
    """How far a run is. state: what it is at, in words. done_s, total_s: of the plan [s]; group, groups: of the plan.

    group counts from 0 and is None before the first. newest_s: time of the newest cycle, by the run's clock [s].
    """

    def __init__(self, groups: int, total_s: float) -> None:
        self.state = "starting"
        self.group: int | None = None
        self.newest_s = 0.0
        self.groups, self.total_s = groups, total_s
        self._before = self._length = 0.0
        self._began: float | None = None

    def begin(self, group: int, before_s: float, length_s: float, now: float) -> None:
        """Note that a group begins, after so much of the plan [s]."""
        self.group, self._before, self._length, self._began = group, before_s, length_s, now

    def end(self) -> None:
        """Note that the group under way is over."""
        self._before, self._began = self._before + self._length, None

    def done_s(self, now: float) -> float:
        """Return how much of the plan is done at a time of the run's clock [s]."""
        under_way = 0.0 if self._began is None else min(self._length, max(0.0, now - self._began))
        return self._before + under_way


class Health:
    """Gathers what is told, from the loop, the bus and the progress of a run."""

    def __init__(self, loop: Loop, bus: Bus, progress: Progress) -> None:
        self._loop, self._bus, self._progress = loop, bus, progress
        self._celsius: dict[str, float] = {}
        self._told = -math.inf

    def take(self, now: float, supply_v: float) -> events.Health | None:
        """Take what the newest cycle told, at a time [s]; return how the run fares when that is due, else None."""
        reading = self._loop.last
        if reading is not None and reading.climate is not None:
            self._celsius[reading.climate.name] = reading.climate.temperature
        self._progress.newest_s = now
        if not now - self._told >= HEALTH_S:
            return None
        self._told = now
        cycles, progress = self._loop.statistics, self._progress
        return events.Health(
            state=progress.state,
            cycles=cycles.cycles,
            missed=cycles.missed,
            incomplete=cycles.incomplete,
            worst_late_ms=round(1e3 * cycles.worst_late_s, 3),
            busy_ms=round(1e3 * cycles.busy_s / max(1, cycles.cycles), 3),
            temperature_c=dict(sorted(self._celsius.items())),
            supply_v=None if math.isnan(supply_v) else round(supply_v, 2),
            bus=asdict(self._bus.statistics),
            done_s=round(progress.done_s(now), 2),
            total_s=round(progress.total_s, 2),
            group=progress.group,
            groups=progress.groups,
        )


# It is noted how a run ended.


@dataclass(slots=True)
class RunReport:
    """How a run ended.

    is_complete: every group of the plan is recorded. sentence: what ended it. stop: how the rig was left.
    groups_done, groups: of the plan, those of earlier attempts included. loop: of the cycles. pretensions: as they came
    out, in order. tracks: the last state of the law of each tracking group of this run, by its index in the plan.
    pauses: what was said of each pause of the computer after which the run went on by itself. is_paused: whether one
    ended it, so that nothing is wrong with the bench and the run can be gone on with at once.
    halted_s: from the request that ended the run until all motors were frozen [s]; None where there was none.
    reads: how a cycle asked all devices in the end; wire_s: how long its bytes were on the wire [s].
    lost_samples: of the sensor, which its board did not read during the run; None where the board does not count them.
    """

    groups: int
    groups_done: int = 0
    is_complete: bool = False
    sentence: str = ""
    stop: StopReport | None = None
    loop: LoopStatistics = field(default_factory=LoopStatistics)
    pretensions: list[events.Pretensioned] = field(default_factory=list)
    tracks: dict[int, events.Track] = field(default_factory=dict)
    pauses: list[str] = field(default_factory=list)
    is_paused: bool = False
    halted_s: float | None = None
    reads: Reads | None = None
    wire_s: float = 0.0
    lost_samples: int | None = None


_ATTEMPTS = 3
_LEVER_HOME_S = 1.5
_BIAS_S = 0.5
_RESTS_SPREAD = math.radians(6.0)
_RESTS_S = 0.5
_RESTS_MOST_S = 10.0
_LOOK_S = 0.02


class Runner:
    """Runs one plan on one rig, once.

    journal: takes every sample, and says which groups are done. tension_n: of each tendon at rest, by pretension [mm],
    as the twin has it. held: the same of a plan with a pose, by tendon and with take-ups. listener: live samples and
    events.
    law: makes what moves the lever in a tracking group, from the group and the time of its begin [s].
    steering: takes what is asked of the run from outside; one of its own, if not given.
    """

    def __init__(
        self,
        rig: Rig,
        clock: Clock,
        plan: Plan,
        journal: Journal,
        tension_n: Mapping[float, float],
        *,
        held: Mapping[float, Held] | None = None,
        listener: Listener | None = None,
        law: Callable[[Group, float], DriveLaw] | None = None,
        steering: Steering | None = None,
    ) -> None:
        self._rig, self._clock, self._plan, self._journal = rig, clock, plan, journal
        if held is None and not plan.rest_pose.is_straight:
            raise SpecError(
                f"plan {plan.name} asks for {plan.rest_pose.words()}, expected what holds it; see `sinew run`"
            )
        count = rig.spec.tendons.count
        upright = {mm: Held.upright(mm, tension, count) for mm, tension in tension_n.items()}
        self._held = upright if held is None else dict(held)
        self._listener = listener
        self._law = law
        self._mover: Mover | None = None
        self._at_mm: float | None = None  # pretension that is set; None: first contact
        self._group: Group | None = None
        self._index = -1
        self._attempt = 0
        self._kept: list[Sample] = []
        self._stepped = 0.0
        self._may_hold = False  # motors that were never under torque are left without
        self._guard = Guard(rig.spec)
        self.steering = steering or Steering(clock.now)
        self._loop = self._new_loop()
        self._tries: Counter[int] = Counter()
        self._checks = 0
        self._groups = plan.groups()
        self.at = Progress(len(self._groups), sum(group.duration_s for group in self._groups))
        self._health = Health(self._loop, rig.bus, self.at)
        self.report = RunReport(len(self._groups))
        self._lost_before: int | None = None

    def _new_loop(self) -> Loop:
        tilt = TiltEstimator(self._rig.spec, self._plan.sample_hz)
        period = 1 / self._plan.sample_hz
        return Loop(self._rig, self._clock, self._guard, tilt, period, self._take, self.steering.check)

    @property
    def motors(self) -> int:
        """How many motors the rig has."""
        return len(self._rig.motors)

    @property
    def group_kind(self) -> str:
        """Kind of the group under way; empty before the first."""
        return self._group.kind if self._group is not None else ""

    def run(self, *, resume: bool = False) -> RunReport:
        """Run what is left of the plan and return how it ended; the rig is in its safe state then.

        resume: the motors may be found as an interrupted run left them; they are released first.
        Raises StartError, with nothing moved, if the bench is not ready, a motor does not take a register that the
        run needs, or the run was to end before it began. What happens later is in the report.
        """
        report = self.report
        refuse_unready(self._rig, self._clock, self._plan, torque_may_be_on=resume)
        self._may_hold = resume
        self.steering.has_begun = True  # before it is looked at: whoever asks later finds motors that may move
        if (halt := self.steering.halt) is not None:
            raise StartError(f"{halt.reason}; nothing has moved")
        self._lost_before = self._lost_samples()
        done = self._journal.finished_groups()
        report.groups_done = len(done)
        try:
            if resume:
                asked = self.steering.emergency_asked
                stop(
                    self._rig, self._clock, "release",
                    lambda first: self._note_frozen(first) if asked() else None, emergency_asked=asked,
                )  # fmt: skip
            if len(done) < report.groups:
                self._await_start()
                self._run_through_pauses()
            report.sentence = f"all {report.groups} groups are recorded"
        except StartError as refusal:  # of a register, before any torque
            report.sentence = str(refusal)
            raise
        except (BenchError, HardwareError, FileError) as trouble:
            report.sentence, report.is_paused = str(trouble), isinstance(trouble, PauseError)
        except KeyboardInterrupt:
            report.sentence = "interrupted"
        except BaseException as fault:
            report.sentence = f"a fault of Sinew's own: {type(fault).__name__}: {fault}"
            raise
        finally:
            report.is_complete = report.groups_done == report.groups
            report.stop = self._stop()
            report.loop = self._loop.statistics
            report.lost_samples = self._lost_since()
            report.reads, report.wire_s = self._rig.reads, self._rig.wire_s()
            self._count(report.loop)
            self._say(events.Ended.of(why=report.sentence, left=report.stop.sentence()))
        return report

    def _lost_samples(self) -> int | None:
        """Return how many samples the sensor's board says to have lost since its start; None where it cannot."""
        try:
            told = self._rig.imu.told()
        except HardwareError:
            return None
        return None if told is None else told.lost_samples

    def _lost_since(self) -> int | None:
        """Return how many samples the board lost in this run; of one that has started anew, since then."""
        before, now = self._lost_before, self._lost_samples()
        if before is None or now is None:
            return None
        return now - before if now >= before else now

    def _stop(self) -> StopReport:
        """Bring the rig to the state that was asked for, or to its declared one."""
        self.at.state = "stopping"
        halt = self.steering.halt
        declared = self._rig.spec.limits.safe_state
        state = (halt.state if halt is not None else None) or declared
        state = state if self._may_hold else "release"
        asked = self.steering.emergency_asked
        report = stop(self._rig, self._clock, state, self._note_frozen, emergency_asked=asked)
        self.steering.note_over(report)
        return report

    def _note_frozen(self, first: StopReport) -> None:
        now = self._clock.now()
        self.steering.note_frozen(first)
        halt = self.steering.halt
        if halt is not None and len(first.frozen) == len(self._rig.motors):
            self.report.halted_s = now - halt.asked_s
            if halt.is_emergency:
                self._say(events.Frozen.of(after_ms=1e3 * self.report.halted_s))

    def _run_through_pauses(self) -> None:
        """Run all groups; after a pause of the computer that let the watchdogs trip, as often as the bench's limits
        allow, bring it to rest and go on from the last whole group."""
        while True:
            try:
                self._run_all(self._journal.finished_groups())
            except PauseError as pause_:
                most = self._rig.spec.limits.most_resumes(is_emulated=self._is_emulated())
                if len(self.report.pauses) >= most:
                    if most == 0:
                        raise
                    raise PauseError(
                        f"{pause_}; the run has gone on {most} times before (resumes_after_pause)"
                    ) from None
                self._stand_after(str(pause_), most)
            else:
                return

    def _is_emulated(self) -> bool:
        """Return whether the bench says that it is emulated; one that does not answer is taken for real."""
        try:
            return self._rig.imu.is_emulated()
        except HardwareError:
            return False

    def _stand_after(self, why: str, most: int) -> None:
        """Mark a hole, have all motors stand until the joint rests, let go, and get ready to pull the tendons anew.

        A lever that lost its torque while the joint still swings would be swung beyond its window.
        """
        report, asked = self.report, self.steering.emergency_asked
        report.pauses.append(why)
        self._journal.end_segment("aborted", why)
        self.at.end()
        self.at.state = "resting after a pause"
        self._say(events.Hole.of(why=why, times=len(report.pauses), most=most))
        for state in ("hold", "release"):
            left = stop(
                self._rig, self._clock, state, lambda first: self._note_frozen(first) if asked() else None,
                emergency_asked=asked,
            )  # fmt: skip
            if not left.is_safe:
                raise LostError(f"{why}; {left.sentence()}")
            self._await_rest()
        self._may_hold = False
        refuse_unready(self._rig, self._clock, self._plan, torque_may_be_on=True)
        self._guard = Guard(self._rig.spec)
        statistics, self._loop = self._loop.statistics, self._new_loop()
        self._loop.statistics = statistics
        self._health = Health(self._loop, self._rig.bus, self.at)
        self._mover = None
        self._say(events.Anew.of())

    def _await_start(self) -> None:
        """Wait until the head rests: an end by force, or a hand, may have left it swinging. Raises StartError."""
        try:
            self._await_rest()
        except LostError as trouble:
            raise StartError(str(trouble)) from trouble

    def _await_rest(self) -> None:
        """Wait until the head rests, ten seconds at most: what swings is taken for tilted, whatever its gyroscope's
        bias. Raises LostError where it does not come to rest."""
        seen: deque[tuple[float, float, float]] = deque(maxlen=round(_RESTS_S / _LOOK_S))
        spread, end = math.inf, self._clock.now() + _RESTS_MOST_S
        while not spread < _RESTS_SPREAD:
            if self._clock.now() > end:
                if math.isinf(spread):
                    raise LostError(
                        f"{len(seen)} readings of the IMU came within {_RESTS_MOST_S:.0f} s, expected "
                        f"{seen.maxlen} that tell whether the head rests; check its cable, then `sinew doctor`"
                    )
                raise LostError(
                    f"the head still turns to and fro by {math.degrees(spread):.1f} °/s after {_RESTS_MOST_S:.0f} s, "
                    f"expected less than {math.degrees(_RESTS_SPREAD):g} °/s; let it come to rest, and start again"
                )
            self.steering.check()
            self._clock.wait_until(self._clock.now() + _LOOK_S)
            imu = self._rig.read().imu
            if imu is not None:
                seen.append(imu.gyro)
            if len(seen) == seen.maxlen:
                spread = max(max(axis) - min(axis) for axis in zip(*seen, strict=True))

    def _run_all(self, done: frozenset[int] | set[int]) -> None:
        self._at_mm = None
        contact = self._power_up()
        motors = MotorMap(self._rig.spec, self._plan.pretension.mode, contact, self._held)
        offsets, before = (0.0, 0.0), 0.0
        current: float | None = None
        for index, group in enumerate(self._groups):
            if index in done:
                continue
            self._rest_if_asked(group)
            if group.pretension_mm != current:
                self.at.state = "setting pretension"
                self._prepare(group.pretension_mm)
                offsets, before = self._set_range(motors, group.pretension_mm, before, offsets)
                current = group.pretension_mm
            before_s = sum(earlier.duration_s for earlier in self._groups[:index])
            self.at.state = "running"
            self.at.begin(index, before_s, group.duration_s, self._loop.due)
            self._run_group(index, group)
            self.at.end()
            if group.kind == "tracking" and self._mover is not None and self._mover.pretension_mm != before:
                before, current = self._mover.pretension_mm, None
            self.report.groups_done += 1
        pause(self._loop)  # a lever that loses its torque in mid-swing would go on swinging

    def _rest_if_asked(self, group: Group) -> None:
        """Cycle with the lever at zero and the tension held for as long as a pause is asked for; `group` comes next."""
        if not self.steering.pause_asked:
            return
        self.at.state = "paused"
        self._say(events.Paused.of(group=_named(group)))
        self._journal.begin_segment(None, 0, Segment("idle", group.pretension_mm, math.nan, math.nan, 0), "pause")
        while self.steering.pause_asked:
            self._loop.cycle()
            self._kept.clear()
        self._journal.end_segment("complete")
        self._say(events.Resumed.of(group=_named(group)))

    def _power_up(self) -> Contact:
        """Configure the motors, put them under power where they are, bring the lever to zero, pull to contact."""
        rig, loop = self._rig, self._loop
        self._begin_from_known_state()
        self._stepped = self._clock.now()
        for motor in rig.motors:
            self._step()
            prepare_goal(motor)
            self._may_hold = True
            _under_torque(motor)
        self._step()
        angles = rig.stand()
        loop.watch = Watch(origin=angles, goals=angles)
        loop.restart()
        lever = rig.drive.angle()
        loop.restart()
        loop.lever = lambda _: lever  # it stays until the wiring of the tendons is known to be right
        self.at.state = "pulling the tendons"
        self._say(events.Pulled.of())
        contact = pull_to_contact(loop, rig)
        self._guard.gyro_bias = _mean([sample.gyro_rad_s[0] for sample in loop.run(_BIAS_S)])
        refuse_wrong_drive_sign(loop, rig.spec, lever, self._guard.gyro_bias)
        lever, begin, loop.lever = rig.drive.angle(), loop.due, at_zero
        loop.run(_LEVER_HOME_S, lambda time: lever * max(0.0, 1 - (time - begin) / _LEVER_HOME_S))
        self._say(events.Contact.of(current_ma=1e3 * contact.current))
        return self._change_mode(contact)

    def _change_mode(self, contact: Contact) -> Contact:
        """Put the tendon motors into the plan's mode, one by one; return the contact in the turns they count then."""
        mode = self._plan.pretension.mode
        self.at.state = "changing the mode"
        angles = list(contact.angles)
        if mode != "position-with-current-limit":
            self._stepped = self._clock.now()
            for index, motor in enumerate(self._rig.tendons):
                self._step()
                before = motor.angle()
                motor.torque_off()
                self._rig.prepare_tendon(motor, mode)
                # A change of mode may take whole turns off the reading.
                angles[index] += math.tau * round((motor.angle() - before) / math.tau)
                if mode == "current":
                    motor.keep_count("goal_current", motor.goal_current.count(contact.current))
                else:
                    prepare_goal(motor)
                    motor.limit_output(self._most_pulls(None)[index])
                _under_torque(motor)
            self._rig.set_tendon_mode(mode)
            self._step()
        self._note_registers(self._look_at_registers("the mode was set"))
        goals = self._rig.stand()
        by_current = mode == "current"
        self._loop.watch = Watch(
            origin=tuple(angles), goals=(contact.current,) * len(angles) if by_current else goals, by_current=by_current
        )
        self._loop.restart()
        return Contact(tuple(angles), contact.current)

    def _step(self) -> None:
        """Look whether the run is to end, between steps that have no cycle, and whether the computer paused in one."""
        self.steering.check()
        if (took := self._clock.now() - self._stepped) > WATCHDOG_S:
            self._loop.refuse_stopped(took)
        self._stepped = self._clock.now()

    def _begin_from_known_state(self) -> None:
        """Bring every register that matters to what the run needs, whatever was there, while nothing has torque.

        Raises StartError, naming the register, where a motor holds or takes another; StoppedError, if the run is
        resumed, for then motors have moved.
        """
        tendons = self._rig.spec.tendons
        most = max((tension for held in self._held.values() for tension in held.tension_n), default=0.0)
        if self._plan.pretension.mode == "position-with-current-limit":
            most += LIMIT_RESERVE_N
        needed = tendons.current(1.0) * max(most, tendons.first_contact_tension.value)
        try:
            self._rig.configure(min(needed, self._rig.spec.limits.tendon_current_a))
            self._rig.set_tendon_mode("position-with-current-limit")
        except TROUBLES as trouble:
            has_moved = self._may_hold or self.report.pauses
            raise (StoppedError if has_moved else StartError)(str(trouble)) from trouble

    def _look_at_registers(self, since: str) -> dict[str, dict[str, int]]:
        """Return the motors' registers; see `Loop.read_registers`. since: what came before."""
        found = self._loop.read_registers(since)
        self._checks += 1
        return found

    def _note_registers(self, found: Mapping[str, Mapping[str, int]]) -> None:
        """Leave in the journal with which registers the motors measure."""
        motors = {
            motor.name: {"id": motor.id, "model": motor.table.model, "registers": found[motor.name]}
            for motor in self._rig.motors
        }
        self._journal.note_registers({"tendon_mode": self._plan.pretension.mode, "motors": motors})

    def _prepare(self, pretension_mm: float) -> None:
        """Set how hard the tendon motors may pull on their way to a pretension."""
        watch = self._loop.watch
        watch.resting, watch.share = False, None
        tendons = self._rig.spec.tendons
        if self._plan.pretension.mode == "position-with-current-limit":
            tensions = self._held[pretension_mm].tension_n
            watch.limit = tuple((tension + LIMIT_RESERVE_N) * tendons.current(1.0) for tension in tensions)
            for motor, limit in zip(self._rig.tendons, watch.limit, strict=True):
                motor.limit_output(limit)
        elif self._plan.pretension.mode == "position":
            self._bound_pull(self._at_mm, pretension_mm, speed=CHANGE_SPEED)

    def _bound_pull(self, *pretensions_mm: float | None, speed: float = 0.0) -> None:
        """Bound by their duty what motors that hold positions pull, by the largest of some pretensions [mm].

        Such a motor goes on holding when its program is killed, for ever, so that what it may pull is set before. None:
        first contact. speed: with which cable is wound [m/s]; a motor that turns needs duty for that.
        """
        each = [self._most_pulls(mm) for mm in pretensions_mm]
        for motor, currents in zip(self._rig.tendons, zip(*each, strict=True), strict=True):
            motor.limit_output(max(currents) + motor.turning_current(speed / self._loop.pulley_radius))

    def _most_pulls(self, pretension_mm: float | None) -> list[float]:
        """Return the current [A] of each tendon's largest pull at a pretension [mm]; None: first contact.

        It is that at rest, and what the largest torsion that the rig allows, or tendons that the plan drives, add.
        """
        tendons, limits = self._rig.spec.tendons, self._rig.spec.limits
        held = self._held.get(pretension_mm) if pretension_mm is not None else None
        rest = (tendons.first_contact_tension.value,) * tendons.count if held is None else held.tension_n
        driven = max((g.amplitude_mm for g in self._groups if g.excitation != "lever"), default=0.0)
        more = self._rig.spec.swing_pull(math.radians(limits.torsion_deg), 1e-3 * driven) + LIMIT_RESERVE_N
        return [tendons.current(min(tension + more, limits.tension_n)) for tension in rest]

    def _set_range(
        self, motors: MotorMap, mm: float, before: float, offsets: tuple[float, float]
    ) -> tuple[tuple[float, float], float]:
        """Set a pretension [mm] and return its levelling correction, and it; where the plan moves the pretension, the
        other end of its way is visited first, and levelled."""
        asked = [mm]
        if self._plan.track is not None and self._plan.track.pretension_to_mm is not None:
            asked.insert(0, self._plan.track.pretension_to_mm)
        levelled = []
        for stop_mm in asked:
            result = set_pretension(self._loop, motors, stop_mm, before, offsets, self._plan.rest_pose.swing_rad)
            offsets, before = result.offsets, stop_mm
            self.report.pretensions.append(result)
            self._say(result)
            share = self._loop.watch.share or (1 / len(self._rig.tendons),) * len(self._rig.tendons)
            levelled.append(Levelled.of(stop_mm, offsets, share, result.current_a))
            self._at_mm = stop_mm
        if self._plan.pretension.mode == "position":
            driven = [
                1e-3 * g.amplitude_mm * math.tau * g.frequency_hz for g in self._groups if g.excitation != "lever"
            ]
            self._bound_pull(*asked, speed=max((one for one in driven if not math.isnan(one)), default=0.0))
        self._mover = Mover(self._loop, motors, levelled[1], levelled[0]) if len(levelled) > 1 else None
        return offsets, before

    def _track(self, index: int, group: Group) -> None:
        """Run a tracking group; a hole in it is the law's to bridge, so it is never measured again."""
        if self._law is None or self._plan.track is None:
            raise StoppedError("the plan tracks a resonance, which needs `sinew track`")
        law = self._law(group, self._loop.due)
        self._guard.imu_patience = self._plan.track.gap_s
        try:
            last = run_tracking(self._loop, group, self._plan.sample_hz, law, self, self._say, self._mover)
        finally:
            self._guard.imu_patience = LOST_AFTER_S
        self.report.tracks[index] = last
        self._look_at_registers(f"{_named(group)} began")
        self._journal.finish_group(index)

    def _run_group(self, index: int, group: Group) -> None:
        """Run a group until it is recorded without holes, a few times at most."""
        sweep = self._plan.sweep
        adaptive = group.kind == "steady" and sweep is not None and sweep.settle == "adaptive"
        self._group, self._index = group, index
        for _ in range(_ATTEMPTS):
            attempt = self._attempt = self._tries[index]  # those before a hole count as well: each has its number
            self._tries[index] += 1
            if group.kind == "ring-down":
                pause(self._loop)
            if group.kind == "tracking":
                self._track(index, group)
                return
            self._attempt, self._kept = attempt, []  # the pause is not recorded, and may have holes
            rule = SettleRule.of(sweep, group.frequency_hz) if adaptive and sweep is not None else None
            run_group(self._loop, group, self._plan.sample_hz, self, rule)
            self._look_at_registers(f"{_named(group)} began")
            if group_is_whole(self._kept, self._plan.sample_hz):
                self._journal.finish_group(index)
                self._doubt(group)
                return
            self._say(events.Repeat.of(group=_named(group)))
        raise LostError(
            f"{_named(group)} came with too many missing answers "
            f"{_ATTEMPTS} times; check cables, ground and supply, then `sinew doctor`"
        )

    def _doubt(self, group: Group) -> None:
        """Say what speaks against the group that was just recorded."""
        if group.kind == "steady" and group.excitation == "lever":
            kept = self._kept[-group.sample_counts(self._plan.sample_hz)[1] :]
            columns = np.array([(s.time_s, s.drive_rad, s.gyro_rad_s[0]) for s in kept])
            for sentence in group_doubts(self._rig.spec, group.segment("steady"), *columns.T):
                self._say(events.Doubted(sentence))

    def begin(self, kind: SegmentKind) -> None:
        """Begin a segment of the present group."""
        assert self._group is not None
        self._journal.begin_segment(self._index, self._attempt, self._group.segment(kind))

    def end(self) -> None:
        """End the segment under way."""
        self._journal.end_segment("complete")

    def _take(self, sample: Sample) -> None:
        self._journal.append(sample)
        self._kept.append(sample)
        if (health := self._health.take(sample.time_s, sample.supply_v)) is not None:
            self._say(health)
        if self._listener is not None:
            self._listener.on_sample(sample)

    def _count(self, loop: LoopStatistics) -> None:
        """Leave in the journal how cycles and bus have fared; a journal that takes nothing has been complained of."""
        numbers = {f"cycles_{name}": getattr(loop, name) for name in ("missed", "incomplete")} | {"cycles": loop.cycles}
        numbers |= {"readings_stale": loop.stale, "readings_impossible": loop.impossible}
        if self.report.lost_samples is not None:
            numbers["samples_lost"] = self.report.lost_samples
        statistics = self._rig.bus.statistics
        numbers["register_checks"] = self._checks
        numbers |= {f"bus_{name}": getattr(statistics, name) for name in statistics.__dataclass_fields__}
        with suppress(FileError):
            self._journal.count(numbers)

    def _say(self, event: events.Event) -> None:
        try:
            self._journal.event(event)
        except FileError as trouble:
            if not self.report.sentence:
                raise StoppedError(str(trouble)) from trouble
        if self._listener is not None:
            self._listener.on_event(event)


def _named(group: Group) -> str:
    """Return what a user calls a group."""
    at = "" if math.isnan(group.frequency_hz) else f" and {group.frequency_hz:g} Hz"
    return f"the {group.kind} group at {group.pretension_mm:g} mm{at}"


def _under_torque(motor: Motor) -> None:
    """Put a motor under torque, its watchdog first: it counts from then on, and there is no moment without it."""
    motor.arm_watchdog(WATCHDOG_S)
    motor.torque_on()


def _mean(values: list[float]) -> float:
    finite = [value for value in values if not math.isnan(value)]
    return sum(finite) / len(finite) if finite else 0.0
