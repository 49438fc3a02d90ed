"""The commands for joints that are not built yet: `sinew joint`, `sinew predict --section` and of several."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.contracts.commands import answered, command_lines, refused

from sinew.apps.cli import main
from sinew.plan.toml import load_rig

RING = ("--section", "annulus", "--outer-mm", "60", "--inner-mm", "30", "--length-mm", "95")
SHORT = ("--pretension-mm", "4", "--from-hz", "2.5", "--to-hz", "3.5", "--amplitude-deg", "10")


def test_a_joint_is_written_as_a_rig_and_told_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "ring.toml"
    document = answered(capsys, "joint", *RING, "--material", "dragon-skin-30", "--tendons", "3", "--out", str(out))
    rig = load_rig(out)
    assert document["section"]["torsion_constant_mm4"] == pytest.approx(np.pi * (60**4 - 30**4) / 32)
    assert document["section"]["area_mm2"] == pytest.approx(np.pi * (60**2 - 30**2) / 4)
    assert document["material"]["name"] == "dragon-skin-30"
    assert {"value", "std", "interval90"} == set(document["material"]["shear_modulus_pa"])
    assert (document["name"], document["out"]) == (rig.name, str(out))
    assert rig.tendons.count == 3


def test_a_joint_can_be_derived_from_one_that_was_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = tmp_path / "a.toml", tmp_path / "b.toml"
    main(["joint", *RING, "--out", str(first)])
    assert main(["joint", str(first), "--length-mm", "190", "--name", "long", "--out", str(second)]) == 0
    a, b = load_rig(first), load_rig(second)
    assert b.name == "long"
    assert b.section == a.section
    assert b.silicone.length.value == pytest.approx(0.19)


def test_a_polygon_comes_from_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "square.csv"
    file.write_text("0,0\n40,0\n40,40\n0,40\n", encoding="utf-8")
    section = answered(capsys, "joint", "--section", "polygon", "--polygon", str(file))["section"]
    assert section["torsion_constant_mm4"] == pytest.approx(0.140577 * 40**4, rel=1e-3)  # Timoshenko and Goodier
    assert section["torsion_error"] < 1e-3


@pytest.fixture
def curve(here: Path) -> Path:
    """A neo-Hookean bar of 200 kPa, pulled to 150 % strain and let back on a softer path."""
    strain = np.concatenate([np.linspace(0.02, 1.5, 80), np.linspace(1.48, 0.1, 60)])
    stress = np.where(np.arange(140) < 80, 200.0, 150.0) * (1 + strain - (1 + strain) ** -2)
    rows = [f"{100 * e:.3f},{s:.4f},0" for e, s in zip(strain, stress, strict=True)]
    (here / "casting.csv").write_text("strain [%],pull,still\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return here / "casting.csv"


def test_a_tensile_curve_gives_the_silicone_its_shear_modulus(
    curve: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "casting.toml"
    words = ("--tensile", str(curve), "--tensile-columns", "strain [%],pull:kPa", "--out", str(out))
    document = answered(capsys, "joint", *RING, *words)
    rigidity = load_rig(out).silicone.torsional_rigidity
    assert document["material"]["name"] == "casting"
    assert document["material"]["shear_modulus_pa"]["value"] == pytest.approx(2e5, rel=1e-3)
    assert document["material"]["slack"] == pytest.approx(0, abs=1e-3)
    assert rigidity.value == pytest.approx(2e5 * np.pi * (0.06**4 - 0.03**4) / 32, rel=1e-3)
    assert rigidity.interval90 is not None


@command_lines("""
    joint --tensile casting.csv => STRAIN:unit,STRESS:unit
    joint --tensile casting.csv --tensile-columns 'strain [%]' => two columns
    joint --tensile casting.csv --tensile-columns 'strain [%],pull' => pull:kPa
    joint --tensile casting.csv --tensile-columns 'strain [%],pull:mm' => cannot be turned into 'Pa'
    joint --tensile casting.csv --tensile-columns 'pull:1,strain [%]:kPa' => expected
    joint --tensile casting.csv --tensile-columns 'strain [%],still:kPa' => a stress that changes
    joint --tensile casting.csv --material dragon-skin-30 => --material and --tensile
    joint --length-mm 95 --tensile-columns a,b => without --tensile
""")
def test_a_tensile_curve_that_cannot_be_meant_is_refused(
    arguments: tuple[str, ...], sentence: str, curve: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, *arguments)


@pytest.mark.slow
def test_a_described_joint_is_predicted_as_the_rig_that_is_written_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "predicted"
    described = answered(capsys, "predict", *RING, "--shear-modulus-kpa", "250", *SHORT, "--out", str(out))
    written = answered(capsys, "predict", str(out / "rig.toml"), *SHORT)
    assert written["branches"] == described["branches"]
    assert written["validity"] == described["validity"]
    assert {"check", "value", "limit", "holds", "sentence"} == set(described["validity"][0])
    assert described["section"]["shape"] == "annulus of 60 and 30 mm"
    assert json.loads((out / "prediction.json").read_text(encoding="utf-8"))["branches"] == described["branches"]
    assert "--section annulus --outer-mm 60 --inner-mm 30" in (out / "prediction.html").read_text(encoding="utf-8")
    assert (out / "figures" / "predicted_response.png").stat().st_size > 10_000


@pytest.mark.slow
def test_two_rigs_are_compared_in_one_document_and_on_one_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soft, out = tmp_path / "soft.toml", tmp_path / "compared"
    main(["joint", "--shear-modulus-kpa", "150", "--name", "soft", "--out", str(soft)])
    capsys.readouterr()
    document = answered(capsys, "predict", "paper", str(soft), *SHORT, "--out", str(out))
    assert [rig["rig"] for rig in document["rigs"]] == ["paper", "soft"]
    assert document["amplitude_deg"] == 10
    first, second = (rig["branches"][0]["peak"] for rig in document["rigs"])
    assert second is None or second["frequency_hz"] < first["frequency_hz"]
    assert (out / "comparison.html").is_file()
    assert (out / "figures" / "predicted_comparison.pdf").is_file()


@command_lines("""
    joint => nothing to change
    joint --section heart => 'heart', expected one of circle
    joint --section annulus --outer-mm 60 => --inner-mm is missing
    joint --section circle --outer-mm 60 --width-mm 3 => --width-mm does not
    joint --outer-mm 60 => --outer-mm without --section
    joint --section annulus --outer-mm 30 --inner-mm 60 => 0 < inner < outer
    joint --material jelly => unknown material 'jelly'
    joint --material dragon-skin-30 --shear-modulus-kpa 9 => expected one way to say
    joint --section polygon --polygon nowhere.csv => nowhere.csv
    joint --length-mm -5 => --length-mm is -5, expected 1 to 5000
    predict --oscillator x=1 --length-mm 50 => --length-mm is for a rig or a bent joint
    predict --oscillator x=1 --out o => --out is for a rig, several rigs,
    predict paper paper --backbone => and this is several rigs
    predict paper paper --pretension-mm -2 => cables cannot push
""")
def test_what_cannot_be_meant_is_refused_in_one_line(
    arguments: tuple[str, ...], sentence: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, *arguments)
    assert list(here.iterdir()) == []
