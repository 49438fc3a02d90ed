"""This is where it is said what the doctor found: one fact, how bad it is, and what to do."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding", "Fix", "Severity"]

Severity = Literal["ok", "note", "warning", "fault"]
"""note: nothing is wrong. warning: a run works, worse than it could. fault: a run is refused, or would be wrong."""


@dataclass(frozen=True, slots=True)
class Fix:
    """A safe setting that the doctor can write.

    device: name of the motor, or "port". register: of the motor; "reboot" and "latency_timer" are none.
    found, wanted: counts; of the timer milliseconds.
    """

    device: str
    register: str
    found: int
    wanted: int

    def __str__(self) -> str:
        if self.register == "reboot":
            return f"{self.device}: reboot, its torque being off"
        return f"{self.device}: {self.register} from {self.found} to {self.wanted}"


@dataclass(frozen=True, slots=True)
class Finding:
    """One fact about a bench.

    subject: the device, or "bus", "port", "loop". found, expected: texts, with units. advice: what to do; empty where
    nothing is to be done. fix: what the doctor could write himself; None where it takes a person.
    """

    severity: Severity
    subject: str
    found: str
    expected: str = ""
    advice: str = ""
    fix: Fix | None = None

    @property
    def fixable(self) -> bool:
        """Whether the doctor can put it right himself."""
        return self.fix is not None
