"""`sinew run` through a pseudo-terminal in real time, beside what the twin answers to the same plan by itself."""

import json
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr
from tests.contracts.emulated_bench import SINEW, playing
from tests.patience import finished
from tests.unit.test_bench_run_against_twin import PLAN

from sinew.measure.files.netcdf import load_dataset, load_recording, save_recording
from sinew.measure.recording import segment_slices
from sinew.plan.toml import load_rig, parse_plan
from sinew.twin.parameters import Effects
from sinew.twin.simulate import simulate

pytestmark = [pytest.mark.slow, pytest.mark.realtime]


class Through(NamedTuple):
    """document: what the run said. truth: of the emulator. recording: of the run. bench, twin: results."""

    document: dict[str, Any]
    truth: dict[str, Any]
    recording: xr.Dataset
    bench: xr.Dataset
    twin: xr.Dataset

    def ratio(self, name: str) -> np.ndarray:
        return np.abs(self.bench[name].values / self.twin[name].values - 1)


def run_to_its_end(port: str, plan: Path, out: Path) -> dict[str, Any]:
    """Run a plan, once: the emulated bench waits while the computer pauses."""
    return dict(
        json.loads(finished([SINEW, "run", str(plan), "--port", port, "--out", str(out), "--json"], 400).stdout)
    )


def analysed(recording: Path, out: Path) -> xr.Dataset:
    subprocess.run([SINEW, "analyse", str(recording), "--out", str(out)], capture_output=True, check=True)
    return load_dataset(out / "results.nc")


@pytest.fixture(scope="module")
def through(tmp_path_factory: pytest.TempPathFactory) -> Through:
    folder = tmp_path_factory.mktemp("through")
    (folder / "plan.toml").write_text(PLAN)
    with playing(folder) as emulator:
        document = run_to_its_end(emulator.port, folder / "plan.toml", folder / "run")
        truth = emulator.truth()
    twin = folder / "twin.nc"
    effects = Effects().without("repeatability")
    save_recording(simulate(parse_plan(PLAN), load_rig("paper"), effects=effects), twin)
    recording = folder / "run" / "recording.nc"
    return Through(
        document, truth, load_recording(recording), analysed(recording, folder / "a"), analysed(twin, folder / "b")
    )


def test_the_whole_plan_is_recorded_and_the_bench_is_left_safe(through: Through) -> None:
    last = through.document
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


@pytest.mark.parametrize(("name", "within"), [("gain", 0.02), ("damping_ratio", 0.05)])
def test_what_the_bench_gives_is_the_twins(through: Through, name: str, within: float) -> None:
    assert through.ratio(name).max() < within


def test_the_phase_is_the_twins_within_two_degrees(through: Through) -> None:
    off = np.degrees(through.bench["phase_lag_rad"].values - through.twin["phase_lag_rad"].values)
    assert np.abs(off).max() < 2.0


def test_the_pretensions_came_out_as_asked(through: Through) -> None:
    for pretension in through.document["pretensions"]:
        assert pretension["reached_mm"] == pytest.approx(pretension["asked_mm"], abs=0.1)
        assert pretension["tilt_deg"] < 0.2
