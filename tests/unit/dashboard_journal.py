"""A run for tests of the dashboard: a journal of known swings and decays, whole or cut off."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.unit.bench_journal import RIG_TEXT, Node, cycles, write_group

from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import Sample
from sinew.plan.plan import Group
from sinew.plan.toml import dump_plan, parse_plan

PLAN = parse_plan(
    """
name = "small"
sample_hz = 200
[pretension]
pretension_mm = [3, 6]
rest_s = 0.5
[sweep]
frequency_hz = [2.9, 4.3]
settle_s = 0.5
repeats = 2
[ring_down]
frequency_hz = [3.0, 3.0]
drive_s = 0.5
record_s = 3
repeats = 2
"""
)
PLAN_TEXT = dump_plan(PLAN)
DECAY_PER_S = 1.5
GROUPS = len(PLAN.groups())


def swing(index: int) -> list[Sample]:
    """The cycles of a group of the plan; those of a ring-down decay from the end of its settle on."""
    group, begin = PLAN.groups()[index], 1000.0 + 20.0 * index
    samples = cycles(group, begin, Node(has_counter=True), index)
    return samples if group.kind != "ring-down" else [_decaying(one, group, begin) for one in samples]


def _decaying(sample: Sample, group: Group, begin: float) -> Sample:
    stop = begin + group.settle_s
    if sample.time_s < stop:
        return sample
    left = float(np.exp(-DECAY_PER_S * (sample.imu_time_s - stop)))
    x, y, z = sample.gyro_rad_s
    return replace(sample, drive_command_rad=0.0, drive_rad=0.0, gyro_rad_s=(x * left, y, z))


def run_folder(folder: Path, groups: Sequence[int] = range(GROUPS)) -> Path:
    """A run's folder with the journal of some groups of the plan."""
    folder.mkdir(parents=True, exist_ok=True)
    with Journal.create(folder / "journal.sqlite", PLAN_TEXT, RIG_TEXT) as journal:
        for index in groups:
            write_group(journal, index, swing(index), plan=PLAN)
    return folder
