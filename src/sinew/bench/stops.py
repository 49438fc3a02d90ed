"""Stops: the rig brought to its declared safe state, whatever has happened before.

First all motors are frozen where they are, with limited output, within milliseconds. *hold* leaves it at that.
*release*: the tension is ramped down, then all motors lose their torque. A motor that does not answer is asked again
for a second: a line that is disturbed, or a motor that starts anew, may be back by then. Nothing here raises: what a
motor does not do is said in the report, and the motors' own bus watchdog has the last word.

`Steering`, below, takes what asks a run for a stop, or a pause.
"""

import threading
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

from sinew.hardware.believable import GOALS, STATE, contradiction
from sinew.hardware.bus import Clock
from sinew.hardware.motor import Motor, TendonServo
from sinew.hardware.registers import CURRENT_MODE, CURRENT_POSITION_MODE, WATCHDOG_TRIPPED, encode_raw
from sinew.hardware.rig import Rig
from sinew.measure.errors import TROUBLES, DeviceError, HardwareError, PortError, StoppedError

# All motors are told at once to stay where they are: the first stage of every stop.
#
# One packet asks all of them how they run, one tells all of them to stay, one asks whether they do; who did not hear
# is told again, and holds up nobody. A tendon motor keeps its goal, as far as that is within reach of the pull that
# it has, so that no tension jumps; one that holds a current goes on holding it. The drive stays where its lever is:
# with the winding closed it brakes, where a lever without torque would go on swinging by up to 115°
# (docs/decisions/0020).

FREEZE_MOST_S = 0.12
"""A motor that has not confirmed by then is left to what follows [s]."""

TENDON_HOLD_SHARE = 0.8
"""Current that a frozen tendon motor may draw, of the rig's limit: what held the tendon must go on holding it."""

DRIVE_HOLD_SHARE = 0.2
"""Output of a frozen drive, of its full one."""

_MARGIN, _UNSURE = 1.3, 3  # of a pull that is read from the current: as a factor, and in counts

Counts = dict[str, int]


@dataclass(slots=True)
class Frozen:
    """Who stays where he is. names: of the motors that confirmed it, or have no torque. took_s: until the last did."""

    names: set[str] = field(default_factory=set)
    took_s: float = 0.0


def freeze(rig: Rig, clock: Clock) -> Frozen:
    """Have all motors stay where they are with limited output, and return who confirmed that, and how soon.

    No motor is waited for alone. One whose bus watchdog has stopped it stays as it is: cleared, it would run to its old
    goal. Raises PortError.
    """
    start = clock.now()
    frozen, orders, before, then = Frozen(), dict[str, Counts](), dict[str, Counts](), start
    pending: Sequence[Motor] = rig.motors
    while pending and (now := clock.now()) - start < FREEZE_MOST_S:
        found = rig.ask_at_once(pending, STATE)
        sure = {
            motor.name
            for motor in pending
            if motor.name in found
            and motor.name in before
            and not contradiction(motor.table, before[motor.name], found[motor.name], now - then)
        }
        there = {
            motor.name
            for motor in pending
            if motor.name in found and _stays(found[motor.name], orders.get(motor.name), motor.name in sure)
        }
        if there:
            frozen.names |= there
            frozen.took_s = clock.now() - start
        pending = [motor for motor in pending if motor.name not in there]
        if silent := [motor for motor in pending if motor.name not in found][:1]:
            # On the line it keeps those behind it from answering, so it is asked last from now on.
            pending = [*(motor for motor in pending if motor is not silent[0]), *silent]
        fresh = [(motor, found[motor.name]) for motor in pending if motor.name in sure]
        orders |= {motor.name: _acceptable(counts | _standing(rig, motor, counts)) for motor, counts in fresh}
        _tell(rig, [motor for motor in pending if motor.name in orders], orders)
        before, then = found, now
    return frozen


