"""The drive's current and duty on the emulated bench: the same at whatever moment a run begins."""

import math

import numpy as np
from tests.unit.bench_virtual import virtual_bench

from sinew.bench.group import run_group
from sinew.bench.guard import Guard
from sinew.bench.loop import Loop
from sinew.bench.record.sample import Sample
from sinew.bench.tilt import TiltEstimator
from sinew.measure.recording import SegmentKind
from sinew.plan.plan import Group
from sinew.plan.toml import load_rig

HZ, PERIOD_S = 4.1, 5e-3
GROUP = Group("steady", 0.0, HZ, 20.0, 0, 0.5, 1.0)


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
