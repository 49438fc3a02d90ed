"""`sinew analyse` and `reproduce`: the documents that other people's scripts rely on."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from sinew.analysis.analysed import decay_rows
from sinew.apps.cli import main
from sinew.apps.recordings.stored import hash_file
from sinew.measure.errors import FileError
from sinew.measure.files.netcdf import load_dataset, load_recording
from sinew.measure.recording import validate_results
from sinew.measure.result import plain
from sinew.measure.tasks import CORES
from sinew.paper import report
from sinew.plan.toml import dump_plan, load_plan

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
        "interval_parts",
        "misfit",
        "paper_method",
        "exponential",
        "reason",
        "rest_drift",
        "amplitude_dependence",
        "start_s",
        "stop_s",
        "remarks",
    }
    assert all(set(found[key]) == QUANTITY for key in ("frequency_hz", "damping_ratio", "decay_rate_per_s"))
    assert set(found["paper_method"]) >= {"decay_rate_per_s", "omega_rad_s", "lehr_damping"}
    assert set(found["amplitude_dependence"]) == {"amplitude", "frequency_hz", "damping_ratio"}


def test_a_ring_down_is_shown_in_the_words_of_the_field_and_its_drift_with_its_uncertainty(
    decay: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["analyse", str(decay), *COLUMNS]) == 0
    out = capsys.readouterr().out
    assert "_per_s" not in out
    assert "Lehr's damping" in out
    assert "exponential: yes" in out
    assert re.search(r"drift of the rest position: .* ± .* rad", out)


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
    files = {"analysis.json", "recording.nc", "decay.png", "decay.pdf"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == files


def test_the_modes_of_a_decay_are_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, noise = np.arange(0, 4, 0.005), np.random.default_rng(4).normal(0, 0.02, 800)
    rows = [(10.0, 1.2, 3.0), (4.0, 2.0, 7.7)]  # amplitude [deg], decay rate [1/s], damped frequency [Hz]
    angle = sum(a * np.exp(-rate * time) * np.cos(2 * np.pi * f * time) for a, rate, f in rows) + noise
    lines = [f"{t:.4f},{x:.6f}" for t, x in zip(time, angle, strict=True)]
    (tmp_path / "two.csv").write_text("t,phi\n" + "\n".join(lines) + "\n", encoding="utf-8")
    words = ("analyse", str(tmp_path / "two.csv"), *COLUMNS, "--modes", "2")
    found = run(capsys, *words)["modes"]
    assert [mode["frequency_hz"]["value"] for mode in found] == pytest.approx([3.0, 7.7], rel=2e-3)
    assert [mode["decay_rate_per_s"]["value"] for mode in found] == pytest.approx([1.2, 2.0], rel=0.02)
    assert {key: set(value) for key, value in found[0].items()} == dict.fromkeys(
        ("frequency_hz", "natural_frequency_hz", "damping_ratio", "decay_rate_per_s", "amplitude", "phase_rad"),
        QUANTITY,
    )
    assert main([*words]) == 0
    assert "modes of the decay" in capsys.readouterr().out


SWEEP = ("--kind", "sweep", "--time", "t", "--response", "phi:deg", "--drive", "drive:deg")


def sweep_file(folder: Path, frequencies: list[float], damping: float) -> Path:
    """Return a table of a joint of 3 Hz, φ̈ + 2Dω₀φ̇ + ω₀²φ = -θ̈ in steady state, with an encoder's noise."""
    rows, start, generator = ["t,drive,phi"], 0.0, np.random.default_rng(5)
    for frequency in frequencies:
        ratio = frequency / 3.0
        response = ratio**2 / (1 - ratio**2 + 2j * damping * ratio)
        time = np.arange(0, 30 / frequency, 0.005)
        drive = np.exp(2j * np.pi * frequency * time)
        noise = generator.normal(0, 0.01, (2, time.size))
        columns = (start + time, drive.imag + noise[0], (response * drive).imag + noise[1])
        rows += [f"{t:.4f},{d:.6f},{p:.6f}" for t, d, p in zip(*columns, strict=True)]
        start += time[-1] + 0.005
    (folder / "sweep.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder / "sweep.csv"


@pytest.fixture(scope="module")
def wide_sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sweep_file(tmp_path_factory.mktemp("sweep"), [2.0, 2.4, 2.7, 2.9, 3.1, 3.3, 3.6, 4.0], 0.1)


def test_a_sweep_of_enough_frequencies_gives_the_resonance_of_the_closed_form(
    wide_sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (row,) = run(capsys, "analyse", wide_sweep, *SWEEP)["resonance"]
    assert row["resonance_measured_drive_hz"]["value"] == pytest.approx(3 / np.sqrt(1 - 2 * 0.1**2), rel=5e-3)
    assert row["gain_peak_measured_drive"]["value"] == pytest.approx(1 / (0.2 * np.sqrt(1 - 0.1**2)), rel=0.01)
    assert row["phase_90_hz"]["value"] == pytest.approx(3.0, rel=5e-3)


def test_the_resonance_has_the_keys_of_the_reference(wide_sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (row,) = run(capsys, "analyse", wide_sweep, *SWEEP)["resonance"]
    assert row.pop("pretension_mm") == 0
    assert {key: set(value) for key, value in row.items()} == dict.fromkeys(
        [
            *("paper_resonance_hz", "paper_gain_peak", "resonance_hz", "gain_peak", "resonance_measured_drive_hz"),
            *("gain_peak_measured_drive", "phase_90_hz", "half_power_width_hz", "drive_amplitude_at_resonance_rad"),
        ],
        QUANTITY,
    )


def test_the_keys_of_a_sweeps_row_are_those_of_the_reference(
    wide_sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "json.md").read_text(encoding="utf-8")
    found = run(capsys, "analyse", wide_sweep, *SWEEP)
    keys = {*found["response"][0], *found["resonance"][0]}
    assert {key for key in keys if f"`{key}`" not in page} == set()


def test_the_tables_of_a_sweep_fit_a_hundred_columns(wide_sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyse", str(wide_sweep), *SWEEP]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if len(line) > 100] == []
    assert "half-power/Hz" in "".join(lines)


def test_a_longer_settling_leaves_a_shorter_record(
    wide_sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lengths = []
    for settle in ("1", "4"):
        run(capsys, "analyse", wide_sweep, *SWEEP, "--settle", settle, "--out", tmp_path / settle)
        found = load_recording(tmp_path / settle / "recording.nc")
        lengths.append(int(found["row_size"].values[found["kind"].values == "steady"].sum()))
    # eight groups lose three seconds at 200 Hz each, up to a period at either end
    assert lengths[0] - lengths[1] == pytest.approx(8 * 3 * 200, rel=0.15)


def test_settling_cannot_be_chosen_once_the_groups_are_cut(
    wide_sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "analyse", wide_sweep, *SWEEP, "--out", tmp_path / "out")
    assert main(["analyse", str(tmp_path / "out" / "recording.nc"), "--settle", "1"]) == 2
    assert "comes too late" in capsys.readouterr().err
    assert (tmp_path / "out" / "response.png").is_file()


def test_a_stretch_of_an_imported_recording_is_analysed_as_that_of_the_table(
    decay: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stretch = ("--start", "1", "--stop", "4")
    run(capsys, "import", decay, *COLUMNS, "--out", tmp_path / "decay.nc")
    assert run(capsys, "analyse", tmp_path / "decay.nc", *stretch) == run(capsys, "analyse", decay, *COLUMNS, *stretch)
    assert main(["analyse", str(tmp_path / "decay.nc"), "--gaps", "split"]) == 2
    assert "--gaps are for tables" in capsys.readouterr().err


def test_the_rate_of_a_single_decay_keeps_the_fits_own_uncertainty() -> None:
    part = {"pretension_mm": [0.0], "repeat": [1]}
    names = ("decay_frequency_hz", "decay_rate_per_s", "damping_ratio", "paper_decay_rate_per_s")
    own = ("decay_frequency_std_hz", "decay_rate_std_per_s", "damping_ratio_std")
    columns = {name: (("pretension_mm", "repeat"), [[3.0]]) for name in names}
    columns |= {name: (("pretension_mm", "repeat"), [[0.1]]) for name in own}
    results = xr.Dataset(columns, coords=part)
    row = plain(decay_rows(results)[0].decay_rate_per_s)
    assert row["std"] == pytest.approx(0.1)
    assert row["interval90"] == pytest.approx([3.0 - 1.645 * 0.1, 3.0 + 1.645 * 0.1], abs=1e-4)


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
    load_recording(campaign / "recording.nc")
    validate_results(load_dataset(campaign / "results.nc"))


@pytest.mark.slow
@pytest.mark.parametrize("cores", ["1", "2"])
def test_what_was_finished_is_there_when_pages_fail(
    cores: str, campaign: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise FileError("no room for figures")

    (tmp_path / "results.nc").write_bytes((campaign / "recording.nc").read_bytes())  # of another time
    monkeypatch.setenv(CORES, cores)
    monkeypatch.setattr(report, "draw_figures", refuse)
    plan = str(campaign.parent / "plan.toml")
    assert main(["reproduce", "--plan", plan, "--out", str(tmp_path), "--seed", "3"]) == 2
    recording, results = load_recording(tmp_path / "recording.nc"), load_dataset(tmp_path / "results.nc")
    validate_results(results)
    assert results.attrs["recording_hash"] == recording.attrs["content_hash"]
    assert results.attrs["effects_hash"] == hash_file(tmp_path / "effects.json")
    monkeypatch.undo()
    assert main(["report", str(tmp_path)]) == 0
    assert (tmp_path / "report.html").is_file()


@pytest.mark.slow
def test_the_summary_has_the_keys_of_the_reference(campaign: Path) -> None:
    summary = json.loads((campaign / "summary.json").read_text(encoding="utf-8"))
    assert set(summary) == {
        *("pretension_mm", "resonance_hz", "resonance_hz_std", "gain", "gain_std", "paper_resonance_hz", "paper_gain"),
        *("gain_measured_drive", "phase_90_hz", "drive_amplitude_deg_at_resonance", "energy", "ring_down"),
        *("resonance", "decay_windows", "paper", "wall_s", "simulated_s"),
    }
    assert summary["pretension_mm"] == [0, 12]


@pytest.mark.slow
def test_report_writes_the_same_summary_anew(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = json.loads((campaign / "summary.json").read_text(encoding="utf-8"))
    (campaign / "report.html").unlink()
    assert run(capsys, "report", campaign) == before
    assert (campaign / "report.html").is_file()


@pytest.mark.slow
def test_report_takes_up_all_that_reproduce_left(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(campaign), "--json"]) == 0
    assert capsys.readouterr().err == ""
    assert "sinew reproduce --plan" in (campaign / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_recording_of_a_campaign_is_analysed_to_both_tables(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, "analyse", campaign / "recording.nc")
    assert {row["pretension_mm"] for row in found["response"]} == {0, 12}
    assert [set(row["damping_ratio"]) for row in found["ring_down"]] == [{*QUANTITY}] * 2
    assert all(row["damping_ratio_misfit"] > 0 for row in found["ring_down"])
