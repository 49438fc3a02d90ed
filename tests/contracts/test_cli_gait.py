"""`sinew gait`: the document of a target, from recordings or from numbers, and the one line that refuses."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from campaigns.walker import Walker, phase_of, yaw_of
from tests.contracts.commands import command_lines, refused

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


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["gait", *arguments, "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_two_files_give_a_row_each_and_one_band(
    slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, *slow_and_fast)
    assert [row["file"] for row in found["bouts"]] == ["slow.csv", "fast.csv"]
    assert found["stride_band_hz"] == pytest.approx([0.75, 1.05], rel=0.06)
    assert [row["speed_m_s"] for row in found["bouts"]] == pytest.approx([0.975, 1.365], rel=0.03)
    assert found["yaw_of"] == "trunk against pelvis"


def test_the_intervals_of_a_file_hold_what_it_was_made_with(
    slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, slow_and_fast[0])
    for key, truth in (("stride_frequency_hz", 0.75), ("yaw_amplitude_deg", Walker().relative_deg)):
        assert set(found[key]) == QUANTITY
        assert found[key]["interval90"][0] < truth < found[key]["interval90"][1]


def test_numbers_give_the_keys_that_recordings_give(
    slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    asked = run(capsys, "--stride-hz", "0.7:1.1", "--yaw-deg", "7")
    assert set(asked) == set(run(capsys, slow_and_fast[0]))
    assert (asked["source"], asked["stride_band_hz"], asked["yaw_band_deg"]) == ("numbers", [0.7, 1.1], [7, 7])
    assert asked["yaw_amplitude_deg"] == {"value": 7, "std": None, "interval90": [None, None]}


def test_the_reference_names_every_key(slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, slow_and_fast[0])
    page = PAGE.read_text(encoding="utf-8").partition("\n## gait\n")[2].partition("\n## ")[0]
    assert {key for key in {*found, *found["bouts"][0], "files"} if f"`{key}`" not in page} == set()


def test_a_folder_gets_the_document_and_a_figure(
    slow_and_fast: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, *slow_and_fast, "--out", str(tmp_path / "out"))
    assert json.loads((tmp_path / "out" / "gait.json").read_text(encoding="utf-8")) == found
    assert {Path(file).name for file in found["files"]} == {"gait.json", "gait_yaw.png", "gait_yaw.pdf"}


def test_a_person_reads_a_table_over_the_speeds_and_sentences(
    slow_and_fast: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["gait", *reversed(slow_and_fast), "--speed-m-s", "1.4,0.9"]) == 0
    out = capsys.readouterr().out
    assert out.index("slow.csv") < out.index("fast.csv")
    assert "0.90" in out
    assert "half of peak to peak" in out


def test_an_angle_column_is_a_target_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, phase, size = phase_of(Walker(), 30, np.random.default_rng(3))
    pelvis, trunk = yaw_of(Walker(), phase, size)
    pd.DataFrame({"time": time, "twist": np.degrees(trunk - pelvis)}).to_csv(tmp_path / "a.csv", index=False)
    found = run(capsys, str(tmp_path / "a.csv"), "--yaw", "twist:deg")
    assert found["bouts"][0]["pelvis_amplitude_deg"] is None


@command_lines("""
    => --stride-hz LOW:HIGH with --yaw-deg
    walk.csv --stride-hz 0.7:1.1 --yaw-deg 7 => not both
    --stride-hz 0.7:1.1 => belong together
    --stride-hz 1.1:0.7 --yaw-deg 7 => 0 < lowest <= highest
    --stride-hz slow --yaw-deg 7 => expected a number (LOW:HIGH
    absent.csv => cannot read absent.csv
    walk.csv --up w => expected x, y or z
    walk.csv --yaw a --pelvis b => leave --pelvis and --trunk out
    walk.csv --speed-m-s 1,2 => one positive speed for each of the 1 files
    walk.csv --trunk C7,IJ => walk.csv: no marker 'C7'
    walk.csv --yaw LASI_z_mm:mdeg => no steps found
    walk.csv --stop 0.5 => too short
""")
def test_what_is_no_gait_is_one_line_and_status_2(
    arguments: tuple[str, ...], sentence: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    walk_file(here / "walk.csv", Walker(), strides=12)
    assert sentence in refused(capsys, "gait", *arguments)
