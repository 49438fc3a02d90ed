"""`sinew predict --bands` and `--against`: the documents that scripts rely on, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from tests.contracts.commands import answered, command_lines, refused
from tests.unit.analysis_sweep import Joint, sweep

from sinew.identify.joint.calibration import Source, calibrated_together
from sinew.measure.files.netcdf import save_recording
from sinew.plan.plan import Plan, Pretension, Sweep
from sinew.plan.toml import dump_rig, load_rig
from sinew.twin.simulate import simulate

SWEEP = Sweep(frequency_hz=(2.6, 2.9, 3.2, 3.5, 3.8, 4.1, 4.4), settle_s=2.0, periods=4, repeats=1)
PLAN = Plan(name="few", pretension=Pretension(pretension_mm=(0.0, 6.0), rest_s=0.2), sweep=SWEEP)
TENSION = "tendons.first_contact_tension"


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two rigs, one of them calibrated at 0 mm as far as it says, and a recording of another joint."""
    folder = tmp_path_factory.mktemp("rigs")
    rig = load_rig("paper")
    record = calibrated_together([TENSION], np.array([[0.3**2]]), [Source("monday.nc", "0" * 64)], [0.0])
    (folder / "mine.toml").write_text(dump_rig(rig.model_copy(update={"calibration": record})), encoding="utf-8")
    (folder / "plain.toml").write_text(dump_rig(rig), encoding="utf-8")
    save_recording(sweep([Joint()], SWEEP.frequency_hz), folder / "other.nc")
    return folder


@pytest.fixture(scope="module")
def bench(rigs: Path) -> Path:
    """The same folder with a recording of the rig at 0 and 6 mm."""
    save_recording(simulate(PLAN, load_rig("paper"), seed=3), rigs / "tuesday.nc")
    return rigs


@pytest.mark.slow
def test_bands_have_the_keys_of_the_reference(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = str(bench / "mine.toml")
    found = answered(
        capsys, "predict", rig, "--pretension-mm", "6", "--from-hz", "2.5", "--to-hz", "4.5", "--bands", "20"
    )
    (band,) = found["bands"]
    assert set(band) == {
        "pretension_mm", "frequency_hz", "up", "down", "reached", "peak", "phase_90", "folds",
        "draws", "complete", "folded",
    }  # fmt: skip
    assert set(found["draws"]) == {"count", "seed", "parameters", "remarks"}
    assert found["draws"]["parameters"] == [TENSION]
    tube = band["up"]["amplitude_deg"]
    assert len(tube["low"]) == len(tube["median"]) == len(tube["high"]) == len(band["frequency_hz"])
    low, high = band["peak"]["frequency_hz"]["interval90"]
    assert low < found["branches"][0]["peak"]["frequency_hz"] < high
    assert (band["draws"], band["complete"], band["folded"], band["folds"]) == (20, 20, 0, [])


@pytest.mark.slow
def test_against_a_recording_has_the_keys_of_the_reference_and_the_figure(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, recording, out = str(bench / "mine.toml"), str(bench / "tuesday.nc"), tmp_path / "out"
    found = answered(capsys, "predict", rig, "--against", recording, "--out", str(out))
    against = found["against"]
    assert set(against) == {
        "recording", "amplitude_deg", "mode", "fitted_mm", "scores", "resonance", "points", "remarks"
    }  # fmt: skip
    assert [branch["pretension_mm"] for branch in found["branches"]] == [0.0, 6.0]
    assert (against["recording"], against["fitted_mm"]) == ("tuesday.nc", [0.0])
    assert [row["fitted"] for row in against["resonance"]] == [True, False]
    assert set(against["scores"]) == {"all", "fitted", "others"}
    assert set(against["scores"]["others"]["gain"]) == {"count", "rms", "largest", "noise", "inside"}
    assert len(against["points"]) == 14
    assert set(against["points"][0]["phase_lag_deg"]) == {"measured", "predicted", "error"}
    assert (out / "figures" / "predicted_against.png").stat().st_size > 20_000
    # The same rig made the recording: what is left is the scatter of a pretension by 0.1 mm, about 2 % of gain at most.
    assert against["scores"]["all"]["gain"]["rms"] < 0.03
    assert against["scores"]["all"]["phase_lag_deg"]["rms"] < 3.0


@command_lines("""
    plain.toml --bands 20 => holds no intervals
    mine.toml --bands 3 => --bands
    --oscillator inertia_kg_m2=1,frequency_hz=1,damping_ratio=0.1 --torque-n-m 1 --bands 20 => is an oscillator
    mine.toml --fitted-mm '0, 4' => name one with --against
    mine.toml --against other.nc --fitted-mm zero => zero or more, as 0,4,8
    mine.toml --against plain.toml => is not a NetCDF file
    mine.toml --against sunday.nc => sunday.nc
    mine.toml --against other.nc --to-hz 4 => goes from 2.6 to 4.4 Hz
""")
def test_what_cannot_be_meant_is_refused(
    arguments: tuple[str, ...],
    sentence: str,
    rigs: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(rigs)
    assert sentence in refused(capsys, "predict", *arguments)


@command_lines("""
    predict paper --azimuth-deg 90 => --azimuth-deg is for a bent joint (--bend-deg), and this is a rig
    predict paper --bend-deg 20 --bands 20 => --bands is for a rig or a fit (FIT.json), and this is a bent joint
    predict paper --bend-deg 20 --backbone => --backbone is for a rig or an oscillator
    predict paper --bend-deg 20 --torque-n-m 1 => --torque is for a fit (FIT.json) or an oscillator
    predict --bend-deg 20 => expected a RIG
    predict paper --bend-deg 20 --out folder => ends with .png, .pdf or .svg
    predict paper --bend-deg 61 => --bend-deg
""")
def test_a_bent_joint_is_not_asked_for_what_only_the_torsional_one_has(
    arguments: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, *arguments)