def freeze_alone(rig: Rig, motor: Motor) -> None:
    """Have one motor stay where it is with limited output. Raises DeviceError, PortError."""
    goals = _standing(rig, motor, motor.state())
    for name in sorted(goals, key=lambda name: name != "goal_position"):
        motor.set_count(name, goals[name])
    found = motor.state()
    if others := [name for name in goals if found[name] != goals[name]]:
        name = others[0]
        raise DeviceError(f"{motor.name} has {found[name]} in {name}, expected the {goals[name]} just written")


def _stays(found: Counts, orders: Counts | None, is_sure: bool) -> bool:
    """Return whether a motor stays where it is: it has no torque or its watchdog has stopped it, if that is sure, or it
    has the goals that it was told."""
    if not found["torque_enable"] or found["bus_watchdog"] == WATCHDOG_TRIPPED:
        return is_sure
    return orders is not None and all(found[name] == orders[name] for name in GOALS)


def _tell(rig: Rig, motors: Sequence[Motor], orders: Mapping[str, Counts]) -> None:
    if motors:
        data = {m.id: b"".join(encode_raw(m.table[name], orders[m.name][name]) for name in GOALS) for m in motors}
        rig.bus.sync_write(motors[0].table["goal_pwm"].address, data)


def _acceptable(counts: Counts) -> Counts:
    """Return registers with goals that a motor takes: a start leaves some beyond limits that were set later."""
    limits = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}
    return counts | {goal: max(-counts[most], min(counts[goal], counts[most])) for goal, most in limits.items()}


def _standing(rig: Rig, motor: Motor, counts: Counts) -> Counts:
    """Return the goals with which a motor that runs with some registers stays where it is, by register."""
    present = counts["present_position"]
    if not isinstance(motor, TendonServo):
        drive = rig.drive
        # Where it has swung beyond its window, its end is the nearest goal that it takes.
        goal = max(drive.goal_angle.low, min(present, drive.goal_angle.high))
        return _limits(rig, motor, counts) | {"goal_position": goal}
    hold = TENDON_HOLD_SHARE * rig.spec.limits.tendon_current_a
    limits = _limits(rig, motor, counts)
    mode, goal_current = counts["operating_mode"], counts["goal_current"]
    pull = max(0, motor.sign * counts["present_current"])
    if mode == CURRENT_MODE:  # one whose cable is off draws next to nothing, and would run on
        return limits | {
            "goal_current": motor.sign * min(max(0, motor.sign * goal_current), pull, limits["goal_current"])
        }
    by_current = mode == CURRENT_POSITION_MODE
    unit = motor.table["present_current"].scale
    in_force = min(goal_current * unit, hold) if by_current else hold
    ahead = motor.sign * (counts["goal_position"] - present)
    give = _give(rig, motor, min(in_force, (_MARGIN * pull + _UNSURE) * unit))
    goals = {"goal_position": present + motor.sign * max(0, min(ahead, give))}
    if not by_current:
        return goals | {"goal_pwm": limits["goal_pwm"]}
    return goals | {"goal_current": limits["goal_current"]}


def _limits(rig: Rig, motor: Motor, counts: Counts) -> Counts:
    """Return the most output that a motor is left with, by register: never more than it has."""
    if not isinstance(motor, TendonServo):
        return {"goal_pwm": _most(motor, "goal_pwm", DRIVE_HOLD_SHARE, counts)}
    hold = TENDON_HOLD_SHARE * rig.spec.limits.tendon_current_a
    return {
        "goal_pwm": _most(motor, "goal_pwm", motor.standstill_duty(hold), counts),
        "goal_current": _most(motor, "goal_current", hold, counts),
    }


def _is_limited(rig: Rig, motor: Motor, counts: Counts) -> bool:
    """Return whether a motor that runs with some registers is left with no more output than that."""
    by_current = counts["operating_mode"] in (CURRENT_MODE, CURRENT_POSITION_MODE)
    register = "goal_current" if by_current and isinstance(motor, TendonServo) else "goal_pwm"
    return abs(counts[register]) <= _limits(rig, motor, counts)[register]


def _most(motor: Motor, register: str, quantity: float, counts: Counts) -> int:
    return int(min(quantity / motor.table[register].scale + 1e-6, abs(counts[register])))


