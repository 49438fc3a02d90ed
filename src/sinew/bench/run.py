"""One run of a plan on a rig: pull, pretension, groups, and always an end in the declared safe state."""

import math
import statistics
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from sinew.bench.group import DriveLaw, Levelled, Mover, pause, run_group, run_tracking
from sinew.bench.guard import LOST_AFTER_S, Guard
from sinew.bench.loop import Loop, LoopStatistics
from sinew.bench.powering import Powering, await_rest
from sinew.bench.preflight import refuse_unready
from sinew.bench.pretension import CHANGE_SPEED, Contact, Held, MotorMap, set_pretension
from sinew.bench.record.conversion import group_is_whole
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import Sample
from sinew.bench.recorder import Health, Listener, Progress, Recorder
from sinew.bench.stops import SafeState, Steering, StopReport, stop
from sinew.bench.tilt import TiltEstimator
from sinew.hardware.bus import Clock
from sinew.hardware.rig import Rig
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
from sinew.plan.plan import Group, Plan


@dataclass(slots=True)
class RunReport:
    """How a run ended.

    is_complete: every group of the plan is recorded. sentence: what ended it. stop: how the rig was left.
    groups_done, groups: of the plan, those of earlier attempts included. loop: of the cycles. pretensions: as they came
    out, in order. tracks: the last state of the law of each tracking group of this run, by its index in the plan.
    pauses: what was said of each pause of the computer after which the run went on by itself. is_paused: whether one
    ended it, so that nothing is wrong with the bench and the run can be gone on with at once.
    halted_s: from the request that ended the run until all motors were frozen [s]; None where there was none.
    wire_s: how long the bytes of a cycle were on the wire [s].
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
    wire_s: float = 0.0
    lost_samples: int | None = None


_ATTEMPTS = 3


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
        self._rig, self._clock, self._plan, self._journal, self._law = rig, clock, plan, journal, law
        if held is None and not plan.rest_pose.is_straight:
            raise SpecError(
                f"plan {plan.name} asks for {plan.rest_pose.words()}, expected what holds it; see `sinew run`"
            )
        count = rig.spec.tendons.count
        upright = {mm: Held.upright(mm, tension, count) for mm, tension in tension_n.items()}
        self._held = upright if held is None else dict(held)
        self.steering = steering or Steering(clock.now)
        self._groups = plan.groups()
        self._tries: Counter[int] = Counter()
        self._checks = 0
        self._mover: Mover | None = None
        self.at = Progress(len(self._groups), sum(group.duration_s for group in self._groups))
        self.report = RunReport(len(self._groups))
        self._power = Powering(rig, plan, self._held)
        self._guard, self._loop = self._new_loop()
        self._recorder = Recorder(journal, Health(self._loop, rig.bus, self.at), listener)

    def _new_loop(self) -> tuple[Guard, Loop]:
        guard, tilt = Guard(self._rig.spec), TiltEstimator(self._rig.spec, self._plan.sample_hz)
        period = 1 / self._plan.sample_hz
        return guard, Loop(self._rig, self._clock, guard, tilt, period, self._take, self.steering.check)

    def _take(self, sample: Sample) -> None:
        self._recorder.take(sample)

    @property
    def motors(self) -> int:
        """How many motors the rig has."""
        return len(self._rig.motors)

    @property
    def group_kind(self) -> str:
        """Kind of the group under way; empty before the first."""
        group = self._recorder.group
        return group.kind if group is not None else ""

    def run(self, *, resume: bool = False) -> RunReport:
        """Run what is left of the plan and return how it ended; the rig is in its safe state then.

        resume: the motors may be found as an interrupted run left them; they are released first.
        Raises StartError, with nothing moved, if the bench is not ready, a motor does not take a register that the
        run needs, or the run was to end before it began. What happens later is in the report.
        """
        report, rig, clock = self.report, self._rig, self._clock
        refuse_unready(rig, clock, self._plan, torque_may_be_on=resume)
        self._power.is_under_torque = resume
        self.steering.has_begun = True  # before it is looked at: whoever asks later finds motors that may move
        if (halt := self.steering.halt) is not None:
            raise StartError(f"{halt.reason}; nothing has moved")
        lost_before = _lost_samples(rig)
        done = self._journal.finished_groups()
        report.groups_done = len(done)
        try:
            if resume:
                self._leave_in("release")
            if len(done) < report.groups:
                try:
                    # An end by force, or a hand, may have left the head swinging.
                    await_rest(rig, clock, self.steering.check)
                except LostError as trouble:
                    raise StartError(str(trouble)) from trouble
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
            self._recorder.is_over = True
            report.is_complete = report.groups_done == report.groups
            report.stop = self._stop()
            report.loop, report.wire_s = self._loop.statistics, rig.wire_s
            if lost_before is not None and (lost := _lost_samples(rig)) is not None:
                report.lost_samples = lost - lost_before if lost >= lost_before else lost  # a board may start anew
            more = {} if report.lost_samples is None else {"samples_lost": report.lost_samples}
            self._recorder.count(self._loop, rig.bus, {"register_checks": self._checks, **more})
            self._recorder.say(events.Ended.of(why=report.sentence, left=report.stop.sentence()))
        return report

    def _stop(self) -> StopReport:
        """Bring the rig to the state that was asked for, or to its declared one."""
        self.at.state = "stopping"
        halt = self.steering.halt
        state = (halt.state if halt is not None else None) or self._rig.spec.limits.safe_state
        state = state if self._power.is_under_torque else "release"
        is_emergency = self.steering.emergency_requested
        report = stop(self._rig, self._clock, state, self._note_frozen, emergency_requested=is_emergency)
        self.steering.note_over(report)
        return report

    def _leave_in(self, state: SafeState) -> StopReport:
        """Bring the rig to a safe state while the run goes on, and return how it was left."""
        is_emergency = self.steering.emergency_requested
        return stop(
            self._rig, self._clock, state, lambda first: self._note_frozen(first) if is_emergency() else None,
            emergency_requested=is_emergency,
        )  # fmt: skip

    def _note_frozen(self, first: StopReport) -> None:
        now = self._clock.now()
        self.steering.note_frozen(first)
        halt = self.steering.halt
        if halt is not None and len(first.frozen) == len(self._rig.motors):
            self.report.halted_s = now - halt.requested_s
            if halt.is_emergency:
                self._recorder.say(events.Frozen.of(after_ms=1e3 * self.report.halted_s))

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
        self.report.pauses.append(why)
        self._journal.end_segment("aborted", why)
        self.at.end()
        self.at.state = "resting after a pause"
        self._recorder.say(events.Hole.of(why=why, times=len(self.report.pauses), most=most))
        states: tuple[SafeState, ...] = ("hold", "release")
        for state in states:
            if not (left := self._leave_in(state)).is_safe:
                raise LostError(f"{why}; {left.sentence()}")
            await_rest(self._rig, self._clock, self.steering.check)
        self._power.is_under_torque = False
        refuse_unready(self._rig, self._clock, self._plan, torque_may_be_on=True)
        statistics = self._loop.statistics
        self._guard, self._loop = self._new_loop()
        self._loop.statistics = statistics
        self._recorder.health = Health(self._loop, self._rig.bus, self.at)
        self._mover = None
        self._recorder.say(events.Anew.of())

    def _run_all(self, done: frozenset[int]) -> None:
        motors = MotorMap(self._rig.spec, self._plan.pretension.mode, self._power_up(), self._held)
        at_mm: float | None = None  # pretension that is set; None: first contact
        offsets, before = (0.0, 0.0), 0.0
        current: float | None = None
        for index, group in enumerate(self._groups):
            if index in done:
                continue
            self._rest_if_requested(group)
            if group.pretension_mm != current:
                self.at.state = "setting pretension"
                self._power.bound_for_change(self._loop, at_mm, group.pretension_mm, CHANGE_SPEED)
                offsets, before = self._set_range(motors, group.pretension_mm, before, offsets)
                current = at_mm = group.pretension_mm
            before_s = sum(earlier.duration_s for earlier in self._groups[:index])
            self.at.state = "running"
            self.at.begin(index, before_s, group.duration_s, self._loop.due)
            self._run_group(index, group)
            self.at.end()
            if group.kind == "tracking" and self._mover is not None and self._mover.pretension_mm != before:
                before, current = self._mover.pretension_mm, None
            self.report.groups_done += 1
        pause(self._loop)  # a lever that loses its torque in mid-swing would go on swinging

    def _rest_if_requested(self, group: Group) -> None:
        """Cycle with the lever at zero and the tension held for as long as a pause is asked for; `group` comes next."""
        if not self.steering.pause_requested:
            return
        self.at.state = "paused"
        self._recorder.say(events.Paused.of(group=_named(group)))
        self._journal.begin_segment(None, 0, Segment("idle", group.pretension_mm, math.nan, math.nan, 0), "pause")
        while self.steering.pause_requested:
            self._loop.cycle()
            self._recorder.kept.clear()
        self._journal.end_segment("complete")
        self._recorder.say(events.Resumed.of(group=_named(group)))

    def _power_up(self) -> Contact:
        """Put the motors under power, and leave in the journal with which registers they measure.

        Raises StartError, naming the register, where a motor holds or takes another; StoppedError, if the run is
        resumed, for then motors have moved.
        """
        has_moved = self._power.is_under_torque or self.report.pauses
        try:
            self._power.set_known_state()
        except TROUBLES as trouble:
            raise (StoppedError if has_moved else StartError)(str(trouble)) from trouble
        contact = self._power.power_up(self._loop, self._guard, self.at, self._recorder)
        found = self._look_at_registers("the mode was set")
        motors = {
            motor.name: {"id": motor.id, "model": motor.table.model, "registers": found[motor.name]}
            for motor in self._rig.motors
        }
        self._journal.note_registers({"tendon_mode": self._plan.pretension.mode, "motors": motors})
        self._power.watch(self._loop, contact)
        return contact

    def _look_at_registers(self, since: str) -> dict[str, dict[str, int]]:
        """Return the motors' registers; see `Loop.read_registers`. since: what came before."""
        found = self._loop.read_registers(since)
        self._checks += 1
        return found

    def _set_range(
        self, motors: MotorMap, mm: float, before: float, offsets: tuple[float, float]
    ) -> tuple[tuple[float, float], float]:
        """Set a pretension [mm] and return its levelling correction, and it; where the plan moves the pretension, the
        other end of its way is visited first, and levelled."""
        track, tendons = self._plan.track, len(self._rig.tendons)
        levels = [mm] if track is None or track.pretension_to_mm is None else [track.pretension_to_mm, mm]
        levelled = []
        for stop_mm in levels:
            result = set_pretension(self._loop, motors, stop_mm, before, offsets, self._plan.rest_pose.swing_rad)
            offsets, before = result.offsets, stop_mm
            share = self._loop.watch.share or (1 / tendons,) * tendons
            levelled.append(Levelled.of(stop_mm, offsets, share, result.current_a))
            if self._plan.pretension.mode == "position-with-current-limit":
                # a plate that is level hangs on unequal tensions: by one limit for all some would never yield
                self._power.limit_current(self._loop, [result.current_a + extra for extra in levelled[-1].extra_a])
                result = replace(result, limit_a=statistics.fmean(self._loop.watch.limit))
            self.report.pretensions.append(result)
            self._recorder.say(result)
        self._power.bound_for_groups(*levels)
        self._mover = Mover(self._loop, motors, levelled[1], levelled[0]) if len(levelled) > 1 else None
        return offsets, before

    def _track(self, index: int, group: Group) -> None:
        """Run a tracking group; a hole in it is the law's to bridge, so it is never measured again."""
        if self._law is None or self._plan.track is None:
            raise StoppedError("the plan tracks a resonance, which needs `sinew track`")
        law, recorder = self._law(group, self._loop.due), self._recorder
        self._guard.imu_patience = self._plan.track.gap_s
        try:
            last = run_tracking(self._loop, group, self._plan.sample_hz, law, recorder, recorder.say, self._mover)
        finally:
            self._guard.imu_patience = LOST_AFTER_S
        self.report.tracks[index] = last
        self._look_at_registers(f"{_named(group)} began")
        self._journal.finish_group(index)

    def _run_group(self, index: int, group: Group) -> None:
        """Run a group until it is recorded without holes, a few times at most."""
        sample_hz = self._plan.sample_hz
        for _ in range(_ATTEMPTS):
            # Those before a hole count as well: each has its number.
            self._recorder.expect(index, group, self._tries[index])
            self._tries[index] += 1
            if group.kind == "ring-down":
                pause(self._loop)
            if group.kind == "tracking":
                self._track(index, group)
                return
            self._recorder.kept = []  # the pause is not recorded, and may have holes
            run_group(self._loop, group, sample_hz, self._recorder)
            self._look_at_registers(f"{_named(group)} began")
            if group_is_whole(self._recorder.kept, sample_hz):
                self._journal.finish_group(index)
                self._recorder.doubt(self._rig.spec, sample_hz)
                return
            self._recorder.say(events.Repeat.of(group=_named(group)))
        raise LostError(
            f"{_named(group)} came with too many missing answers "
            f"{_ATTEMPTS} times; check cables, ground and supply, then `sinew doctor`"
        )


def _lost_samples(rig: Rig) -> int | None:
    """Return how many samples the sensor's board says to have lost since its start; None where it cannot."""
    try:
        node_report = rig.imu.node_report()
    except HardwareError:
        return None
    return None if node_report is None else node_report.lost_samples


def _named(group: Group) -> str:
    """Return what a user calls a group."""
    at = "" if math.isnan(group.frequency_hz) else f" and {group.frequency_hz:g} Hz"
    return f"the {group.kind} group at {group.pretension_mm:g} mm{at}"
