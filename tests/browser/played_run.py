"""A run that is played: samples of a known swing come at their rate into a journal, and no motor moves.

`python played_run.py FOLDER [--resume]`. It listens and ends as `sinew run` does; its plan's name says how it behaves.
"""

import json
import math
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from tests.unit.bench_journal import Node, cycle
from tests.unit.dashboard_journal import RIG_TEXT

from sinew.apps.bench.run_control import RunControl, listening
from sinew.bench.record.journal import Journal
from sinew.bench.recorder import Progress
from sinew.bench.stops import Steering, StopReport
from sinew.measure.events import Contact, Doubted, Ended, Health, Paused, Pulled
from sinew.measure.recording import Segment
from sinew.plan.plan import Group
from sinew.plan.toml import dump_plan, load_plan

PREPARES, FALLS_SILENT, LINGERS, DOUBTS = "prepares", "falls-silent", "lingers", "doubts"
"""Tries its plan for ever; gives neither sample nor answer after a while; is long in writing its recording; doubts."""

GIVES_NOTHING = "gives-nothing"
"""Gives no samples after a while, and answers all the same."""

_SOURCE = "emulated bench"
_STEP_S, _SILENT_AFTER_S, _LINGERS_S = 0.05, 1.5, 2.5
_STOPPED = StopReport("release", frozen=frozenset({"drive", "tendon 1", "tendon 2", "tendon 3", "tendon 4"}))


class Played:
    """A run that is played into a journal."""

    def __init__(self, journal: Journal, control: RunControl, steering: Steering, name: str) -> None:
        self._journal, self._control, self._steering, self._name = journal, control, steering, name
        self._random = np.random.default_rng(0)
        self._began = time.monotonic()
        self._cycles, self._told = 0, 0.0
        self._newest = self._began
        self.at = Progress(1, 1.0)

    def run(self, groups: list[Group]) -> str:
        """Play the groups that are not recorded yet; return what ended it, empty where all are recorded."""
        self.at = Progress(len(groups), sum(group.duration_s for group in groups))
        self._control.runner = self  # type: ignore[assignment]
        self._steering.has_begun = True
        self._journal.event(Pulled.of())
        self._journal.event(Contact.of(current_ma=85.0))
        if DOUBTS in self._name:
            self._journal.event(Doubted("the gain at 3 Hz is 0.41, where the rig's prediction gives 2.3 to 2.7"))
        before = 0.0
        for index, group in enumerate(groups):
            if index not in self._journal.finished_groups() and not self._rested_and_played(index, group, before):
                assert self._steering.halt is not None
                return self._steering.halt.reason
            before += group.duration_s
        return ""

    motors = 5

    def _rested_and_played(self, index: int, group: Group, before: float) -> bool:
        while self._steering.pause_requested and self._steering.halt is None:
            if self.at.state != "paused":
                self.at.state = "paused"
                self._journal.event(Paused("the run rests"))
                self._journal.begin_segment(
                    None, 0, Segment("idle", group.pretension_mm, math.nan, math.nan, 0), "pause"
                )
            self._samples(group, 0.0)
        self.at.state = "running"
        self.at.begin(index, before, group.duration_s, self._newest)
        for kind, seconds in (("settle", group.settle_s), (group.kind, group.duration_s - group.settle_s)):
            self._journal.begin_segment(index, 0, replace(group.segment("settle"), kind=kind))
            end = self._newest + seconds
            while self._newest < end:
                if self._steering.halt is not None:
                    return False
                self._samples(group, 1.0)
            self._journal.end_segment("complete")
        self._journal.finish_group(index)
        self.at.end()
        return True

    def _samples(self, group: Group, share: float) -> None:
        """Let a moment pass, and write the samples that fall into it."""
        if FALLS_SILENT in self._name and self._newest - self._began > _SILENT_AFTER_S:
            os.kill(os.getpid(), 19)  # SIGSTOP: it neither answers nor samples
        time.sleep(_STEP_S)
        now = time.monotonic()
        if GIVES_NOTHING in self._name and now - self._began > _SILENT_AFTER_S:
            return
        while self._newest < now:
            self._newest += 0.005
            one = cycle(self._newest, group.frequency_hz or 1.0, self._began, Node(has_counter=True), self._random)
            x, y, z = one.gyro_rad_s
            self._journal.append(
                replace(
                    one,
                    gyro_rad_s=(share * x, y, z),
                    drive_command_rad=share * one.drive_command_rad,
                    drive_rad=share * one.drive_rad,
                    drive_current_a=0.1 + 0.4 * share * one.drive_rad,
                )
            )
            self._cycles += 1
        self.at.newest_s = self._newest
        if self._newest - self._told > 0.5:
            self._told = self._newest
            at = self.at
            health = Health(
                state=at.state,
                cycles=self._cycles,
                missed=0,
                incomplete=0,
                worst_late_ms=0.4,
                busy_ms=2.0,
                temperature_c={"drive": 41.0, "tendon 1": 38.0, "tendon 2": 37.0},
                supply_v=12.1,
                bus={"transactions": 3 * self._cycles, "retries": 0, "silent": 0},
                done_s=at.done_s(self._newest),
                total_s=at.total_s,
                group=at.group,
                groups=at.groups,
            )
            self._journal.event(health)


def main(folder: Path, resume: bool) -> int:
    plan = load_plan(str(folder / "plan.toml"))
    groups, text, path = list(plan.groups()), dump_plan(plan), folder / "journal.sqlite"
    steering = Steering(time.monotonic)
    with listening(folder, steering) as control:
        while (PREPARES in plan.name or time.monotonic() < _READY) and steering.halt is None:
            time.sleep(0.02)
        if steering.halt is not None:
            print(f"sinew: {steering.halt.reason}; nothing has moved", flush=True)
            return 1
        open_journal = Journal.open if resume else Journal.create
        more = () if resume else ({"source": _SOURCE},)
        with open_journal(path, text, RIG_TEXT, *more) as journal:  # type: ignore[operator]
            why = Played(journal, control, steering, plan.name).run(groups)
            steering.note_frozen(_STOPPED)
            journal.event(Ended(why or f"all {len(groups)} groups are recorded"))
            done = len(journal.finished_groups())
        time.sleep(0.1)
        steering.note_over(_STOPPED)
    if LINGERS in plan.name:
        time.sleep(_LINGERS_S)
    told = {
        "complete": not why,
        "ended": why or f"all {len(groups)} groups are recorded",
        "left": "the tension is let down",
        "groups_done": done,
    }
    print(json.dumps(told, indent=2), flush=True)
    return 1 if why else 0


_READY = time.monotonic() + 0.4

if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), "--resume" in sys.argv))