def _give(rig: Rig, motor: Motor, current: float) -> int:
    """Return by how many counts the goal of a tendon motor is ahead of its horn where it pulls with a current [A]."""
    tendons = rig.spec.tendons
    angle = tendons.tension(current) / tendons.servo_stiffness.value / tendons.pulley_radius.value
    return int(angle / motor.table["goal_position"].scale) + 1


RAMP_SPEED = 0.02
"""Speed at which cable is given back while the tension is ramped down [m/s]."""

CURRENT_RAMP_S = 0.6
"""Time over which the current of motors that hold a current is ramped down [s]."""

RAMP_MOST_S = 2.0
"""A ramp ends after so long, slack or not [s]; the torque then goes off all the same."""

PERSIST_S = 1.0
"""A motor that does not answer is asked again for so long [s]."""

STAND_S = 0.5
"""After an emergency all motors stand for so long before the tension is let down: the joint's swing dies away [s]."""

_AGAIN_S = 0.1
_RAMP_STEP_S = 0.02
_SETTLE_S = 0.1  # until a motor that was told to stay does so
_SLACK_COUNTS = 3

Acts = dict[str, Callable[[], None]]
"""What is done to each motor, by name."""


@dataclass(slots=True)
class StopReport:
    """How the rig was left.

    declared: hold or release. reached: names of the motors that confirmed it. failed: (name, sentence) of the others.
    port_lost: the port is gone, so nobody could be asked; the bus watchdog has stopped the motors.
    frozen: names of the motors that stood frozen, or had no torque, after the first stage; frozen_s: how long that
    took [s]. took_s: until all was done [s]. cut: names of the tendon motors that lost their torque without having let
    their tension down, for they took no goal, as one does not that its bus watchdog has stopped.
    """

    declared: str
    reached: list[str] = field(default_factory=list)
    failed: list[tuple[str, str]] = field(default_factory=list)
    port_lost: bool = False
    frozen: frozenset[str] = frozenset()
    frozen_s: float = 0.0
    took_s: float = 0.0
    cut: list[str] = field(default_factory=list)

    @property
    def is_safe(self) -> bool:
        """Whether every motor confirmed the declared state."""
        return not self.failed and not self.port_lost

    def sentence(self) -> str:
        """Return what a user must know about how the rig was left."""
        if self.port_lost:
            return "the port is gone: the motors' bus watchdog has stopped them where they are; switch the supply off"
        if self.failed:
            who = _listed([name for name, _ in self.failed])
            return f"{self.declared} is not confirmed by {who} ({self.failed[0][1]}); switch the supply off"
        if self.declared == "hold":
            return "hold: all motors stand still with limited current; `sinew stop --port PORT --state release` lets go"
        if self.cut:
            return (
                f"release: torque off on all motors; {_listed(self.cut)} took no goal, as behind a bus watchdog, so "
                "what friction holds of the tension stays until somebody turns the pulley"
            )
        return "release: tension let down, torque off on all motors"


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def stop(
    rig: Rig,
    clock: Clock,
    state: str,
    on_frozen: Callable[[StopReport], None] | None = None,
    *,
    is_emergency: bool = False,
    emergency_requested: Callable[[], bool] = lambda: False,
) -> StopReport:
    """Bring the rig to a safe state, hold or release, and report how it was left.

    Works from any state: how each motor runs is read from its registers. on_frozen: called with what is known so far
    when the first stage is over. is_emergency: the motors stand for a while before a release lets the tension down.
    emergency_requested: looked at while the tension is let down; once it is so, all motors are frozen anew, `on_frozen`
    is called again, and the motors stand for a while before the tension goes on being let down.
    """
    start = clock.now()
    report = StopReport(state)
    on_frozen = on_frozen or (lambda _report: None)
    _freeze(report, rig, clock)
    on_frozen(report)
    if state == "hold":
        _hold(report, rig, clock)
    else:
        stands = is_emergency or emergency_requested()
        if stands:
            _stand(report, rig, clock)
        if not _ramp_down(report, rig, clock, (lambda: False) if stands else emergency_requested):
            _freeze(report, rig, clock)
            on_frozen(report)
            _stand(report, rig, clock)
            _ramp_down(report, rig, clock, lambda: False)
        _carry_out(report, clock, {motor.name: partial(_torque_off, motor) for motor in rig.motors})
    report.took_s = clock.now() - start
    return report


