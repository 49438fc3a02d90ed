"""Names for what can go wrong between Sinew and a bench.

    SinewError
    └── HardwareError
        ├── PacketError      a packet that cannot be sent: an id, address or length the protocol does not have
        ├── RegisterError    no such register, or a value that it cannot hold
        ├── PortError        the serial port cannot be opened, or is gone
        └── DeviceError      a device does not do what it must: silent, another model, a register that does not take

To the bus a device that is silent, refuses or raises its alert is no exception but an outcome, see
`sinew.hardware.bus`; a motor or sensor that is set up, though, must do as it is told, and raises DeviceError.
"""

from sinew.measure.errors import SinewError


class HardwareError(SinewError):
    """Base of what can go wrong between Sinew and a bench."""


class PacketError(HardwareError):
    """A packet that cannot be sent: an id, address or length the protocol does not have."""


class RegisterError(HardwareError):
    """No such register, or a value that it cannot hold."""


class PortError(HardwareError):
    """The serial port cannot be opened, or is gone."""


class DeviceError(HardwareError):
    """A device that does not do what it must: it is silent, of another model, or does not take a register's value."""


TROUBLES = (PacketError, RegisterError, DeviceError)
"""What can go wrong while the port is there, and the others can still be asked."""
