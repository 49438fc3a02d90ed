"""This is where several registers are unpacked from one block of bytes at once, as fast as Python can."""

from collections.abc import Sequence
from dataclasses import dataclass
from struct import Struct

from sinew.hardware.errors import RegisterError
from sinew.hardware.registers import Register, RegisterTable

__all__ = ["Layout", "lay_out"]

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
