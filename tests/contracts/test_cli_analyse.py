"""`sinew analyse` and `reproduce`: the documents that other people's scripts rely on."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinew.apps.cli import main
from sinew.measure.netcdf import load_dataset, load_recording
from sinew.measure.results import validate_results
from sinew.plan.toml import dump_plan, load_plan

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
QUANTITY = {"value", "std", "interval90"}


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> dict[str, Any]:
    assert main([*map(str, arguments), "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


@pytest.fixture
def decay(tmp_path: Path) -> Path:
    """A decay of 3 Hz (damped) and 1.2 1/s, in degrees, with the noise of an encoder."""
    time = np.arange(0, 6, 0.005)
    noise = np.random.default_rng(3).normal(0, 0.02, time.size)
    angle = 30 * np.exp(-1.2 * time) * np.cos(2 * np.pi * 3 * time) + noise
    path = tmp_path / "decay.csv"
    path.write_text(
        "t,phi\n" + "".join(f"{t:.4f},{x:.6f}\n" for t, x in zip(time, angle, strict=True)), encoding="utf-8"
    )
    return path


COLUMNS = ("--kind", "ring-down", "--time", "t", "--response", "phi:deg")


def test_a_ring_down_has_the_keys_of_the_reference(decay: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, "analyse", decay, *COLUMNS)
    assert set(found) == {
        "kind",
        "frequency_hz",
        "damping_ratio",
        "decay_rate_per_s",
        "paper_method",
        "exponential",
        "reason",
        "rest_drift",
        "amplitude_dependence",
    }
    assert all(set(found[key]) == QUANTITY for key in ("frequency_hz", "damping_ratio", "decay_rate_per_s"))
    assert set(found["paper_method"]) >= {"decay_rate_per_s", "omega_rad_s", "lehr_damping"}
    assert set(found["amplitude_dependence"]) == {"amplitude", "frequency_hz", "damping_ratio"}


def test_a_ring_down_gives_the_frequency_and_rate_it_was_made_with(
    decay: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, "analyse", decay, *COLUMNS)
    assert found["frequency_hz"]["value"] == pytest.approx(3.0, rel=1e-3)
    assert found["decay_rate_per_s"]["value"] == pytest.approx(1.2, rel=5e-3)
    assert found["exponential"] is True


def test_the_folder_of_an_analysis_holds_the_same_document(
    decay: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, "analyse", decay, *COLUMNS, "--out", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "analysis.json").read_text(encoding="utf-8")) == found
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"analysis.json", "recording.nc"}


def test_an_imported_table_is_analysed_as_the_table_would_be(
    decay: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "import", decay, *COLUMNS, "--out", tmp_path / "decay.nc")
    assert run(capsys, "analyse", tmp_path / "decay.nc") == run(capsys, "analyse", decay, *COLUMNS)


def test_a_person_reads_the_damping_ratio_and_whether_to_believe_it(
    decay: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["analyse", str(decay), *COLUMNS]) == 0
    out = capsys.readouterr().out
    assert "damping ratio" in out
    assert "exponential: yes" in out


def test_a_sweep_gives_gain_and_lag_at_each_frequency(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows, start = ["t,drive,phi"], 0.0
    for frequency in (2.0, 3.0, 4.0):
        time = np.arange(0, 30 / frequency, 0.005)
        drive, phi = np.sin(2 * np.pi * frequency * time), 2 * np.sin(2 * np.pi * frequency * time - 0.5)
        rows += [f"{start + t:.4f},{d:.6f},{p:.6f}" for t, d, p in zip(time, drive, phi, strict=True)]
        start += time[-1] + 0.005
    (tmp_path / "sweep.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    columns = ("--kind", "sweep", "--time", "t", "--response", "phi:deg", "--drive", "drive:deg")
    table = run(capsys, "analyse", tmp_path / "sweep.csv", *columns)["response"]
    assert [row["frequency_hz"] for row in table] == pytest.approx([2, 3, 4], rel=1e-3)
    assert [row["gain_measured_drive"]["value"] for row in table] == pytest.approx([2, 2, 2], rel=1e-3)
    assert [row["phase_lag_deg"]["value"] for row in table] == pytest.approx([np.degrees(0.5)] * 3, abs=0.1)


@pytest.mark.skipif(not DATA.is_dir(), reason="no folder ../shared/data with recordings by others")
def test_a_real_beam_is_analysed_from_the_mean_of_its_markers(capsys: pytest.CaptureFixture[str]) -> None:
    file = DATA / "silicone_beam_dragonskin10" / "beam_gravity_V2_a.csv"
    markers = "Tip-1_x_m,Tip-2_x_m,Tip-3_x_m"
    found = run(capsys, "analyse", file, "--kind", "ring-down", "--time", "t_s", "--response", markers)
    assert found["damping_ratio"]["value"] > 0


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of `sinew reproduce` with a small plan."""
    folder = tmp_path_factory.mktemp("campaign")
    plan = load_plan("short")
    assert plan.sweep is not None
    sweep = plan.sweep.model_copy(update={"frequency_hz": plan.sweep.frequency_hz[2:10], "repeats": 2})
    text = dump_plan(plan.model_copy(update={"sweep": sweep}))
    (folder / "plan.toml").write_text(text.replace("[0, 6, 12]", "[0, 12]"), encoding="utf-8")
    assert main(["reproduce", "--plan", str(folder / "plan.toml"), "--out", str(folder / "out"), "--json"]) == 0
    return folder / "out"


@pytest.mark.slow
def test_reproduce_leaves_recording_results_figures_report_and_summary(campaign: Path) -> None:
    names = {path.name for path in campaign.iterdir()}
    assert names == {"recording.nc", "results.nc", "figures", "report.html", "summary.json", "effects.json"}


@pytest.mark.slow
def test_what_reproduce_leaves_keeps_its_schema(campaign: Path) -> None:
    load_recording(campaign / "recording.nc")
    validate_results(load_dataset(campaign / "results.nc"))


@pytest.mark.slow
def test_the_summary_has_the_keys_of_the_reference(campaign: Path) -> None:
    summary = json.loads((campaign / "summary.json").read_text(encoding="utf-8"))
    assert set(summary) == {
        "pretension_mm",
        "resonance_hz",
        "resonance_hz_std",
        "gain",
        "gain_std",
        "gain_measured_drive",
        "phase_90_hz",
        "drive_amplitude_deg_at_resonance",
        "ring_down",
        "paper",
        "wall_s",
        "simulated_s",
    }
    assert summary["pretension_mm"] == [0, 12]


@pytest.mark.slow
def test_report_writes_the_same_summary_anew(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = json.loads((campaign / "summary.json").read_text(encoding="utf-8"))
    (campaign / "report.html").unlink()
    assert run(capsys, "report", campaign) == before
    assert (campaign / "report.html").is_file()


@pytest.mark.slow
def test_a_recording_of_a_campaign_is_analysed_to_both_tables(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, "analyse", campaign / "recording.nc")
    assert {row["pretension_mm"] for row in found["response"]} == {0, 12}
    assert [set(row["damping_ratio"]) for row in found["ring_down"]] == [QUANTITY, QUANTITY]
