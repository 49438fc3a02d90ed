"""A register: how it is described, and how its bytes become a quantity and back.

A register is a row: where it lies, what may be done to it, and what one count of it means. Quantities are in SI and
radians; a duty (PWM) is a fraction of the supply and temperatures are in degrees Celsius.
"""

import difflib
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from struct import Struct

from sinew.hardware.errors import RegisterError

_FLOAT = struct.Struct("<f")


@dataclass(frozen=True, slots=True)
class Register:
    """One item of a control table.

    name: as in the manual, with underscores. address, size: of its first byte, and how many [bytes].
    writable: RW in the manual, else R. signed: two's complement. unit: of the decoded quantity; 1 for counts and bits.
    scale: quantity of one count [unit]. low, high: counts that may be written; None: all that fit into the size.
    initial: counts after factory reset or start; None where it depends.
    is_float: the bytes are an IEEE 754 single instead of a count; then scale is 1.
    """

    name: str
    address: int
    size: int
    writable: bool = False
    signed: bool = False
    unit: str = "1"
    scale: float = 1.0
    low: int | None = None
    high: int | None = None
    initial: int | None = None
    is_float: bool = False

    @property
    def stop(self) -> int:
        """The address behind its last byte."""
        return self.address + self.size

    @property
    def lowest(self) -> int:
        """The least count that may be written."""
        return self.low if self.low is not None else -(1 << (8 * self.size - 1)) if self.signed else 0

    @property
    def highest(self) -> int:
        """The greatest count that may be written."""
        return self.high if self.high is not None else (1 << (8 * self.size - self.signed)) - 1


@dataclass(frozen=True)
class RegisterTable:
    """The control table of one model.

    model: its name. number: what it answers to a ping. rows: by address.
    eeprom_stop: registers below it are kept without power, and locked while the torque is on; 0 where there are none.
    """

    model: str
    number: int
    rows: tuple[Register, ...]
    eeprom_stop: int = 0
    _by_name: dict[str, Register] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_by_name", {row.name: row for row in self.rows})

    def __getitem__(self, name: str) -> Register:
        """Return a register by its name; raises RegisterError with what there is instead."""
        try:
            return self._by_name[name]
        except KeyError:
            alike = difflib.get_close_matches(name, self._by_name, n=4)
            hint = f"there is {', '.join(alike)}" if alike else "docs/reference/registers.md lists them"
            raise RegisterError(f"{self.model} has no register {name!r}; {hint}") from None

    def __iter__(self) -> Iterator[Register]:
        return iter(self.rows)

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    @property
    def size(self) -> int:
        """The address behind the last register."""
        return max(row.stop for row in self.rows)

    def block(self, names: Iterable[str]) -> tuple[int, int]:
        """Return (address, length) of the smallest block that holds these registers."""
        rows = [self[name] for name in names]
        start = min(row.address for row in rows)
        return start, max(row.stop for row in rows) - start


def decode_raw(register: Register, data: bytes) -> int | float:
    """Return the counts that the bytes of a register stand for; of a float register, the number itself.

    Raises RegisterError if there are more or fewer bytes than the register has.
    """
    if len(data) != register.size:
        raise RegisterError(f"{register.name} came with {len(data)} bytes; expected {register.size}")
    if register.is_float:
        return float(_FLOAT.unpack(data)[0])
    return int.from_bytes(data, "little", signed=register.signed)


def encode_raw(register: Register, count: int) -> bytes:
    """Return the bytes of so many counts.

    Raises RegisterError if the register cannot be written, or not with that.
    """
    if not register.writable:
        raise RegisterError(f"{register.name} can only be read; expected one that can be written")
    if not register.lowest <= count <= register.highest:
        unit = "" if register.unit == "1" else f" of {register.scale:.4g} {register.unit}"
        raise RegisterError(
            f"{register.name} cannot hold {count} counts{unit}; expected {register.lowest} to {register.highest}"
        )
    return count.to_bytes(register.size, "little", signed=register.signed)


def decode(register: Register, data: bytes) -> float:
    """Return the quantity [register.unit] that the bytes of a register stand for.

    Raises RegisterError if there are more or fewer bytes than the register has.
    """
    return decode_raw(register, data) * register.scale


# Several registers are unpacked from one block of bytes at once, as fast as Python can.

_CODES = {(1, False): "B", (1, True): "b", (2, False): "H", (2, True): "h", (4, False): "I", (4, True): "i"}


@dataclass(frozen=True, slots=True)
class Layout:
    """Where registers lie in the smallest block that holds them.

    address, length: of the block [bytes]. unpack: turns its bytes into counts, in the order of the registers asked for
    (numbers of a float register as they are). scales: quantity of one count, by register.
    """

    address: int
    length: int
    unpack: Struct
    scales: tuple[float, ...]


def lay_out(table: RegisterTable, names: Sequence[str]) -> Layout:
    """Return the layout of some registers, which must be named by increasing address.

    Raises RegisterError where the table has no such register, or the order is another.
    """
    rows = [table[name] for name in names]
    address, length = table.block(names)
    form, at = "<", address
    for row in rows:
        if row.address < at:
            raise RegisterError(f"{row.name} lies before {at}; expected registers by increasing address")
        form += f"{row.address - at}x" + _code(row)
        at = row.stop
    return Layout(address, length, Struct(form), tuple(row.scale for row in rows))


def _code(row: Register) -> str:
    return "f" if row.is_float else _CODES[row.size, row.signed]
