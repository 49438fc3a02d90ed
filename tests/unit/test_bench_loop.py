"""The bench's cycle: when goals are meant for, and when they are heard."""

import math

import numpy as np
import pytest
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.bench.guard import Guard
from sinew.bench.loop import Loop
from sinew.bench.tilt import TiltEstimator
from sinew.hardware.rig import Rig
from sinew.plan.servo import PULSE


@pytest.mark.parametrize(("hz", "baud"), [(200.0, 1_000_000), (400.0, 4_500_000)])
def test_the_staircase_of_goals_has_the_phase_of_the_command(hz: float, baud: int) -> None:
    # A motor keeps a goal for a cycle: its mean over the cycle is the command's where the goal is that of the middle.
    # A command that grows steadily shows any lag: without the lead of half a period the goals are half a period old.
    spec = paper_rig(baud=baud)
    bench = Bench(spec, imu_ppm=0.0, return_delay=0)
    rig = Rig(bench.bus, bench.port, spec)
    rig.configure()
    rig.set_tendon_mode("position")
    rig.drive.torque_on()
    bench.wait(0.05)
    heard: list[tuple[float, float]] = []
    motor = bench.rig.motors[spec.wiring.drive_id]
    write = motor.write

    def note(address: int, data: bytes, now: float) -> int:
        found = write(address, data, now)
        heard.append((now, (motor.registers["goal_position"] - spec.wiring.drive_zero_counts) * PULSE))
        return found

    motor.write = note  # type: ignore[method-assign]
    loop = Loop(rig, bench.port, Guard(spec), TiltEstimator(spec, hz), 1 / hz, lambda _: None)
    start, speed = loop.due, math.radians(200.0)
    loop.watch.goals = tuple(tendon.angle() for tendon in rig.tendons)
    loop.watch.origin = loop.watch.goals
    loop.restart()
    loop.run(0.4, lambda time: speed * (time - start))
    times, goals = np.array(heard).T
    middle = 0.5 * (times[1:] + times[:-1])
    lag = middle - (start + goals[:-1] / speed)
    assert abs(lag.mean()) < 0.05 / hz  # of half a period that the lead is; the port takes some
