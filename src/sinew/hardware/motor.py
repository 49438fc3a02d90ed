"""One motor of the bus, set up and asked: registers by name, torque, watchdog, modes, errors.

What a motor does not do raises DeviceError with a sentence. The bench's cycle does not go this way, see
`sinew.hardware.rig`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sinew.hardware.bus import Bus
from sinew.hardware.errors import DeviceError
from sinew.hardware.register_tables import (
    HARDWARE_ERRORS,
    MOTORS,
    WATCHDOG_TRIPPED,
)
from sinew.hardware.registers import Register, RegisterTable, decode_raw, encode_raw, lay_out
from sinew.hardware.transport import Outcome, Reply

RETRIES = 3
"""How often a device that is set up is asked again where it did not answer, or answered damaged."""

_OUT_OF_RANGE = 4
_ADVICE = {
    Outcome.SILENT: "check its cable, supply, id and baud; if it answers pings, the doctor sets status_return_level",
    Outcome.DAMAGED: "check the cable, and that no two devices have this id",
    Outcome.WRONG_LENGTH: "check that no two devices have this id",
    Outcome.REFUSED: "`sinew doctor` shows the state of its registers",
}


@dataclass(frozen=True, slots=True)
class Identity:
    """Who answers at an id. number: of the model. firmware: its version."""

    id: int
    number: int
    firmware: int


class Motor:
    """One motor on the bus.

    name: as a user knows it, "tendon 1" or "drive". id: on the bus. table: of its model.
    sign: 1 where more counts of the encoder are positive in the rig's sense, else -1.
    kept: counts by register that it was seen to hold when it was set up, and is to hold from then on.
    """

    def __init__(self, bus: Bus, name: str, device: int, table: RegisterTable, sign: int = 1) -> None:
        self.bus, self.name, self.id, self.table, self.sign = bus, name, device, table, sign
        self.kept: dict[str, int] = {}

    def identify(self) -> Identity:
        """Return who answers. Raises DeviceError if nobody does, or another model than expected."""
        return check_identity(self.bus, self.name, self.id, self.table)

    def get(self, register: str) -> float:
        """Return a register's quantity, in the sense of the motor's own counts. Raises DeviceError."""
        row = self.table[register]
        return self.get_count(register) * row.scale

    def get_count(self, register: str) -> int:
        """Return a register's count. Raises DeviceError."""
        row = self.table[register]
        reply = self.bus.read(self.id, row.address, row.size, retries=RETRIES)
        if not reply.ok:
            raise self._trouble("cannot read", row, reply)
        return int(decode_raw(row, reply.data))

    def get_counts(self, registers: Sequence[str]) -> dict[str, int]:
        """Return several registers' counts, read at once; they must be named by increasing address.

        Raises DeviceError, or RegisterError for another order.
        """
        layout = lay_out(self.table, registers)
        reply = self.bus.read(self.id, layout.address, layout.length, retries=RETRIES)
        if not reply.ok:
            raise self._trouble("cannot read", self.table[registers[0]], reply)
        return dict(zip(registers, layout.unpack.unpack(reply.data), strict=True))

    def set(self, register: str, value: float) -> None:
        """Store a quantity [unit of the register]. Raises DeviceError, or RegisterError where it cannot hold that."""
        self.set_count(register, round(value / self.table[register].scale))

    def set_count(self, register: str, count: int) -> None:
        """Store a count. Raises DeviceError, or RegisterError where it cannot hold that."""
        row = self.table[register]
        reply = self.bus.write(self.id, row.address, encode_raw(row, count), retries=RETRIES)
        if not reply.ok:
            raise self._trouble(f"cannot write {count} to", row, reply)

    def set_counts(self, counts: Mapping[str, int]) -> None:
        """Store counts in registers that follow one another without a gap, at once. Raises as `set_count`."""
        rows = [self.table[register] for register in counts]
        data = b"".join(encode_raw(row, count) for row, count in zip(rows, counts.values(), strict=True))
        reply = self.bus.write(self.id, rows[0].address, data, retries=RETRIES)
        if not reply.ok:
            raise self._trouble(
                f"cannot write {len(rows)} registers, the first {counts[rows[0].name]}, to", rows[0], reply
            )

    def ensure_count(self, register: str, count: int) -> bool:
        """Store a count unless it is there already, and read it back; return whether it was another.

        Raises DeviceError if the motor does not take it.
        """
        if self.get_count(register) == count:
            return False
        self.set_count(register, count)
        self._expect(register, count)
        return True

    def keep_count(self, register: str, count: int) -> None:
        """Store a count, read it back, and remember that the motor is to hold it. Raises DeviceError."""
        self.set_count(register, count)
        self._expect(register, count)
        self.kept[register] = count

    def torque_is_on(self) -> bool:
        """Return whether the motor is under torque. Raises DeviceError."""
        return bool(self.get_count("torque_enable"))

    def torque_on(self) -> None:
        """Switch the torque on and read it back. Raises DeviceError, which names the hardware error if there is one."""
        self.set_count("torque_enable", 1)
        if not self.torque_is_on():
            errors = ", ".join(self.hardware_errors()) or "no hardware error"
            raise DeviceError(
                f"{self._who()} took no torque, expected torque_enable 1 ({errors}); after a shutdown only a reboot "
                "helps"
            )
        self.kept["torque_enable"] = 1

    def torque_off(self) -> None:
        """Switch the torque off and read it back. Raises DeviceError."""
        self.set_count("torque_enable", 0)
        if self.torque_is_on():
            raise DeviceError(f"{self._who()} kept its torque, expected it off; switch the supply off")
        self.kept["torque_enable"] = 0

    def require_torque_off(self, purpose: str) -> None:
        """Raise DeviceError if the torque is on. purpose: what it must be off for."""
        if self.torque_is_on():
            raise DeviceError(
                f"{self._who()} has its torque on, expected off {purpose}; "
                "make sure that nothing falls, then `sinew stop --state release`"
            )

    def arm_watchdog(self, seconds: float) -> None:
        """Have the motor stop itself after so long [s] without any instruction on the bus, in whole units of 20 ms.

        At least one unit, else rounded down. Clears a watchdog that has tripped: it is written 0 first. Raises
        DeviceError, also where the motor does not take it, or RegisterError beyond 127 units.
        """
        unit = self.table["bus_watchdog"].scale
        self.disarm_watchdog()
        self.keep_count("bus_watchdog", max(1, int(seconds / unit + 1e-6)))

    def disarm_watchdog(self) -> None:
        """Switch the bus watchdog off, and clear it if it has tripped. Raises DeviceError."""
        self.set_count("bus_watchdog", 0)
        self.kept["bus_watchdog"] = 0

    def watchdog_tripped(self) -> bool:
        """Return whether the bus watchdog has stopped the motor. Raises DeviceError."""
        return self.get_count("bus_watchdog") == WATCHDOG_TRIPPED

    def hardware_errors(self) -> tuple[str, ...]:
        """Return the names of the hardware errors that the motor reports. Raises DeviceError."""
        return name_hardware_errors(self.get_count("hardware_error_status"))

    def _expect(self, register: str, count: int) -> None:
        if (found := self.get_count(register)) != count:
            raise DeviceError(
                f"{self._who()} has {found} in {register}, expected the {count} just written; is its torque on, or are "
                "there two devices with this id?"
            )

    def _who(self) -> str:
        return f"{self.name} (id {self.id})"

    def _trouble(self, what: str, row: Register, reply: Reply) -> DeviceError:
        if reply.number == _OUT_OF_RANGE and row.name.startswith("goal_") and self.watchdog_tripped():
            return DeviceError(f"{self._who()} takes no {row.name}: its bus watchdog has stopped it; arm it anew first")
        return DeviceError(f"{what} {row.name} of {self._who()}: {reply}; {_ADVICE[reply.outcome]}")


def check_identity(bus: Bus, name: str, device: int, table: RegisterTable) -> Identity:
    """Return who answers a ping. Raises DeviceError if nobody does, or another model than the table's.

    name: what to call the device in the sentence.
    """
    reply = bus.ping(device)
    for _ in range(RETRIES):
        if reply.ok or reply.outcome is Outcome.REFUSED:
            break
        reply = bus.ping(device)
    if not reply.ok:
        raise DeviceError(
            f"{name} does not answer: {reply}, expected a {table.model} at id {device}; {_ADVICE[reply.outcome]}"
        )
    found = Identity(device, int.from_bytes(reply.data[:2], "little"), reply.data[2])
    if found.number != table.number:
        other = MOTORS.get(found.number)
        known = f" ({other.model})" if other else ""
        raise DeviceError(
            f"{name} (id {device}) is model {found.number}{known}, expected {table.number} ({table.model}); "
            "correct ids or models in the rig's [wiring]"
        )
    return found


def name_hardware_errors(status: int) -> tuple[str, ...]:
    """Return the names of the bits set in `hardware_error_status`."""
    return tuple(HARDWARE_ERRORS.get(bit, f"bit {bit}") for bit in range(8) if status >> bit & 1)
