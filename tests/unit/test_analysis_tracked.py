"""A tracked swing made up from sines: what its turns and its point of the backbone must be is known."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sinew.analysis.analysed import analyse
from sinew.analysis.signal.signals import DelayBudget, drive_chain, torsion_chain
from sinew.analysis.tracked import (
    BACKBONES_ATTRIBUTE,
    find_tracking,
    frequency_on_backbone,
    tracked_point,
    tracked_turns,
    turns_to_lock,
)
from sinew.apps.cli import main
from sinew.measure.files.netcdf import provenance, save_recording
from sinew.measure.recording import Segment, build_recording
from sinew.plan.toml import load_rig

RIG = load_rig("paper")
RATE = 200.0
LEVER, TORSION = math.radians(8.0), math.radians(36.0)


def recording(
    hertz: float = 3.5, error_deg: float = 2.0, seconds: float = 8.0, noise: float = 0.0, drift: float = 0.0
) -> xr.Dataset:
    """Return a swing of which the true lag behind the true lever is 90° and an error, seen by the rig's sensors."""
    rng = np.random.default_rng(1000)
    budget = DelayBudget(
        RATE,
        RIG.imu.low_pass.value,
        RIG.imu.residual_delay.value,
        RIG.imu.average_samples,
        RIG.bus.drive_delay.value,
    )
    time = np.arange(round(seconds * RATE)) / RATE
    phase = math.tau * (hertz * time + 0.5 * drift * time**2)
    omega = math.tau * hertz
    lever = LEVER * complex(drive_chain(budget, hertz)) * np.exp(1j * (phase - 2.0 - math.pi / 2))
    lag = math.radians(90.0 + error_deg)
    rate = 1j * omega * TORSION * complex(torsion_chain(budget, hertz)) * np.exp(1j * (phase - 2.0 - math.pi / 2 - lag))
    third = 0.1 * LEVER * np.cos(3 * phase)
    samples = {
        "time_s": time,
        "drive_command_rad": math.radians(20.0) * np.sin(phase),
        "drive_rad": lever.real + third + noise * rng.standard_normal(time.size),
        "gyro_rad_s": np.stack([rate.real + 0.02, 0 * time, 0 * time], axis=1),
    }
    segment = Segment("tracking", 6.0, math.nan, 20.0, 0)
    return build_recording(samples, [segment], [time.size], provenance("twin"))


def test_turns_have_the_frequency_phase_and_amplitudes_that_were_put_in() -> None:
    turns = tracked_turns(recording(), 0, RIG)
    assert turns.sizes["turn"] == 26  # of 28; the record begins and ends on a zero, which is no crossing
    assert turns["frequency_hz"].values == pytest.approx(3.5, rel=1e-4)
    assert np.degrees(turns["phase_error_rad"].values) == pytest.approx(2.0, abs=0.05)
    assert turns["lever_rad"].values == pytest.approx(LEVER, rel=1e-3)
    assert turns["torsion_rad"].values == pytest.approx(TORSION, rel=1e-3)


def test_a_turn_with_a_hole_is_left_out() -> None:
    whole = recording()
    kept = (whole["time_s"].values < 3.0) | (whole["time_s"].values > 3.5)
    samples = {name: whole[name].values[kept] for name in ("time_s", "drive_command_rad", "drive_rad", "gyro_rad_s")}
    segment = Segment("tracking", 6.0, math.nan, 20.0, 0)
    torn = build_recording(samples, [segment], [int(kept.sum())], provenance("twin"))
    turns = tracked_turns(torn, 0, RIG)
    assert turns.sizes["turn"] < 26
    assert np.degrees(turns["phase_error_rad"].values) == pytest.approx(2.0, abs=0.1)


def test_the_point_has_lehrs_damping_of_the_equivalent_linear_joint() -> None:
    point = tracked_point(tracked_turns(recording(error_deg=0.0), 0, RIG), RIG)
    inertia = RIG.inertia.head.value + RIG.inertia.lever.value
    # At phase resonance I_l Ω² θ = d Ω φ and k = I Ω², so D = d/(2 I Ω).
    omega = math.tau * 3.5
    damper = RIG.inertia.lever.value * omega * LEVER / TORSION
    assert point.damping_ratio.value == pytest.approx(damper / (2 * inertia * omega), rel=2e-3)
    assert point.frequency_hz.low < 3.5 < point.frequency_hz.high
    assert point.torsion_deg.value == pytest.approx(36.0, rel=1e-3)


