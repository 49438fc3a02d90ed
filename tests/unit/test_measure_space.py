"""Recordings of a head that bends or sways: the second schema, and what stays of the first."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy import io

from sinew.measure.attitude import quaternion
from sinew.measure.errors import SchemaError
from sinew.measure.files.formats import export_recording
from sinew.measure.files.netcdf import content_hash, load_recording, save_recording
from sinew.measure.recording import SPATIAL_SEGMENTS, Segment, build_recording, iterate_segments, validate_recording

STEADY = Segment("steady", 6.0, 3.0, 20.0, 0)
BENT = replace(STEADY, bend_deg=20.0, azimuth_deg=90.0)
FIRST_SCHEMA_HASH = "57a3bf02463ff997b1a9e63cdff1c6acc46e5ab154f887d36d677c18c116ea3a"
SWAYED = replace(BENT, amplitude_deg=np.nan, excitation="roll", amplitude_mm=1.0, repeat=1)


def recorded(*segments: Segment, oriented: bool = False) -> xr.Dataset:
    size = 20 * len(segments)
    random = np.random.default_rng(4)
    samples = {"time_s": np.arange(size) / 200, "gyro_rad_s": random.normal(size=(size, 3))}
    if oriented:
        samples["orientation"] = quaternion(0.1 * random.normal(size=size), 0.3, 1.5)
    return build_recording(samples, segments, [20] * len(segments), {"source": "twin"})


def test_a_straight_recording_is_still_of_the_first_schema_and_has_its_hash() -> None:
    recording = recorded(STEADY, STEADY)
    assert recording.attrs["schema"] == "sinew-recording-1"
    assert not {*SPATIAL_SEGMENTS, "orientation"} & set(recording.variables)
    assert content_hash(recording) == FIRST_SCHEMA_HASH  # as the program wrote it before there was a second schema


def test_pose_excitation_and_orientation_come_back_from_a_file(tmp_path: Path) -> None:
    recording = recorded(BENT, SWAYED, oriented=True)
    save_recording(recording, tmp_path / "bent.nc")
    back = load_recording(tmp_path / "bent.nc")
    del back.attrs["content_hash"]
    xr.testing.assert_identical(back, recording)


def test_the_segments_of_a_bent_recording_say_their_pose() -> None:
    recording = recorded(BENT, SWAYED)
    told = [(s.bend_deg, s.azimuth_deg, s.excitation, s.amplitude_mm) for _, s, _ in iterate_segments(recording)]
    assert (recording.attrs["schema"], told[1]) == ("sinew-recording-2", (20.0, 90.0, "roll", 1.0))


def test_an_orientation_alone_makes_the_second_schema() -> None:
    recording = recorded(STEADY, oriented=True)
    assert (recording.attrs["schema"], "bend_deg" in recording) == ("sinew-recording-2", False)


def test_the_first_schema_has_no_orientation() -> None:
    recording = recorded(STEADY, oriented=True).assign_attrs(schema="sinew-recording-1")
    with pytest.raises(SchemaError, match="'sinew-recording-1' has 'orientation', expected schema 'sinew-recording-2'"):
        validate_recording(recording)


def test_a_pose_without_its_excitation_is_refused() -> None:
    with pytest.raises(SchemaError, match="lacks the variable 'excitation', which belongs beside 'bend_deg'"):
        validate_recording(recorded(BENT).drop_vars("excitation"))


def test_an_orientation_that_is_no_unit_quaternion_is_refused() -> None:
    recording = recorded(BENT, oriented=True)
    recording["orientation"] = recording["orientation"] * 1.1
    recording["orientation"].attrs["units"] = "1"
    with pytest.raises(SchemaError, match=r"a length of 1\.1, expected unit quaternions w, x, y, z"):
        validate_recording(recording)


def test_a_table_of_a_bent_recording_has_pose_and_quaternion(tmp_path: Path) -> None:
    export_recording(recorded(BENT, SWAYED, oriented=True), tmp_path / "bent.csv", "csv")
    table = pd.read_csv(tmp_path / "bent.csv")
    norm = table[["orientation_w", "orientation_x", "orientation_y", "orientation_z"]].pow(2).sum(axis=1)
    assert (table["excitation"].iloc[-1], table["bend_deg"].iloc[0], norm.max()) == ("roll", 20.0, pytest.approx(1.0))


def test_matlab_gets_pose_and_quaternion(tmp_path: Path) -> None:
    export_recording(recorded(BENT, SWAYED, oriented=True), tmp_path / "bent.mat", "mat")
    found = io.loadmat(tmp_path / "bent.mat", simplify_cells=True)
    assert (found["orientation"].shape, list(found["segments"]["excitation"])) == ((40, 4), ["lever", "roll"])
