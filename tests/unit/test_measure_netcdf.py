"""NetCDF files: whole or not at all, checked on the way in and out."""

import faulthandler
import os
import random
import signal
import stat
import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from sinew.measure.errors import FileError, SchemaError
from sinew.measure.files.netcdf import (
    content_hash,
    is_netcdf,
    load_dataset,
    load_recording,
    provenance,
    save_dataset,
    save_recording,
    write_atomically,
)
from sinew.measure.recording import Segment, build_recording


def recording_of(samples: int, segments: int = 2) -> xr.Dataset:
    noise = np.random.default_rng(samples)
    return build_recording(
        {
            "time_s": np.arange(samples) / 200,
            "drive_rad": noise.normal(size=samples),
            "gyro_rad_s": noise.normal(size=(samples, 3)),
            "tendon_rad": noise.normal(size=(samples, 4)).astype(np.float32),
        },
        [Segment("steady", 1.0, 3.0, 20.0, i) for i in range(segments - 1)] + [Segment("idle", 1.0, np.nan, np.nan, 0)],
        [samples // segments] * (segments - 1) + [samples - samples // segments * (segments - 1)],
        provenance("twin", rig="[silicone]\nlength = 1\n", seed=7),
    )


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "recording.nc"
    save_recording(recording_of(400), path)
    return path


def test_a_recording_comes_back_identical_except_for_its_hash(saved: Path) -> None:
    back = load_recording(saved)
    del back.attrs["content_hash"]
    xr.testing.assert_identical(back, recording_of(400))


def test_the_hash_of_what_was_read_is_the_hash_of_what_was_written(saved: Path) -> None:
    assert content_hash(load_recording(saved)) == content_hash(recording_of(400))


@pytest.mark.parametrize("value", [[1, 2], [0.5], ["a", "b"], "", 3, 2.5])
def test_attributes_of_any_kind_keep_the_hash(tmp_path: Path, value: object) -> None:
    save_dataset(xr.Dataset({"x": ("n", [1.0, 2.0])}, attrs={"value": value}), tmp_path / "x.nc")
    assert load_dataset(tmp_path / "x.nc").sizes == {"n": 2}


def test_the_hash_notices_a_changed_unit() -> None:
    changed = recording_of(400)
    changed["drive_rad"].attrs["units"] = "deg"
    assert content_hash(changed) != content_hash(recording_of(400))


@pytest.mark.parametrize("of", ["a number", "a text"])
def test_a_file_that_was_changed_after_writing_is_refused(saved: Path, of: str) -> None:
    with netCDF4.Dataset(saved, "a") as file:
        if of == "a number":
            file["drive_rad"][17] += 1e-6
        else:
            file.setncattr("rig", "another rig")
    with pytest.raises(FileError, match="does not match its own content hash"):
        load_recording(saved)


@pytest.mark.parametrize("share", [0.0005, 0.1, 0.5, 0.9, 0.999])
def test_a_file_that_was_cut_short_is_refused(saved: Path, share: float) -> None:
    whole = saved.read_bytes()
    saved.write_bytes(whole[: int(share * len(whole)) + 8])
    with pytest.raises(FileError, match="damaged NetCDF file, perhaps cut short") as caught:
        load_recording(saved)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"t,a\n0,1\n", bytes(range(256)) * 8])
def test_a_file_that_is_no_netcdf_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.nc").write_bytes(content)
    with pytest.raises(FileError, match="is not a NetCDF file; expected a recording"):
        load_recording(tmp_path / "x.nc")


@pytest.mark.parametrize("name", [".", "absent.nc"])
def test_a_folder_and_an_absent_file_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match="cannot read"):
        load_recording(tmp_path / name)


def test_netcdf_is_known_by_its_content_whatever_its_name(saved: Path) -> None:
    assert is_netcdf(saved.rename(saved.with_suffix(".dat")))


def test_a_text_file_is_not_taken_for_netcdf_whatever_its_name(tmp_path: Path) -> None:
    (tmp_path / "x.nc").write_text("t,a\n0,1\n", encoding="utf-8")
    assert not is_netcdf(tmp_path / "x.nc")


