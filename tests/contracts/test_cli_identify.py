"""`sinew identify`: the document that other people's scripts rely on, and what it says of bad input."""

import html
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.figures_sample import Joint, sample_recording
from tests.unit.identify_signals import OMEGA, chirp, motion, noisy, viscous

from sinew.apps.cli import main
from sinew.measure.netcdf import save_recording

TIME = np.arange(0, 16, 0.01)
PHASE = chirp(1, 6, 16)
QUANTITY = {"value", "std", "interval90"}


def push(t):
    return 20 * np.sin(PHASE(t))


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A linear joint of 3 Hz and D = 0.1 under a force sweep, in volts."""
    response = noisy(motion(viscous(0.1), push, TIME)[0], 0.002, 1)
    return write(tmp_path_factory.mktemp("sweep") / "sweep.csv", t=TIME, u=push(TIME), y=response)


def write(path: Path, **columns: np.ndarray) -> Path:
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> dict[str, Any]:
    assert main(["identify", *map(str, arguments), "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    assert main(["identify", *map(str, arguments), "--json"]) == 2
    return capsys.readouterr().err


COLUMNS = ("--time", "t", "--input", "u:V", "--output", "y:V", "--excitation", "force")
DOCUMENT = (
    "model",
    "parameters",
    "natural_frequency_hz",
    "damping_ratio",
    "rmse",
    "unit",
    "converged",
    "message",
    "unidentifiable",
    "compared",
)


def test_the_document_has_the_keys_of_the_reference(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, sweep, *COLUMNS, "--model", "linear")
    assert tuple(found) == DOCUMENT
    assert set(found["compared"][0]) == {"model", "rmse_test", "bic"}
    assert all(set(one) == QUANTITY for one in found["parameters"].values())


def test_the_mechanics_are_those_the_sweep_was_made_with(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, sweep, *COLUMNS, "--model", "linear")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=1e-3)
    assert found["damping_ratio"]["value"] == pytest.approx(0.1, rel=1e-2)
    assert found["unit"] == "V"


def test_train_and_test_ranges_are_sample_indices(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, sweep, *COLUMNS, "--model", "linear", "--train", "0:1000", "--test", "1000:1600")
    assert found["rmse"]["test"] == pytest.approx(0.002, rel=0.2)


def test_a_test_range_before_the_training_range_is_predicted_too(
    sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, sweep, *COLUMNS, "--model", "linear", "--train", "600:1600", "--test", "0:600")
    assert found["rmse"]["test"] == pytest.approx(0.002, rel=0.2)


def test_a_rate_stands_in_for_a_time_column(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, sweep, *COLUMNS[2:], "--rate", "100", "--model", "linear")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=1e-3)


def test_auto_names_the_model_it_chose_and_those_it_compared(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, sweep, *COLUMNS)
    assert found["model"] == "linear"
    assert {row["model"] for row in found["compared"]} >= {"linear", "loss-factor", "coulomb", "cubic"}


def test_without_json_a_table_is_printed(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(sweep), *COLUMNS, "--model", "linear"]) == 0
    assert "natural_frequency_hz" in capsys.readouterr().out


def test_a_constant_input_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path / "a.csv", t=TIME, u=np.ones_like(TIME), y=np.sin(OMEGA * TIME))
    assert "input is constant" in refused(capsys, file, *COLUMNS)


def test_swapped_columns_are_named(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    swapped = ("--time", "t", "--input", "y:V", "--output", "u:V", "--excitation", "force", "--model", "linear")
    assert "swapped" in run(capsys, sweep, *swapped)["message"]


def test_sampling_too_slow_for_the_resonance_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(0, 20, 1 / 7)
    file = write(tmp_path / "a.csv", t=t, u=np.cos(OMEGA * t), y=np.sin(OMEGA * t))
    assert "too slow" in refused(capsys, file, *COLUMNS)


def test_a_record_of_one_period_is_refused_as_too_short(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(0, 0.45, 0.01)
    file = write(tmp_path / "a.csv", t=t, y=np.exp(-t) * np.cos(OMEGA * t))
    assert "too short" in refused(capsys, file, "--time", "t", "--output", "y", "--excitation", "none")


def test_a_lever_taken_for_a_force_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lever = lambda t: 0.3 * np.sin(PHASE(t))  # noqa: E731
    h = 1e-4
    r = motion(viscous(0.1), lambda t: -0.6 * (lever(t + h) - 2 * lever(t) + lever(t - h)) / h**2, TIME)[0]
    file = write(tmp_path / "a.csv", t=TIME, u=lever(TIME), y=noisy(r, 0.002, 3))
    columns = ("--time", "t", "--input", "u:rad", "--output", "y:rad", "--excitation", "torque", "--model", "linear")
    assert "excitation torque looks wrong: as lever" in run(capsys, file, *columns)["message"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--model", "quartic"), "linear"),
        (("--train", "5"), "A:B"),
        (("--train", "0:99999"), "1600"),
        (("--excitation", "wind"), "force"),
    ],
)
def test_a_wrong_word_is_refused_with_what_was_expected(
    sweep: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, str], words: str
) -> None:
    assert words in refused(capsys, sweep, *COLUMNS, *more)


def test_a_whole_folder_of_pages_is_written(sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, sweep, *COLUMNS, "--model", "linear", "--out", tmp_path / "out")
    figures = {
        f"figures/{name}.{ending}" for name in ("backbone", "corner", "fit_data", "residuals") for ending in ENDINGS
    }
    written = {
        path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*") if path.is_file()
    }
    assert written == figures | {"fit.json", "fit.html"}
    assert json.loads((tmp_path / "out" / "fit.json").read_text()) == found


ENDINGS = ("png", "pdf")


def test_the_page_tells_how_to_make_it_again(sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = ("--model", "linear", "--train", "0:1200", "--out", tmp_path / "out")
    run(capsys, sweep, *COLUMNS, *more)
    page = (tmp_path / "out" / "fit.html").read_text(encoding="utf-8")
    again = html.unescape(re.search(r"<pre><code>(sinew identify .*?)</code></pre>", page)[1])  # type: ignore[index]
    words = shlex.split(again)
    assert words[2] == str(sweep)
    assert words[words.index("--train") + 1] == "0:1200"
    assert main([*words[1:], "--json"]) == 0


def test_a_free_decay_has_a_backbone_by_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = TIME[:600]
    clean = motion(viscous(0.03), lambda _: 0.0, t, (0.5, 0.0))[0]
    file = write(tmp_path / "a.csv", t=t, y=noisy(clean, 0.002, 5))
    found = run(capsys, file, "--time", "t", "--output", "y:rad", "--model", "linear", "--out", tmp_path)
    assert found["damping_ratio"]["value"] == pytest.approx(0.03, rel=0.02)
    assert (tmp_path / "figures" / "backbone.png").stat().st_size > 10_000


def test_profiles_are_added_where_they_are_asked_for(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, sweep, *COLUMNS, "--model", "cubic", "--profile")
    [(name, interval)] = found["profile"].items()
    assert name.startswith("cubic_per_s2")
    plain = found["parameters"][name]  # so well known a number has nearly a parabola for a sum of squares
    assert interval["interval90"] == pytest.approx(plain["interval90"], abs=0.1 * plain["std"])


def test_the_rate_may_stand_beside_the_stamps_it_agrees_with(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, sweep, *COLUMNS, "--rate", "100", "--model", "linear")["converged"]
    assert "--rate is 50 Hz" in refused(capsys, sweep, *COLUMNS, "--rate", "50", "--model", "linear")


def test_electrical_units_and_none_at_all_give_the_same_oscillation(
    sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = [
        run(capsys, sweep, "--time", "t", "--input", given, "--output", output, *("--excitation", "force"), *LINEAR)
        for given, output in (("u:V", "y:mV"), ("u:1", "y:1"), ("u:N", "y:mm"), ("u", "y"))
    ]
    assert [one["unit"] for one in found] == ["V", "1", "m", "1"]
    assert np.ptp([one["natural_frequency_hz"]["value"] for one in found]) < 1e-4


LINEAR = ("--model", "linear")


def damaged(folder: Path, kind: str) -> Path:
    """A file or folder that holds no usable record."""
    path = folder / "a.csv"
    rows = [f"{t:.2f},{np.sin(OMEGA * t):.5f},{np.cos(OMEGA * t):.5f}" for t in np.arange(0, 4, 0.01)]
    if kind == "folder":
        path.mkdir()
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "bytes":
        path.write_bytes(bytes(range(256)) * 40)
    elif kind == "nan":
        rows[50] = "0.50,nan,0.1"
    elif kind == "text":
        rows[0] = "s,V,V"
    elif kind == "backwards":
        rows[100], rows[101] = rows[101], rows[100]
    elif kind == "ten rows":
        rows = rows[:10]
    if not path.exists() and kind != "absent":
        path.write_text("\n".join(["t,u,y", *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("folder", "folder"),
        ("empty", "empty"),
        ("bytes", "binary"),
        ("absent", "cannot read"),
        ("nan", "data row 51"),
        ("text", "data row 1"),
        ("backwards", "backwards"),
        ("ten rows", "10 samples"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, words: str
) -> None:
    said = refused(capsys, damaged(tmp_path, kind), *COLUMNS)
    assert words in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (
            ("--time", "t", "--input", "uu:V", "--output", "y:V", "--excitation", "force"),
            "no column 'uu', did you mean",
        ),
        (("--time", "t", "--input", "u:V", "--output", "y:V"), "--excitation"),
        (("--time", "t", "--output", "y:V", "--excitation", "force"), "no input is given"),
        (("--time", "t", "--input", "u:V", "--output", "y:V", "--excitation", "none"), "leave the"),
        (("--time", "t", "--input", "u:V", "--excitation", "force"), "--output COL is missing"),
        (("--input", "u:V", "--output", "y:V", "--excitation", "force"), "--rate HZ"),
        (("--time", "t:mm", "--input", "u:V", "--output", "y:V", "--excitation", "force"), "'mm'"),
        (("--time", "t", "--input", "u:furlongg", "--output", "y:V", "--excitation", "force"), "furlongg"),
        (("--time", "t", "--input", "u:N*m", "--output", "y:rad", "--excitation", "lever"), "no motion"),
        (("--time", "t", "--input", "u:N", "--output", "y:mm", "--excitation", "base"), "force or torque"),
        (("--rate", "-5", "--input", "u:V", "--output", "y:V", "--excitation", "force"), "--rate is -5"),
        ((*COLUMNS, "--model", "tendon"), "recording of a rig"),
        ((*COLUMNS, "--rig", "paper"), "--rig is for"),
        ((*COLUMNS, "--pretension", "4"), "--pretension is for"),
        ((*COLUMNS, "--bootstrap", "50"), "repeats"),
        ((*COLUMNS, "--train", "0:8"), "at least 16"),
        ((*COLUMNS, "--train", "900:400"), "A < B"),
        ((*COLUMNS, "--train", "0:800", "--test", "1500:1700"), "1600"),
    ],
)
def test_a_question_that_cannot_be_answered_is_refused_in_one_line(
    sweep: Path, capsys: pytest.CaptureFixture[str], columns: tuple[str, ...], words: str
) -> None:
    said = refused(capsys, sweep, *columns)
    assert words in said
    assert said.count("\n") == 1


def test_a_training_range_of_one_period_is_refused_as_too_short(
    sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "too short" in refused(capsys, sweep, *COLUMNS, "--train", "0:40")


def test_an_input_in_the_unit_of_a_motion_is_no_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    response = noisy(motion(viscous(0.1), push, TIME)[0], 0.002, 1)
    file = write(tmp_path / "a.csv", t=TIME, u=push(TIME), y=response)
    columns = ("--time", "t", "--input", "u:mm", "--output", "y:mm", "--excitation", "force", "--model", "linear")
    assert "the input is in m, which is no force" in run(capsys, file, *columns)["message"]


def test_one_column_for_both_is_refused(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    columns = ("--time", "t", "--input", "u:V", "--output", "u:V", "--excitation", "force")
    assert "the same numbers" in refused(capsys, sweep, *columns)


def test_a_gap_is_refused_with_what_this_command_can_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.concatenate([TIME[:300], TIME[500:]])
    file = write(tmp_path / "a.csv", t=t, u=push(t), y=np.sin(OMEGA * t))
    said = refused(capsys, file, *COLUMNS)
    assert "gap of 2.01 s" in said
    assert "--start" not in said


def test_stamps_that_were_straightened_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    response = noisy(motion(viscous(0.1), push, TIME)[0], 0.002, 1)
    late = 0.05 * np.ceil(TIME / 0.05)  # five samples wait for one another
    file = write(tmp_path / "a.csv", t=late, u=push(TIME), y=response)
    assert "time stamps replaced" in run(capsys, file, *COLUMNS, "--model", "linear")["message"]


def imported(capsys: pytest.CaptureFixture[str], sweep: Path, folder: Path) -> Path:
    columns = ("--time", "t", "--response", "y:V", "--drive", "u:V", "--kind", "sweep")
    assert main(["import", str(sweep), *columns, "--out", str(folder / "a.nc")]) == 0
    capsys.readouterr()
    return folder / "a.nc"


def test_an_imported_recording_is_asked_what_drives_it(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = imported(capsys, sweep, tmp_path)
    assert "--excitation force" in refused(capsys, file, "--model", "linear")
    found = run(capsys, file, "--excitation", "force", "--model", "linear")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=1e-3)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--time", "t"), "knows its columns"),
        (("--model", "tendon"), "names none"),
        (("--pretension", "4", "--excitation", "force"), "imported"),
        (("--bootstrap", "50", "--excitation", "force"), "imported"),
        (("--model", "tendon", "--posterior"), "--posterior is for models"),
        (("--model", "tendon", "--train", "0:100"), "--train does not go"),
    ],
)
def test_a_recording_is_not_asked_what_it_cannot_answer(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], words: str
) -> None:
    assert words in refused(capsys, imported(capsys, sweep, tmp_path), *more)


def test_a_recording_without_its_ending_is_known_by_its_bytes(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = imported(capsys, sweep, tmp_path).rename(tmp_path / "recording")
    assert run(capsys, file, "--excitation", "force", "--model", "linear")["converged"]


def rig_recording(folder: Path, repeats: int) -> Path:
    """Two pretensions of a linear joint under its lever, at three frequencies, with a gyroscope's noise."""
    path = folder / "rig.nc"
    save_recording(sample_recording((0.0, 4.0), np.array([2.6, 3.0, 3.6]), repeats), path)
    return path


