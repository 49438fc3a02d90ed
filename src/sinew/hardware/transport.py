"""This is where the seams to the outside stand: what the bus asks of a port, and of a clock.

Both are handed in by the caller: a serial port and the computer's clock on a bench, lists of bytes and a clock moved by
hand in a test.
"""

from time import monotonic, sleep
from typing import Protocol

__all__ = ["Clock", "MonotonicClock", "Transport"]


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
