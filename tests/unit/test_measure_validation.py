"""What a user's own program hands in: taken for what it says, or refused with a sentence."""

from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sinew.analysis.analysed import analyse_recording
from sinew.analysis.decay.ring_down import analyse_ring_down, analyse_ring_downs
from sinew.analysis.sweep.response import estimate_response
from sinew.identify.oscillator.record import make_record
from sinew.measure.errors import FileError, RecordingError, SchemaError, SpecError, TimeError, UnitError
from sinew.measure.files.formats import export_recording
from sinew.measure.files.netcdf import load_dataset, load_recording, save_recording
from sinew.measure.read import read
from sinew.measure.recording import Segment, build_recording, validate_results
from sinew.measure.validation import as_numbers, as_path, as_seconds
from sinew.twin.simulate import simulate

STEP_S = 0.01
as_csv = partial(export_recording, to="csv")
T = np.arange(0, 4, STEP_S)
PHI = 0.3 * np.exp(-1.2 * T) * np.cos(2 * np.pi * 3 * T)
STAMPS = pd.Timestamp("2026-03-01 12:00:00.25") + pd.to_timedelta(T, unit="s")

TIMES: dict[str, Any] = {
    "a list": T.tolist(),
    "a Series whose index is not from 0": pd.Series(T, index=np.arange(T.size) + 50),
    "a DataArray": xr.DataArray(T, dims="n"),
    "a DatetimeIndex": STAMPS,
    "a Series of dates": pd.Series(STAMPS),
    "dates with a time zone": STAMPS.tz_localize("Europe/Berlin"),
    "a Series with a time zone": pd.Series(STAMPS.tz_localize("UTC")),
    "a TimedeltaIndex": pd.to_timedelta(T, unit="s"),
    "numpy dates": STAMPS.to_numpy(),
    "numpy durations of whole milliseconds": (T * 1000).round().astype("timedelta64[ms]"),
    "Python's datetimes": [datetime(2026, 3, 1, tzinfo=UTC) + timedelta(seconds=float(t)) for t in T],
    "Python's timedeltas": [timedelta(seconds=float(t)) for t in T],
    "a DataFrame of one column": pd.DataFrame({"t": T}),
    "pandas' own floats": pd.Series(T).astype("Float64"),
    "a masked array without a masked sample": np.ma.masked_array(T, mask=False),
}


@pytest.mark.parametrize("name", TIMES)
def test_times_become_seconds_from_the_first(name: str) -> None:
    np.testing.assert_allclose(as_seconds(TIMES[name]), T, atol=1e-9)


def test_a_day_of_summer_time_has_no_hole_of_an_hour() -> None:
    across = pd.date_range("2026-03-29 01:59:59", periods=3, freq="1s", tz="Europe/Berlin")
    np.testing.assert_allclose(as_seconds(across), [0, 1, 2])


WHOLE = np.round(1e4 * PHI).astype(np.int32)


@pytest.mark.parametrize(
    "given", [WHOLE, WHOLE.tolist(), pd.Series(WHOLE), WHOLE.astype(np.float32), pd.DataFrame({"phi": WHOLE})]
)
def test_whole_numbers_lists_series_and_float32_are_taken_for_what_they_are(given: Any) -> None:
    found, plain = analyse_ring_down(T, given), analyse_ring_down(T, WHOLE.astype(float))
    assert found.damping_ratio.value == pytest.approx(plain.damping_ratio.value, rel=1e-12)


class Quantity:
    """A number with a unit, as pint has it."""

    magnitude, units = PHI, "degree"


