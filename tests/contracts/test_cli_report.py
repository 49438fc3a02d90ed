"""`sinew report`: what it takes up from the folder, what it makes anew, and that a foreign recording needs no rig."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.contracts.commands import answered, command_lines, refused

from sinew.analysis.analysed import analyse_with
from sinew.apps.cli import main
from sinew.apps.recordings.stored import hash_file, stored_answers, stored_beyond, stored_effects, stored_results
from sinew.measure.files.netcdf import load_dataset, load_recording, save_dataset, save_recording
from sinew.measure.read import read
from sinew.plan.toml import dump_rig, load_rig

RIG = load_rig("paper")
OTHER = RIG.with_values({"silicone.loss_factor": 0.9 * RIG.silicone.loss_factor.value})
TIME = np.arange(0, 6, 0.005)


def recording(folder: Path, rate: float) -> xr.Dataset:
    """Return a foreign decay of 3 Hz with a decay rate [1/s], as a file gives it back."""
    angle = 30 * np.exp(-rate * TIME) * np.cos(2 * np.pi * 3 * TIME) + np.random.default_rng(3).normal(0, 0.02, 1200)
    rows = [f"{t:.4f},{x:.6f}" for t, x in zip(TIME, angle, strict=True)]
    (folder / "decay.csv").write_text("t,phi\n" + "\n".join(rows) + "\n", encoding="utf-8")
    save_recording(read(folder / "decay.csv", time="t", response="phi:deg"), folder / "recording.nc")
    return load_recording(folder / "recording.nc")


def results_in(folder: Path, of: xr.Dataset) -> Path:
    """Return the path of the results of a recording with the paper's rig."""
    save_dataset(analyse_with(of, RIG), folder / "results.nc")
    return folder / "results.nc"


def test_results_are_taken_up_by_the_same_recording_and_rig_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = recording(tmp_path, 1.2)
    path = results_in(tmp_path, found)
    assert stored_results(path, found, RIG) is not None
    assert capsys.readouterr().err == ""
    for rig in (OTHER, None):
        assert stored_results(path, found, rig) is None
        assert "made with another rig" in capsys.readouterr().err
    assert stored_results(path, recording(tmp_path, 2.4), RIG) is None
    assert "results.nc was made from another recording; analysed anew" in capsys.readouterr().err
    path.write_bytes(path.read_bytes()[:2000])
    assert stored_results(path, found, RIG) is None
    assert "results.nc cannot be used" in capsys.readouterr().err


def test_a_sweep_beyond_the_range_of_another_rig_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = results_in(tmp_path, recording(tmp_path, 1.2).assign_attrs(rig=dump_rig(RIG)))
    assert stored_beyond(path, RIG) is not None
    assert stored_beyond(path, OTHER) is None
    assert "belongs to another rig and is left out" in capsys.readouterr().err


def test_effects_that_the_results_do_not_name_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "effects.json"
    path.write_text('[{"effect": "a"}]', encoding="utf-8")
    named = xr.Dataset(attrs={"effects_hash": hash_file(path)})
    assert stored_effects(path, named) == [{"effect": "a"}]
    assert stored_effects(path, xr.Dataset()) == []
    assert "effects.json belongs to other results" in capsys.readouterr().err


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a foreign recording, reported without a rig."""
    folder = tmp_path_factory.mktemp("lab")
    recording(folder, 1.2)
    assert main(["report", str(folder), "--json"]) == 0
    return folder


def test_the_report_of_a_changed_recording_is_made_from_the_changed_recording(
    lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(lab, tmp_path / "lab"))
    recording(folder, 2.4)
    assert main(["report", str(folder), "--json"]) == 0
    rate = json.loads(capsys.readouterr().out)["ring_down"]["decay_rate_per_s"]
    assert rate == pytest.approx([2.4], rel=0.02)
    assert load_dataset(folder / "results.nc")["decay_rate_per_s"].item() == pytest.approx(2.4, rel=0.01)


def test_the_report_keeps_the_command_that_made_the_recording(lab: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(lab, tmp_path / "lab"))
    made = load_recording(folder / "recording.nc").assign_attrs(command="sinew reproduce --plan short --seed 5")
    save_recording(made, folder / "recording.nc")
    assert main(["report", str(folder), "--json"]) == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "sinew reproduce --plan short --seed 5" in page
    assert f"sinew report {folder}" not in page


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a foreign recording that was asked the open questions."""
    folder = tmp_path_factory.mktemp("asked")
    recording(folder, 1.2)
    assert main(["report", str(folder / "recording.nc"), "--answers", "--json"]) == 0
    return folder


