"""The time that a preview promises, beside what a run takes on an emulated bench in virtual time."""

from pathlib import Path

import pytest
from tests.unit.bench_virtual import virtual_bench

from sinew.plan.check import check_plan
from sinew.plan.toml import load_rig, parse_plan
from sinew.twin.simulate import rest_tension

PLAN = """
name = "timed"
[pretension]
pretension_mm = {pretensions}
mode = "{mode}"
rest_s = 0.5
[sweep]
frequency_hz = [3.0, 3.6]
settle_s = 1.5
periods = 3
repeats = 1
"""
DECAY = """
[ring_down]
frequency_hz = [3.7, 3.7]
drive_s = 1.5
record_s = 2
repeats = 1
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "pretensions", "decay"),
    [
        ("position", "[4]", DECAY),
        ("current", "[2, 8]", DECAY),
    ],
)
def test_a_run_takes_what_its_preview_says_within_fifteen_percent(
    mode: str, pretensions: str, decay: str, tmp_path: Path
) -> None:
    rig = load_rig("paper")
    plan = parse_plan(PLAN.format(mode=mode, pretensions=pretensions) + decay)
    levels = plan.pretension.pretension_mm
    bench = virtual_bench(rig)
    began = bench.port.now()
    report = bench.run(plan, tmp_path, dict(zip(levels, rest_tension(levels, rig).tolist(), strict=True)))
    assert report.is_complete
    assert bench.port.now() - began == pytest.approx(check_plan(plan, rig).bench_s, rel=0.15)
