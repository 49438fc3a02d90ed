"""The state in which a motor begins a run: every register that matters, what it must hold, and how it is brought there.

`KNOWN_STATE` is the one table of it. A start brings every motor to it whatever was there, after a change of mode once
more, for that resets gains, profiles and goals on the motor, while the same mode written again resets nothing. What
outlives a loss of power is written only where it differs, since that memory wears out; the rest is written each time.
All is read back, and what was read is kept in `Motor.kept`, which a run compares with the motors later. The doctor
reads the same table.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from sinew.hardware.motor import DriveServo, Motor, TendonServo
from sinew.hardware.registers import CURRENT_MODE, SHUTDOWN
from sinew.measure.errors import DeviceError
from sinew.plan.rig import RigSpec
from sinew.plan.servo import COUNTS_PER_TURN, FULL_DUTY_COUNTS, SERVOS

NO_SECOND_ID = 253
"""From here on a shadow id stands for none."""

_ROUNDING = 1e-6

Rule = Literal["exactly", "at most", "at least", "with these bits", "refused unless", "refused below", "refused above"]
"""What a register may hold beside what is wanted; a run writes none of the refused ones."""


@dataclass(frozen=True, slots=True)
class Post:
    """A motor and what it is to do: in which rig, in which mode (register operating_mode), by how much current [A].

    needed_a: the largest current that the run will ask of it.
    """

    motor: Motor
    spec: RigSpec
    mode: int
    needed_a: float = 0.0

    @property
    def is_drive(self) -> bool:
        """Whether it swings the lever; else it pulls a tendon."""
        return isinstance(self.motor, DriveServo)

    @property
    def most_a(self) -> float:
        """The largest current that the rig allows it [A]."""
        limits = self.spec.limits
        return limits.drive_current_a if self.is_drive else limits.tendon_current_a

    def counts(self, register: str, quantity: float, rounding: Callable[[float], float] = math.floor) -> int:
        """Return a quantity in whole counts of a register."""
        return int(rounding(quantity / self.motor.table[register].scale + _ROUNDING))

    def initial(self, register: str) -> int:
        """Return what a register holds from the factory."""
        count = self.motor.table[register].initial
        assert count is not None, f"{register} has no value from the factory"
        return count

    def position_gain(self) -> int:
        """Return the P gain of the position loop as the twin has it.

        The drive's is the rig's `position_gain`, in duty per radian; a tendon motor's is the one that belongs to the
        rig's `servo_stiffness`: that of its model.
        """
        table = self.motor.table
        if not self.is_drive:
            return SERVOS[table.model].position_gain_counts
        per_count = self.spec.drive.position_gain.value * table["goal_position"].scale * FULL_DUTY_COUNTS
        return round(per_count / table["position_p_gain"].scale)

    def full_duty(self) -> int:
        """Return the limit of the duty: of the drive the rig's `duty_limit`, else all."""
        share = self.spec.drive.duty_limit.value if self.is_drive else 1.0
        return min(self.initial("pwm_limit"), round(share * FULL_DUTY_COUNTS))

    def needed_duty(self) -> int | None:
        """Return the duty that drives the largest current asked of a tendon motor at rest; None where none is asked."""
        if not self.needed_a or not isinstance(self.motor, TendonServo):
            return None
        return self.counts("goal_pwm", self.motor.standstill_duty(self.needed_a), math.ceil)

    def window(self, end: Literal["min_position_limit", "max_position_limit"]) -> int:
        """Return the end of what the drive may be told; a tendon motor's modes have no such ends."""
        drive = self.motor
        if not isinstance(drive, DriveServo):
            return self.initial(end)
        return drive.lowest_count if end == "min_position_limit" else drive.highest_count


@dataclass(frozen=True, slots=True)
class Row:
    """A register that matters to a run.

    wanted: what it is to hold in a post; None where it does not matter there. rule: what else it may hold. why: a run
    needs that. is_goal: every stop leaves another there, so the doctor is silent on it. advice: where it is refused.
    """

    register: str
    wanted: Callable[[Post, Mapping[str, int]], int | None]
    why: str
    rule: Rule = "exactly"
    is_goal: bool = False
    advice: str = ""

    @property
    def is_refused(self) -> bool:
        """Whether a run refuses a wrong value instead of writing the right one."""
        return self.rule.startswith("refused")

    def target(self, post: Post, counts: Mapping[str, int]) -> int | None:
        """Return what the register is to hold, given what the motor holds: a stricter limit stays."""
        wanted, found = self.wanted(post, counts), counts[self.register]
        if wanted is None:
            return None
        if self.rule in ("at most", "refused above"):
            return min(found, wanted)
        if self.rule in ("at least", "refused below"):
            return max(found, wanted)
        return found | wanted if self.rule == "with these bits" else wanted


