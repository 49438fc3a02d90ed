"""Checks of a bench before anything moves, and the reason for which a start is refused."""

import math
from collections.abc import Iterator, Sequence

from sinew.bench.doctor import STATE, examine_gravity, examine_state
from sinew.hardware.bus import Clock, Outcome, Reply
from sinew.hardware.imu import ImuReading
from sinew.hardware.motor import Motor
from sinew.hardware.rig import Rig, wire_s
from sinew.measure.errors import TROUBLES, PortError, StartError
from sinew.plan.plan import Plan, require_motors
from sinew.plan.rig import RigSpec

_LISTEN_S = 0.06
_ATTEMPTS = 3
_IMU_ATTEMPTS = 5
_LEANING = math.acos(0.9)


def refuse_unready(rig: Rig, clock: Clock, plan: Plan, *, torque_may_be_on: bool = False) -> None:
    """Raise StartError, with every reason found, if the bench is not ready to run a plan.

    Nothing moves and nothing is written. torque_may_be_on: a run that is resumed finds the motors as they were left.
    Raises SpecError for a plan whose head no motor of the bench moves so.
    """
    require_motors(plan, "the bench")
    _refuse_slow_bus(rig, plan)
    try:
        _refuse_strangers(rig, clock)
        held = plan.rest_pose.bend_rad if torque_may_be_on else 0.0
        reasons = [*_motor_reasons(rig, torque_may_be_on), *_imu_reasons(rig, clock, held)]
        reasons += [] if torque_may_be_on else _lever_reasons(rig)
    except PortError as trouble:
        raise StartError(str(trouble)) from trouble
    if reasons:
        raise StartError("; ".join(reasons))


MOST_ON_WIRE = 0.8
"""Share of a cycle that may be bytes on the wire."""


def wire_times(plan: Plan, rig: RigSpec) -> dict[str, float]:
    """Return how long a cycle of a plan is on the wire, and how long it may be [ms]."""
    return {
        "cycle_ms": round(1e3 * wire_s(rig, plan.pretension.mode), 3),
        "limit_ms": round(1e3 * MOST_ON_WIRE / plan.sample_hz, 3),
    }


def _refuse_slow_bus(rig: Rig, plan: Plan) -> None:
    """Refuse a sample rate that the bytes of a cycle alone do not allow."""
    if rig.wire_s > MOST_ON_WIRE / plan.sample_hz:
        raise StartError(
            f"a cycle needs {1e3 * rig.wire_s:.1f} ms on the wire at {rig.spec.wiring.baud} baud, the plan's "
            f"{plan.sample_hz:g} Hz leave {1e3 / plan.sample_hz:.1f} ms; raise the baud (rig key wiring.baud and the "
            "motors' baud_rate) or lower sample_hz"
        )


def _refuse_strangers(rig: Rig, clock: Clock) -> None:
    """Refuse a bus on which another program speaks, or a device is missing, or is another one, or shares its id."""
    if heard := rig.bus.overhear(_LISTEN_S):
        raise StartError(
            f"{heard} packets come on the line within {1e3 * _LISTEN_S:.0f} ms though nothing was sent: another "
            "program uses the bus; end it, or unplug its adapter"
        )
    names = {device.id: device.name for device in rig.devices}
    replies = {device: _pinged(rig, clock, device) for device in names}
    silent = [f"{names[d]} (id {d})" for d, reply in replies.items() if reply.outcome is Outcome.SILENT]
    baud = rig.spec.wiring.baud
    if len(silent) == len(names):
        raise StartError(
            f"no device answers at {baud} baud; check supply and cable, or another baud (`sinew doctor` looks at all)"
        )
    damaged = [f"{names[d]} (id {d})" for d, reply in replies.items() if reply.outcome is Outcome.DAMAGED]
    damaged += [f"{m.name} (id {m.id})" for m in rig.motors if replies[m.id].ok and _answers_damaged(rig, clock, m)]
    if damaged:
        missing = f" and none from {_listed(silent)}" if silent else ""
        raise StartError(
            f"damaged answers come from {_listed(damaged)}{missing}; two devices with one id answer at once and do "
            "that: unplug one and give it another id; else check cable and ground"
        )
    if silent:
        raise StartError(
            f"no answer from {_listed(silent)} at {baud} baud, but from the others; check cable, baud, and its id, "
            "which another device may have as well (its registers baud_rate, protocol_type and id)"
        )
    if others := list(_other_models(rig)):
        raise StartError("; ".join(others))


