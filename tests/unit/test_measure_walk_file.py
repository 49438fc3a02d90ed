"""A file of a walking person: which columns are which sensor or marker, in which unit, and what is refused."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tests.experiments.walker import Walker, phase_of, sensor_columns, yaw_of

from sinew.measure.errors import FileError, RecordingError, SpecError, TimeError
from sinew.measure.files.walk import Imu, MarkerPair, WalkColumns, read_walk
from sinew.tune.gait import body_motion, estimate_gait

Columns = dict[str, NDArray[np.float64]]

WALKER = Walker(cv=(0.01, 0.02))


@pytest.fixture(scope="module")
def made_up() -> tuple[Columns, Columns]:
    """Return (sensors' columns, markers' columns) of the same walk of 30 strides, the sensors mounted anyhow."""
    generator = np.random.default_rng(1)
    time, phase, size = phase_of(WALKER, 30, generator)
    pelvis, trunk = yaw_of(WALKER, phase, size)
    height = 0.02 * np.cos(2 * phase)
    sensors: Columns = {"t": time}
    markers: Columns = {"t_s": time}
    mountings = Rotation.random(2, rng=generator)
    for i, (sensor, pair, yaw) in enumerate((("hip", "LASI RASI", pelvis), ("upper_back", "LSHO RSHO", trunk))):
        sensors |= sensor_columns(sensor, time, yaw, height, mountings[i], generator)
        for name, side in zip(pair.split(), (1, -1), strict=True):
            across = 130.0 * side * np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)])
            place = across + np.column_stack([1200 * time, 0 * time, 900 + 1000 * height])
            markers |= {f"{name}_{axis}_mm": place[:, k] for k, axis in enumerate("xyz")}
    return sensors, markers


def csv(folder: Path, columns: Columns) -> Path:
    pd.DataFrame(columns).to_csv(folder / "walk.csv", index=False)
    return folder / "walk.csv"


def as_arrays(sensors: Columns) -> Columns:
    names = sorted({name[:-2] for name in sensors if name != "t"})
    return {"t": sensors["t"]} | {
        name: np.column_stack([sensors[f"{name}_{axis}"] for axis in "xyz"]) for name in names
    }


def yaw_deg(file: Path, columns: WalkColumns | None = None) -> float:
    return estimate_gait(body_motion(read_walk(file, columns)), "made up").bouts[0].yaw_amplitude_deg.value


def test_sensors_mounted_anyhow_give_the_yaw_that_the_body_made(
    made_up: tuple[Columns, Columns], tmp_path: Path
) -> None:
    gait = estimate_gait(body_motion(read_walk(csv(tmp_path, made_up[0]))), "made up")
    (bout,) = gait.bouts
    assert gait.swing == "trunk against pelvis"
    assert bout.yaw_amplitude_deg.value == pytest.approx(WALKER.relative_deg, abs=0.2)
    assert bout.stride_frequency_hz.value == pytest.approx(WALKER.frequency_hz, rel=0.01)


def test_arrays_of_an_npz_file_are_read_as_the_table_would_be(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    np.savez(tmp_path / "walk.npz", **as_arrays(made_up[0]))  # type: ignore[arg-type]
    assert yaw_deg(tmp_path / "walk.npz") == pytest.approx(yaw_deg(csv(tmp_path, made_up[0])), rel=1e-9)


def test_the_units_in_the_names_of_columns_count(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    degrees = {
        (f"{name}_deg_s" if "_gyr_" in name else name): np.degrees(values) if "_gyr_" in name else values
        for name, values in made_up[0].items()
    }
    one = read_walk(csv(tmp_path, degrees)).bodies["pelvis"]
    assert isinstance(one, Imu)
    assert one.gyro[:, 0] == pytest.approx(made_up[0]["hip_gyr_x"], abs=1e-9)


def test_another_upward_axis_turns_the_markers(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    renamed = {"x": "z", "y": "x", "z": "y"}
    turned = {
        (name if name == "t_s" else f"{name[:5]}{renamed[name[5]]}_mm"): values for name, values in made_up[1].items()
    }
    assert yaw_deg(csv(tmp_path, turned), WalkColumns(up="y")) == pytest.approx(WALKER.relative_deg, abs=0.1)


def test_names_of_ones_own_are_named(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    own = {name.replace("hip", "s1").replace("upper_back", "s2"): values for name, values in made_up[0].items()}
    file = csv(tmp_path, own)
    with pytest.raises(RecordingError, match=r"found the sensors s1, s2"):
        read_walk(file)
    record = read_walk(file, WalkColumns(bodies={"pelvis": "s1", "trunk": "s2"}))
    assert record.names == {"pelvis": "s1", "trunk": "s2"}


def test_a_single_sensor_is_taken_for_the_pelvis(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    one = {name.replace("hip_", ""): values for name, values in made_up[0].items() if "upper" not in name}
    assert body_motion(read_walk(csv(tmp_path, one))).swing[0] == "pelvis"


def test_an_angle_that_others_computed_needs_no_body(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    time, phase, size = phase_of(WALKER, 30, np.random.default_rng(2))
    pelvis, trunk = yaw_of(WALKER, phase, size)
    file = csv(tmp_path, {"time": time, "twist": np.degrees(trunk - pelvis)})
    assert yaw_deg(file, WalkColumns(yaw="twist:deg")) == pytest.approx(WALKER.relative_deg, rel=0.02)


def test_markers_that_are_lost_at_the_ends_and_for_a_moment_do_no_harm(
    made_up: tuple[Columns, Columns], tmp_path: Path
) -> None:
    lost = {name: values.copy() for name, values in made_up[1].items()}
    for name in list(lost)[1:]:
        lost[name][:100] = np.nan
    lost["LASI_x_mm"][1000:1006] = np.nan
    record = read_walk(csv(tmp_path, lost))
    assert record.time_s[0] == pytest.approx(1.0)
    assert isinstance(record.bodies["pelvis"], MarkerPair)
    assert "6 samples with missing values" in " ".join(record.notes)


def test_a_long_hole_leaves_the_longest_whole_stretch(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    lost = {name: values.copy() for name, values in made_up[1].items()}
    lost["RSHO_y_mm"][800:850] = np.nan
    record = read_walk(csv(tmp_path, lost))
    assert record.time_s[0] == pytest.approx(8.5)


def test_start_and_stop_choose_a_stretch(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    record = read_walk(csv(tmp_path, made_up[0]), start_s=5, stop_s=12)
    assert record.time_s[[0, -1]] == pytest.approx([5, 12])


FAULTS: dict[str, tuple[str, object, type[Exception], str]] = {
    "no sensor of that name": ("sensors", {"bodies": {"pelvis": "hips"}}, RecordingError, "no sensor 'hips'"),
    "no marker of that name": ("markers", {"bodies": {"pelvis": "LASI,RASII"}}, RecordingError, "no marker 'RASII'"),
    "three markers": ("markers", {"bodies": {"pelvis": "LASI,RASI,LSHO"}}, RecordingError, "found 3 markers"),
    "acceleration in gravities": ("sensors", {"acceleration_unit": "g_0"}, RecordingError, "--acc-unit"),
    "no such angle": ("markers", {"yaw": "twist"}, RecordingError, "no column 'twist'"),
    "no such time": ("sensors", {"time": "seconds"}, RecordingError, "no column 'seconds'"),
}


@pytest.mark.parametrize(("which", "asked", "error", "words"), FAULTS.values(), ids=FAULTS.keys())
def test_what_cannot_be_read_is_said_in_a_sentence(
    made_up: tuple[Columns, Columns], which: str, asked: dict[str, object], error: type[Exception], words: str,
    tmp_path: Path,
) -> None:  # fmt: skip
    file = csv(tmp_path, made_up[which == "markers"])
    with pytest.raises(error, match=words):
        read_walk(file, WalkColumns(**asked))  # type: ignore[arg-type]


def test_degrees_that_are_not_named_so_are_noticed(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    degrees = {name: np.degrees(values) if "_gyr_" in name else values for name, values in made_up[0].items()}
    file = csv(tmp_path, degrees)
    with pytest.raises(RecordingError, match="--gyro-unit"):
        read_walk(file)
    assert yaw_deg(file, WalkColumns(gyro_unit="deg/s")) == pytest.approx(WALKER.relative_deg, abs=0.2)


def test_a_table_without_a_time_asks_for_its_name(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="--time COL"):
        read_walk(csv(tmp_path, {name: values for name, values in made_up[0].items() if name != "t"}))


def test_slow_samples_are_refused(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    with pytest.raises(TimeError, match="samples per second"):
        read_walk(csv(tmp_path, {name: values[::10] for name, values in made_up[0].items()}))


def test_an_npz_file_of_objects_or_of_nothing_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "objects.npz", t=np.array([None, {}], dtype=object))
    (tmp_path / "torn.npz").write_bytes(b"PK\x03\x04 torn")
    np.savez(tmp_path / "empty.npz", name=np.array("nothing"))
    for name in ("objects", "torn", "empty", "absent"):
        with pytest.raises(FileError, match="npz"):
            read_walk(tmp_path / f"{name}.npz")


def test_markers_of_the_wrong_upward_axis_are_refused(made_up: tuple[Columns, Columns], tmp_path: Path) -> None:
    for up in ("x", "y"):
        with pytest.raises(RecordingError, match="--up"):
            body_motion(read_walk(csv(tmp_path, made_up[1]), WalkColumns(up=up)))
