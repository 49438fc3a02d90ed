"""A run without a bench: samples of a known swing on two clocks, written to a journal."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import MISSING, Sample
from sinew.plan.plan import Group, Plan
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan

RIG = load_rig("paper")
RIG_TEXT = dump_rig(RIG)
PLAN = parse_plan(
    """
name = "swing"
sample_hz = 200
pretension = { pretension_mm = [3], rest_s = 0.5 }
sweep = { frequency_hz = [2.9, 4.3], settle_s = 0.5, repeats = 1 }
"""
)
PLAN_TEXT = dump_plan(PLAN)
SWING_RAD_S, DRIVE_RAD = 3.0, 0.3


@dataclass(frozen=True)
class Node:
    """The IMU's own clock: share by which it is slow, and its phase; jitter of the host's guess of its times."""

    drift: float = 80e-6
    phase_s: float = 2.3e-3
    jitter_s: float = 0.2e-3
    has_counter: bool = False


def cycle(time: float, frequency_hz: float, start: float, node: Node, random: np.random.Generator) -> Sample:
    """One cycle while the lever swings as a sine and the head's rate as a cosine, both from `start`."""
    period = (1 + node.drift) / 200.0
    taken = np.floor((time - node.phase_s) / period) * period + node.phase_s
    omega = 2 * np.pi * frequency_hz
    drive_delay = RIG.bus.drive_delay.value
    late = 3e-3 * (random.uniform() < 0.02)
    return Sample(
        time_s=time,
        imu_time_s=taken + node.jitter_s * random.standard_normal() + late,
        drive_command_rad=DRIVE_RAD * np.sin(omega * (time + drive_delay - start)),
        drive_rad=DRIVE_RAD * np.sin(omega * (time - start)),
        drive_current_a=0.1,
        drive_pwm=0.2,
        tendon_goal=(1.0, 1.0, 1.0, 1.0),
        tendon_rad=(1.0, 1.1, 1.2, 1.3),
        tendon_current_a=(0.1, 0.1, 0.1, 0.1),
        gyro_rad_s=(SWING_RAD_S * np.cos(omega * (taken - start)), 0.0, 0.0),
        acceleration_m_s2=(9.81, 0.0, 0.0),
        tilt_rad=0.01,
        late_s=0.0,
        imu_counter_s=taken / (1 + node.drift) if node.has_counter else MISSING,
        tendon_pwm=(0.1, 0.2, 0.3, 0.4),
        supply_v=12.3,
        drive_goal_rad=DRIVE_RAD * np.sin(omega * (time - start)),
    )


def cycles(group: Group, begin: float, node: Node, seed: int = 0) -> list[Sample]:
    """The cycles of a group from a time on, and ten more, in which the swing goes on."""
    random = np.random.default_rng(seed)
    settle, record = group.sample_counts(PLAN.sample_hz)
    frequency = group.frequency_hz if group.kind != "idle" else 1.0
    stamps = begin + np.arange(settle + record + 10) / PLAN.sample_hz
    return [cycle(t + 1e-4 * random.standard_normal(), frequency, begin, node, random) for t in stamps]


def write_group(
    journal: Journal, index: int, samples: Sequence[Sample], *, attempt: int = 0, plan: Plan = PLAN, finish: bool = True
) -> None:
    """Write a group's settle and record, and what follows them outside of any segment."""
    group = plan.groups()[index]
    settle, record = group.sample_counts(plan.sample_hz)
    rest = iter(samples)
    for kind, count in (("settle", settle), (group.kind, record)):
        if count:
            journal.begin_segment(index, attempt, replace(group.segment("settle"), kind=kind))
            for _ in range(count):
                journal.append(next(rest))
            journal.end_segment("complete")
    if finish:
        journal.finish_group(index)
    for sample in rest:
        journal.append(sample)


def written(folder: Path, node: Node | None = None, groups: Sequence[int] = (0, 1, 2)) -> Path:
    """A journal with some groups of the plan, each 20 s after the one before."""
    path = folder / "journal.sqlite"
    with Journal.create(path, PLAN_TEXT, RIG_TEXT, {"seed": 7}) as journal:
        for index in groups:
            write_group(journal, index, cycles(PLAN.groups()[index], 1000.0 + 20.0 * index, node or Node(), index))
    return path


def with_holes(samples: Sequence[Sample], missing: Sequence[int], **readings: object) -> Iterator[Sample]:
    """The samples, those of some numbers without certain readings."""
    for number, sample in enumerate(samples):
        yield replace(sample, **readings) if number in missing else sample