def _pinged(rig: Rig, clock: Clock, device: int) -> Reply:
    """Return the answer to a ping; without a whole one it is asked again later, for the computer may be busy."""
    reply = rig.bus.ping(device)
    for _ in range(_ATTEMPTS):
        if reply.outcome not in (Outcome.SILENT, Outcome.DAMAGED):
            break
        clock.wait_until(clock.now() + _LISTEN_S)
        reply = rig.bus.ping(device)
    return reply


def _answers_damaged(rig: Rig, clock: Clock, motor: Motor) -> bool:
    """Return whether a motor's present values come damaged more often than whole: twins of one id agree on a ping.

    What they say of the present is hardly ever the same. An answer that comes in pieces because the computer is busy
    looks damaged, too; hence the waits.
    """
    address, length = motor.table.block(("realtime_tick", "present_temperature"))
    damaged, enough = 0, _ATTEMPTS
    for attempt in range(1, 2 * enough):
        if rig.bus.read(motor.id, address, length).outcome is Outcome.DAMAGED:
            damaged += 1
            clock.wait_until(clock.now() + _LISTEN_S)
        if damaged == enough or attempt - damaged == enough:
            break
    return damaged == enough


def _other_models(rig: Rig) -> Iterator[str]:
    """Yield which devices are of another model than expected."""
    for device in rig.devices:
        try:
            device.identify()
        except TROUBLES as trouble:
            yield str(trouble)


def _motor_reasons(rig: Rig, torque_may_be_on: bool) -> Iterator[str]:
    """Yield what is wrong with the motors; the same at several of them is one reason."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for motor in rig.motors:
        try:
            counts = motor.get_counts(STATE)
        except TROUBLES as trouble:
            yield str(trouble)
            continue
        for one in examine_state(motor, counts, rig.spec.limits, torque_may_be_on=torque_may_be_on):
            if one.severity == "fault":
                found.setdefault((one.found, one.expected, one.advice), []).append(motor.name)
    for (what, expected, advice), names in found.items():
        who = "all motors" if len(names) == len(rig.motors) else _listed(names)
        yield f"{what} at {who}, expected {expected}; {advice}"


def _lever_reasons(rig: Rig) -> list[str]:
    """Return what is wrong with where the lever stands. A motor left in a mode of many turns counts them until it
    starts anew or changes its mode; the place within its turn is what stays."""
    # No run leaves it further from its middle than it may swing: what stands there has another middle, or was turned.
    limits, drive = rig.spec.limits, rig.drive
    window, key = min(
        (limits.drive_window_deg, "drive_window_deg"), (limits.drive_amplitude_deg, "drive_amplitude_deg")
    )
    try:
        angle = math.degrees(math.remainder(drive.angle(), math.tau))
    except TROUBLES as trouble:
        return [str(trouble)]
    if abs(angle) <= window:
        return []
    return [
        f"the lever stands {angle:.0f}° from its middle, expected within {window:g}° ({key}); turn it back by "
        "hand, or correct wiring.drive_zero_counts"
    ]


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _imu_reasons(rig: Rig, clock: Clock, held: float) -> Iterator[str]:
    """Yield what is wrong with the IMU: silent, frozen, or not mounted as the rig says.

    held: bend [rad] in which motors under torque may have been left."""
    first = _imu_reading(rig)
    clock.wait_until(clock.now() + _LISTEN_S)
    second = _imu_reading(rig)
    if first is None or second is None:
        why = f": {rig.imu.objection}" if rig.imu.objection else ""
        yield f"the IMU answers a ping but gives no readings{why}; `sinew doctor` says more"
        return
    if first.counter == second.counter:
        yield f"the IMU repeats one sample for {1e3 * _LISTEN_S:.0f} ms; restart its board"
    for finding in examine_gravity(second.acceleration, rig.spec.wiring.imu_axes, _LEANING + held):
        yield f"{finding.subject}: {finding.found}, expected {finding.expected}; {finding.advice}"


def _imu_reading(rig: Rig) -> ImuReading | None:
    """Return a reading of the IMU; a single one may come late on a busy computer."""
    return next((imu for imu in (rig.read().imu for _ in range(_IMU_ATTEMPTS)) if imu is not None), None)