def _initial(register: str) -> Callable[[Post, Mapping[str, int]], int | None]:
    return lambda post, _: post.initial(register)


def _is(count: int) -> Callable[[Post, Mapping[str, int]], int | None]:
    return lambda _post, _counts: count


def _needed(post: Post, _: Mapping[str, int]) -> int | None:
    return post.counts("current_limit", post.needed_a, math.ceil) if post.needed_a else None


def _drive_only(register: Literal["min_position_limit", "max_position_limit"]) -> Callable[..., int | None]:
    return lambda post, _: post.window(register) if post.is_drive else None


_RAISE = "raise this limit with the maker's Wizard if the laboratory allows it"
_WIDEN = (
    "make the rig's drive_window_deg smaller, or widen this limit: `sinew doctor --fix` does where a run has set it, "
    "the maker's Wizard where the laboratory has"
)

KNOWN_STATE: tuple[Row, ...] = (
    Row("return_delay_time", _is(0), "answers come at once, and their time is known"),
    Row("drive_mode", _is(0), "no reversal, no profile by time, no torque by a goal"),
    Row("operating_mode", lambda post, _: post.mode, "the loop that the twin has"),
    Row(
        "shadow_id",
        _is(NO_SECOND_ID),
        "it obeys nobody's orders but its own",
        "refused below",
        advice="a motor with a second id obeys orders to another; `sinew doctor --fix` takes it away",
    ),
    Row(
        "protocol_type",
        _is(2),
        "it hears the bus's protocol",
        "refused unless",
        advice="set it to 2: the bus speaks Protocol 2.0",
    ),
    Row(
        "homing_offset",
        _is(0),
        "it stands still when its bus watchdog stops it",
        "refused unless",
        advice="with one the motor moves when its bus watchdog stops it; `sinew doctor --fix` removes it",
    ),
    Row("moving_threshold", _initial("moving_threshold"), "as from the factory"),
    Row(
        "temperature_limit",
        lambda post, _: post.counts("temperature_limit", post.spec.limits.temperature_c),
        "it shuts down where the rig ends",
        "at most",
    ),
    Row(
        "max_voltage_limit",
        lambda post, _: post.counts("max_voltage_limit", post.spec.limits.voltage_v[1]),
        "it reports a supply that the rig does not allow",
        "at most",
    ),
    Row(
        "min_voltage_limit",
        lambda post, _: post.counts("min_voltage_limit", post.spec.limits.voltage_v[0] - 2e-6, math.ceil),
        "it reports a supply that the rig does not allow",
        "at least",
    ),
    Row(
        "pwm_limit",
        lambda post, _: post.full_duty() if post.is_drive else None,
        "the drive's ceiling is the twin's; less measures another rig",
        "refused below",
        advice=f"lower the rig's drive.duty_limit to it, or {_RAISE}",
    ),
    Row(
        "pwm_limit",
        lambda post, _: None if post.is_drive else post.needed_duty(),
        "it pulls as much as the plan asks",
        "refused below",
        advice=f"lower the plan's pretension, or {_RAISE}",
    ),
    Row("pwm_limit", lambda post, _: post.full_duty(), "the drive's ceiling is the twin's", "at most"),
    Row(
        "current_limit",
        _needed,
        "it pulls as much as the plan asks",
        "refused below",
        advice="lower the plan's pretension, or raise this limit up to the rig's",
    ),
    Row(
        "current_limit",
        lambda post, _: post.counts("current_limit", post.most_a),
        "no more than the rig allows",
        "at most",
    ),
    Row("velocity_limit", _initial("velocity_limit"), "as from the factory; no mode of a run uses it", "at most"),
    Row(
        "max_position_limit",
        _drive_only("max_position_limit"),
        "goals within the rig's window are heard",
        "refused below",
        advice=_WIDEN,
    ),
    Row(
        "min_position_limit",
        _drive_only("min_position_limit"),
        "goals within the rig's window are heard",
        "refused above",
        advice=_WIDEN,
    ),
    Row("max_position_limit", _drive_only("max_position_limit"), "goals beyond the rig's window are not", "at most"),
    Row("min_position_limit", _drive_only("min_position_limit"), "goals beyond the rig's window are not", "at least"),
    Row("startup_configuration", _is(0), "after a start it has no torque, and its registers as from the factory"),
    Row("shutdown", _is(SHUTDOWN), "heat, shock and overload take its torque", "with these bits"),
    Row("velocity_i_gain", _initial("velocity_i_gain"), "as from the factory"),
    Row("velocity_p_gain", _initial("velocity_p_gain"), "as from the factory"),
    Row("position_d_gain", _is(0), "the twin's loop is proportional"),
    Row("position_i_gain", _is(0), "the twin's loop is proportional"),
    Row("position_p_gain", lambda post, _: post.position_gain(), "the twin's gain"),
    Row("feedforward_2nd_gain", _is(0), "the twin's loop has none"),
    Row("feedforward_1st_gain", _is(0), "the twin's loop has none"),
    Row("bus_watchdog", _is(0), "off until there is torque; writing 0 clears one that has tripped", is_goal=True),
    Row(
        "goal_pwm",
        lambda post, counts: min(post.full_duty(), counts["pwm_limit"]),
        "every stop leaves a fraction there",
        is_goal=True,
    ),
    Row(
        "goal_current",
        lambda post, counts: 0 if post.mode == CURRENT_MODE else counts["current_limit"],
        "every stop leaves another limit, or a pull, there",
        is_goal=True,
    ),
    Row("goal_velocity", _is(0), "nothing turns by itself", is_goal=True),
    Row("profile_acceleration", _is(0), "goals are taken at once"),
    Row("profile_velocity", _is(0), "goals are taken at once"),
)
"""Every register that a run depends on, by increasing address; one may have two rows, of different rules.

Goals that a run itself tells are not here: before the torque comes on, `prepare_goal` puts goal_position where the horn
stands. Not looked at: id and baud (who has others does not answer), LED, indirect addresses (the bench uses none).
"""

