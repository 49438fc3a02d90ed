"""`sinew identify --kind stepped`: a table of steady states, and a rig's steady segments, through the command."""

from pathlib import Path

import numpy as np
import pytest
from tests.contracts.commands import command_lines
from tests.contracts.identify_sweep import DOCUMENT, identified, unidentified, write
from tests.unit.figures_sample import Joint, sample_recording

from sinew.measure.files.netcdf import save_recording

INERTIA, STIFFNESS, DAMPING = 0.0127, 4.5, 0.024
COLUMNS = ("--kind", "stepped", "--output", "angle:deg", "--input", "torque:N*m", "--excitation", "torque")


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a table of a linear joint at two levels, its phase counted as a lag, half a percent of noise."""
    frequency = np.tile(np.linspace(2.0, 4.5, 14), 2)
    omega, torque = 2 * np.pi * frequency, np.repeat([0.1, 0.3], 14)
    rng = np.random.default_rng(2)
    noise = 5e-3 * (rng.standard_normal(28) + 1j * rng.standard_normal(28))
    angle = torque / (STIFFNESS - INERTIA * omega**2 + 1j * DAMPING * omega) * (1 + noise)
    columns = {"angle": np.rad2deg(np.abs(angle)), "phase_deg": -np.rad2deg(np.angle(angle)), "torque": torque}
    return write(tmp_path_factory.mktemp("steps") / "steps.csv", frequency_hz=frequency, **columns)


def test_the_mechanics_behind_steady_states_come_back_inside_their_intervals(
    steps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified(capsys, steps, *COLUMNS, "--model", "linear")
    truth = {"stiffness_n_m_per_rad": STIFFNESS, "damping_n_m_s_per_rad": DAMPING, "inertia_kg_m2": INERTIA}
    for name, value in truth.items():
        one = found["parameters"][name]
        assert abs(one["value"] - value) < 3 * one["std"] < 0.02 * value


def test_the_document_of_steady_states_is_that_of_samples_and_has_their_peaks(
    steps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified(capsys, steps, *COLUMNS, "--model", "linear")
    assert set(found) == {*DOCUMENT, "peaks"}
    assert [one["input_amplitude"] for one in found["peaks"]] == [0.1, 0.3]


@pytest.mark.slow
def test_auto_finds_the_law_of_steady_states_and_draws_them(
    steps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified(capsys, steps, *COLUMNS, "--out", tmp_path)
    assert found["model"] == "linear" or "cannot tell linear" in found["message"]
    assert (tmp_path / "figures" / "response.png").stat().st_size > 10_000
    assert (
        "response.png" in (tmp_path / "fit.html").read_text() or "data:image/png" in (tmp_path / "fit.html").read_text()
    )


def test_the_steady_segments_of_a_rig_are_steady_states(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "rig.nc"
    save_recording(sample_recording((0.0, 4.0), np.array([2.6, 2.8, 3.0, 3.3, 3.6]), 1), file)
    found = identified(capsys, file, "--kind", "stepped", "--pretension", "4", "--model", "linear")
    assert found["natural_frequency_hz"]["value"] == pytest.approx(Joint.at(4.0).natural_hz, rel=2e-3)
    assert found["damping_ratio"]["value"] == pytest.approx(Joint.at(4.0).damping, rel=0.02)


@command_lines("""
    --time t => --time is for samples over time
    --posterior => --posterior is for samples over time
    --chain delay => expected phase, background
    --phase turn => turn
    --frequency frequency_hz:rad/s => expected Hz
    --model tendon => leave --kind stepped out
    --pretension 4 => recording of a rig
    --excitation none => say what the input is
    --kind sweep => expected one of samples, stepped
""")
def test_what_does_not_go_with_steady_states_is_refused(
    steps: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    assert sentence in unidentified(capsys, steps, *COLUMNS, *arguments)


def test_options_of_steady_states_are_refused_for_samples(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "add --kind stepped" in unidentified(capsys, sweep, "--time", "t", "--output", "y:V", "--phase", "p")
