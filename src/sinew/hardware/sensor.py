"""A sensor on a node of its own: one value, asked for alone, as simple firmware answers."""

import math

from sinew.hardware.bus import Bus
from sinew.hardware.motor import Identity, check_identity
from sinew.hardware.register_tables import sensor_table
from sinew.hardware.registers import decode
from sinew.hardware.transport import Reply
from sinew.plan.rig import BusSensor


class SensorNode:
    """One sensor of the rig.

    Its value is taken for that of the moment: the node has no clock that would tell an old answer.
    """

    def __init__(self, bus: Bus, spec: BusSensor) -> None:
        self.bus, self.spec, self.id, self.name = bus, spec, spec.id, spec.model
        self.table = sensor_table(spec)
        self.row = self.table[spec.channel]

    def identify(self) -> Identity:
        """Return who answers. Raises DeviceError if nobody does, or another model than expected."""
        return check_identity(self.bus, self.name, self.id, self.table)

    def ask(self) -> Reply:
        """Return its answer, asked once. Raises PortError."""
        return self.bus.read(self.id, self.row.address, self.row.size, retries=0)

    def value(self, reply: Reply) -> float:
        """Return the quantity of an answer [unit of its channel], NaN of one that is not ok."""
        return decode(self.row, reply.data) if reply.ok else math.nan
