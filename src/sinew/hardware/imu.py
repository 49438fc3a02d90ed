"""Sensors as they are read: the head's rates and accelerations in its frame, and their age; and those of one value."""

import math
from dataclasses import dataclass
from statistics import median_high

from sinew.hardware.believable import SensorBounds
from sinew.hardware.bus import Bus, Reply
from sinew.hardware.codec import Read
from sinew.hardware.motor import RETRIES, Identity, check_identity
from sinew.hardware.registers import (
    EMULATED_FIRMWARE,
    OPENCR_NODE,
    Register,
    decode,
    decode_raw,
    encode_raw,
    lay_out,
    sensor_table,
)
from sinew.measure.errors import DeviceError
from sinew.plan.rig import BusSensor

# A device's own clock is held against the host's, so that an old answer is not taken for a new one.
#
# A bus may deliver late what was asked a cycle before: whole, with the right id and the right CRC. Its values are then
# good, but of another time. Every device counts its own time, and that gives such an answer away.

_TOLERANCE = 3e-3  # s; an answer that is a cycle of 5 ms old is found, a host that was 2 ms late is not disturbed
_OF_A_CYCLE = 0.6
_DRIFT = 0.01  # of the time since the last answer; far more than two crystals differ by
_WEIGHT = 0.05
_GAP = 0.1  # s
_SETTLED = 15


class ClockTrack:
    """Follows the difference between a device's counter and the host's clock.

    unit: of a count [s]. span: the counter counts 0 to span - 1 and begins anew. tolerance: see below [s].

    An answer is fresh if the counter has advanced by as much as the host's clock, within 3 ms, or within 0.6 of a cycle
    where that is shorter (`pace`): one that is a cycle old must not pass. The first 15 answers,
    and those after a gap of 0.1 s, are held against their median, so that a single one, old or with a wrong stamp of
    the host, does not decide; after a gap they must also agree with what was before, within 1 % of the gap. A device
    that has started anew is therefore not fresh until `reset`.
    """

    def __init__(self, unit: float, span: int) -> None:
        self._unit, self._span = unit, span
        self.tolerance = _TOLERANCE
        self.reset()

    def pace(self, period: float) -> None:
        """Expect an answer in every cycle of so long [s]."""
        self.tolerance = min(_TOLERANCE, _OF_A_CYCLE * period)

    def reset(self) -> None:
        """Begin anew: the next answer is fresh."""
        self._time = self._fresh = math.nan
        self._count = 0.0
        self._first: list[float] | None = None
        self._doubt = _GAP

    def is_fresh(self, count: int, time: float) -> bool:
        """Return whether an answer with this count belongs to this host time [s]."""
        if math.isnan(self._time):
            self._time, self._count, self._fresh, self._first = time, count, time, [0.0]
            return True
        passed = time - self._fresh
        if passed > _GAP:
            self._settle()
            self._first, self._doubt = [], self.tolerance + _DRIFT * passed
        ahead = self._since(count, time) - (time - self._time)
        if self._first is not None:
            return self._is_among_first(ahead, time)
        if abs(ahead) > self.tolerance:
            return False
        self._count = (self._count + (time - self._time + _WEIGHT * ahead) / self._unit) % self._span
        self._time = self._fresh = time
        return True

    def ahead(self, count: int, time: float) -> float:
        """Return by how much an answer with this count is ahead of this host time [s], 0 before the first; nothing is
        learnt from it."""
        if math.isnan(self._time):
            return 0.0
        middle = median_high(self._first) if self._first else 0.0
        return self._since(count, time) - middle - (time - self._time)

    def could_be(self, count: int, time: float) -> bool:
        """Return whether an answer with this count might belong to this host time [s]."""
        return abs(self.ahead(count, time)) <= self.tolerance

    def host_time(self, count: int) -> float:
        """Return the host time [s] of a count of the device, by its answers so far; NaN before one."""
        middle = median_high(self._first) if self._first else 0.0
        return self._time + self._since(count, self._fresh) - middle

    def _since(self, count: int, near: float) -> float:
        """Return by how much the counter has advanced since the reference [s], taken to be about at a host time [s]."""
        expected = (near - self._time) / self._unit
        half = self._span / 2
        return ((count - self._count - expected + half) % self._span - half + expected) * self._unit

    def _is_among_first(self, ahead: float, time: float) -> bool:
        assert self._first is not None
        if abs(ahead) > self._doubt:
            return False
        self._first.append(ahead)
        fresh = abs(ahead - median_high(self._first)) <= self.tolerance
        if fresh:
            self._fresh = time
        if len(self._first) >= _SETTLED:
            self._settle()
        return fresh

    def _settle(self) -> None:
        """Move the reference by the median of what was seen, and follow it from now on."""
        if self._first:
            self._count = (self._count + median_high(self._first) / self._unit) % self._span
        self._first = None


_READINGS = ("gyro_x", "gyro_y", "gyro_z", "acceleration_x", "acceleration_y", "acceleration_z")
_LAYOUT = lay_out(OPENCR_NODE, (*_READINGS, "sample_time", "clock"))
_MICROSECOND = 1e-6
_WRAP = 1 << 32