@pytest.mark.slow
def test_a_foreign_decay_is_told_what_it_cannot_answer(asked: Path) -> None:
    document = json.loads((asked / "answers.json").read_text(encoding="utf-8"))
    verdicts = {one["name"]: one["verdict"] for one in document["answers"]}
    assert list(verdicts) == ["hardening", "saturation", "losses", "constancy", "delay"]
    assert {verdicts[name] for name in ("saturation", "losses", "constancy", "delay")} == {"cannot tell"}
    page = (asked / "answers.html").read_text(encoding="utf-8")
    assert "no rig is known" in page
    assert 'href="report.html"' in page


def test_a_linear_foreign_decay_does_not_harden(asked: Path) -> None:
    document = json.loads((asked / "answers.json").read_text(encoding="utf-8"))
    low, high = document["answers"][0]["numbers"]["frequency_shift_at_smallest_pretension"]["interval90"]
    assert low < 0 < high


def test_the_report_takes_up_the_answers_of_its_recording(asked: Path) -> None:
    assert main(["report", str(asked), "--json"]) == 0
    page = (asked / "report.html").read_text(encoding="utf-8")
    assert 'href="answers.html"' in page
    assert "cannot tell" in page


def test_answers_of_another_recording_are_left_out(
    asked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = recording(tmp_path, 2.4)
    assert stored_answers(asked / "answers.json", load_recording(asked / "recording.nc"))
    assert stored_answers(asked / "answers.json", other) == []
    assert "answers.json belongs to another recording" in capsys.readouterr().err


def test_a_report_without_answers_says_how_to_get_them(lab: Path) -> None:
    page = (lab / "report.html").read_text(encoding="utf-8")
    assert list((lab / "figures").glob("*.png"))
    assert "sinew report --answers" in page
    assert "answers.html" not in page


def test_results_of_another_recording_in_the_folder_are_not_replaced(
    lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, other = Path(shutil.copytree(lab, tmp_path / "lab")), tmp_path / "other.nc"
    before = (folder / "results.nc").read_bytes()
    recording(tmp_path, 2.4)
    (tmp_path / "recording.nc").rename(other)
    assert "results.nc exists" in refused(capsys, "report", other, "--out", folder)
    assert (folder / "results.nc").read_bytes() == before
    assert main(["report", str(other)]) == 0
    assert (tmp_path / "other" / "report.html").is_file()


def test_a_report_films_the_decay_on_request(lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = (str(lab / "recording.nc"), "--film", "ring-down", "--out", str(tmp_path))
    film = answered(capsys, "report", *words)["film"]
    assert film == {"film": str(tmp_path / "figures" / "ring-down.webp"), "kind": "ring-down"} | {
        "frames": film["frames"],
        "lasts_s": film["frames"] / 20,
    }
    assert 5.5 < film["lasts_s"] < 6.5
    assert Path(film["film"]).stat().st_size > 10_000
    assert "sinew report" in (tmp_path / "report.html").read_text(encoding="utf-8")


@command_lines("""
    report paper --film sweep => --film is for a recording, and paper is a rig
    report paper --rig short => --rig is for a recording
    report recording.nc --film backwards => sweep, ring-down
    report nowhere => found no recording nowhere
""")
def test_what_cannot_be_reported_is_one_line(
    arguments: tuple[str, ...], sentence: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, *arguments)
    assert list(here.iterdir()) == []
