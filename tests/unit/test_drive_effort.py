"""Current and duty of a drive whose goals come in steps: the same wherever between two steps it is read."""

import math

import numpy as np
import pytest
from tests.unit.bench_virtual import virtual_bench
from tests.unit.ideal_motor import VOLTS

from sinew.analysis.signal.power import drive_effort
from sinew.analysis.signal.signals import read_signals
from sinew.bench.group import run_group
from sinew.bench.guard import Guard
from sinew.bench.loop import Loop
from sinew.bench.record.sample import Sample
from sinew.bench.tilt import TiltEstimator
from sinew.measure.arrays import Array
from sinew.measure.recording import Segment, build_recording
from sinew.measure.schema import SegmentKind
from sinew.plan.plan import Group
from sinew.plan.toml import load_rig

HZ, PERIOD_S = 4.1, 5e-3
GROUP = Group("steady", 0.0, HZ, 20.0, 0, 0.5, 1.0)


@pytest.mark.parametrize("age", [0.0, 0.3, 0.7, 1.0])
def test_the_effort_is_that_of_the_command_however_old_the_goal_is(age: float) -> None:
    # A lever that follows with a known lag, and goals that were sent `age` of a cycle before each reading, each the
    # command in the middle of its cycle: the law of the motor, u = g (goal - angle), i = (V u - k ω)/R, is exact.
    rig = load_rig("paper")
    drive, omega = rig.drive, math.tau * HZ
    read_s = np.arange(400) * PERIOD_S

    def command(time: Array) -> Array:
        return 0.1 * np.sin(omega * time)

    angle = 0.07 * np.sin(omega * read_s - 0.4)
    speed = 0.07 * omega * np.cos(omega * read_s - 0.4)
    goal = command(read_s + (0.5 - age) * PERIOD_S)

    def law(to: Array) -> tuple[Array, Array]:
        duty = drive.position_gain.value * (to - angle)
        return duty, (VOLTS * duty - 2.0 * speed) / drive.resistance

    stamps = read_s + rig.bus.drive_delay.value
    duty, current = law(goal)
    samples = {
        "time_s": stamps, "drive_command_rad": command(stamps), "drive_goal_rad": goal, "drive_rad": angle,
        "drive_pwm": duty, "drive_current_a": current, "supply_v": np.full(read_s.size, VOLTS),
        "gyro_rad_s": np.zeros((read_s.size, 3)),
    }  # fmt: skip
    recording = build_recording(samples, [Segment("steady", 0.0, HZ, 20.0, 0)], [read_s.size], {})
    found = drive_effort(read_signals(recording, rig))
    expected = law(command(read_s))  # the ends have a neighbour on one side only
    assert found["drive_pwm"][1:-1] == pytest.approx(expected[0][1:-1], abs=2e-4)
    assert found["drive_current_a"][1:-1] == pytest.approx(expected[1][1:-1], abs=5e-4)


class _Taken:
    """Keeps the samples of the steady segment."""

    def __init__(self) -> None:
        self.samples: list[Sample] = []
        self.kind: SegmentKind = "settle"

    def begin(self, kind: SegmentKind) -> None:
        self.kind = kind

    def end(self) -> None:
        pass

    def take(self, sample: Sample) -> None:
        if self.kind == "steady":
            self.samples.append(sample)


def fundamentals(begins_s: float) -> tuple[complex, complex]:
    """Return the first harmonics of current [A] and duty, against the command, of a run that begins at a time."""
    bench = virtual_bench(load_rig("paper"))
    rig, port, taken = bench.rig, bench.port, _Taken()
    rig.configure()
    rig.set_tendon_mode("position")
    rig.drive.torque_on()
    loop = Loop(rig, port, Guard(bench.spec), TiltEstimator(bench.spec, 1 / PERIOD_S), PERIOD_S, taken.take)
    loop.watch.goals = loop.watch.origin = tuple(tendon.angle() for tendon in rig.tendons)
    port.wait_until(1.0 + begins_s)
    loop.restart()
    run_group(loop, GROUP, 1 / PERIOD_S, taken)
    rows = [(s.time_s, s.drive_command_rad, s.drive_current_a, s.drive_pwm) for s in taken.samples]
    time, command, current, duty = np.array(rows).T
    turns = np.exp(-1j * math.tau * HZ * time)
    return turns @ current / (turns @ command), turns @ duty / (turns @ command)


def test_runs_that_begin_at_other_moments_find_one_current_and_one_phase_of_the_duty() -> None:
    # The emulated joint moves in ticks of 1.25 ms. Where one fell between goal and reading, the current was 0.41 A in
    # place of 0.29 A, and the duty half a cycle of 5 ms older: 3.7° at 4.1 Hz.
    first, *others = (fundamentals(1.25e-3 * share) for share in (0.0, 0.4, 0.8))
    for current, duty in others:
        assert abs(current / first[0] - 1) < 0.005  # registers in whole counts, 1 % of each reading
        assert abs(math.degrees(np.angle(duty / first[1]))) < 0.3
