"""This is where the head's inertial sensor is read: rates and accelerations in the head's frame, and their age."""

import math
from dataclasses import dataclass

from sinew.hardware.bus import Bus
from sinew.hardware.clock_track import ClockTrack
from sinew.hardware.errors import DeviceError
from sinew.hardware.imu_registers import EMULATED_FIRMWARE, OPENCR_NODE, TURTLEBOT3
from sinew.hardware.instructions import Read
from sinew.hardware.layout import Layout, lay_out
from sinew.hardware.motor import RETRIES, Identity, check_identity
from sinew.hardware.registers import Register, RegisterTable, decode_raw, encode_raw
from sinew.hardware.reply import Reply

__all__ = ["Imu", "ImuReading"]

_READINGS = ("gyro_x", "gyro_y", "gyro_z", "acceleration_x", "acceleration_y", "acceleration_z")
_LAYOUTS: dict[str, Layout] = {
    OPENCR_NODE.model: lay_out(OPENCR_NODE, (*_READINGS, "sample_time", "clock")),
    TURTLEBOT3.model: lay_out(TURTLEBOT3, ("sample_time", *_READINGS)),
}
_CONTROL = {OPENCR_NODE.model: "imu_control", TURTLEBOT3.model: "imu_recalibrate"}
_MICROSECOND = 1e-6
_WRAP = 1 << 32
_REFRESH = 0.02  # s; how often TurtleBot3's firmware writes its table

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ImuReading:
    """The newest sample of the sensor.

    gyro [rad/s], acceleration (specific force) [m/s²]: along x, y and z of the head's frame H.
    counter: the device's own time of the sample [µs], as it counts it; the same counter is the same sample.
    time: host's time at which it was taken [s].
    """

    gyro: Vector
    acceleration: Vector
    counter: int
    time: float


class Imu:
    """The sensor on the bus.

    axes: the axes of the chip that point along x, y and z of the head. table: `OPENCR_NODE`, whose samples have an age
    by its own clock, or `TURTLEBOT3`: it takes no part in reads of several devices, and its samples, which it does not
    date, are taken to be half of its 20 ms old.
    """

    name = "IMU"

    def __init__(
        self, bus: Bus, device: int, table: RegisterTable = OPENCR_NODE, axes: tuple[str, ...] = ("+x", "+y", "+z")
    ) -> None:
        self.bus, self.id, self.table = bus, device, table
        self.layout = _LAYOUTS[table.model]
        self.is_grouped = table is OPENCR_NODE
        self.ask = Read(device, self.layout.address, self.layout.length)
        self.track = ClockTrack(_MICROSECOND, _WRAP) if self.is_grouped else ClockTrack(1e-3, _WRAP)
        self._unpack = self.layout.unpack.unpack
        first = 0 if self.is_grouped else 1
        gyro, force = self.layout.scales[first], self.layout.scales[first + 3]
        turned = [("xyz".index(axis[1]), -1 if axis[0] == "-" else 1) for axis in axes]
        # Where in the unpacked block each of the six values along the head's axes stands, and what a count of it means.
        (gx, gy, gz), (ax, ay, az) = (
            [(start + place, sign * scale) for place, sign in turned]
            for start, scale in ((first, gyro), (first + 3, force))
        )
        self._places = (gx, gy, gz, ax, ay, az)

    def identify(self) -> Identity:
        """Return who answers. Raises DeviceError if nobody does, or another model than expected."""
        return check_identity(self.bus, self.name, self.id, self.table)

    def is_emulated(self) -> bool:
        """Return whether the node says of itself that it is emulated. Raises DeviceError if nobody answers."""
        return self.is_grouped and self.identify().firmware == EMULATED_FIRMWARE

    def read(self) -> ImuReading:
        """Return the newest sample, asked for alone. Raises DeviceError if there is no fresh answer."""
        for _ in range(1 + RETRIES):
            reply = self.bus.read(self.id, self.ask.address, self.ask.length, retries=0)
            if reply.ok:
                reading = self.decode(reply, self.bus.left_wire)
                if reading is not None:
                    return reading
        raise DeviceError(
            f"IMU (id {self.id}) gave no fresh reading: {reply}; check its cable and supply, or restart its board"
        )

    def configure(self) -> int:
        """Bring the board to the state in which a run begins: asked for nothing, as after a start; return the register.

        Raises DeviceError, naming the register, where it does not take that.
        """
        row = self.table[_CONTROL[self.table.model]]
        found = self._control(row)
        if found != 0:
            self.bus.write(self.id, row.address, encode_raw(row, 0), retries=RETRIES)
            found = self._control(row)
        if found != 0:
            raise DeviceError(
                f"IMU (id {self.id}) has {found} in {row.name} after 0 was written, expected 0; restart its board"
            )
        return found

    def _control(self, row: Register) -> int:
        reply = self.bus.read(self.id, row.address, row.size, retries=RETRIES)
        if not reply.ok:
            raise DeviceError(f"cannot read {row.name} of IMU (id {self.id}): {reply}; check its cable and supply")
        return int(decode_raw(row, reply.data))

    def decode(self, reply: Reply, answered: float) -> ImuReading | None:
        """Return what a good answer says, or None if it is an old one.

        answered: host's time at which the device took the values [s]; NaN where not known, then by earlier answers.
        """
        values = self._unpack(reply.data)
        if self.is_grouped:
            counter, clock = values[6], values[7]
            if math.isnan(answered):
                answered = self.track.host_time(clock)
                if math.isnan(answered):
                    return None
            elif not self.track.is_fresh(clock, answered):
                return None
            age = ((clock - counter + (_WRAP >> 1)) % _WRAP - (_WRAP >> 1)) * _MICROSECOND
        else:
            counter = values[0] * 1000
            age = 0.5 * _REFRESH
        (a, i), (b, j), (c, k), (d, m), (e, n), (f, o) = self._places
        return ImuReading(
            (values[a] * i, values[b] * j, values[c] * k),
            (values[d] * m, values[e] * n, values[f] * o),
            counter,
            answered - age,
        )
