"""An emulated bench in virtual time: port and clock in one, and nothing sleeps."""

from sinew.emulator.faults import FaultyRig
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.errors import PortError


class VirtualPort:
    """A Transport and a Clock of the same time.

    rig: the bench, with faults or without. host_cost: how long each call keeps the host busy [s], so that time passes
    for a master that never waits.
    """

    def __init__(self, rig: EmulatedRig | FaultyRig, host_cost: float = 50e-6) -> None:
        self.rig, self.host_cost = rig, host_cost
        self._now = rig.time

    def now(self) -> float:
        """Return the time of the bench [s]."""
        self._now = max(self._now, self.rig.time)
        return self._now

    def wait_until(self, time: float) -> None:
        """Let time pass until then [s]; one that has passed changes nothing."""
        self._now = max(self.now(), time)
        self.rig.advance(self._now)

    def write(self, data: bytes) -> None:
        """Send bytes; raises PortError if the bench is unplugged."""
        self._work()
        self.rig.receive(data, self._now)

    def read(self, deadline: float) -> bytes:
        """Return what has arrived, waiting for at least a byte until `deadline` [s]; then b"".

        Raises PortError if the bench is unplugged.
        """
        self._work()
        while True:
            data = self.rig.transmit(self._now)
            if data:
                return data
            event = self.rig.next_event()
            if event > deadline:
                self.wait_until(deadline)
                self._refuse_unplugged()
                return self.rig.transmit(self._now)
            self.wait_until(event)
            self._refuse_unplugged()

    def close(self) -> None:
        """Give the port back; may be called again."""

    def _work(self) -> None:
        self._refuse_unplugged()
        self._now = self.now() + self.host_cost

    def _refuse_unplugged(self) -> None:
        if self.rig.unplugged:
            raise PortError("the port is gone; plug it in again")
