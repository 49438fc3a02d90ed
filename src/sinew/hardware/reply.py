"""This is where it is said what became of a question to one device.

Silence, damage and refusal are outcomes of a bus, not exceptions: the caller decides whether one lost sample matters.
"""

from dataclasses import dataclass
from enum import Enum

__all__ = ["ERROR_NUMBERS", "Outcome", "Reply"]

# What the number in the byte ERR of a status means.
ERROR_NUMBERS = {
    1: "could not carry it out",
    2: "does not know the instruction, or action without reg write",
    3: "got a damaged packet",
    4: "the value is outside the register's range",
    5: "the data are shorter than the register",
    6: "the value is beyond a limit that is set",
    7: "the register cannot be read or written, or is locked while the torque is on",
}


class Outcome(Enum):
    """How a question to one device ended."""

    ANSWERED = "answered"
    REFUSED = "answered with an error number"
    SILENT = "sent nothing before the deadline"
    DAMAGED = "bytes came before the deadline, but no whole packet"
    WRONG_LENGTH = "answered with another number of bytes than asked for"


@dataclass(frozen=True, slots=True)
class Reply:
    """What one device said.

    data: the bytes asked for; empty unless `ok`. number: the error number, 0 where there is none. alert: whether it
    reports a hardware error (register `hardware_error_status` says which). attempts: how often it was asked.
    at: when the answer was whole [s, of the bus's clock], or when the waiting ended.
    """

    id: int
    outcome: Outcome
    data: bytes = b""
    number: int = 0
    alert: bool = False
    attempts: int = 1
    at: float = float("nan")

    @property
    def ok(self) -> bool:
        """Whether the device did what it was asked, and `data` is what was asked for."""
        return self.outcome is Outcome.ANSWERED

    def __str__(self) -> str:
        why = f": {ERROR_NUMBERS.get(self.number, f'error {self.number}')}" if self.number else ""
        alert = "; it raises its alert, read hardware_error_status" if self.alert else ""
        times = f" (asked {self.attempts} times)" if self.attempts > 1 else ""
        return f"device {self.id} {self.outcome.value}{why}{times}{alert}"
