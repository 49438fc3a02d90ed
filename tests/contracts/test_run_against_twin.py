"""`sinew run` through a pseudo-terminal in real time, beside what the twin answers to the same plan by itself."""

import json
import subprocess
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr
from tests.contracts.emulated_bench import SINEW, playing

from sinew.measure.netcdf import load_dataset, load_recording, save_recording
from sinew.measure.recording import segment_slices
from sinew.plan.toml import load_rig, parse_plan
from sinew.twin.effects import Effects
from sinew.twin.simulate import simulate

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

PLAN = """
name = "through the pseudo-terminal"
[pretension]
pretension_mm = [2, 8]
[sweep]
frequency_hz = [2.5, 3.2, 4.0]
repeats = 1
[ring_down]
frequency_hz = [3.0, 4.0]
repeats = 1
"""
# How a run ends where the computer leaves it, or the emulator, alone for longer than the motors' watchdogs wait.
PAUSES = (
    "the computer paused",
    "began too late",
    "bus watchdog has stopped",
    "too many missing answers",
    "not answered for",
    "repeats one sample for",
    "no answer from",
    "damaged answers come from",
)
RESUMED_MOST = 7


class Through(NamedTuple):
    """documents: what each run said. truth: of the emulator. recording: of the runs. bench, twin: results."""

    documents: list[dict[str, Any]]
    truth: dict[str, Any]
    recording: xr.Dataset
    bench: xr.Dataset
    twin: xr.Dataset

    def ratio(self, name: str) -> np.ndarray:
        return np.abs(self.bench[name].values / self.twin[name].values - 1)


def run_to_its_end(port: str, plan: Path, out: Path) -> list[dict[str, Any]]:
    """Run a plan; where the computer pauses for longer than the motors' watchdogs allow, go on with it."""
    command = [SINEW, "run", str(plan), "--port", port, "--out", str(out), "--json"]
    said = []
    for _ in range(1 + RESUMED_MOST):
        done = subprocess.run(
            [*command, *["--resume"] * out.exists()], capture_output=True, text=True, check=False, timeout=400
        )
        ended = json.loads(done.stdout)["ended"] if done.returncode != 2 else done.stderr
        if done.returncode != 2:
            said.append(json.loads(done.stdout))
        if done.returncode == 0:
            break
        assert any(pause in ended for pause in PAUSES), ended
        time.sleep(5.0)  # until the joint, let go in the middle of a swing, is at rest
    return said


def analysed(recording: Path, out: Path) -> xr.Dataset:
    subprocess.run([SINEW, "analyse", str(recording), "--out", str(out)], capture_output=True, check=True)
    return load_dataset(out / "results.nc")


@pytest.fixture(scope="module")
def through(tmp_path_factory: pytest.TempPathFactory) -> Through:
    folder = tmp_path_factory.mktemp("through")
    (folder / "plan.toml").write_text(PLAN)
    with playing(folder) as emulator:
        documents = run_to_its_end(emulator.port, folder / "plan.toml", folder / "run")
        truth = emulator.truth()
    twin = folder / "twin.nc"
    effects = Effects().without("repeatability")
    save_recording(simulate(parse_plan(PLAN), load_rig("paper"), effects=effects), twin)
    recording = folder / "run" / "recording.nc"
    return Through(
        documents, truth, load_recording(recording), analysed(recording, folder / "a"), analysed(twin, folder / "b")
    )


def test_the_whole_plan_is_recorded_and_the_bench_is_left_safe(through: Through) -> None:
    last = through.documents[-1]
    assert (last["complete"], last["groups_done"], last["is_safe"]) == (True, 10, True)
    assert through.truth["in_safe_state"]


def test_every_segment_of_the_plan_is_there_at_200_hz(through: Through) -> None:
    recording = through.recording
    kinds = ["idle", "settle", "steady", "settle", "steady", "settle", "steady", "settle", "ring-down"]
    assert recording["kind"].values.tolist() == kinds * 2
    for where in segment_slices(recording):
        steps = np.diff(recording["time_s"].values[where])
        assert steps.mean() == pytest.approx(0.005, rel=0.02)


def test_analyse_finds_every_group_of_it(through: Through) -> None:
    assert np.isfinite(through.bench["gain"].values).all()
    assert np.isfinite(through.bench["damping_ratio"].values).all()


def test_the_gain_is_the_twins_within_two_percent(through: Through) -> None:
    assert through.ratio("gain").max() < 0.02


def test_the_phase_is_the_twins_within_two_degrees(through: Through) -> None:
    off = np.degrees(through.bench["phase_lag_rad"].values - through.twin["phase_lag_rad"].values)
    assert np.abs(off).max() < 2.0


def test_the_damping_is_the_twins_within_five_percent(through: Through) -> None:
    assert through.ratio("damping_ratio").max() < 0.05


def test_the_pretensions_came_out_as_asked(through: Through) -> None:
    for pretension in (each for document in through.documents for each in document["pretensions"]):
        assert pretension["reached_mm"] == pytest.approx(pretension["asked_mm"], abs=0.1)
        assert pretension["tilt_deg"] < 0.2
