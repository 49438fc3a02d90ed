"""What `sinew analyse` and `sinew report` say of the energy of a recording."""

import json
from pathlib import Path

import pytest
from tests.unit.ideal_motor import RIG, recorded

from sinew.apps.cli import main
from sinew.measure.files.netcdf import save_recording
from sinew.measure.recording import ENERGY_QUANTITIES

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("energy") / "recording.nc"
    save_recording(recorded(), path)
    return path


def test_every_pretension_has_every_quantity_with_its_interval(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["analyse", str(recording), "--json"]) == 0
    energy = json.loads(capsys.readouterr().out)["energy"]
    assert energy["idle_power_w"] == pytest.approx(5 * 0.040 * RIG.drive.supply_voltage.value)
    assert [row["pretension_mm"] for row in energy["pretensions"]] == [0, 1]
    for row in energy["pretensions"]:
        assert row.pop("pretension_mm") in (0, 1)
        assert set(row) == set(ENERGY_QUANTITIES)
        assert all(set(value) == {"value", "std", "interval90"} for value in row.values())


def test_the_quantities_are_those_of_the_reference() -> None:
    page = (ROOT / "docs" / "reference" / "results.md").read_text(encoding="utf-8")
    assert {name for name in ENERGY_QUANTITIES if f"`{name}`" not in page} == set()


def test_the_table_of_the_energy_fits_a_hundred_columns(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyse", str(recording)]) == 0
    lines = capsys.readouterr().out.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("energy at resonance"))
    assert max(map(len, lines[start:])) <= 100


@pytest.mark.slow
def test_the_report_of_a_folder_holds_table_and_figure_of_the_energy(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(recording.parent), "--json"]) == 0
    page = (recording.parent / "report.html").read_text(encoding="utf-8")
    assert "reduction in %" in page
    assert (recording.parent / "figures" / "energy.png").is_file()
    assert json.loads(capsys.readouterr().out)["energy"]["energy_reduction"][0] > 0.5
