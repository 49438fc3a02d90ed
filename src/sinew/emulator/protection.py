"""This is where a motor grows warm, and notices that it is too warm, overloaded or badly fed.

The manual says what is detected, not how. Assumed: first-order heating by I²R of the winding, whose resistance is
nominal voltage over stall current; 6 K/W to surroundings of 25 °C with a time constant of 300 s, so that an
XH430-W350 may carry 0.99 A for ever and is shut down 4.4 min into a stall at 12 V; overload where the current
stays at 80 % of the stall current or more for 1 s. The voltage's bit follows the voltage unless it is in the shutdown
mask; all others stay until the motor starts anew.
"""

from dataclasses import dataclass

from sinew.plan.servo import SERVOS

__all__ = ["ELECTRICAL_SHOCK", "ENCODER", "OVERHEATING", "OVERLOAD", "PERIOD", "STALL_CURRENT", "VOLTAGE", "Protection"]

VOLTAGE, OVERHEATING, ENCODER, ELECTRICAL_SHOCK, OVERLOAD = 0x01, 0x04, 0x08, 0x10, 0x20
"""Bits of the registers hardware_error_status and shutdown."""
PERIOD = 0.05
"""How often a motor looks after itself [s]."""
STALL_CURRENT = {1000: SERVOS["XH430-W350"].stall_current, 1020: SERVOS["XM430-W350"].stall_current}
"""By model number, at 12 V [A]; data sheets of XH430-W350 and XM430-W350."""

_AMBIENT, _PER_WATT, _TIME_CONSTANT = 25.0, 6.0, 300.0
_NOMINAL_VOLTAGE = SERVOS["XH430-W350"].nominal_voltage
_OVERLOAD_SHARE, _OVERLOAD_TIME = 0.8, 1.0


@dataclass(slots=True)
class Protection:
    """What a motor knows about its own health.

    stall_current: [A]. temperature: of the winding, taken for that of the register [°C]. overloaded_for: [s].
    latched: bits that stay until the motor starts anew.
    """

    stall_current: float
    temperature: float = _AMBIENT
    overloaded_for: float = 0.0
    latched: int = 0

    def advance(self, dt: float, current: float) -> None:
        """Carry a current [A] for a time [s]."""
        resistance = _NOMINAL_VOLTAGE / self.stall_current
        target = _AMBIENT + _PER_WATT * resistance * current * current
        self.temperature += (target - self.temperature) * min(1.0, dt / _TIME_CONSTANT)
        loaded = abs(current) >= _OVERLOAD_SHARE * self.stall_current
        self.overloaded_for = self.overloaded_for + dt if loaded else 0.0

    def errors(self, supply: float, low: float, high: float, temperature_limit: float, shutdown: int) -> int:
        """Return the bits of hardware_error_status, for a supply and its limits [V] and a limit [°C]."""
        bad_voltage = not low <= supply <= high
        if self.temperature > temperature_limit:
            self.latched |= OVERHEATING
        if self.overloaded_for >= _OVERLOAD_TIME - PERIOD / 2:
            self.latched |= OVERLOAD
        if bad_voltage and shutdown & VOLTAGE:
            self.latched |= VOLTAGE
        return self.latched | VOLTAGE * bad_voltage

    def restart(self) -> None:
        """Forget the errors; the winding stays warm."""
        self.latched = 0
        self.overloaded_for = 0.0
