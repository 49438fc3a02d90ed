"""The bench's cycle: when goals are meant for, and when they are heard."""

import math

import numpy as np
import pytest
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.bench.guard import Guard
from sinew.bench.loop import Loop
from sinew.bench.record.sample import Sample
from sinew.bench.tilt import TiltEstimator
from sinew.hardware.rig import Rig
from sinew.plan.servo import PULSE


@pytest.mark.parametrize(("hz", "baud"), [(200.0, 1_000_000), (400.0, 4_500_000)])
def test_the_staircase_of_goals_has_the_phase_of_the_command(hz: float, baud: int) -> None:
    # A motor keeps a goal for a cycle: its mean over the cycle is the command's where the goal is that of the middle.
    # A command that grows steadily shows any lag: without the lead of half a period the goals are half a period old.
    loop, heard, _ = _watched(hz, baud)
    start, speed = loop.due, math.radians(200.0)
    loop.run(0.4, lambda time: speed * (time - start))
    times, goals = np.array(heard).T
    middle = 0.5 * (times[1:] + times[:-1])
    lag = middle - (start + goals[:-1] / speed)
    assert abs(lag.mean()) < 0.05 / hz  # of half a period that the lead is; the port takes some


def _watched(hz: float, baud: int) -> tuple[Loop, list[tuple[float, float]], list[Sample]]:
    """Return a loop on a bench, the goals that its drive hears with their times, and the samples it takes."""
    spec = paper_rig(baud=baud)
    bench = Bench(spec, imu_ppm=0.0, return_delay=0)
    rig = Rig(bench.bus, bench.port, spec)
    rig.configure()
    rig.set_tendon_mode("position")
    rig.drive.torque_on()
    bench.wait(0.05)
    heard: list[tuple[float, float]] = []
    taken: list[Sample] = []
    motor = bench.rig.motors[spec.wiring.drive_id]
    write = motor.write

    def note(address: int, data: bytes, now: float) -> int:
        found = write(address, data, now)
        heard.append((now, (motor.registers["goal_position"] - spec.wiring.drive_zero_counts) * PULSE))
        return found

    motor.write = note  # type: ignore[method-assign]
    loop = Loop(rig, bench.port, Guard(spec), TiltEstimator(spec, hz), 1 / hz, taken.append)
    loop.watch.goals = loop.watch.origin = tuple(tendon.angle() for tendon in rig.tendons)
    loop.restart()
    return loop, heard, taken


@pytest.mark.parametrize(("hz", "baud"), [(200.0, 1_000_000), (25.0, 57_600)])
def test_every_row_holds_the_goal_that_was_in_force_when_the_drive_was_read(hz: float, baud: int) -> None:
    # On the slow line reading takes longer than half a cycle: the goal is then older or younger, but known.
    loop, heard, taken = _watched(hz, baud)
    start = loop.due
    loop.run(0.8, lambda time: math.radians(60.0) * (time - start))
    heard_s, goals = np.array(heard).T
    read_s = np.array([sample.time_s for sample in taken])[1:]
    in_force = goals[np.searchsorted(heard_s, read_s) - 1]
    assert np.array([sample.drive_goal_rad for sample in taken])[1:] == pytest.approx(in_force, abs=1e-9)
