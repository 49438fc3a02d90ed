"""What goes into a file comes out of it, whatever it is."""

import contextlib
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
import xarray as xr
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sinew.measure.errors import FileError, SinewError, UnitError
from sinew.measure.files.formats import export_recording
from sinew.measure.files.names import find_columns
from sinew.measure.files.netcdf import load_recording, provenance, save_recording
from sinew.measure.read import numbers, read, read_table
from sinew.measure.recording import Segment, build_recording
from sinew.measure.units import canonical_unit, convert

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
KINDS = st.sampled_from(["settle", "steady", "ring-down", "idle"])
TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
SEGMENTS = st.builds(
    Segment,
    kind=KINDS,
    pretension_mm=st.floats(0, 20),
    frequency_hz=st.floats(0.1, 10),
    amplitude_deg=st.floats(0, 30),
    repeat=st.integers(0, 9),
)
UNIT_ATOMS = st.sampled_from(["deg", "rad", "mm", "m", "s", "ms", "V", "A", "N", "kg", "Hz", "dps", "rpm", "°"])


@st.composite
def recordings(draw: st.DrawFn) -> xr.Dataset:
    sizes = draw(st.lists(st.integers(1, 6), min_size=1, max_size=4))
    n = sum(sizes)
    channel = st.lists(NUMBERS, min_size=n, max_size=n)
    samples = {"time_s": np.cumsum(draw(st.lists(st.floats(1e-4, 10), min_size=n, max_size=n)))}
    samples["torsion_rad"] = np.array(draw(channel))
    if draw(st.booleans()):
        samples["gyro_rad_s"] = np.array([draw(channel) for _ in range(3)]).T
    segments = [draw(SEGMENTS) for _ in sizes]
    return build_recording(samples, segments, sizes, provenance("twin", rig=draw(TEXT), seed=draw(st.integers(0, 99))))


Thing = TypeVar("Thing")


def through_file(
    recording: xr.Dataset, save: Callable[[xr.Dataset, Path], object], load: Callable[[Path], Thing]
) -> Thing:
    """Return what is read from the file that a recording was saved in."""
    with tempfile.TemporaryDirectory() as folder:
        save(recording, Path(folder) / "x")
        return load(Path(folder) / "x")


@given(recordings())
@settings(max_examples=25, deadline=None)
def test_any_recording_comes_back_from_netcdf_identical(recording: xr.Dataset) -> None:
    back = through_file(recording, save_recording, load_recording)
    del back.attrs["content_hash"]
    xr.testing.assert_identical(back, recording)


@given(st.lists(NUMBERS, min_size=8, max_size=30))
@settings(max_examples=40, deadline=None)
def test_any_numbers_come_back_from_an_exported_table_unchanged(values: list[float]) -> None:
    samples = {"time_s": np.arange(len(values)) / 100, "torsion_rad": np.array(values)}
    recording = build_recording(samples, [Segment("idle", 0, 1, 1, 0)], [len(values)], provenance("twin"))
    back = through_file(
        recording, partial(export_recording, to="csv"), partial(read, time="time_s", response="torsion_rad")
    )
    assert back["torsion_rad"].values.tolist() == values


@given(st.binary(min_size=1, max_size=200))
@settings(max_examples=100, deadline=None)
def test_any_bytes_are_a_table_with_columns_or_a_sinew_error(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "x.csv").write_bytes(content)
        with contextlib.suppress(SinewError):
            assert len(read_table(Path(folder) / "x.csv").columns) >= 1


@given(st.text(st.sampled_from("ta,;:\t #%\"'01.5e-\n\r "), max_size=80))
@settings(max_examples=150, deadline=None)
def test_any_text_gives_finite_numbers_or_a_sinew_error(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "x.csv").write_text(text, encoding="utf-8")
        with contextlib.suppress(SinewError):
            table = read_table(Path(folder) / "x.csv")
            assert np.isfinite(numbers(table, find_columns(table, "t")[0][0])).all()


@given(st.integers(1, 10_000))
@settings(max_examples=30, deadline=None)
def test_a_netcdf_file_cut_anywhere_is_refused(cut: int) -> None:
    samples = {"time_s": np.arange(50.0), "torsion_rad": np.ones(50)}
    recording = build_recording(samples, [Segment("idle", 0, 1, 1, 0)], [50], provenance("twin"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.nc"
        save_recording(recording, path)
        path.write_bytes(path.read_bytes()[:-cut])
        with pytest.raises(FileError):
            load_recording(path)


@given(UNIT_ATOMS, st.sampled_from("*/"), UNIT_ATOMS)
@settings(max_examples=60, deadline=None)
def test_the_factor_to_a_canonical_unit_is_that_of_a_conversion(a: str, sign: str, b: str) -> None:
    unit, factor = canonical_unit(f"{a}{sign}{b}")
    assert factor == pytest.approx(convert(f"{a}{sign}{b}", unit), rel=1e-12)


@given(st.one_of(st.text(max_size=30), st.text(st.sampled_from("mskgNVA*/^().-² 123"), max_size=30)))
@example("k²²")  # of Boltzmann's constant: no number holds its factor
@example("1/k^30")
@settings(max_examples=200, deadline=None)
def test_any_text_is_a_unit_with_a_positive_factor_or_a_unit_error(text: str) -> None:
    with contextlib.suppress(UnitError):
        assert canonical_unit(text)[1] > 0
