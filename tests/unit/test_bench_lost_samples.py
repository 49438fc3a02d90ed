"""Samples that the IMU's board loses during a run, counted by the board and told by the run."""

from pathlib import Path

import pytest
from tests.unit.bench_virtual import VirtualBench, virtual_bench

from sinew.apps.bench.bench_run import print_run, run_document
from sinew.bench.record.journal import JournalReader
from sinew.bench.run import RunReport
from sinew.plan.toml import load_rig, parse_plan

pytestmark = pytest.mark.slow

SPEC = load_rig("paper")
PLAN = parse_plan(
    'name = "short"\n[pretension]\npretension_mm = [2]\nrest_s = 0.3\n'
    "[sweep]\nfrequency_hz = [3.4]\nsettle_s = 0.3\nperiods = 2\nrepeats = 1"
)


def lossy_bench(already: int) -> VirtualBench:
    """Return a bench whose board loses one sample of twenty, and has lost some before."""
    bench = virtual_bench(SPEC)
    bench.emulated.imu.loses = 0.05
    bench.emulated.imu.registers["lost_samples"] = already
    return bench


def said_of(report: RunReport, capsys: pytest.CaptureFixture[str]) -> str:
    print_run(run_document(report, PLAN, SPEC, None, Path("journal.sqlite")))
    return capsys.readouterr().out


def test_a_run_counts_and_tells_what_its_board_lost_meanwhile(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = lossy_bench(already=1000)
    report = bench.run(PLAN, tmp_path, {2.0: 20.0})
    lost = report.lost_samples
    assert report.is_complete
    assert lost is not None
    assert lost == pytest.approx(0.05 * 200 * bench.port.now(), abs=2)
    assert f"{lost} samples of the IMU are lost" in said_of(report, capsys)
    with JournalReader(tmp_path / "journal.sqlite") as reader:
        assert reader.counts()["samples_lost"] == lost
