"""Second runs: whatever a run leaves behind on a bench that stays powered, the next one measures what the twin says.

A few here; of 200 pairs none was silently wrong (decision 36).
"""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from tests.experiments.second_runs import Bench, End, KilledError, compare, draw_writes, plan_of

from sinew.bench.stops import stop
from sinew.plan.plan import TendonMode
from sinew.plan.toml import load_rig

pytestmark = pytest.mark.slow
RUNS = 8  # one behind each of the seven ends


def one_after_the_other(folder: Path) -> Iterator[tuple[str, dict[str, float]]]:
    """Run again and again on one bench, in every mode and after every kind of end; yield what each whole run is off."""
    bench, rng = Bench(load_rig("paper"), seed=5), np.random.default_rng(5)
    modes, ends = get_args(TendonMode), get_args(End)
    for number in range(RUNS):
        mode, end = modes[number % len(modes)], ends[number % len(ends)]
        measured = folder / f"{number}"
        report = bench.run(plan_of(mode), measured)
        off = compare(measured / "journal.sqlite", mode) if report.is_complete else {}
        yield f"run {number} by {mode}: {report.sentence}", off
        early = end not in ("normal", "other software")
        if early:
            with suppress(KilledError):
                bench.run(plan_of(mode), folder / f"{number} cut short", at_s=float(rng.uniform(1.0, 16.0)), act=end)
        bench.leave_alone()
        bench.emulated.unplugged = False
        if end == "other software":
            bench.write(draw_writes(rng, 20))
        rig, port = bench.program()
        stop(rig, port, "release")


def test_a_run_that_finds_the_joint_swinging_waits_until_it_rests(tmp_path: Path) -> None:
    # killed while it swung the joint, then resumed: seen to take the swing for tilt
    bench = Bench(load_rig("paper"), seed=1145735149)
    with pytest.raises(KilledError):
        bench.run(plan_of("current"), tmp_path, at_s=11.938, act="killed")
    bench.leave_alone()
    report = bench.run(plan_of("current"), tmp_path, resume=True)
    off = compare(tmp_path / "journal.sqlite", "current")
    assert report.is_complete, report.sentence
    assert max(off.values()) <= 1.0, f"{off}, in parts of 2 %, 2° and 5 %"


@pytest.mark.long
def test_a_run_behind_every_end_measures_what_the_twin_says(tmp_path: Path) -> None:
    for said, off in one_after_the_other(tmp_path):
        assert set(off) == {"gain", "phase", "D"}, said
        assert max(off.values()) <= 1.0, f"{said}: {off}, in parts of 2 %, 2° and 5 %"