_REGISTERS = tuple(dict.fromkeys(row.register for row in KNOWN_STATE))
_IDENTITY = ("model_number", "firmware_version")
_STATE = ("torque_enable", "status_return_level")
_JUMP_COUNTS = 3  # a horn at rest may flicker between two counts


@dataclass(frozen=True, slots=True)
class Setting:
    """A register that is not as the bench wants it: counts found, and counts expected.

    is_refused: a run refuses it instead of writing what is expected. advice: what to do then.
    """

    register: str
    found: int
    expected: int
    is_refused: bool = False
    advice: str = ""


def may_be_widened(motor: Motor, register: str, counts: Mapping[str, int]) -> bool:
    """Return whether Sinew may write a register that a run refuses, given what the motor holds.

    Limits belong to the laboratory, and a stricter one stays. Only the drive's window of position, as wide as the rig's
    or cut off by the end of the turn, is what a run about this middle or another has left there.
    """
    if not register.endswith("_limit"):
        return True
    if not isinstance(motor, DriveServo) or not register.endswith("position_limit"):
        return False
    low, high = counts["min_position_limit"], counts["max_position_limit"]
    is_cut = low == 0 or high == COUNTS_PER_TURN - 1
    return high - low == 2 * motor.reach or (is_cut and high - low < 2 * motor.reach)


def registers_read(motor: Motor) -> tuple[str, ...]:
    """Return the names of the registers that are read back, by increasing address."""
    names = (*_IDENTITY, *_REGISTERS, *_STATE)
    return tuple(sorted(names, key=lambda name: motor.table[name].address))


def read_counts(motor: Motor) -> dict[str, int]:
    """Return what all registers that matter hold, and model, firmware and torque; one read. Raises DeviceError."""
    return motor.get_counts(registers_read(motor))


def unfit_settings(post: Post, counts: Mapping[str, int], *, goals: bool = False) -> list[Setting]:
    """Return what is not as a run needs it, by address. goals: with those that every stop leaves."""
    settings = []
    for row in KNOWN_STATE:
        target = row.target(post, counts)
        if target is not None and target != counts[row.register] and (goals or not row.is_goal):
            settings.append(Setting(row.register, counts[row.register], target, row.is_refused, row.advice))
    return settings