REFUSED: dict[str, tuple[Any, str]] = {
    "masked samples": (np.ma.masked_array(PHI, mask=PHI > 0.29), "masked samples; fill them in"),
    "dates": (STAMPS, "holds dates or durations, expected numbers"),
    "dates with a zone": (pd.Series(STAMPS.tz_localize("UTC")), "holds dates or durations"),
    "complex numbers": (PHI + 0j, "complex numbers, expected real ones"),
    "text": (["0.1", "0.2"], "values, expected numbers"),
    "truth": (PHI > 0, "bool values, expected numbers"),
    "things": ([None, object()], "what is no number"),
    "a table": (pd.DataFrame({"a": PHI, "b": PHI}), r"a table of columns a, b; expected one column"),
    "a dataset": (xr.Dataset({"a": ("n", PHI)}), "a whole dataset; expected one variable"),
    "a quantity": (Quantity(), "carries a unit of its own"),
    "rows of different length": ([[1.0, 2.0], [3.0]], "no column of numbers"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_column_of_numbers_is_refused_with_a_sentence(name: str) -> None:
    given, told = REFUSED[name]
    with pytest.raises(RecordingError, match=told):
        as_numbers(given, "response")


@pytest.mark.parametrize("door", [analyse_ring_down, make_record], ids=["ring-down", "identify"])
def test_every_function_of_numbers_refuses_dates_among_them(door: Any) -> None:
    with pytest.raises(RecordingError, match="holds dates or durations, expected numbers"):
        door(T, STAMPS)


def test_a_recording_can_be_built_from_dates_and_a_series() -> None:
    made = build_recording(
        {"time_s": STAMPS, "torsion_rad": pd.Series(PHI)},
        [Segment("ring-down", 0.0, np.nan, np.nan, 0)],
        [T.size],
        {"source": "import"},
    )
    np.testing.assert_allclose(made["time_s"], T, atol=1e-9)


def test_float32_samples_stay_float32_in_a_recording() -> None:
    segment = Segment("ring-down", 0.0, np.nan, np.nan, 0)
    made = build_recording({"time_s": T, "torsion_rad": PHI.astype(np.float32)}, [segment], [T.size], {})
    assert made["torsion_rad"].dtype == np.float32


def test_a_missing_date_is_named_by_its_sample() -> None:
    with pytest.raises(TimeError, match="missing at sample 2"):
        as_seconds(pd.DatetimeIndex([STAMPS[0], STAMPS[1], pd.NaT]))


def test_missing_numbers_of_pandas_own_are_found_as_nan() -> None:
    with pytest.raises(RecordingError, match="NaN or infinity"):
        analyse_ring_down(T, pd.Series(PHI).astype("Float64").mask(T[30] == T))


# Paths and tables


def frame() -> pd.DataFrame:
    return pd.DataFrame(
        {"stamp": STAMPS.tz_localize("Europe/Berlin"), "angle_deg": np.degrees(PHI), "n": range(T.size)}
    )


def test_a_data_frame_is_imported_with_its_dates() -> None:
    recording = read(frame(), time="stamp", response="angle_deg")
    np.testing.assert_allclose(recording["torsion_rad"], PHI, atol=1e-12)
    np.testing.assert_allclose(recording["time_s"] - recording["time_s"][0], T, atol=1e-9)


def test_dates_are_not_taken_for_a_response_nor_scaled_by_a_unit() -> None:
    with pytest.raises(RecordingError, match="'stamp' holds dates or durations"):
        read(frame(), time="n:ms", response="stamp")
    with pytest.raises(UnitError, match="which need no unit"):
        read(frame(), time="stamp:ms", response="angle_deg")


@pytest.mark.parametrize("path", ["", "  ", b"x.nc", 3, None, ["x.nc"]])
def test_what_is_no_path_is_refused_with_a_sentence(path: Any) -> None:
    for door in (as_path, load_dataset, load_recording):
        with pytest.raises(FileError, match="where a path is expected; name a file"):
            door(path)


@pytest.mark.parametrize("given", [frame(), "recording.nc", {"kind": []}, None], ids=["frame", "text", "dict", "none"])
@pytest.mark.parametrize("door", [analyse_recording, estimate_response, analyse_ring_downs, as_csv, save_recording])
def test_what_is_no_recording_is_refused_with_a_sentence(door: Any, given: Any, tmp_path: Path) -> None:
    more = (tmp_path / "x",) if door in (as_csv, save_recording) else ()
    with pytest.raises(SchemaError, match=r"where a recording \(xarray.Dataset\) is expected; sn.read"):
        door(given, *more)


def test_what_are_no_results_is_refused_with_a_sentence() -> None:
    with pytest.raises(SchemaError, match=r"where a results \(xarray.Dataset\) is expected"):
        validate_results(frame())  # type: ignore[arg-type]


def test_a_simulation_of_things_that_are_neither_plan_nor_rig_is_refused() -> None:
    with pytest.raises(SpecError, match="expected a Plan and a RigSpec, in this order"):
        simulate({"name": "x"}, {"name": "y"})  # type: ignore[arg-type]
    with pytest.raises(SpecError, match="nowhere"):
        simulate("nowhere", "paper")