def test_a_netcdf_file_of_another_kind_is_refused_by_schema(tmp_path: Path) -> None:
    save_dataset(xr.Dataset({"x": ("n", [1.0])}), tmp_path / "x.nc")
    with pytest.raises(SchemaError, match=r"x\.nc.* 'sinew-recording-1' or 'sinew-recording-2' \(found None\)"):
        load_recording(tmp_path / "x.nc")


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("pretension_mm", [1.0, -1.0], "negative or missing pretension_mm"),
        ("pretension_mm", [1.0, np.nan], "negative or missing pretension_mm"),
        ("row_size", [200, 100], "segments claim 300 samples"),
        ("kind", np.array(["steady", "song"], dtype=object), "unknown segment kind 'song'"),
        ("time_s", np.zeros(400), "time_s does not increase at sample 1"),
        ("drive_rad", np.full(400, np.nan), "holds NaN or infinity"),
        ("drive_rad", np.full(400, "a", dtype=object), "holds object values, expected numbers"),
    ],
)
def test_what_is_no_valid_recording_is_not_written(tmp_path: Path, name: str, values: object, said: str) -> None:
    wrong = recording_of(400)
    wrong[name] = (wrong[name].dims, values, wrong[name].attrs)
    with pytest.raises(SchemaError, match=said):
        save_recording(wrong, tmp_path / "x.nc")
    assert list(tmp_path.iterdir()) == []


def test_a_place_below_a_file_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(FileError, match="choose a folder that you may write"):
        save_recording(recording_of(400), tmp_path / "file" / "x.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(FileError, match="Permission denied; choose a folder"):
        save_recording(recording_of(400), tmp_path / "x.nc")


def test_a_folder_in_the_place_of_the_file_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "x.nc").mkdir()
    with pytest.raises(FileError, match=r"cannot write .*x\.nc"):
        save_recording(recording_of(400), tmp_path / "x.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["x.nc"]


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), RuntimeError("NetCDF: HDF error")])
def test_a_write_that_fails_half_way_leaves_the_old_file(tmp_path: Path, failure: Exception) -> None:
    path = tmp_path / "x.nc"
    path.write_text("old", encoding="utf-8")

    def write(temporary: Path) -> None:
        temporary.write_text("half", encoding="utf-8")
        raise failure

    with pytest.raises(FileError, match="check the free space"):
        write_atomically(path, write)
    assert [(p.name, p.read_text(encoding="utf-8")) for p in tmp_path.iterdir()] == [("x.nc", "old")]


def test_a_write_that_is_interrupted_leaves_no_temporary_file(tmp_path: Path) -> None:
    def write(_: Path) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "x.nc", write)
    assert list(tmp_path.iterdir()) == []


def interrupted_at_random(path: Path, times: int, seed: int) -> None:
    """Write and read a file, broken off at random; prints how often, and ends the process where it stands still."""

    faulthandler.dump_traceback_later(40, exit=True)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what began in the background
    signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    draw, broken_off = random.Random(seed), 0
    data = xr.Dataset({"x": (("n", "k"), np.arange(400_000.0).reshape(-1, 4))})
    save_dataset(data, path)
    for _ in range(times):
        try:
            signal.setitimer(signal.ITIMER_REAL, draw.uniform(0.001, 0.04))
            save_dataset(data, path)
            load_dataset(path)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        except KeyboardInterrupt:
            broken_off += 1
    assert load_dataset(path).equals(data)
    print(broken_off)


def test_an_interrupt_at_any_time_ends_the_writing_and_the_reading(tmp_path: Path) -> None:
    call = f"interrupted_at_random({str(tmp_path / 'x.nc')!r}, 60, 1)"
    code = f"from tests.unit.test_measure_netcdf import interrupted_at_random; {call}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 20


def test_a_written_file_has_the_usual_permissions(saved: Path, tmp_path: Path) -> None:
    (tmp_path / "usual").touch()
    assert stat.S_IMODE(saved.stat().st_mode) == stat.S_IMODE((tmp_path / "usual").stat().st_mode)


def test_a_folder_that_is_not_there_yet_is_made(tmp_path: Path) -> None:
    save_recording(recording_of(400), tmp_path / "new" / "folder" / "x.nc")
    assert is_netcdf(tmp_path / "new" / "folder" / "x.nc")


def test_many_numbers_are_deflated(tmp_path: Path) -> None:
    save_dataset(xr.Dataset({"many": ("n", np.zeros(20_000)), "few": ("k", np.zeros(20))}), tmp_path / "both.nc")
    with netCDF4.Dataset(tmp_path / "both.nc") as file:
        assert {name: file[name].filters()["zlib"] for name in file.variables} == {"few": False, "many": True}
