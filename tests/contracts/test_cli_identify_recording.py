"""`sinew identify` on recordings: imported ones, those of a rig, and what they cannot be asked."""

from pathlib import Path

import numpy as np
import pytest
from tests.contracts.commands import command_lines
from tests.contracts.identify_sweep import (
    DOCUMENT,
    LINEAR,
    identified,
    unidentified,
)
from tests.contracts.virtual_run import spoken
from tests.unit.figures_sample import Joint, sample_recording

from sinew.apps.cli import main
from sinew.measure.files.netcdf import save_recording


def imported(capsys: pytest.CaptureFixture[str], sweep: Path, folder: Path) -> Path:
    columns = ("--time", "t", "--response", "y:V", "--drive", "u:V", "--kind", "sweep")
    assert main(["import", str(sweep), *columns, "--out", str(folder / "a.nc")]) == 0
    capsys.readouterr()
    return folder / "a.nc"


def test_an_imported_recording_is_asked_what_drives_it(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = imported(capsys, sweep, tmp_path)
    assert "excitation: force" in unidentified(capsys, file, "--model", "linear")
    found = identified(capsys, file, "--excitation", "force", "--model", "linear")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=1e-3)


@command_lines("""
    --time t => knows its columns
    --gaps bridge => --gaps are for tables
    --kind stepped --run 2 => knows its columns
    --model tendon => names none
    --pretension 4 --excitation force => imported
    --model tendon --posterior => posterior does not go
    --model tendon --train 0:100 => train does not go
""")
def test_a_recording_is_not_asked_what_it_cannot_answer(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    assert sentence in unidentified(capsys, imported(capsys, sweep, tmp_path), *arguments)


def test_a_recording_without_its_ending_is_known_by_its_bytes(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = imported(capsys, sweep, tmp_path).rename(tmp_path / "recording")
    assert identified(capsys, file, "--excitation", "force", "--model", "linear")["converged"]


def rig_recording(folder: Path, repeats: int) -> Path:
    """Two pretensions of a linear joint under its lever, at three frequencies, with a gyroscope's noise."""
    path = folder / "rig.nc"
    save_recording(sample_recording((0.0, 4.0), np.array([2.6, 3.0, 3.6]), repeats), path)
    return path


@pytest.mark.slow
def test_segments_of_one_pretension_of_a_rig_are_fitted_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified(capsys, rig_recording(tmp_path, 1), "--pretension", "4", *LINEAR, "--out", tmp_path)
    assert found["natural_frequency_hz"]["value"] == pytest.approx(Joint.at(4.0).natural_hz, rel=2e-3)
    assert found["damping_ratio"]["value"] == pytest.approx(Joint.at(4.0).damping, rel=0.02)
    assert found["parameters"]["lever_inertia_ratio"]["value"] == pytest.approx(Joint.at(4.0).share, rel=0.01)
    assert "3 segments at 4 mm" in found["message"]
    assert (tmp_path / "figures" / "fit_data.png").is_file()


@command_lines("""
    --pretension 5 => the recording has 0, 4
    --train 0:100 => one record
    --model tendon => names none
    --model tendon --excitation base => driven by its lever
""")
def test_a_rig_s_recording_is_not_asked_what_it_cannot_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    assert sentence in unidentified(capsys, rig_recording(tmp_path, 1), *LINEAR, *arguments)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording that `sinew simulate` wrote."""
    path = tmp_path_factory.mktemp("twin") / "a.nc"
    assert spoken("simulate", "short", "--rig", "paper", "--out", str(path))[0] == 0
    return path


@pytest.mark.slow
def test_a_recording_of_the_twin_needs_no_columns_and_gives_the_papers_three_hertz(
    simulated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified(capsys, simulated, "--model", "cubic")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=0.04)


@pytest.mark.slow
@pytest.mark.long
def test_the_tendon_joint_of_a_recording_has_the_papers_three_hertz(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified(capsys, simulated, "--model", "tendon", "--out", tmp_path / "out")
    assert set(found) == set(DOCUMENT) - {"mechanics"}  # a rig is what it is simulated from
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=0.04)
    assert (tmp_path / "out" / "figures" / "corner.png").is_file()
