"""A film shows a recording at its own pace, in a format that can be written here."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image
from tests.unit.figures_sample import RECORD_S, SETTLE_S, sample_recording

from sinew.figures import motion as film
from sinew.measure.errors import FileError, RecordingError


@pytest.fixture(scope="module")
def recording() -> xr.Dataset:
    return sample_recording((0.0, 6.0), np.array([2.0, 3.0, 4.0]), repeats=1)


def test_a_film_of_a_decay_lasts_as_long_as_the_drive_and_the_record(recording: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "decay.gif"
    count = film.save_film(recording, path, frames_per_s=2)
    with Image.open(path) as picture:
        assert (count, getattr(picture, "n_frames", 1)) == (round(2 * (SETTLE_S + RECORD_S)), count)


def test_a_film_of_a_sweep_stays_two_periods_at_each_frequency(recording: xr.Dataset, tmp_path: Path) -> None:
    count = film.save_film(recording, tmp_path / "sweep.webp", "sweep", 6.0, frames_per_s=6)
    assert count == pytest.approx(6 * (2 / 2 + 2 / 3 + 2 / 4), abs=1)


def test_a_film_in_another_format_is_refused(recording: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"ends with \.gif or \.webp"):
        film.save_film(recording, tmp_path / "decay.mp4")


@pytest.mark.parametrize(("kind", "left_out"), [("ring-down", "ring-down"), ("sweep", "steady")])
def test_a_recording_without_what_is_to_be_filmed_is_refused(
    recording: xr.Dataset, tmp_path: Path, kind: film.FilmKind, left_out: str
) -> None:
    sizes = recording["row_size"].values
    keep = recording["kind"].values != left_out
    rest = recording.isel(sample=np.repeat(keep, sizes), segment=keep)
    with pytest.raises(RecordingError, match="holds no"):
        film.save_film(rest, tmp_path / "film.gif", kind)


def test_a_response_that_is_no_angle_is_refused(recording: xr.Dataset, tmp_path: Path) -> None:
    response = ("sample", recording["gyro_rad_s"].values[:, 0], {"units": "m"})
    foreign = recording.drop_vars("gyro_rad_s").assign(response=response)
    with pytest.raises(RecordingError, match="in m"):
        film.save_film(foreign, tmp_path / "film.gif", "sweep")
