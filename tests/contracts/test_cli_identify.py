"""`sinew identify`: the document that other people's scripts rely on, and what it says of bad input."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.identify_signals import OMEGA, chirp, motion, noisy, viscous

from sinew.apps.cli import main

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


def test_the_document_has_the_keys_of_the_reference(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run(capsys, sweep, *COLUMNS, "--model", "linear")
    assert set(found) == {
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
    }
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


@pytest.mark.slow
def test_a_recording_of_the_twin_needs_no_columns_and_gives_the_papers_three_hertz(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "short", "--rig", "paper", "--out", str(tmp_path / "a.nc")]) == 0
    capsys.readouterr()
    found = run(capsys, tmp_path / "a.nc", "--model", "cubic")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=0.04)
