"""The bench's cycle by dynamixel-sdk: the same goals told, the same registers asked for.

GroupSyncRead knows one address and length for all, so sensor and climate need transactions of their own; GroupBulkRead
makes the packets that Sinew makes. Both are used as the SDK's examples do, and what comes is taken apart.
"""

import importlib
import math
from typing import Any

from sinew.plan.rig import RigSpec

TORQUE, GOAL_POSITION, PRESENT_POSITION = 64, 116, 132  # addresses
PRESENT, CLIMATE, PRESENT_AND_CLIMATE, IMU = (120, 16), (144, 3), (120, 27), (32, 28)  # (address, bytes)
VALUES = ((120, 2), (124, 2), (126, 2), (128, 4), (132, 4))  # tick, pwm, current, velocity, position


class SdkMaster:
    """All six devices under dynamixel-sdk, with the motors under torque where they are.

    port: path. spec: wiring. Raises SystemExit where the SDK cannot open the port.
    """

    def __init__(self, port: str, spec: RigSpec) -> None:
        self._sdk: Any = importlib.import_module("dynamixel_sdk")
        sdk, wiring = self._sdk, spec.wiring
        self._wiring = wiring
        self._motors = (*wiring.tendon_ids, wiring.drive_id)
        self._handler, self._packets = sdk.PortHandler(port), sdk.PacketHandler(2.0)
        # It refuses 4.5 Mbaud, which the port takes as any other.
        self._handler.getCFlagBaud = lambda baud: baud
        if not self._handler.openPort() or not self._handler.setBaudRate(wiring.baud):
            raise SystemExit(f"dynamixel-sdk cannot open {port}")
        group = self._handler, self._packets
        self._sync_write, self._sync_read = (
            sdk.GroupSyncWrite(*group, GOAL_POSITION, 4),
            sdk.GroupSyncRead(*group, *PRESENT),
        )
        self._bulk_write = sdk.GroupBulkWrite(*group)
        self._goals: dict[int, int] = {}
        for motor in self._motors:
            self._packets.write1ByteTxRx(self._handler, motor, TORQUE, 1)
            self._goals[motor] = self._packets.read4ByteTxRx(self._handler, motor, PRESENT_POSITION)[0]
            self._sync_read.addParam(motor)
            self._sync_write.addParam(motor, self._goal(motor))
            self._bulk_write.addParam(motor, GOAL_POSITION, 4, self._goal(motor))
        self._bulk_reads = [self._bulk_read(asked) for asked in self._motors]
        self._turn = 0

    def sync_cycle(self, drive: float) -> bool:
        """Tell the goals, the lever's [rad] among them, and ask everybody; return whether all answered."""
        self._aim(drive)
        for motor in self._motors:
            self._sync_write.changeParam(motor, self._goal(motor))
        self._sync_write.txPacket()
        if self._sync_read.txRxPacket() != self._sdk.COMM_SUCCESS:
            return False
        self._take_apart(self._sync_read)
        asked = self._motors[self._turn]
        reads = ((self._wiring.imu_id, *IMU), (asked, *CLIMATE))
        return all(self._packets.readTxRx(self._handler, *read)[1] == self._sdk.COMM_SUCCESS for read in reads)

    def bulk_cycle(self, drive: float) -> bool:
        """Do the same in one packet of goals and one question to all."""
        return self._bulk(drive, "txRxPacket")

    def fast_bulk_cycle(self, drive: float) -> bool:
        """Do the same, and have all devices answer in one packet."""
        return self._bulk(drive, "fastBulkRead")

    def _bulk(self, drive: float, ask: str) -> bool:
        self._aim(drive)
        for motor in self._motors:
            self._bulk_write.changeParam(motor, GOAL_POSITION, 4, self._goal(motor))
        self._bulk_write.txPacket()
        reading = self._bulk_reads[self._turn]
        if getattr(reading, ask)() != self._sdk.COMM_SUCCESS:
            return False
        self._take_apart(reading)
        for address in range(IMU[0], sum(IMU), 2):
            reading.getData(self._wiring.imu_id, address, 2)
        return True

    def close(self) -> None:
        """Take the torque off and give the port back."""
        for motor in self._motors:
            self._packets.write1ByteTxRx(self._handler, motor, TORQUE, 0)
        self._handler.closePort()

    def _bulk_read(self, asked: int) -> Any:
        """Return a question to all, in which one motor is also asked for its climate."""
        reading = self._sdk.GroupBulkRead(self._handler, self._packets)
        reading.addParam(self._wiring.drive_id, *(PRESENT_AND_CLIMATE if asked == self._wiring.drive_id else PRESENT))
        reading.addParam(self._wiring.imu_id, *IMU)
        for motor in self._wiring.tendon_ids:
            reading.addParam(motor, *(PRESENT_AND_CLIMATE if asked == motor else PRESENT))
        return reading

    def _aim(self, drive: float) -> None:
        wiring = self._wiring
        self._goals[wiring.drive_id] = wiring.drive_zero_counts + round(wiring.drive_sign * drive * 4096 / math.tau)
        self._turn = (self._turn + 1) % len(self._motors)

    def _goal(self, motor: int) -> list[int]:
        return list(self._goals[motor].to_bytes(4, "little"))

    def _take_apart(self, reading: Any) -> None:
        for motor in self._motors:
            for address, size in VALUES:
                reading.getData(motor, address, size)
