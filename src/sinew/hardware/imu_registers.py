"""This is where the control tables of the head's inertial sensor stand: an OpenCR board that answers like a motor.

`OPENCR_NODE` lies on the motors' bus. Its registers up to 50 are those of the firmware of ROBOTIS's OP3. Stock firmware
has no usable time, so Sinew asks for two registers more, both in microseconds of the board, which wrap after 71.6
minutes: `sample_time`, when the newest sample was taken, which stands still where the sensor is frozen; and `clock`,
when the board answered. Their difference is the age of the sample, whatever the bus does. `TURTLEBOT3` is the map of
the TurtleBot3 firmware: the board alone on a port of its own, floats in SI, refreshed at 50 Hz only, plain reads only.

Sources: the OP3 and TurtleBot3 firmware in ROBOTIS's OpenCR repository; gyro 2000 °/s, accelerometer 2 g full scale as
its IMU library sets them.
"""

import math

from sinew.hardware.registers import Register, RegisterTable

__all__ = ["EMULATED_FIRMWARE", "IMUS", "OPENCR_NODE", "TURTLEBOT3"]

EMULATED_FIRMWARE = 0xEE
"""Firmware version that an emulated node tells in its answer to a ping; those of real nodes count from 1."""

_GYRO = math.radians(2000) / 32_768  # rad/s
_ACCELERATION = 2 * 9.80665 / 32_768  # m/s²
_TENTH_DEGREE = math.radians(0.1)


def _three(names: tuple[str, str, str], address: int, unit: str, scale: float) -> tuple[Register, ...]:
    return tuple(Register(n, address + 2 * i, 2, signed=True, unit=unit, scale=scale) for i, n in enumerate(names))


def _floats(names: tuple[str, ...], address: int, unit: str) -> tuple[Register, ...]:
    return tuple(Register(n, address + 4 * i, 4, signed=True, unit=unit, is_float=True) for i, n in enumerate(names))


OPENCR_NODE = RegisterTable(
    "OpenCR node",
    0x7400,
    (
        Register("model_number", 0, 2, initial=0x7400),
        *_three(("gyro_x", "gyro_y", "gyro_z"), 32, "rad/s", _GYRO),
        *_three(("acceleration_x", "acceleration_y", "acceleration_z"), 38, "m/s^2", _ACCELERATION),
        *_three(("roll", "pitch", "yaw"), 44, "rad", _TENTH_DEGREE),
        Register("imu_control", 50, 1, writable=True, initial=0),
        Register("sample_time", 52, 4, unit="s", scale=1e-6),
        Register("clock", 56, 4, unit="s", scale=1e-6),
    ),
)
TURTLEBOT3 = RegisterTable(
    "TurtleBot3",
    0x5000,
    (
        Register("model_number", 0, 2, initial=0x5000),
        Register("sample_time", 10, 4, unit="s", scale=1e-3),
        Register("heartbeat", 19, 1, writable=True, initial=0),
        Register("imu_recalibrate", 59, 1, writable=True, low=0, high=1, initial=0),
        *_floats(("gyro_x", "gyro_y", "gyro_z"), 60, "rad/s"),
        *_floats(("acceleration_x", "acceleration_y", "acceleration_z"), 72, "m/s^2"),
        *_floats(("magnetic_x", "magnetic_y", "magnetic_z"), 84, "1"),
        *_floats(("orientation_w", "orientation_x", "orientation_y", "orientation_z"), 96, "1"),
    ),
)
IMUS = {table.number: table for table in (OPENCR_NODE, TURTLEBOT3)}