def _freeze(report: StopReport, rig: Rig, clock: Clock) -> None:
    try:
        frozen = freeze(rig, clock)
    except PortError:
        frozen, report.port_lost = Frozen(), True
    report.frozen, report.frozen_s = frozenset(frozen.names), frozen.took_s


def _hold(report: StopReport, rig: Rig, clock: Clock) -> None:
    _carry_out(report, clock, {motor.name: partial(_stay, rig, motor, report.frozen) for motor in rig.motors})
    if not report.port_lost:
        clock.wait_until(clock.now() + _SETTLE_S)


def _stand(report: StopReport, rig: Rig, clock: Clock) -> None:
    """Have all motors stand until the joint's swing has died away; those that were frozen late count as frozen."""
    _hold(report, rig, clock)
    report.frozen |= frozenset(report.reached)
    if not report.port_lost:
        clock.wait_until(clock.now() + STAND_S - _SETTLE_S)
    report.reached.clear()


def _carry_out(report: StopReport, clock: Clock, acts: Acts) -> None:
    """Do something to each motor, by name, and again to those that did not confirm it."""
    start = clock.now()
    while True:
        report.failed.clear()
        acts = {name: act for name, act in acts.items() if not _try(report, name, act)}
        if not acts or report.port_lost or clock.now() - start > PERSIST_S:
            return
        clock.wait_until(clock.now() + _AGAIN_S)


def _ramp_down(report: StopReport, rig: Rig, clock: Clock, must_freeze: Callable[[], bool]) -> bool:
    """Let the tension of every tendon that answers down in small steps; the others are left to their torque-off.

    Return whether that is done: False as soon as the motors must be frozen instead.
    """
    if report.port_lost:
        return True
    ramps = []
    for motor in rig.tendons:
        try:
            if motor.torque_is_on():
                by_current = _holds_current(motor)
                ramps.append(_Ramp(motor, motor.current() if by_current else motor.angle(), by_current))
        except PortError:
            report.port_lost = True
            return True
        except HardwareError:
            continue
    begun = list(ramps)
    speed = RAMP_SPEED / rig.spec.tendons.pulley_radius.value
    slack = _SLACK_COUNTS * rig.spec.tendons.current_lsb.value
    start = clock.now()
    while ramps and (elapsed := clock.now() - start) < RAMP_MOST_S:
        clock.wait_until(clock.now() + _RAMP_STEP_S)
        if must_freeze():
            return False
        try:
            ramps = [ramp for ramp in ramps if not ramp.step(elapsed, speed, slack)]
        except PortError:
            report.port_lost = True
            return True
    report.cut += [ramp.motor.name for ramp in begun if ramp.was_refused]
    return True


@dataclass(slots=True)
class _Ramp:
    """A tendon on its way to slackness, from an angle [rad] or a current [A]. was_refused: its motor takes no goal."""

    motor: TendonServo
    start: float
    by_current: bool
    was_refused: bool = False

    def step(self, elapsed: float, speed: float, slack: float) -> bool:
        """Take a step; return whether the tendon is slack, or its motor does not take part."""
        try:
            if self.by_current:
                share = max(0.0, 1 - elapsed / CURRENT_RAMP_S)
                self.motor.set_goal_current(self.start * share)
                return share == 0.0
            self.motor.set_goal_angle(self.start - speed * elapsed)
            return self.motor.current() <= slack
        except TROUBLES:
            self.was_refused = True
            return True


def _holds_current(motor: TendonServo) -> bool:
    return motor.get_count("operating_mode") == CURRENT_MODE


