"""The registers of an emulated device, and what may be read and written where.

What the manual leaves open is assumed, and said here: a gap between registers reads as 0, but a read that touches no
register at all, or runs past the table, is an access error; a write that touches a gap is an access error; a write to
several registers of which one is refused stores nothing.
"""

from collections.abc import Sequence

from sinew.hardware.registers import Register, RegisterTable

# Error numbers of the protocol (e-Manual, "DYNAMIXEL Protocol 2.0", Error).
DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = 4, 5, 6, 7

Part = tuple[Register, int]
"""A register and the count that is to be stored in it."""

_MOST_PLANS = 1000  # what a master writes is always the same few; what noise writes must not fill the memory
_Plan = tuple[int, tuple[tuple[Register, int], ...]]  # error number, or registers and where their bytes are


class ControlTable:
    """The bytes of one device, by the rows of its model.

    `indirect_data_n` stands for the byte that `indirect_address_n` points to; one that points to an indirect byte
    (as each does to itself at the start) is plain memory.
    """

    def __init__(self, rows: RegisterTable) -> None:
        self.rows = rows
        self.memory = bytearray(rows.size)
        self._by_name = {row.name: row for row in rows}
        self._places = {row.name: (row.address, row.stop, row.signed) for row in rows}
        self._owner: list[Register | None] = [None] * rows.size
        for row in rows:
            self._owner[row.address : row.stop] = [row] * row.size
        self._pointers = {
            row.address: self._by_name[row.name.replace("data", "address")]
            for row in rows
            if row.name.startswith("indirect_data")
        }
        self._indirect_start = min(self._pointers, default=rows.size)
        self._plans: dict[tuple[int, int], _Plan] = {}
        self.reset()

    def reset(self, keep: Sequence[str] = ()) -> None:
        """Put all registers to what they are when they come from the factory, but those in `keep`."""
        kept = {name: self[name] for name in keep}
        self._initialise(0)
        for name, count in kept.items():
            self[name] = count

    def restart(self) -> None:
        """Put the registers that do not outlive a loss of power to what they are at the start."""
        self._initialise(self.rows.eeprom_stop)

    def _initialise(self, start: int) -> None:
        self.memory[start:] = bytes(len(self.memory) - start)
        for row in self.rows:
            if row.address >= start and row.initial is not None:
                self[row.name] = row.initial

    def __getitem__(self, name: str) -> int:
        start, stop, signed = self._places[name]
        return int.from_bytes(self.memory[start:stop], "little", signed=signed)

    def __setitem__(self, name: str, count: int) -> None:
        self.store(self._by_name[name], count)

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def store(self, row: Register, count: int) -> None:
        """Put counts into a register without asking whether a master might."""
        self.memory[row.address : row.stop] = count.to_bytes(row.size, "little", signed=row.signed)

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Return (0, the bytes), or (error number, nothing)."""
        if not self._is_readable(address, length):
            return ACCESS, b""
        data = self.memory[address : address + length]
        if self._is_indirect(address, length):
            for at in range(max(address, self._indirect_start), address + length):
                data[at - address] = self.memory[self._target(at)]
        return 0, bytes(data)

    def parts(self, address: int, data: bytes, *, locked: bool) -> tuple[int, list[Part]]:
        """Return (0, what a write would store), or (error number, nothing).

        locked: whether the registers that outlive a loss of power must not change, as while the torque is on.
        """
        if self._is_indirect(address, len(data)):
            number, places = self._plan([self._target(at) for at in range(address, address + len(data))])
        else:
            key = (address, len(data))
            if key not in self._plans:
                if len(self._plans) > _MOST_PLANS:
                    self._plans.clear()
                self._plans[key] = self._plan(range(address, address + len(data)))
            number, places = self._plans[key]
        if number:
            return number, []
        found: list[Part] = []
        for row, at in places:
            if locked and row.address < self.rows.eeprom_stop:
                return ACCESS, []
            count = int.from_bytes(data[at : at + row.size], "little", signed=row.signed)
            if not row.is_float and not row.lowest <= count <= row.highest:
                return DATA_RANGE, []
            found.append((row, count))
        return 0, found

    def _plan(self, addresses: Sequence[int]) -> _Plan:
        """Return which registers bytes at these addresses make up, and the index of each one's first byte."""
        places: list[tuple[Register, int]] = []
        at = 0
        while at < len(addresses):
            row = self._owner[addresses[at]] if addresses[at] < len(self._owner) else None
            if row is None or not row.writable:
                return ACCESS, ()
            if list(addresses[at : at + row.size]) != list(range(row.address, row.stop)):
                return DATA_LENGTH, ()
            places.append((row, at))
            at += row.size
        return (0, tuple(places)) if places else (DATA_LENGTH, ())

    def _is_readable(self, address: int, length: int) -> bool:
        stop = address + length
        return length > 0 and stop <= len(self.memory) and any(self._owner[address:stop])

    def _is_indirect(self, address: int, length: int) -> bool:
        """Return whether one of the bytes stands for another."""
        return address + length > self._indirect_start and any(
            at in self._pointers for at in range(address, address + length)
        )

    def _target(self, address: int) -> int:
        pointer = self._pointers.get(address)
        if pointer is None:
            return address
        return int.from_bytes(self.memory[pointer.address : pointer.stop], "little")
