"""`sinew design --walk`: the document of a target from recordings, what is designed for it, and the refusals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.contracts.commands import command_lines, refused
from tests.experiments.walker import Walker, phase_of, yaw_of

from sinew.apps.cli import main

QUANTITY = {"value", "std", "interval90"}
PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "json.md"


def walk_file(path: Path, walker: Walker, strides: int = 30, seed: int = 1) -> Path:
    """Write the markers of a made-up walk that goes on at 1.3 m a stride, millimetres at 100 Hz."""
    time, phase, size = phase_of(walker, strides, np.random.default_rng(seed))
    columns = {"t_s": time}
    for pair, yaw in zip((("LASI", "RASI"), ("LSHO", "RSHO")), yaw_of(walker, phase, size), strict=True):
        for name, side in zip(pair, (1, -1), strict=True):
            place = 1300 * phase / (2 * np.pi), 0 * time, 900 + 20 * np.cos(2 * phase)
            across = -130 * side * np.sin(yaw), 130 * side * np.cos(yaw), 0 * time
            columns |= {f"{name}_{axis}_mm": p + a for axis, p, a in zip("xyz", place, across, strict=True)}
    pd.DataFrame(columns).round(3).to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def slow_and_fast(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    folder = tmp_path_factory.mktemp("walks")
    fast = walk_file(folder / "fast.csv", Walker(frequency_hz=1.05), seed=2)
    return str(walk_file(folder / "slow.csv", Walker(frequency_hz=0.75))), str(fast)


def words_of(*files: str) -> list[str]:
    return ["design", *(word for file in files for word in ("--walk", file))]


def run(capsys: pytest.CaptureFixture[str], files: tuple[str, ...], *arguments: str) -> dict[str, Any]:
    assert main([*words_of(*files), "--gait-only", *arguments, "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_two_files_give_a_row_each_and_one_band(
    slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, slow_and_fast)
    assert [row["file"] for row in found["bouts"]] == ["slow.csv", "fast.csv"]
    assert found["stride_band_hz"] == pytest.approx([0.75, 1.05], rel=0.06)
    assert found["yaw_of"] == "trunk against pelvis"


def test_the_intervals_of_a_file_hold_what_it_was_made_with(
    slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, slow_and_fast[:1])
    for key, truth in (("stride_frequency_hz", 0.75), ("yaw_amplitude_deg", Walker().relative_deg)):
        assert set(found[key]) == QUANTITY
        assert found[key]["interval90"][0] < truth < found[key]["interval90"][1]


def test_the_reference_names_every_key(slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, slow_and_fast[:1])
    page = PAGE.read_text(encoding="utf-8").partition("\n## design --walk\n")[2].partition("\n## ")[0]
    assert {key for key in {*found, *found["bouts"][0], "files"} if f"`{key}`" not in page} == set()


def test_a_folder_gets_the_document(
    slow_and_fast: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, slow_and_fast, "--out", str(tmp_path / "out"))
    assert json.loads((tmp_path / "out" / "gait.json").read_text(encoding="utf-8")) == found


def test_a_person_reads_a_row_for_each_bout_and_the_band(
    slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words_of(*slow_and_fast), "--gait-only"]) == 0
    out = capsys.readouterr().out
    assert out.index("slow.csv") < out.index("fast.csv") < out.index("over five in a row")


def test_an_angle_column_is_a_target_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, phase, size = phase_of(Walker(), 30, np.random.default_rng(3))
    pelvis, trunk = yaw_of(Walker(), phase, size)
    pd.DataFrame({"time": time, "twist": np.degrees(trunk - pelvis)}).to_csv(tmp_path / "a.csv", index=False)
    found = run(capsys, (str(tmp_path / "a.csv"),), "--yaw-column", "twist:deg")
    low, high = found["yaw_amplitude_deg"]["interval90"]
    assert low < Walker().relative_deg < high


@pytest.mark.slow
def test_joints_are_designed_for_the_gait_of_a_recording(
    slow_and_fast: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quick = ("--starts", "2", "--exact", "2", "--proposals", "1", "--shape", "circle", "--material", "base")
    assert main([*words_of(*slow_and_fast), *quick, "--out", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["target"]["stride_band_hz"] == found["gait"]["stride_band_hz"]
    assert found["target"]["yaw_deg"] == found["gait"]["yaw_amplitude_deg"]["value"]
    assert {"gait.json", "design.json", "design.html"} <= {path.name for path in (tmp_path / "out").iterdir()}


@command_lines("""
    --walk absent.csv => cannot read absent.csv
    --walk walk.csv --up w => expected one of x, y, z
    --walk walk.csv --yaw-column a --pelvis b => leave --pelvis and --trunk out
    --walk walk.csv --trunk C7,IJ => walk.csv: no marker 'C7'
    --walk walk.csv --yaw-column LASI_z_mm:mdeg => no steps found
    --walk walk.csv --stop 0.5 => too short
    --walk walk.csv --yaw-deg 7 => either the recording or the two numbers
    --gait-only => name one by --walk
    --stride-hz 0.7:1.1 --yaw-deg 7 --pelvis hip => --pelvis is about recordings of walking
""")
def test_what_is_no_gait_is_one_line_and_status_2(
    arguments: tuple[str, ...], sentence: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    walk_file(here / "walk.csv", Walker(), strides=12)
    assert sentence in refused(capsys, "design", *arguments)
