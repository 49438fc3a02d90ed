"""This is where it is noted how a run ended."""

from dataclasses import dataclass, field

from sinew.bench.loop import LoopStatistics
from sinew.bench.pretension import Pretensioned
from sinew.bench.stops import StopReport

__all__ = ["RunReport"]


@dataclass(slots=True)
class RunReport:
    """How a run ended.

    is_complete: every group of the plan is recorded. sentence: what ended it. stop: how the rig was left.
    groups_done, groups: of the plan, those of earlier attempts included. loop: of the cycles. pretensions: as they came
    out, in order. tracks: the last state of the law of each tracking group of this run, by its index in the plan.
    pauses: what was said of each pause of the computer after which the run went on by itself.
    halted_s: from the request that ended the run until all motors were frozen [s]; None where there was none.
    """

    groups: int
    groups_done: int = 0
    is_complete: bool = False
    sentence: str = ""
    stop: StopReport | None = None
    loop: LoopStatistics = field(default_factory=LoopStatistics)
    pretensions: list[Pretensioned] = field(default_factory=list)
    tracks: dict[int, dict[str, float | bool | None]] = field(default_factory=dict)
    pauses: list[str] = field(default_factory=list)
    halted_s: float | None = None
