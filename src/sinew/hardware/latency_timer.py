"""This is where the latency timer of a USB adapter is read and set: how long it gathers bytes before it passes them on.

Adapters with an FTDI chip come with 16 ms, three cycles of the bench; 1 ms is what it needs. Linux shows the timer as
a file. Boards that are a modem by themselves (ttyACM, such as an OpenCR) and pseudo-terminals have none.
"""

from pathlib import Path

from sinew.hardware.errors import PortError

__all__ = ["WANTED_MS", "LatencyTimer", "find_latency_timer"]

WANTED_MS = 1
_SYSTEM = Path("/sys/bus/usb-serial/devices")


class LatencyTimer:
    """The timer of one adapter. path: of the file that shows it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> int:
        """Return the time [ms]. Raises PortError if it cannot be read."""
        try:
            return int(self.path.read_text(encoding="ascii"))
        except (OSError, ValueError) as trouble:
            raise PortError(f"cannot read {self.path} ({trouble}); expected a time in ms") from trouble

    def write(self, milliseconds: int) -> None:
        """Set the time [ms] until the adapter is unplugged. Raises PortError without the right to."""
        try:
            self.path.write_text(f"{milliseconds}\n", encoding="ascii")
        except OSError as trouble:
            raise PortError(
                f"cannot write {self.path} ({trouble.strerror or trouble}); "
                f"as administrator: echo {milliseconds} > {self.path}"
            ) from trouble


def find_latency_timer(port: str, system: Path = _SYSTEM) -> LatencyTimer | None:
    """Return the timer of the adapter behind a port, or None where there is none.

    port: its path; a link such as those in /dev/serial/by-id is followed. system: where the adapters are listed.
    """
    path = system / Path(port).resolve().name / "latency_timer"
    return LatencyTimer(path) if path.is_file() else None
