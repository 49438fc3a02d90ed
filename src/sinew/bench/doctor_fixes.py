"""This is where the doctor puts right what he found: only safe settings, only with the torque off, and read back."""

from collections.abc import Iterable, Sequence

from sinew.bench.finding import Finding, Fix
from sinew.hardware.configuration import answer_everything
from sinew.hardware.errors import DeviceError, HardwareError, PortError
from sinew.hardware.latency_timer import LatencyTimer
from sinew.hardware.motor import Motor
from sinew.hardware.rig import Rig
from sinew.hardware.transport import Clock

__all__ = ["apply_fixes", "list_fixes"]

_REBOOT_S = 1.0
# What makes a motor answer, then what makes it listen, then the rest.
_FIRST = ("status_return_level", "reboot", "bus_watchdog")


def list_fixes(findings: Iterable[Finding]) -> list[Fix]:
    """Return what the doctor could write, in the order in which it has to be."""
    fixes = [finding.fix for finding in findings if finding.fix is not None]
    return sorted(fixes, key=lambda fix: _FIRST.index(fix.register) if fix.register in _FIRST else len(_FIRST))


def apply_fixes(rig: Rig, clock: Clock, fixes: Sequence[Fix], timer: LatencyTimer | None = None) -> list[Finding]:
    """Write settings and read them back; return a finding for each: ok, or a warning that says why not.

    A motor whose torque is on is left as it is. timer: of the port's adapter. Raises PortError if the port is gone.
    """
    motors = {motor.name: motor for motor in rig.motors}
    return [_apply(rig, clock, fix, motors.get(fix.device), timer) for fix in fixes]


def _apply(rig: Rig, clock: Clock, fix: Fix, motor: Motor | None, timer: LatencyTimer | None) -> Finding:
    try:
        if motor is not None:
            _apply_to_motor(rig, clock, fix, motor)
        elif timer is not None:
            _set_timer(timer, fix.wanted)
    except PortError as trouble:
        if motor is not None:
            raise
        return Finding("warning", fix.device, str(trouble), str(fix.wanted))
    except HardwareError as trouble:
        return Finding("warning", fix.device, str(trouble), f"{fix.register} {fix.wanted}")
    return Finding("ok", fix.device, f"{fix.register} is {fix.wanted} now" if fix.register != "reboot" else "rebooted")


def _apply_to_motor(rig: Rig, clock: Clock, fix: Fix, motor: Motor) -> None:
    if fix.register == "status_return_level":
        answer_everything(motor)
        return
    motor.require_torque_off(f"to write {fix.register}" if fix.register != "reboot" else "to be rebooted")
    if fix.register == "reboot":
        _reboot(rig, clock, motor)
    elif fix.register == "bus_watchdog":
        motor.disarm_watchdog()
    else:
        motor.ensure_count(fix.register, fix.wanted)


def _reboot(rig: Rig, clock: Clock, motor: Motor) -> None:
    reply = rig.bus.reboot(motor.id)
    if not reply.ok:
        raise DeviceError(f"{motor.name} did not reboot: {reply}; switch its supply off and on")
    clock.wait_until(clock.now() + _REBOOT_S)
    rig.forget()
    if errors := motor.hardware_errors():
        raise DeviceError(
            f"{motor.name} still reports {', '.join(errors)} after a reboot, expected nothing; replace it"
        )


def _set_timer(timer: LatencyTimer, wanted: int) -> None:
    timer.write(wanted)
    if (found := timer.read()) != wanted:
        raise PortError(f"{timer.path} is {found} after {wanted} was written; expected {wanted} ms")
