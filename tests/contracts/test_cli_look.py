"""`sinew look`: what is in a file, and a command to go on with that works when it is pasted."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from tests.contracts.commands import answered, refused
from tests.unit.dialects import DIALECTS, STEP, SWING, TEXTS, TIME, Dialect, rows

from sinew.apps.cli import main
from sinew.measure.files.netcdf import save_recording
from sinew.measure.read import read

QUICK = {"labview.lvm", "tektronix_old.csv", "headless_german.csv", "plotjuggler.csv", "runs_below.csv"}


def pasted(capsys: pytest.CaptureFixture[str], file: Path) -> dict[str, object]:
    """Return what the command answers that `sinew look` prints last, HZ being the swing's rate."""
    assert main(["look", str(file)]) == 0
    line = capsys.readouterr().out.rstrip().splitlines()[-1].strip()
    assert main([*shlex.split(line.replace("HZ", f"{1 / STEP:g}"))[1:], "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


@pytest.mark.parametrize(
    "dialect",
    [pytest.param(one, id=one.name, marks=[] if one.name in QUICK else [pytest.mark.slow]) for one in DIALECTS],
)
def test_the_command_that_look_prints_finds_the_swing_in_a_file(
    dialect: Dialect, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dialect.write(tmp_path / dialect.name)
    found = pasted(capsys, tmp_path / dialect.name)
    assert found["kind"] == "ring-down"
    assert found["frequency_hz"]["value"] == pytest.approx(3.0, rel=2e-3)  # type: ignore[index]
    assert found["decay_rate_per_s"]["value"] == pytest.approx(0.5, rel=2e-2)  # type: ignore[index]


def swing_without(folder: Path, missing: slice) -> Path:
    kept = np.delete(np.arange(TIME.size), missing)
    (folder / "gap.csv").write_text("\n".join(["t,angle_deg", *rows(TIME[kept], SWING[kept])]) + "\n")
    return folder / "gap.csv"


@pytest.mark.parametrize(("missing", "way"), [(slice(100, 104), "bridge"), (slice(100, 140), "split")])
def test_a_gap_is_shown_and_bridged_where_it_is_shorter_than_half_a_period(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], missing: slice, way: str
) -> None:
    found = answered(capsys, "look", swing_without(tmp_path, missing))
    assert [gap["missing"] for gap in found["time"]["gaps"]] == [missing.stop - missing.start]
    assert shlex.split(found["command"])[-2:] == ["--gaps", way]


def test_a_ring_down_with_several_bridged_gaps_keeps_its_frequency_and_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    noisy = SWING + np.random.default_rng(2).normal(0, 0.02, SWING.size)
    kept = np.delete(np.arange(TIME.size), np.r_[40:44, 100:103, 180:184])
    (tmp_path / "a.csv").write_text("\n".join(["t,angle_deg", *rows(TIME[kept], noisy[kept])]) + "\n")
    assert "--gaps bridge" in refused(capsys, "analyse", tmp_path / "a.csv", "--kind", "ring-down")
    assert main(["analyse", str(tmp_path / "a.csv"), "--kind", "ring-down", "--gaps", "bridge", "--json"]) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert "3 gaps of about 11 missing samples bridged" in err
    assert found["frequency_hz"]["interval90"][0] < 3.0 < found["frequency_hz"]["interval90"][1]
    assert found["decay_rate_per_s"]["value"] == pytest.approx(0.5, rel=1e-2)


def test_of_a_sweep_the_clean_drive_is_not_taken_for_the_response(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(0, 60, 0.01)
    phase = 2 * np.pi * np.cumsum(np.repeat([2.0, 2.5, 4.0], 2000)) / 100
    noisy = np.sin(phase - 0.4) + np.random.default_rng(3).normal(0, 0.05, t.size)
    (tmp_path / "a.csv").write_text("\n".join(["t_s,lever_deg,angle_deg", *rows(t, np.sin(phase), noisy)]) + "\n")
    assert pasted(capsys, tmp_path / "a.csv")["kind"] == "sweep"


def test_a_file_of_several_runs_is_listed_and_the_chosen_one_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (dialect,) = [one for one in TEXTS if one.name == "capstone.csv"]
    dialect.write(tmp_path / "runs.csv")
    found = answered(capsys, "look", tmp_path / "runs.csv", "--run", "Run #2")
    assert ([one["name"] for one in found["runs"]], found["run"]) == (["Run #1", "Run #2"], "Run #2")
    assert found["columns"][1]["high"] == pytest.approx(2.0)


def test_a_recording_is_told_by_its_segments_and_channels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    swing_without(tmp_path, slice(0))
    save_recording(read(tmp_path / "gap.csv"), tmp_path / "swing.nc")
    found = answered(capsys, "look", tmp_path / "swing.nc")
    assert found["command"] == f"sinew analyse {tmp_path / 'swing.nc'}"
    assert [(one["name"], one["unit"]) for one in found["columns"]] == [("time_s", "s"), ("torsion_rad", "rad")]
