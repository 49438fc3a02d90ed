"""One emulated motor on the line with its torque on, and the manual's numbers for it."""

import math

from tests.unit.emulator_stand_in import Bench

from sinew.emulator.plant import Law
from sinew.hardware.codec import Instruction, Status

M = 1  # the motor's id
FAIL, UNKNOWN, RANGE, LENGTH, ACCESS = 1, 2, 4, 5, 7
CURRENT, VELOCITY, POSITION, EXTENDED, LIMITED, PWM = 0, 1, 3, 4, 5, 16
VOLTAGE, HOT, SHOCK, OVERLOAD = 0x01, 0x04, 0x10, 0x20
COUNT = math.tau / 4096  # rad


def running(mode: int = EXTENDED, **rig: object) -> Bench:
    """Return a bench whose first motor has its torque on."""
    bench = Bench(**rig)  # type: ignore[arg-type]
    bench.put(M, "operating_mode", mode)
    if mode == CURRENT:
        bench.put(M, "goal_current", 0)
    bench.put(M, "torque_enable", 1)
    return bench


def law(bench: Bench) -> Law:
    """Return the law that the motor has given to its horn."""
    return bench.plant.laws[M - 1]


def say(bench: Bench, code: int, params: bytes = b"", device: int = M) -> Status | None:
    """Give the motor itself an instruction."""
    return bench.rig.motors[M].obey(Instruction(device, code, params), bench.rig.time)