def test_what_is_unknown_of_the_delay_is_in_the_interval_of_the_frequency() -> None:
    point = tracked_point(tracked_turns(recording(), 0, RIG), RIG)
    phase = math.tau * 3.5 * RIG.imu.delay_std.value
    assert point.frequency_hz.std == pytest.approx(phase * point.damping_ratio.value * 3.5, rel=0.05)


def turns_of(error_deg: Sequence[float], number: Sequence[int] | None = None) -> xr.Dataset:
    count = range(2, 2 + len(error_deg)) if number is None else number
    return xr.Dataset({"phase_error_rad": ("turn", np.radians(error_deg)), "number": ("turn", list(count))})


@pytest.mark.parametrize(
    ("error_deg", "number", "expected"),
    [
        ([50, 20, 5, 3, 1, 1], None, (5.0, 0)),
        ([50, 5, 20, 5, -5, 1], None, (6.0, 0)),  # one turn alone is a chance
        ([50, 40, 20], None, (None, 0)),
        ([5, 3, 31, 20, 5, 5], None, (3.0, 1)),
        ([5, 3, 29, 3], None, (3.0, 0)),
        ([5, 3, 3], [2, 3, 9], (3.0, 1)),  # six turns without a phase
        ([5, 5, 3], [2, 4, 5], (5.0, 0)),  # no two in a row before
    ],
)
def test_it_is_locked_at_the_second_turn_below_6_degrees_and_lost_above_30_or_without_a_phase(
    error_deg: Sequence[float], number: Sequence[int] | None, expected: tuple[float | None, int]
) -> None:
    assert turns_to_lock(turns_of(error_deg, number)) == expected


def test_no_frequency_is_read_off_a_backbone_beyond_its_end() -> None:
    curve = (np.array([10.0, 20.0]), np.array([3.2, 3.0]))
    found = [frequency_on_backbone(*curve, amplitude) for amplitude in (15.0, 20.2, 20.5, 9.9)]
    assert found == pytest.approx([3.1, 3.0, math.nan, math.nan], nan_ok=True)


def predicted(found: xr.Dataset) -> xr.Dataset:
    """Return a recording with the backbone that was predicted of it: 3.4 Hz at its torsion of 36°."""
    curve = {"pretension_mm": 6.0, "frequency_hz": [3.5, 3.4, 3.3], "torsion_deg": [0.0, 36.0, 40.0]}
    return found.assign_attrs({BACKBONES_ATTRIBUTE: json.dumps([curve])})


def test_a_recording_tells_the_prediction_beside_what_was_tracked() -> None:
    (track,) = find_tracking(predicted(recording(error_deg=0.5)), RIG).tracks
    assert track.point is not None
    assert track.point.predicted_hz == pytest.approx(3.4, abs=1e-4)
    assert (track.lock_cycles, track.lock_losses, track.follow) == (3.0, 0, None)
    assert track.phase_error_deg == pytest.approx(0.5, abs=0.05)


def test_what_was_tracked_is_analysed_and_told_as_a_table() -> None:
    found = analyse(recording(error_deg=0.5), RIG)
    (table,) = found.blocks()
    assert not isinstance(table, str)
    assert table.columns[:3] == ["pretension/mm", "held/°", "locked after turns"]
    assert table.rows[0][:3] == ("6", "20", "3")
    assert found.dataset is None


def test_a_recording_that_tracks_gives_its_figure_and_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_recording(predicted(recording(error_deg=0.5)), tmp_path / "recording.nc")
    out = tmp_path / "analysed"
    assert main(["analyse", str(tmp_path / "recording.nc"), "--rig", "paper", "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"recording.nc", "analysis.json", "tracking.png", "tracking.pdf"}
    assert main(["report", str(tmp_path), "--rig", "paper"]) == 0
    assert "resonance/Hz" in capsys.readouterr().out
    assert "A tracked resonance" in (tmp_path / "report.html").read_text()
