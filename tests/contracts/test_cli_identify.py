"""`sinew identify`: the document that other people's scripts rely on, and the pages that it writes."""

import html
import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from tests.contracts.identify_sweep import (
    COLUMNS,
    DOCUMENT,
    LINEAR,
    TIME,
    identified,
    push,
    write,
)
from tests.unit.identify_signals import motion, noisy, viscous

from sinew.apps.cli import main

QUANTITY = {"value", "std", "interval90"}


def test_the_document_has_the_keys_of_the_reference_and_the_mechanics_that_the_sweep_was_made_with(
    sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified(capsys, sweep, *COLUMNS, "--model", "linear")
    assert set(found) == set(DOCUMENT)
    assert set(found["compared"][0]) == {"model", "rmse_test", "bic"}
    assert all(set(one) == QUANTITY for one in found["parameters"].values())
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=1e-3)
    assert found["damping_ratio"]["value"] == pytest.approx(0.1, rel=1e-2)
    assert found["unit"] == "V"


@pytest.mark.parametrize(("train", "test"), [("0:1000", "1000:1600"), ("600:1600", "0:600")])
def test_a_test_range_of_samples_after_or_before_the_training_range_is_predicted(
    sweep: Path, capsys: pytest.CaptureFixture[str], train: str, test: str
) -> None:
    found = identified(capsys, sweep, *COLUMNS, "--model", "linear", "--train", train, "--test", test)
    assert found["rmse"]["test"] == pytest.approx(0.002, rel=0.2)


def test_nothing_outside_start_and_stop_is_looked_at(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    x = noisy(motion(viscous(0.1), push, TIME)[0], 0.002, 1)
    spoilt = np.where(TIME < 4, x, 7.0)
    t = np.where(TIME < 12, TIME, TIME + 5.0)  # a gap, too
    file = write(tmp_path / "a.csv", t=t, u=push(TIME), y=spoilt)
    found = identified(capsys, file, *COLUMNS, *LINEAR, "--start", "0", "--stop", "3.9")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=0.01)


def test_a_rate_stands_in_for_a_time_column(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = identified(capsys, sweep, *COLUMNS[2:], "--rate", "100", "--model", "linear")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(3.0, rel=1e-3)


@pytest.mark.slow
def test_auto_names_the_model_it_chose_and_those_it_compared(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = identified(capsys, sweep, *COLUMNS)
    assert found["model"] == "linear"
    assert {row["model"] for row in found["compared"]} >= {"linear", "loss-factor", "coulomb", "cubic"}


def test_without_json_a_table_is_printed(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(sweep), *COLUMNS, "--model", "linear"]) == 0
    assert "natural frequency/Hz" in capsys.readouterr().out


@pytest.mark.slow
def test_a_whole_folder_of_pages_is_written(sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = identified(capsys, sweep, *COLUMNS, "--model", "linear", "--out", tmp_path / "out")
    figures = {f"figures/{name}.{ending}" for name in ("corner", "fit_data", "residuals") for ending in ENDINGS}
    written = {
        path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*") if path.is_file()
    }
    assert written == figures | {"fit.json", "fit.html"}
    assert json.loads((tmp_path / "out" / "fit.json").read_text()) == found


ENDINGS = ("png", "pdf")


@pytest.mark.slow
def test_the_page_tells_how_to_make_it_again(sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = ("--model", "linear", "--train", "0:1200", "--out", tmp_path / "out")
    identified(capsys, sweep, *COLUMNS, *more)
    page = (tmp_path / "out" / "fit.html").read_text(encoding="utf-8")
    again = html.unescape(re.search(r"<pre><code>(sinew identify .*?)</code></pre>", page)[1])  # type: ignore[index]
    words = shlex.split(again)
    assert words[2] == str(sweep)
    assert words[words.index("--train") + 1] == "0:1200"
    assert main([*words[1:], "--json"]) == 0


@pytest.mark.slow
def test_a_free_decay_needs_no_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = TIME[:600]
    clean = motion(viscous(0.03), lambda _: 0.0, t, (0.5, 0.0))[0]
    file = write(tmp_path / "a.csv", t=t, y=noisy(clean, 0.002, 5))
    found = identified(capsys, file, "--time", "t", "--output", "y:rad", "--model", "linear", "--out", tmp_path)
    assert found["damping_ratio"]["value"] == pytest.approx(0.03, rel=0.02)
    assert (tmp_path / "figures" / "residuals.png").stat().st_size > 10_000


def test_electrical_units_and_none_at_all_give_the_same_oscillation(
    sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = [
        identified(
            capsys, sweep, "--time", "t", "--input", given, "--output", output, *("--excitation", "force"), *LINEAR
        )
        for given, output in (("u:V", "y:mV"), ("u:1", "y:1"), ("u:N", "y:mm"), ("u", "y"))
    ]
    assert [one["unit"] for one in found] == ["V", "1", "m", "1"]
    assert np.ptp([one["natural_frequency_hz"]["value"] for one in found]) < 1e-4


def test_the_help_has_an_example_of_each_kind_of_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "--help"]) == 0
    said = capsys.readouterr().out
    for kind in ("--excitation force", "--excitation none", "--excitation base", "--train", "--model tendon"):
        assert re.search(rf"^ *sinew identify .*{kind}", said, re.MULTILINE), kind


@pytest.mark.slow
def test_the_posterior_of_a_sweep_agrees_with_its_fit(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("numpyro", reason="the posterior needs the extra")
    found = identified(
        capsys, sweep, *COLUMNS, *LINEAR, "--train", "0:500", "--test", "500:600", "--posterior", "--out", tmp_path
    )
    fitted, drawn = found["natural_frequency_hz"], found["posterior"]["natural_frequency_hz"]
    assert drawn["value"] == pytest.approx(fitted["value"], abs=0.5 * fitted["std"])
    assert drawn["std"] == pytest.approx(fitted["std"], rel=0.25)
    assert "posterior: 1000 draws" in found["message"]