def test_segments_of_one_pretension_of_a_rig_are_fitted_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(capsys, rig_recording(tmp_path, 1), "--pretension", "4", *LINEAR, "--out", tmp_path)
    assert found["natural_frequency_hz"]["value"] == pytest.approx(Joint.at(4.0).natural_hz, rel=2e-3)
    assert found["damping_ratio"]["value"] == pytest.approx(Joint.at(4.0).damping, rel=0.02)
    assert found["parameters"]["lever_inertia_ratio"]["value"] == pytest.approx(Joint.at(4.0).share, rel=0.01)
    assert "3 segments at 4 mm" in found["message"]
    assert (tmp_path / "figures" / "fit_data.png").is_file()


def test_repeats_of_a_rig_give_intervals_by_bootstrap(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, rig_recording(tmp_path, 3), *LINEAR, "--bootstrap", "20")
    assert found["bootstrap"]["natural_frequency_hz"]["value"] == pytest.approx(Joint.at(0.0).natural_hz, rel=2e-3)
    assert 0 < found["bootstrap"]["damping_ratio"]["std"] < 0.002  # nothing but the gyroscope's noise differs
    assert "bootstrap: " in found["message"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--bootstrap", "20"), "repeats nothing"),
        (("--pretension", "5"), "the recording has 0, 4"),
        (("--train", "0:100"), "one record"),
        (("--model", "tendon"), "names none"),
        (("--model", "tendon", "--excitation", "base"), "driven by its lever"),
    ],
)
def test_a_rig_s_recording_is_not_asked_what_it_cannot_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], words: str
) -> None:
    assert words in refused(capsys, rig_recording(tmp_path, 1), *LINEAR, *more)


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("")
    assert "cannot write" in refused(capsys, sweep, *COLUMNS, "--out", tmp_path / "out" / "deeper")