Vector = tuple[float, float, float]
_NODE_REPORT = lay_out(OPENCR_NODE, ("lost_samples", "who_am_i", "filter_delay"))


@dataclass(frozen=True, slots=True)
class NodeReport:
    """What the node tells of itself, asked outside of cycles.

    lost_samples: those that the chip made and the board did not read, since its start. chip: its WHO_AM_I.
    filter_delay: by how much its gyroscope is late [s].
    """

    lost_samples: int
    chip: int
    filter_delay: float


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

    bounds: of what it can tell; None: of anything. objection: why the newest answer, whole and fresh, cannot be true.
    axes: the axes of the chip that point along x, y and z of the head.
    """

    name = "IMU"

    def __init__(self, bus: Bus, device: int, axes: tuple[str, ...] = ("+x", "+y", "+z")) -> None:
        self.bus, self.id, self.table = bus, device, OPENCR_NODE
        self.ask = Read(device, _LAYOUT.address, _LAYOUT.length)
        self.track = ClockTrack(_MICROSECOND, _WRAP)
        self.bounds: SensorBounds | None = None
        self.objection = ""
        self._unpack = _LAYOUT.unpack.unpack
        gyro, force = _LAYOUT.scales[0], _LAYOUT.scales[3]
        turned = [("xyz".index(axis[1]), -1 if axis[0] == "-" else 1) for axis in axes]
        # Where in the unpacked block each of the six values along the head's axes stands, and what a count of it means.
        (gx, gy, gz), (ax, ay, az) = (
            [(start + byte, sign * scale) for byte, sign in turned] for start, scale in ((0, gyro), (3, force))
        )
        self._places = (gx, gy, gz, ax, ay, az)

    def identify(self) -> Identity:
        """Return who answers. Raises DeviceError if nobody does, or another model than expected."""
        return check_identity(self.bus, self.name, self.id, self.table)

    def is_emulated(self) -> bool:
        """Return whether the node says of itself that it is emulated. Raises DeviceError if nobody answers."""
        return self.identify().firmware == EMULATED_FIRMWARE

    def node_report(self) -> NodeReport | None:
        """Return what the node tells of its chip and of samples that it lost; None of one whose firmware has no such
        registers, or does not answer. Raises PortError."""
        reply = self.bus.read(self.id, _NODE_REPORT.address, _NODE_REPORT.length, retries=RETRIES)
        if not reply.ok:
            return None
        lost, chip, delay = _NODE_REPORT.unpack.unpack(reply.data)
        return NodeReport(lost, chip, delay * _MICROSECOND) if chip else None

    def read(self) -> ImuReading:
        """Return the newest sample, asked for alone. Raises DeviceError if there is no fresh answer."""
        for _ in range(1 + RETRIES):
            reply = self.bus.read(self.id, self.ask.address, self.ask.length, retries=0)
            if (reading := self.decode(reply, self.bus.left_wire)) is not None:
                return reading
        raise DeviceError(
            f"IMU (id {self.id}) gave no fresh reading: {self.objection or reply}; check its cable and supply, or "
            "restart its board"
        )

    def configure(self) -> int:
        """Bring the board to the state in which a run begins: asked for nothing, as after a start; return the register.

        Raises DeviceError, naming the register, where it does not take that.
        """
        row = self.table["imu_control"]
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
        return decode_raw(row, reply.data)

    def forget(self) -> None:
        """Take the next answer as fresh, and whatever it tells for possible."""
        self.track.reset()
        if self.bounds is not None:
            self.bounds.forget()

    def decode(self, reply: Reply, answered: float) -> ImuReading | None:
        """Return what an answer says, or None if it is not good, an old one, or cannot be true.

        answered: host's time at which the device took the values [s]; NaN where not known, then by earlier answers.
        """
        self.objection = ""
        if not reply.ok:
            return None
        values = self._unpack(reply.data)
        if reply.rivals and not math.isnan(answered):
            every = map(self._unpack, (reply.data, *reply.rivals))
            possible = [one for one in every if self.track.could_be(one[7], answered)]
            if len(possible) > 1:
                self.objection = "two answers come under its id, and differ"
                return None
            values = (possible or [values])[0]
        counter, clock = values[6], values[7]
        if math.isnan(answered):
            answered = self.track.host_time(clock)
            if math.isnan(answered):
                return None
        elif not self.track.is_fresh(clock, answered):
            return None
        age = ((clock - counter + (_WRAP >> 1)) % _WRAP - (_WRAP >> 1)) * _MICROSECOND
        (a, i), (b, j), (c, k), (d, m), (e, n), (f, o) = self._places
        rates = values[a] * i, values[b] * j, values[c] * k
        if self.bounds is not None:
            self.objection = self.bounds.objection(rates, (values[d], values[e], values[f]), counter, clock)
            if self.objection:
                return None
        return ImuReading(rates, (values[d] * m, values[e] * n, values[f] * o), counter, answered - age)


class SensorReader:
    """A sensor of the rig on a node of its own: one value, asked for alone, as simple firmware answers.

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
