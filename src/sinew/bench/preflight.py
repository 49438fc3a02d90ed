"""This is where a bench is looked at before anything moves, and a start is refused with a reason."""

import math
from collections.abc import Iterator

from sinew.bench.errors import StartError
from sinew.hardware.errors import HardwareError, PortError
from sinew.hardware.motor import Motor
from sinew.hardware.reply import Outcome
from sinew.hardware.rig import Rig
from sinew.hardware.transport import Clock
from sinew.plan.plan import Plan

__all__ = ["refuse_unready"]

_LISTEN_S = 0.06
_ATTEMPTS = 3
_GRAVITY = 9.80665
_GRAVITY_TOLERANCE = 0.1
_UPRIGHT_SHARE = 0.9


def refuse_unready(rig: Rig, clock: Clock, plan: Plan, *, torque_may_be_on: bool = False) -> None:
    """Raise StartError, with every reason found, if the bench is not ready to run a plan.

    Nothing moves and nothing is written. torque_may_be_on: a run that is resumed finds the motors as they were left.
    """
    _refuse_slow_bus(rig, plan)
    _refuse_strangers(rig)
    reasons = [reason for motor in rig.motors for reason in _motor_reasons(rig, motor, torque_may_be_on)]
    reasons += _imu_reasons(rig, clock)
    if reasons:
        raise StartError("; ".join(reasons))


def _refuse_slow_bus(rig: Rig, plan: Plan) -> None:
    """Refuse a sample rate that the bytes of a cycle alone do not allow."""
    needed = rig.cycle_bytes * 10 / rig.spec.wiring.baud
    if needed > 0.8 / plan.sample_hz:
        raise StartError(
            f"a cycle needs {1e3 * needed:.1f} ms on the wire at {rig.spec.wiring.baud} baud, the plan's "
            f"{plan.sample_hz:g} Hz leave {1e3 / plan.sample_hz:.1f} ms; raise the baud (rig key wiring.baud and the "
            "motors' baud_rate) or lower sample_hz"
        )


def _refuse_strangers(rig: Rig) -> None:
    """Refuse a bus on which a device is missing, or is another one, or shares its id."""
    names = {**{motor.id: motor.name for motor in rig.motors}, rig.imu.id: "IMU"}
    try:
        replies = {device: rig.bus.ping(device) for device in names}
    except PortError as trouble:
        raise StartError(str(trouble)) from trouble
    silent = [f"{names[d]} (id {d})" for d, reply in replies.items() if reply.outcome is Outcome.SILENT]
    baud = rig.spec.wiring.baud
    if len(silent) == len(names):
        raise StartError(
            f"no device answers at {baud} baud; check supply and cable, or another baud (`sinew doctor` looks at all)"
        )
    damaged = [f"{names[d]} (id {d})" for d, reply in replies.items() if reply.outcome is Outcome.DAMAGED]
    damaged += [f"{m.name} (id {m.id})" for m in rig.motors if replies[m.id].ok and _answers_damaged(rig, m)]
    if damaged:
        raise StartError(
            f"{', '.join(damaged)} answers in damaged packets; two devices with one id answer at once and do that: "
            "unplug one and give it another id; else check cable and ground"
        )
    if silent:
        raise StartError(f"{', '.join(silent)} does not answer at {baud} baud, the others do; check id, cable, baud")
    for identify in (*(motor.identify for motor in rig.motors), rig.imu.identify):
        try:
            identify()
        except HardwareError as trouble:
            raise StartError(str(trouble)) from trouble


def _answers_damaged(rig: Rig, motor: Motor) -> bool:
    """Return whether a motor's present values come damaged again and again: twins of one id agree on a ping."""
    address, length = motor.table.block(("realtime_tick", "present_temperature"))
    return all(rig.bus.read(motor.id, address, length).outcome is Outcome.DAMAGED for _ in range(_ATTEMPTS))


def _motor_reasons(rig: Rig, motor: Motor, torque_may_be_on: bool) -> Iterator[str]:
    limits = rig.spec.limits
    try:
        if errors := motor.hardware_errors():
            yield f"{motor.name} reports {' and '.join(errors)}; find the cause, then reboot it (`sinew doctor --fix`)"
        if motor.torque_is_on() and not torque_may_be_on:
            yield (
                f"torque is on at {motor.name}: another program may be using it; end that, or `sinew stop`, "
                "or go on with an interrupted run by --resume"
            )
        temperature, voltage = motor.get("present_temperature"), motor.get("present_input_voltage")
        if temperature > limits.temperature_c:
            yield f"{motor.name} has {temperature:.0f} °C, the rig allows {limits.temperature_c:g}; let it cool"
        low, high = limits.voltage_v
        if not low <= voltage <= high:
            yield f"{motor.name} is fed {voltage:.1f} V, the rig expects {low:g} to {high:g}; set the supply"
        if motor.get_count("homing_offset") != 0:
            yield (
                f"{motor.name} has a homing offset, and with it the firmware moves the motor when its bus watchdog "
                "trips; set it to 0 (`sinew doctor --fix`)"
            )
    except HardwareError as trouble:
        yield str(trouble)


def _imu_reasons(rig: Rig, clock: Clock) -> Iterator[str]:
    """Yield what is wrong with the IMU: silent, frozen, or not mounted as the rig says."""
    first = rig.read().imu
    clock.wait_until(clock.now() + _LISTEN_S)
    second = rig.read().imu
    if first is None or second is None:
        yield "the IMU answers a ping but gives no readings; `sinew doctor` says more"
        return
    if first.counter == second.counter:
        yield f"the IMU repeats one sample for {1e3 * _LISTEN_S:.0f} ms; restart its board"
    size = math.hypot(*second.acceleration)
    if abs(size / _GRAVITY - 1) > _GRAVITY_TOLERANCE:
        yield f"the IMU reads {size:.2f} m/s² at rest, expected 9.81; is the joint moving, or is it another sensor?"
    elif second.acceleration[0] < _UPRIGHT_SHARE * size:
        yield (
            f"the IMU reads {second.acceleration[0]:.2f} m/s² along the joint, expected about 9.81 with the rig "
            "upright; set wiring.imu_axes to how the board is mounted"
        )
