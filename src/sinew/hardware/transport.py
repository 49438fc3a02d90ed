"""The seams to the outside: what the bus asks of a port, and of a clock.

Both are handed in by the caller: a serial port and the computer's clock on a bench, lists of bytes and a clock moved by
hand in a test.
"""

from dataclasses import dataclass
from enum import Enum
from time import monotonic, sleep
from typing import Protocol


class Clock(Protocol):
    """Tells a time that never goes back, and waits."""

    def now(self) -> float:
        """Return the time [s] since some fixed moment."""
        ...

    def wait_until(self, time: float) -> None:
        """Return at `time` [s] or a little later; at once if it has passed."""
        ...


class Transport(Protocol):
    """Carries bytes to the bus and back. What is sent comes back on some adapters; the bus expects that."""

    def write(self, data: bytes) -> None:
        """Send bytes; raises PortError if the port is gone."""
        ...

    def read(self, deadline: float) -> bytes:
        """Return what has arrived, waiting for at least a byte until `deadline` [s, of the bus's clock]; then b"".

        A deadline that has passed asks for what is there already. Raises PortError if the port is gone.
        """
        ...

    def close(self) -> None:
        """Give the port back; may be called again."""
        ...


class MonotonicClock:
    """The computer's clock that no setting of the date moves."""

    def now(self) -> float:
        """Return the time [s] since some fixed moment."""
        return monotonic()

    def wait_until(self, time: float) -> None:
        """Return at `time` [s] or a little later; at once if it has passed."""
        if (left := time - self.now()) > 0:
            sleep(left)


# It is said what became of a question to one device.
#
# Silence, damage and refusal are outcomes of a bus, not exceptions: the caller decides whether one lost sample matters.

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