def refuse_unfit(post: Post) -> dict[str, int]:
    """Return what a motor holds. Raises DeviceError, naming the register, where a run must not overwrite that."""
    counts = read_counts(post.motor)
    refused = [setting for setting in unfit_settings(post, counts) if setting.is_refused]
    if refused:
        raise DeviceError("; ".join(_refusal(post.motor, setting) for setting in refused))
    return counts


def bring_to_known_state(post: Post) -> dict[str, int]:
    """Bring a motor whose torque is off to the known state of its post, read it back, and return what it holds.

    What outlives a loss of power goes first, and is right before any goal is written: a motor that takes torque by a
    goal must not. Raises DeviceError, naming the register: one that is refused, or one that the motor did not take.
    """
    motor = post.motor
    counts = refuse_unfit(post)
    if counts["torque_enable"]:
        motor.require_torque_off("to be set up")
    motor.kept.clear()
    for setting in unfit_settings(post, counts):
        if motor.table[setting.register].address < motor.table.eeprom_stop:
            motor.ensure_count(setting.register, setting.expected)
    counts = read_counts(motor)
    for block in _blocks(post, counts):
        motor.set_counts(block)
    counts = read_counts(motor)
    if wrong := unfit_settings(post, counts, goals=True):
        raise DeviceError("; ".join(_not_taken(motor, setting) for setting in wrong))
    motor.kept.update({name: counts[name] for name in _REGISTERS} | {"torque_enable": 0})
    return counts


def _blocks(post: Post, counts: Mapping[str, int]) -> list[dict[str, int]]:
    """Return what is to be written each time, in pieces without a gap: while a motor without torque is set up, no
    other is told anything."""
    table, blocks, stop = post.motor.table, list[dict[str, int]](), -1
    for row in KNOWN_STATE:
        target, register = row.target(post, counts), table[row.register]
        if target is None or register.address < table.eeprom_stop:
            continue
        if register.address != stop:
            blocks.append({})
        blocks[-1][row.register], stop = target, register.stop
    return blocks


def prepare_goal(motor: Motor) -> None:
    """Have a motor without torque, in a mode that goes to positions, begin from where it stands; the goal is read back.

    Raises DeviceError, naming the register, where it keeps another: it would jump when its torque comes on.
    """
    row, present = motor.table["goal_position"], motor.state()["present_position"]
    if isinstance(motor, DriveServo) and not motor.lowest_count <= present <= motor.highest_count:
        return  # it takes no goal out there, and sets its own as the torque comes on
    motor.set_count("goal_position", present)
    if abs((found := motor.get_count("goal_position")) - present) > _JUMP_COUNTS:
        jump = math.degrees((found - present) * row.scale)
        raise DeviceError(
            f"{motor.name} (id {motor.id}) has {found} in goal_position after {present}, where it stands, was written: "
            f"it would jump by {jump:.0f}° as its torque comes on; is other software using it?"
        )


def changed_registers(motor: Motor, counts: Mapping[str, int], but: Sequence[str] = ()) -> list[str]:
    """Return what is no longer as the run left it, a clause for each register. but: registers that may change."""
    return [
        f"{name} of {motor.name} (id {motor.id}) reads {counts[name]}, {kept} when the run set it"
        for name, kept in motor.kept.items()
        if name in counts and name not in but and counts[name] != kept
    ]


def answer_everything(motor: Motor) -> None:
    """Have a motor answer reads and writes. Raises DeviceError if it does not."""
    row = motor.table["status_return_level"]
    if motor.bus.read(motor.id, row.address, row.size).data != b"\x02":
        # One that answers only pings, or only reads, says nothing to this either.
        motor.bus.write(motor.id, row.address, b"\x02", retries=0)
    motor.ensure_count("status_return_level", 2)


def _refusal(motor: Motor, setting: Setting) -> str:
    return (
        f"{motor.name} (id {motor.id}) has {_text(motor, setting.register, setting.found)} in {setting.register}, "
        f"expected {_text(motor, setting.register, setting.expected)}; {setting.advice}"
    )


def _not_taken(motor: Motor, setting: Setting) -> str:
    return (
        f"{motor.name} (id {motor.id}) has {setting.found} in {setting.register} after {setting.expected} was written, "
        "expected it to keep that; is other software using it, or are there two devices with this id?"
    )


def _text(motor: Motor, register: str, count: int) -> str:
    row = motor.table[register]
    return (
        f"{count}" if row.unit == "1" else f"{count} counts ({count * row.scale:.4g} {row.unit.replace('degC', '°C')})"
    )
