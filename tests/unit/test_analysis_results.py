"""Results of a whole recording, and their map and table."""

import json

import numpy as np
import pytest
import xarray as xr
from tests.unit.analysis_sweep import QUIET, Joint, Sensing, rig_with, sweep

from sinew.analysis.analysed import analyse_recording, join_parts, response_rows
from sinew.measure.errors import RecordingError, SchemaError
from sinew.measure.files.netcdf import content_hash, load_dataset, save_dataset
from sinew.measure.recording import (
    ENERGY_QUANTITIES,
    POWER_COLUMNS,
    RESULT_VARIABLES,
    companions,
    validate_results,
)
from sinew.measure.result import plain

FREQUENCY_HZ = np.linspace(1.53, 5.97, 24)
JOINTS = [Joint(natural_hz=3.0), Joint(natural_hz=3.6, damping=0.09), Joint(natural_hz=4.1, damping=0.1)]


@pytest.fixture(scope="module")
def recording():
    return sweep(JOINTS, FREQUENCY_HZ, repeats=3, sensing=Sensing())


@pytest.fixture(scope="module")
def results(recording):
    return analyse_recording(recording, rig_with(Sensing(), delay_std_s=0.3e-3))


def test_results_of_a_sweep_have_every_variable_of_response_and_resonance(results) -> None:
    axes = {("pretension_mm", "frequency_hz", "repeat"), ("pretension_mm",), ("frequency_hz",)}
    expected = {name for name, row in RESULT_VARIABLES.items() if row.dims in axes}
    without_currents = POWER_COLUMNS | {end for name in ENERGY_QUANTITIES for end in (name, *companions(name))}
    assert expected - without_currents <= set(map(str, results.variables))


def test_results_survive_a_file(results, tmp_path) -> None:
    save_dataset(results, tmp_path / "results.nc")
    assert content_hash(load_dataset(tmp_path / "results.nc").drop_attrs()) == content_hash(results.drop_attrs())


def test_the_resonances_are_those_of_the_joints(results) -> None:
    np.testing.assert_allclose(results["resonance_hz"], [joint.resonance_hz for joint in JOINTS], rtol=3e-4)


def test_five_frequencies_give_a_response_without_resonance() -> None:
    found = analyse_recording(sweep(JOINTS[:1], [2.0, 2.5, 3.0, 3.5, 4.0]), rig_with(QUIET))
    assert "resonance_hz" not in found
    assert "too few" in found.attrs["resonance_notes"]


def test_a_recording_of_rest_alone_is_refused() -> None:
    rest = sweep(JOINTS[:1], [2.0])
    rest["kind"][0] = "idle"
    with pytest.raises(RecordingError, match="only idle segments"):
        analyse_recording(rest)


def test_the_table_has_a_row_for_each_pretension_and_frequency_with_intervals_in_json(results) -> None:
    rows = response_rows(results)
    row = rows[7]
    assert len(rows) == 3 * FREQUENCY_HZ.size
    assert row.gain_measured_drive.low < row.gain_measured_drive.value < row.gain_measured_drive.high
    assert row.phase_lag_deg.std >= 360 * row.frequency_hz * 0.3e-3  # the delay's share is in it
    assert row.drive_current_rms_a is None
    assert json.loads(json.dumps(plain(rows), allow_nan=False))


def ring_down_part(pretension_mm, repeats: int) -> xr.Dataset:
    values = np.add.outer(np.asarray(pretension_mm), np.arange(repeats) / 10)
    return xr.Dataset(
        {"damping_ratio": (("pretension_mm", "repeat"), values, {"units": "1"})},
        {"pretension_mm": np.asarray(pretension_mm), "repeat": np.arange(1, repeats + 1)},
    )


def test_a_pretension_is_found_by_its_millimetres_and_not_by_its_place(recording) -> None:
    at = analyse_recording(recording.assign(pretension_mm=recording["pretension_mm"] + 14.0))
    with pytest.raises(KeyError):
        at.sel(pretension_mm=1)
    np.testing.assert_array_equal(at.sel(pretension_mm=15)["gain"], at.isel(pretension_mm=1)["gain"])


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda r: r.drop_vars("repeat"), "the axis 'repeat' of these results has no coordinate"),
        (
            lambda r: r.assign_coords(pretension_mm=[0.0, 0.0, 1.0]),
            "'pretension_mm' of these results holds a mark twice",
        ),
        (lambda r: r.assign_coords(pretension_mm=[0.0, 1.0, np.nan]), "holds a mark twice, NaN or infinity"),
    ],
)
def test_results_whose_places_have_no_name_of_their_own_are_refused(results, wrong, told) -> None:
    with pytest.raises(SchemaError, match=told):
        validate_results(wrong(results))


def test_a_ring_down_part_joins_a_sweep_at_its_own_pretensions(results) -> None:
    joined = join_parts([results, ring_down_part([1.0, 5.0], 2)])
    np.testing.assert_array_equal(joined["pretension_mm"], [0, 1, 2, 5])
    np.testing.assert_array_equal(joined["damping_ratio"].values[:, 1], [np.nan, 1.1, np.nan, 5.1])
    np.testing.assert_array_equal(joined["gain"].values[:3], results["gain"].values)
