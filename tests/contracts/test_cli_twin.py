"""`sinew simulate`, `export` and `import`: a recording comes out whole, with what it was made from."""

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import io

from sinew.apps.cli import main
from sinew.measure.files.netcdf import load_recording
from sinew.plan.toml import load_rig, parse_plan, parse_rig

PLAN = """
name = "tiny"
[pretension]
pretension_mm = [0]
rest_s = 0.5
[sweep]
frequency_hz = [3.0]
settle_s = 0.5
periods = 3
repeats = 1
"""


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> dict[str, Any]:
    assert main([*map(str, arguments), "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording of the tiny plan."""
    folder = tmp_path_factory.mktemp("twin")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    arguments = ("simulate", folder / "plan.toml", "--out", folder / "recording.nc", "--seed", "7")
    assert main([*map(str, arguments), "--without", "sensor_noise", "--without", "stamp_jitter"]) == 0
    return folder


def test_the_recording_holds_what_it_was_made_from(folder: Path) -> None:
    attrs = load_recording(folder / "recording.nc").attrs
    assert (parse_plan(attrs["plan"]), parse_rig(attrs["rig"])) == (parse_plan(PLAN), load_rig("paper"))
    assert (attrs["seed"], set(attrs["effects_off"].split())) == (7, {"sensor_noise", "stamp_jitter"})
    words = shlex.split(attrs["command"])
    assert words[:2] + words[5:7] == ["sinew", "simulate", "--seed", "7"]
    assert words[-4:] == ["--without", "sensor_noise", "--without", "stamp_jitter"]


def test_a_stretch_of_a_campaign_is_refused_with_the_reason(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyse", str(folder / "recording.nc"), "--start", "1"]) == 2
    assert "this one is a campaign whose segments are analysed whole" in capsys.readouterr().err


def test_the_recording_has_the_samples_that_the_check_foretold(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    expected_text = run(capsys, "check", folder / "plan.toml")["samples"]
    assert load_recording(folder / "recording.nc").sizes["sample"] == expected_text


def test_export_to_matlab_carries_every_sample(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = run(capsys, "export", folder / "recording.nc", "--to", "mat", "--out", folder / "recording.mat")
    stored = io.loadmat(folder / "recording.mat")["time_s"].ravel()
    assert document["format"] == "mat"
    np.testing.assert_array_equal(stored, load_recording(folder / "recording.nc")["time_s"].values)


def test_a_table_goes_out_and_comes_in_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(capsys, "export", folder / "recording.nc", "--to", "csv", "--out", folder / "table.csv")
    columns = ("--time", "time_s", "--response", "drive_rad:rad", "--gaps", "split", "--start", "1.0")
    document = run(capsys, "import", folder / "table.csv", *columns, "--out", folder / "again.nc")
    recording, again = load_recording(folder / "recording.nc"), load_recording(folder / "again.nc")
    late = recording["time_s"].values >= 1.0
    assert document["samples"] == late.sum()
    np.testing.assert_array_equal(again["torsion_rad"].values.astype(np.float32), recording["drive_rad"].values[late])
