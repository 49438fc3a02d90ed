"""Motors are put under power: from one known state, where they stand, with no more pull than the plan asks for."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from sinew.bench.guard import Guard, Watch
from sinew.bench.loop import WATCHDOG_S, Loop, at_zero
from sinew.bench.pretension import Contact, Held, pull_to_contact, refuse_wrong_drive_sign
from sinew.bench.recorder import Progress, Recorder
from sinew.hardware.bus import Clock
from sinew.hardware.configuration import prepare_goal
from sinew.hardware.motor import Motor
from sinew.hardware.rig import Rig
from sinew.measure import events
from sinew.measure.errors import LostError
from sinew.plan.plan import Plan
from sinew.plan.rig import LIMIT_RESERVE_N

_LEVER_HOME_S = 1.5
_BIAS_S = 0.5
_RESTS_SPREAD = math.radians(6.0)
_RESTS_S = 0.5
_RESTS_MOST_S = 10.0
_LOOK_S = 0.02


def await_rest(rig: Rig, clock: Clock, check: Callable[[], None]) -> None:
    """Wait until the head rests, ten seconds at most: what swings is taken for tilted, whatever its gyroscope's bias.

    check: raises where the wait is to end. Raises LostError where the head does not come to rest.
    """
    seen: deque[tuple[float, float, float]] = deque(maxlen=round(_RESTS_S / _LOOK_S))
    spread, end = math.inf, clock.now() + _RESTS_MOST_S
    while not spread < _RESTS_SPREAD:
        if clock.now() > end:
            if math.isinf(spread):
                raise LostError(
                    f"{len(seen)} readings of the IMU came within {_RESTS_MOST_S:.0f} s, expected "
                    f"{seen.maxlen} that tell whether the head rests; check its cable, then `sinew doctor`"
                )
            raise LostError(
                f"the head still turns to and fro by {math.degrees(spread):.1f} °/s after {_RESTS_MOST_S:.0f} s, "
                f"expected less than {math.degrees(_RESTS_SPREAD):g} °/s; let it come to rest, and start again"
            )
        check()
        clock.wait_until(clock.now() + _LOOK_S)
        imu = rig.read().imu
        if imu is not None:
            seen.append(imu.gyro)
        if len(seen) == seen.maxlen:
            spread = max(max(axis) - min(axis) for axis in zip(*seen, strict=True))


class Powering:
    """Puts a rig's motors under power for a plan, and bounds what those of the tendons may pull.

    held: by pretension [mm], what the twin has at rest. is_under_torque: whether any motor may be; one that never was
    is left without.
    """

    def __init__(self, rig: Rig, plan: Plan, held: Mapping[float, Held]) -> None:
        self._rig, self._plan, self._held = rig, plan, held
        self._mode = plan.pretension.mode
        self._swings = [group for group in plan.groups() if group.excitation != "lever"]  # of the tendons
        self.is_under_torque = False

    def set_known_state(self) -> None:
        """Bring every register that matters to what the run needs, whatever was there, while nothing has torque.

        Raises DeviceError, naming the register, where a motor holds or takes another.
        """
        tendons = self._rig.spec.tendons
        most = max((tension for held in self._held.values() for tension in held.tension_n), default=0.0)
        if self._mode == "position-with-current-limit":
            most += 2 * LIMIT_RESERVE_N  # on the way; then above what levelling left
        needed = tendons.current(1.0) * max(most, tendons.first_contact_tension.value)
        self._rig.configure(min(needed, self._rig.spec.limits.tendon_current_a))
        self._rig.set_tendon_mode("position-with-current-limit")

    def power_up(self, loop: Loop, guard: Guard, at: Progress, recorder: Recorder) -> Contact:
        """Put the motors under power where they are, pull to contact, bring the lever to zero, and set the plan's mode.

        Return the contact in the turns that the tendon motors count then. Raises what `Loop.cycle` does.
        """
        rig = self._rig
        loop.begin_steps()
        for motor in rig.motors:
            loop.step()
            prepare_goal(motor)
            self.is_under_torque = True
            _put_under_torque(motor)
        loop.step()
        angles = rig.stand()
        loop.watch = Watch(origin=angles, goals=angles)
        loop.restart()
        lever = rig.drive.angle()
        loop.restart()
        loop.lever = lambda _: lever  # it stays until the wiring of the tendons is known to be right
        at.state = "pulling the tendons"
        recorder.say(events.Pulled.of())
        contact = pull_to_contact(loop, rig)
        rates = [sample.gyro_rad_s[0] for sample in loop.run(_BIAS_S) if not math.isnan(sample.gyro_rad_s[0])]
        guard.gyro_bias = sum(rates) / len(rates) if rates else 0.0
        refuse_wrong_drive_sign(loop, rig.spec, lever, guard.gyro_bias)
        lever, begin, loop.lever = rig.drive.angle(), loop.due, at_zero
        loop.run(_LEVER_HOME_S, lambda time: lever * max(0.0, 1 - (time - begin) / _LEVER_HOME_S))
        recorder.say(events.Contact.of(current_ma=1e3 * contact.current))
        at.state = "changing the mode"
        return self._change_mode(loop, contact)

    def _change_mode(self, loop: Loop, contact: Contact) -> Contact:
        """Put the tendon motors into the plan's mode, one by one."""
        mode, angles = self._mode, list(contact.angles)
        if mode != "position-with-current-limit":
            loop.begin_steps()
            for index, motor in enumerate(self._rig.tendons):
                loop.step()
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
                _put_under_torque(motor)
            self._rig.set_tendon_mode(mode)
            loop.step()
        return Contact(tuple(angles), contact.current)

    def watch(self, loop: Loop, contact: Contact) -> None:
        """Have a loop watch the tendon motors from where they stand in the plan's mode."""
        goals, by_current = self._rig.stand(), self._mode == "current"
        goals = (contact.current,) * len(goals) if by_current else goals
        loop.watch = Watch(origin=contact.angles, goals=goals, by_current=by_current)
        loop.restart()

    def bound_for_change(self, loop: Loop, before_mm: float | None, pretension_mm: float, speed: float) -> None:
        """Set how hard the tendon motors may pull while the pretension changes to another [mm], at a speed [m/s].

        before_mm: the one that is set; None: first contact.
        """
        loop.watch.resting, loop.watch.share = False, None
        tendons = self._rig.spec.tendons
        if self._mode == "position-with-current-limit":
            self.limit_current(loop, [tendons.current(one) for one in self._held[pretension_mm].tension_n])
        elif self._mode == "position":
            self._bound_pull((before_mm, pretension_mm), speed)

    def bound_for_groups(self, *pretensions_mm: float) -> None:
        """Set how hard motors that hold positions may pull at some pretensions [mm] while the plan's groups run."""
        if self._mode == "position":
            driven = [1e-3 * one.amplitude_mm * math.tau * one.frequency_hz for one in self._swings]
            self._bound_pull(pretensions_mm, max((one for one in driven if not math.isnan(one)), default=0.0))

    def limit_current(self, loop: Loop, rest_a: Sequence[float]) -> None:
        """Have each tendon motor yield `LIMIT_RESERVE_N` above its current at rest [A], to the nearest count."""
        tendons = self._rig.spec.tendons
        lsb, reserve = tendons.current_lsb.value, tendons.current(LIMIT_RESERVE_N)
        loop.watch.limit = tuple(lsb * round((current + reserve) / lsb) for current in rest_a)
        for motor, limit in zip(self._rig.tendons, loop.watch.limit, strict=True):
            motor.limit_output(limit)

    def _bound_pull(self, pretensions_mm: Sequence[float | None], speed: float) -> None:
        """Bound by their duty what motors that hold positions pull, by the largest of some pretensions [mm].

        Such a motor goes on holding when its program is killed, for ever, so that what it may pull is set before. None:
        first contact. speed: with which cable is wound [m/s]; a motor that turns needs duty for that.
        """
        each = [self._most_pulls(mm) for mm in pretensions_mm]
        turning = speed / self._rig.spec.tendons.pulley_radius.value
        for motor, currents in zip(self._rig.tendons, zip(*each, strict=True), strict=True):
            motor.limit_output(max(currents) + motor.turning_current(turning))

    def _most_pulls(self, pretension_mm: float | None) -> list[float]:
        """Return the current [A] of each tendon's largest pull at a pretension [mm]; None: first contact.

        It is that at rest, and what the largest torsion that the rig allows, or tendons that the plan drives, add.
        """
        tendons, limits = self._rig.spec.tendons, self._rig.spec.limits
        held = self._held.get(pretension_mm) if pretension_mm is not None else None
        rest = (tendons.first_contact_tension.value,) * tendons.count if held is None else held.tension_n
        driven = max((group.amplitude_mm for group in self._swings), default=0.0)
        swing, shortened = math.radians(limits.torsion_deg), 1e-3 * (pretension_mm or 0.0)
        more = self._rig.spec.swing_pull(swing, 1e-3 * driven, shortened) + LIMIT_RESERVE_N
        return [tendons.current(min(tension + more, limits.tension_n)) for tension in rest]


def _put_under_torque(motor: Motor) -> None:
    """Put a motor under torque, its watchdog first: it counts from then on, and there is no moment without it."""
    motor.arm_watchdog(WATCHDOG_S)
    motor.torque_on()
