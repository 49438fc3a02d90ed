"""`sinew predict fit.json`: the document that scripts rely on, what is written, and what is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.contracts.commands import answered, command_lines, refused

from sinew.identify.forced import Mechanics

OMEGA = 2 * np.pi * 3.0
FEW = ("--from-hz", "2", "--to-hz", "4", "--bands", "20")


def held(unit: str, excitation: str = "none", **more: float) -> dict[str, Any]:
    numbers = {"stiffness": OMEGA**2, "damping": 0.1 * OMEGA} | more
    spread = np.diag((1e-3 * np.array(list(numbers.values()))) ** 2)
    known = Mechanics("linear", excitation, unit, "N*m", numbers, spread, 500.0, 0.5)  # type: ignore[arg-type]
    return {"model": "linear", "mechanics": known.to_dict()}


@pytest.fixture
def fits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with fits of a decay of an angle and of a length, of a driven record, and of what none is."""
    monkeypatch.chdir(tmp_path)
    made = {
        "angle": held("rad"),
        "length": held("m"),
        "driven": held("rad", "torque", gain=80.0),
        "joint": {"model": "tendon"},
        "old": {"model": "linear"},
        "else": {"rig": "paper"},
    }
    for name, document in made.items():
        Path(f"{name}.json").write_text(json.dumps(document), encoding="utf-8")
    Path("text.json").write_text("no JSON", encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_the_document_has_the_keys_of_the_reference(fits: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = answered(
        capsys, "predict", "length.json", "--torque", "1,2:V", "--through", "2.8:5+-0.1:mm@2", *FEW, "--out", "out"
    )
    assert set(found) == {
        "fit", "model", "unit", "drive", "through", "levels", "harmonics", "error_estimate", "draws", "remarks"
    }  # fmt: skip
    assert (found["unit"], found["drive"]["kind"], found["drive"]["unit"]) == ("mm", "torque", "V")
    assert found["through"] == pytest.approx({"frequency_hz": 2.8, "amplitude": 5.0, "std": 0.1, "level": 2.0})
    first, second = found["levels"]
    assert set(first) == {
        "level", "frequency_hz", "amplitude", "fundamental", "phase_deg", "stable", "folds", "peak", "phase_90",
        "complete", "message", "band",
    }  # fmt: skip
    assert set(first["band"]) == {
        "frequency_hz", "up", "down", "peak", "phase_90", "folds", "draws", "complete", "folded"
    }  # fmt: skip
    near = float(np.interp(2.8, second["frequency_hz"], second["amplitude"]))
    assert near == pytest.approx(5.0, rel=1e-3)
    assert first["peak"]["amplitude"] == pytest.approx(0.5 * second["peak"]["amplitude"], rel=1e-6)
    written = {path.relative_to("out").as_posix() for path in Path("out").rglob("*") if path.is_file()}
    figures = {f"figures/forced_response.{ending}" for ending in ("png", "pdf")}
    assert written == figures | {"prediction.json", "prediction.html"}
    assert json.loads(Path("out/prediction.json").read_text(encoding="utf-8")) == found


@pytest.mark.slow
def test_angles_are_degrees_and_a_driven_fit_takes_levels_in_its_inputs_unit(
    fits: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = answered(capsys, "predict", "driven.json", "--torque", "100:mN*m", *FEW)
    (one,) = found["levels"]
    assert (found["unit"], found["drive"]["unit"], one["level"]) == ("deg", "mN*m", pytest.approx(100.0))
    assert one["peak"]["amplitude"] == pytest.approx(np.degrees(8.0 / (0.1 * OMEGA**2)), rel=3e-3)


@pytest.mark.parametrize(("said", "size"), [("mm", 1e-3), ("%", 0.01)])
def test_numbers_without_a_unit_are_in_that_of_the_decay(
    said: str, size: float, fits: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(0, 3, 0.01)
    swing = 8 * np.exp(-1.2 * t) * np.cos(OMEGA * t) + np.random.default_rng(0).normal(0, 0.05, t.size)
    Path("decay.csv").write_text("t,x\n" + "\n".join(f"{a:.2f},{b:.4f}" for a, b in zip(t, swing, strict=True)))
    found = answered(capsys, "identify", "decay.csv", "--time", "t", "--output", f"x:{said}", "--model", "linear")
    Path("fit.json").write_text(json.dumps(found), encoding="utf-8")
    pushed = answered(capsys, "predict", "fit.json", "--torque", "1", "--through", "2.8:5", *FEW)
    assert (pushed["unit"], pushed["through"]["amplitude"]) == (said, pytest.approx(5.0))
    moved = answered(capsys, "predict", "fit.json", "--base", "0.5", *FEW)
    assert (moved["drive"]["unit"], moved["levels"][0]["level"]) == (said, pytest.approx(0.5))
    omega, damping = (found["parameters"][name]["value"] for name in ("stiffness_per_s2", "damping_per_s"))
    at = (2 * np.pi * 2.8) ** 2
    gain = 5.0 * size * np.hypot(omega - at, damping * np.sqrt(at))
    assert pushed["drive"]["gain"]["value"] == pytest.approx(gain, rel=1e-3)


@command_lines("""
    angle.json => --torque, the levels
    angle.json --torque 1 --base 1 => --torque, the levels
    angle.json --torque 1 => does not determine the inertia
    angle.json --torque 1 --through 3 => expected HZ:AMPLITUDE
    angle.json --torque 1 --through 3:x => found 'x'
    angle.json --torque 1 --through 3:1:mm => cannot be turned into 'rad'
    angle.json --torque 0,1 --through 3:1 => positive amplitudes
    angle.json --base 1:mm => cannot be turned into 'rad'
    angle.json --base 1 --amplitude-deg 5 => --amplitude-deg
    angle.json --base 1 --backbone => --backbone is for a rig or an oscillator (--oscillator), and this is a fit
    angle.json --base 1 --length-mm 50 => --length-mm is for a rig or a bent joint (--bend-deg), and this is a fit
    angle.json --base 1 --from-hz 4 --to-hz 2 => from 4 to 2 Hz
    joint.json --base 1 => sinew calibrate
    old.json --base 1 => identify anew
    else.json --base 1 => is no fit
    text.json --base 1 => is not JSON
    none.json --base 1 => cannot read none.json
    paper --through 3:1 => --through is for a fit
    angle.json angle.json --base 1 => found 2 files, expected one fit
""")
def test_what_cannot_be_meant_is_refused_in_one_line(
    arguments: tuple[str, ...], sentence: str, fits: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, "predict", *arguments)