def test_the_help_has_an_example_of_each_kind_of_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "--help"]) == 0
    said = capsys.readouterr().out
    for kind in ("--excitation force", "--excitation none", "--excitation base", "--train", "--model tendon"):
        assert re.search(rf"^ *sinew identify .*{kind}", said, re.MULTILINE), kind


@pytest.mark.slow
def test_a_recording_of_the_twin_needs_no_columns_and_gives_the_papers_three_hertz(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "short", "--rig", "paper", "--out", str(tmp_path / "a.nc")]) == 0
    capsys.readouterr()
    found = run(capsys, tmp_path / "a.nc", "--model", "cubic")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=0.04)


@pytest.mark.slow
def test_the_posterior_of_a_sweep_agrees_with_its_fit(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("numpyro", reason="the posterior needs the extra")
    found = run(
        capsys, sweep, *COLUMNS, *LINEAR, "--train", "0:500", "--test", "500:600", "--posterior", "--out", tmp_path
    )
    fitted, drawn = found["natural_frequency_hz"], found["posterior"]["natural_frequency_hz"]
    assert drawn["value"] == pytest.approx(fitted["value"], abs=0.5 * fitted["std"])
    assert drawn["std"] == pytest.approx(fitted["std"], rel=0.25)
    assert "posterior: 1000 draws" in found["message"]


@pytest.mark.slow
def test_the_tendon_joint_of_a_recording_has_the_papers_three_hertz(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "short", "--rig", "paper", "--out", str(tmp_path / "a.nc")]) == 0
    capsys.readouterr()
    found = run(capsys, tmp_path / "a.nc", "--model", "tendon", "--out", tmp_path / "out")
    assert set(found) == set(DOCUMENT)
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=0.04)
    assert (tmp_path / "out" / "figures" / "corner.png").is_file()
