"""One vocabulary: columns, laws, units of a drive and axes are called alike in every command and in Python."""

import inspect
import json
import math
from pathlib import Path

import numpy as np
import pytest
import typer

import sinew as sn
from sinew.apps.cli import app, main
from sinew.predict.oscillator import KEYS, Oscillator


@pytest.mark.parametrize("pair", [{"--response", "--output"}, {"--drive", "--input"}])
def test_a_command_takes_a_column_by_either_of_its_names(pair: set[str]) -> None:
    commands = typer.main.get_group(app).commands
    named = {name: {word for option in one.params for word in option.opts} & pair for name, one in commands.items()}
    assert {name: words for name, words in named.items() if words} == dict.fromkeys(
        ("analyse", "identify", "import"), pair
    )


def test_analyse_finds_the_same_by_output_as_by_response(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{i / 100},{i},{math.exp(-i / 100) * math.cos(i / 5)}" for i in range(400)]
    Path("decay.csv").write_text("\n".join(["t_s,other,angle_deg", *rows]))
    found = []
    for word in ("--response", "--output"):
        assert main(["analyse", "decay.csv", "--kind", "ring-down", "--time", "t_s", word, "angle_deg", "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0] == found[1]


def test_help_of_identify_lists_every_law(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "--help"]) == 0
    said = capsys.readouterr().out
    listed = said[said.index("--model MODEL") : said.index("--start S")]
    words = set("".join(listed.split()).replace("[default:auto]", "").split("fit:")[1].rstrip(".").split(","))
    assert {name for name in sn.MODELS if name not in words | {word.removeprefix("or") for word in words}} == set()
    assert {"auto", "tendon(ofarig'srecording)"} <= words


def test_every_plot_takes_one_axes_as_ax() -> None:
    plots = [
        one for name, one in vars(sn.plot).items() if inspect.isfunction(one) and one.__module__ == sn.plot.__name__
    ]
    public = [one for one in plots if not one.__name__.startswith("_")]
    assert len(public) >= 9
    assert [one.__name__ for one in public if "ax" not in inspect.signature(one).parameters] == []


@pytest.mark.slow
def test_a_base_of_one_degree_is_one_degree_in_python_and_on_the_command_line(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(0, 4, 0.01)
    swing = 0.35 * np.exp(-1.2 * t) * np.cos(2 * np.pi * 3 * t) + np.random.default_rng(0).normal(0, 0.003, t.size)
    fit = sn.identify(sn.make_record(t, swing, output_unit="rad"), "linear")
    Path("fit.json").write_text(json.dumps(fit.to_dict()))
    (level,) = fit.predict(base=1.0, draws=20).to_dict()["levels"]
    assert level["level"] == pytest.approx(1.0)
    assert main(["predict", "fit.json", "--base", "1", "--bands", "20", "--json"]) == 0
    (same,) = json.loads(capsys.readouterr().out)["levels"]
    assert (same["level"], max(same["amplitude"])) == pytest.approx((1.0, max(level["amplitude"])))


def test_help_of_predict_lists_every_number_of_an_oscillators_law(capsys: pytest.CaptureFixture[str]) -> None:
    """Units of k₃ φ³, k₂ φ², M_c and c |φ̇| φ̇, each a torque."""
    assert main(["predict", "--help"]) == 0
    said = "".join(capsys.readouterr().out.split())
    for key in ("cubic_n_m_rad3", "quadratic_n_m_rad2", "coulomb_n_m", "drag_n_m_s2_rad2", "inertia_kg_m2"):
        assert key in said
    assert set(KEYS.values()) == set(Oscillator._fields) - {"torque", "base"}