def _stay(rig: Rig, motor: Motor, frozen: Container[str]) -> None:
    """Have a motor stay frozen when nobody speaks any more; freeze it, if it is not."""
    state = motor.state()
    if state["bus_watchdog"] == WATCHDOG_TRIPPED:
        return  # it stands still already; clearing the watchdog would let it run to its old goal
    if motor.name not in frozen or not _is_limited(rig, motor, state):
        freeze_alone(rig, motor)
    motor.disarm_watchdog()
    if not state["torque_enable"]:
        raise DeviceError(f"{motor.name} has no torque, expected it to hold; has it shut down, or did its supply fail?")


def _torque_off(motor: Motor) -> None:
    motor.torque_off()
    motor.disarm_watchdog()


def _try(report: StopReport, name: str, act: Callable[[], None]) -> bool:
    """Do something to a motor and note the outcome; return whether it confirmed."""
    if report.port_lost:
        return False
    try:
        act()
    except PortError:
        report.port_lost = True
    except HardwareError as trouble:
        report.failed.append((name, str(trouble)))
    else:
        report.reached.append(name)
        return True
    return False


# Requests to pause a run, to go on, or to end it, come from whoever steers it: a signal, a socket, a dashboard.
#
# They come from other threads or from signal handlers, so each is one assignment and waits for nothing. The run looks
# at them before every cycle and between the steps that have none.


SafeState = Literal["hold", "release"]


@dataclass(frozen=True, slots=True)
class Halt:
    """Why a run is to end. state: in which to leave the rig, or None for its declared one. is_emergency: at once.

    requested_s: when it was asked for [s, the run's clock].
    """

    reason: str
    state: SafeState | None
    is_emergency: bool
    requested_s: float


class Steering:
    """What was asked of a run.

    now: the run's clock [s]. can_pause: whether it takes a pause; one that tracks a resonance does not.
    halt: why the run is to end, or None. pause_requested: whether it is to rest after the group under way.
    has_begun: whether motors may be under power by this run. stopped: what is known of the stop since its first stage
    was over; None before. is_over: whether the stop is done.
    """

    def __init__(self, now: Callable[[], float], *, can_pause: bool = True) -> None:
        self._now = now
        self.can_pause = can_pause
        self.halt: Halt | None = None
        self.pause_requested = False
        self.has_begun = False
        self.stopped: StopReport | None = None
        self.is_over = False
        self._frozen = threading.Event()

    def request_pause(self) -> None:
        """Have the run rest after the group under way. One that cannot pause goes on."""
        self.pause_requested = self.can_pause

    def request_resume(self) -> None:
        """Have a run that rests, or is to rest, go on."""
        self.pause_requested = False

    def request_stop(self, reason: str, state: SafeState | None = None) -> None:
        """End the run at the next cycle; the first request counts. state: to leave the rig in; None: as declared."""
        if self.halt is None:
            self.halt = Halt(reason, state, False, self._now())

    def request_emergency(self, reason: str) -> None:
        """End the run at once: before the next step of whatever it is at, letting the tension down among it."""
        if not self.emergency_requested():
            if self.stopped is not None and self.stopped.declared == "release" and not self.is_over:
                self._frozen = threading.Event()  # the motors stood, and move again; before the request, or it is lost
            self.halt = Halt(reason, None, True, self._now())

    def emergency_requested(self) -> bool:
        """Return whether the run is to end at once."""
        return self.halt is not None and self.halt.is_emergency

    def check(self) -> None:
        """Raise StoppedError if the run is to end."""
        if self.halt is not None:
            raise StoppedError(self.halt.reason)

    def note_frozen(self, report: StopReport) -> None:
        """Take that the first stage of the stop is over, or that of an emergency that came in between."""
        self.stopped = report
        self._frozen.set()

    def note_over(self, report: StopReport) -> None:
        """Take that the stop is done."""
        self.is_over = True
        self.note_frozen(report)

    def await_frozen(self, timeout_s: float) -> StopReport | None:
        """Return what is known of the stop when its first stage is over; None where that takes longer [s]."""
        return self.stopped if self._frozen.wait(timeout_s) else None
