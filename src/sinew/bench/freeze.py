"""This is where all motors are told at once to stay where they are: the first stage of every stop.

One packet asks all of them how they run, one tells all of them to stay, one asks whether they do; who did not hear is
told again, and holds up nobody. A tendon motor keeps its goal, as far as that is within reach of the pull that it has,
so that no tension jumps; one that holds a current goes on holding it. The drive stays where its lever is: with the
winding closed it brakes, where a lever without torque would go on swinging by up to 115° (docs/decisions/0020).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sinew.hardware.instructions import Read
from sinew.hardware.layout import lay_out
from sinew.hardware.motor import Motor
from sinew.hardware.motor_registers import CURRENT_MODE, CURRENT_POSITION_MODE, WATCHDOG_TRIPPED
from sinew.hardware.registers import encode_raw
from sinew.hardware.rig import Rig
from sinew.hardware.servos import TendonServo
from sinew.hardware.transport import Clock

__all__ = ["DRIVE_HOLD_SHARE", "FREEZE_MOST_S", "TENDON_HOLD_SHARE", "Frozen", "freeze", "freeze_alone"]

FREEZE_MOST_S = 0.12
"""A motor that has not confirmed by then is left to what follows [s]."""

TENDON_HOLD_SHARE = 0.8
"""Current that a frozen tendon motor may draw, of the rig's limit: what held the tendon must go on holding it."""

DRIVE_HOLD_SHARE = 0.2
"""Output of a frozen drive, of its full one."""

_GOALS = ("goal_pwm", "goal_current", "goal_velocity", "profile_acceleration", "profile_velocity", "goal_position")
_ASKED = (
    "operating_mode", "pwm_limit", "current_limit", "velocity_limit", "torque_enable", "bus_watchdog",
    *_GOALS, "present_current", "present_position",
)  # fmt: skip

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
    frozen, told = Frozen(), dict[str, Counts]()
    pending: Sequence[Motor] = rig.motors
    while pending and clock.now() - start < FREEZE_MOST_S:
        found = _ask(rig, pending)
        there = {motor.name for motor in pending if motor.name in found and _stays(found[motor.name], told, motor)}
        if there:
            frozen.names |= there
            frozen.took_s = clock.now() - start
        pending = [motor for motor in pending if motor.name not in there]
        told |= {
            m.name: _acceptable(found[m.name] | _standing(rig, m, found[m.name])) for m in pending if m.name in found
        }
        _tell(rig, [motor for motor in pending if motor.name in told], told)
    return frozen


def freeze_alone(rig: Rig, motor: Motor) -> None:
    """Have one motor stay where it is with limited output. Raises DeviceError, PortError."""
    goals = _standing(rig, motor, motor.get_counts(_ASKED))
    for name in sorted(goals, key=lambda name: name != "goal_position"):
        motor.set_count(name, goals[name])


def _ask(rig: Rig, motors: Sequence[Motor]) -> dict[str, Counts]:
    """Return the registers of those motors that answer, by name."""
    layouts = {motor.id: lay_out(motor.table, _ASKED) for motor in motors}
    replies = rig.bus.bulk_read([Read(id_, lay.address, lay.length) for id_, lay in layouts.items()], retries=0)
    return {
        motor.name: dict(zip(_ASKED, layouts[motor.id].unpack.unpack(replies[motor.id].data), strict=True))
        for motor in motors
        if replies[motor.id].ok
    }


def _stays(found: Counts, told: Mapping[str, Counts], motor: Motor) -> bool:
    if not found["torque_enable"] or found["bus_watchdog"] == WATCHDOG_TRIPPED:
        return True
    return motor.name in told and all(found[name] == told[motor.name][name] for name in _GOALS)


def _tell(rig: Rig, motors: Sequence[Motor], told: Mapping[str, Counts]) -> None:
    if motors:
        data = {m.id: b"".join(encode_raw(m.table[name], told[m.name][name]) for name in _GOALS) for m in motors}
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
        return {"goal_pwm": _most(motor, "goal_pwm", DRIVE_HOLD_SHARE, counts["pwm_limit"]), "goal_position": goal}
    hold = TENDON_HOLD_SHARE * rig.spec.limits.tendon_current_a
    limits = {
        "goal_pwm": _most(motor, "goal_pwm", motor.standstill_duty(hold), counts["pwm_limit"]),
        "goal_current": _most(motor, "goal_current", hold, counts["current_limit"]),
    }
    mode, asked = counts["operating_mode"], counts["goal_current"]
    pull = max(0, motor.sign * counts["present_current"])
    if mode == CURRENT_MODE:  # one whose cable is off draws next to nothing, and would run on
        return limits | {"goal_current": motor.sign * min(max(0, motor.sign * asked), pull, limits["goal_current"])}
    by_current = mode == CURRENT_POSITION_MODE
    unit = motor.table["present_current"].scale
    in_force = min(asked * unit, hold) if by_current else hold
    ahead = motor.sign * (counts["goal_position"] - present)
    give = _give(rig, motor, min(in_force, (_MARGIN * pull + _UNSURE) * unit))
    goals = {"goal_position": present + motor.sign * max(0, min(ahead, give))}
    if not by_current:
        return goals | {"goal_pwm": limits["goal_pwm"]}
    # One that pulls at its limit, on its way to a goal far ahead, would jerk if the limit were wider for a moment.
    return goals | {"goal_current": limits["goal_current"] if ahead <= give else asked}


def _most(motor: Motor, register: str, quantity: float, limit: int) -> int:
    return int(min(quantity / motor.table[register].scale + 1e-6, limit))


def _give(rig: Rig, motor: Motor, current: float) -> int:
    """Return by how many counts the goal of a tendon motor is ahead of its horn where it pulls with a current [A]."""
    tendons = rig.spec.tendons
    radius = tendons.pulley_radius.value
    angle = current * tendons.torque_constant.value / radius / tendons.servo_stiffness.value / radius
    return int(angle / motor.table["goal_position"].scale) + 1
