"""A film shows a recording at its own pace, in a format that can be written here."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image
from tests.unit.figures_sample import RECORD_S, SETTLE_S, sample_recording

from sinew.figures import film
from sinew.measure.errors import FileError, RecordingError


@pytest.fixture(scope="module")
def recording() -> xr.Dataset:
    return sample_recording((0.0, 6.0), np.array([2.0, 3.0, 4.0]), repeats=1)


def test_a_film_of_a_decay_lasts_as_long_as_the_drive_and_the_record(recording: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "decay.gif"
    count = film.save_film(recording, path, frames_per_s=4, speed=4.0)
    with Image.open(path) as picture:
        assert (count, getattr(picture, "n_frames", 1)) == (round(SETTLE_S + RECORD_S), count)


def test_a_film_of_a_sweep_stays_two_periods_at_each_frequency(recording: xr.Dataset, tmp_path: Path) -> None:
    count = film.save_film(recording, tmp_path / "sweep.webp", "sweep", 6.0, frames_per_s=6, speed=2.0)
    assert count == pytest.approx(3 * (2 / 2 + 2 / 3 + 2 / 4), abs=1)


def test_a_film_that_needs_ffmpeg_says_so_where_there_is_none(
    recording: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(FileError, match=r"found no ffmpeg.*\.gif"):
        film.save_film(recording, tmp_path / "decay.mp4")


@pytest.mark.parametrize(("kind", "left_out"), [("decay", "ring-down"), ("sweep", "steady")])
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


def test_an_ffmpeg_that_fails_ends_in_one_sentence_and_leaves_nothing(
    recording: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "ffmpeg"
    program.write_text("#!/bin/sh\ncat > /dev/null\nexit 3\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:/bin:/usr/bin")
    with pytest.raises(FileError, match="status 3"):
        film.save_film(recording, tmp_path / "film.mp4", frames_per_s=2)
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]
