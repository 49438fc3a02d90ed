"""A folder of runs as one dataset: its numbers are those of the files, and nothing is read before it is computed."""

import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sinew.measure.errors import SpecError
from sinew.measure.files import netcdf as module
from sinew.measure.files.netcdf import load_recording, open_runs, provenance, save_dataset, save_recording
from sinew.measure.recording import Segment, build_recording, iterate_segments

NAMES = ("friday", "monday", "tuesday")


def recording_of(seed: int, count: int = 300, tendons: int = 4, **more: np.ndarray) -> xr.Dataset:
    random = np.random.default_rng(seed)
    samples = {"time_s": np.arange(count) / 200, "gyro_rad_s": random.normal(size=(count, 3))}
    samples |= {"tendon_rad": random.normal(size=(count, tendons)).astype(np.float32), **more}
    segments = [Segment("steady", float(seed), 3.0, 20.0, 0), Segment("idle", float(seed), np.nan, np.nan, 0)]
    return build_recording(samples, segments, [count - 100, 100], provenance("twin", seed=seed))


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    pytest.importorskip("dask.array", reason="needs dask, the extra `cluster`")
    for seed, name in enumerate(NAMES):
        (tmp_path / "runs" / name).mkdir(parents=True)
        save_recording(recording_of(seed, 300 + seed), tmp_path / "runs" / name / "recording.nc")
    return tmp_path / "runs"


@pytest.mark.parametrize("block", [1 << 18, 70])
def test_every_run_has_the_numbers_of_its_file(runs: Path, monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    monkeypatch.setattr(module, "_BLOCK", block)
    opened, begin = open_runs(runs), 0
    for name in NAMES:
        alone = load_recording(runs / name / "recording.nc")
        end = begin + alone.sizes["sample"]
        for channel in ("time_s", "gyro_rad_s", "tendon_rad"):
            part = opened[channel][begin:end].compute()
            np.testing.assert_array_equal(part, alone[channel])
            assert part.dtype == alone[channel].dtype
        begin = end
    assert opened.sizes["sample"] == begin


def test_segments_are_those_of_the_runs_in_order_and_a_run_says_of_itself_what_its_recording_does(runs: Path) -> None:
    opened = open_runs(runs)
    found = [(segment.pretension_mm, where.stop - where.start) for _, segment, where in iterate_segments(opened)]
    assert found == [(0.0, 200), (0.0, 100), (1.0, 201), (1.0, 100), (2.0, 202), (2.0, 100)]
    assert [*opened["run_name"].values] == [name for name in NAMES for _ in range(2)]
    about = opened.sel(run="tuesday")
    assert (int(about["seed"]), str(about["source"].values), int(about["samples"])) == (2, "twin", 302)
    assert Path(str(about["file"].values)) == runs / "tuesday" / "recording.nc"


def test_memory_holds_blocks_and_not_the_folder(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import dask

    for name in NAMES:
        save_recording(recording_of(1, 200_000), runs / name / "recording.nc")
    monkeypatch.setattr(module, "_BLOCK", 20_000)
    block, whole = 20_000 * 3 * 8, 600_000 * 3 * 8
    tracemalloc.start()
    opened = open_runs(runs)
    held, at_opening = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    with dask.config.set(scheduler="synchronous"):
        (opened["gyro_rad_s"] ** 2).mean().compute()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert at_opening < whole / 2
    assert peak - held < 10 * block < whole / 2


def test_a_channel_that_a_run_lacks_is_not_a_number_there(runs: Path) -> None:
    current = np.arange(300.0)
    save_recording(recording_of(5, 300, drive_current_a=current), runs / "monday" / "recording.nc")
    found = open_runs(runs)["drive_current_a"].values
    assert np.isnan(found[:300]).all()
    np.testing.assert_array_equal(found[300:600], current)
    assert np.isnan(found[600:]).all()


def test_a_joint_of_fewer_tendons_has_none_in_the_place_of_the_others(runs: Path) -> None:
    fewer = recording_of(5, 300, tendons=3)
    save_recording(fewer, runs / "monday" / "recording.nc")
    found = open_runs(runs)["tendon_rad"].values
    assert (found.shape, found.dtype) == ((902, 4), np.float32)
    np.testing.assert_array_equal(found[300:600, :3], fewer["tendon_rad"])
    assert np.isnan(found[300:600, 3]).all()


def test_poses_that_one_run_alone_has_are_upright_in_the_others(runs: Path) -> None:
    times = {"time_s": np.arange(20) / 200, "gyro_rad_s": np.zeros((20, 3))}
    bent = build_recording(times, [Segment("idle", 1.0, np.nan, np.nan, 0, bend_deg=20.0)], [20], provenance("twin"))
    save_recording(bent, runs / "monday" / "recording.nc")
    found = [segment.bend_deg for _, segment, _ in iterate_segments(open_runs(runs))]
    assert found == [0.0, 0.0, 20.0, 0.0, 0.0]


def cut_short(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:2000])


def of_no_samples(path: Path) -> None:
    save_dataset(load_recording(path).drop_vars("time_s"), path)


def of_too_few_samples(path: Path) -> None:
    save_dataset(load_recording(path).isel(sample=slice(100)), path)


def of_something_else(path: Path) -> None:
    save_dataset(xr.Dataset({"x": ("n", np.zeros(3))}), path)


@pytest.mark.parametrize(
    ("harm", "sentence"),
    [
        (cut_short, "damaged NetCDF file"),
        (of_no_samples, "lacks time_s"),
        (of_too_few_samples, "has 100 samples, and segments of another number"),
        (of_something_else, "is no recording"),
    ],
)
def test_what_is_no_whole_recording_is_left_out_and_told_of(runs: Path, harm: object, sentence: str) -> None:
    harm(runs / "monday" / "recording.nc")  # type: ignore[operator]
    opened = open_runs(runs)
    assert [*opened["run"].values] == ["friday", "tuesday"]
    assert sentence in opened.attrs["left_out"]


def test_a_response_in_another_unit_is_left_out_and_told_of(tmp_path: Path) -> None:
    pytest.importorskip("dask.array", reason="needs dask, the extra `cluster`")
    for name, unit in (("a", "m"), ("b", "m/s"), ("c", "m")):
        samples = {"time_s": np.arange(20) / 10, "response": np.ones(20)}
        made = build_recording(
            samples, [Segment("ring-down", 0.0, np.nan, np.nan, 0)], [20], provenance("import"), {"response": unit}
        )
        save_recording(made, tmp_path / f"{name}.nc")
    opened = open_runs([tmp_path / "c.nc", tmp_path / "b.nc", tmp_path / "a.nc"])
    assert [*opened["run"].values] == ["a", "c"]
    assert opened["response"].attrs["units"] == "m"
    assert "b.nc has its response in 'm/s', the first one in 'm'" in opened.attrs["left_out"]


def test_without_dask_it_is_said_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "dask.array", None)
    with pytest.raises(SpecError, match=r"need dask; install it: .*\[cluster\]"):
        open_runs(tmp_path)
