"""A run on the emulated bench, analysed, calibrated, predicted and answered, against the rig that the bench plays."""

import json
import signal
from pathlib import Path
from typing import Any

import pytest
from tests.contracts.emulated_bench import PATIENCE, SINEW, joint, playing, running, virtual_port
from tests.contracts.virtual_run import spoken
from tests.patience import await_end, finished, until

from sinew.bench.record.journal import JournalReader
from sinew.measure.files.netcdf import load_recording
from sinew.plan.toml import load_rig

pytestmark = [pytest.mark.slow, pytest.mark.long]

PLAN = """
name = "chain"
[pretension]
pretension_mm = [2, 8]
mode = "MODE"
rest_s = 0.5
[sweep]
frequency_hz = [2.5, 3.2, 4.0]
repeats = 1
settle_s = 1.5
periods = 4
[ring_down]
frequency_hz = [3.0, 4.0]
repeats = 1
drive_s = 1.5
record_s = 1.5
"""
MODES = ("position", "position-with-current-limit", "current")
KILLED = "position, killed and resumed"


def plan_of(mode: str, folder: Path) -> Path:
    path = folder / "chain.toml"
    path.write_text(PLAN.replace("MODE", mode))
    return path


def run_in_virtual_time(mode: str, folder: Path) -> Path:
    rig, out = load_rig("paper"), folder / "run"
    with pytest.MonkeyPatch.context() as patch:
        virtual_port(patch, rig, joint(rig))
        assert spoken("run", str(plan_of(mode, folder)), "--port", "b", "--out", str(out))[0] == 0
    return out / "recording.nc"


def groups_done(out: Path) -> int:
    with JournalReader(out / "journal.sqlite") as journal:
        return len(journal.finished())


def run_killed_and_resumed(folder: Path) -> Path:
    """`sinew run` in a process of its own, ended by SIGKILL within its fourth group; a second one goes on with it."""
    plan, out = plan_of("position", folder), folder / "run"
    with playing(folder) as bench:
        with running(bench.port, plan, out) as process:
            until(lambda: groups_done(out) >= 3, PATIENCE, "no third group is recorded")
            process.send_signal(signal.SIGKILL)
            assert await_end(process, PATIENCE) == -signal.SIGKILL
        before = groups_done(out)
        finished([SINEW, "run", plan, "--port", bench.port, "--out", out, "--resume"], 3 * PATIENCE, check=True)
    assert 3 <= before < groups_done(out) == 10
    assert load_recording(out / "recording.nc").attrs["runs"] == 2
    return out / "recording.nc"


@pytest.fixture(scope="module")
def chains(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What `sinew calibrate` found from each run; the other commands of the chain must not fail."""
    found = {}
    for case in (*MODES, KILLED):
        folder = tmp_path_factory.mktemp("chain")
        recording = str(run_killed_and_resumed(folder) if case == KILLED else run_in_virtual_time(case, folder))
        rig = str(folder / "found.toml")
        assert spoken("analyse", recording)[0] == 0
        status, text, _ = spoken("calibrate", "paper", recording, "--out", rig, "--json")
        assert status == 0
        assert spoken("predict", rig, "--against", recording)[0] == 0
        status, said, _ = spoken("report", recording, "--answers", "--out", str(folder / "answers"))
        assert (status, "No tendon joint could be fitted" in " ".join(said.split())) == (0, False)
        found[case] = json.loads(text)
    return found


def rows_of(document: dict[str, Any]) -> dict[str, Any]:
    return {name: row["after"] for name, row in document["parameters"].items() if row["after"]["std"] is not None}


def test_every_run_of_the_bench_determines_all_nine_parameters(chains: dict[str, dict[str, Any]]) -> None:
    assert {case: (one["converged"], len(rows_of(one))) for case, one in chains.items()} == dict.fromkeys(
        chains, (True, 9)
    )


def test_the_intervals_of_all_runs_hold_the_rig_that_the_bench_plays(chains: dict[str, dict[str, Any]]) -> None:
    """Of 36 independent 90 % intervals fewer than 28 hold the truth once in 130 times (binomial). Those of one fit hang
    together, which makes a small count likelier still, so no larger one can be promised."""
    truth = dict(load_rig("paper").parameters())
    inside = {
        case: [n for n, row in rows_of(one).items() if row["interval90"][0] <= truth[n].value <= row["interval90"][1]]
        for case, one in chains.items()
    }
    assert sum(map(len, inside.values())) >= 28, inside


def test_the_fit_leaves_as_little_of_the_gyroscope_in_every_mode(chains: dict[str, dict[str, Any]]) -> None:
    """It is the noise of the same sensor and the rounding of the same encoder, which know nothing of the mode."""
    left = {case: one["rmse"]["gyro_rad_s"] for case, one in chains.items()}
    assert max(left.values()) < 1.15 * min(left.values()), left
