"""CSV in and out, and files for other programs out."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import io

from sinew.measure.errors import FileError, RecordingError, SinewError, TimeError, UnitError
from sinew.measure.files.formats import export_recording
from sinew.measure.files.netcdf import provenance
from sinew.measure.read import read
from sinew.measure.recording import Segment, build_recording

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
with_data = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not at ../shared/data")
BEAMS = [f"beam_{load}_V2_{run}.csv" for load in ("gravity", "load52", "load101") for run in "ab"]
PENDULUMS = ["60.csv", "70.csv", "80P.csv", "90p.csv", "100.csv", "110Pnedulum-120-14-1.6-2.csv"]
PENDULUMS += ["120Pnedulum-120-14-1.6.csv", "120Pnedulum-120-14-1.6-2.csv"]


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """Write two seconds of a swing at 100 Hz: the angle is 10° at first and 10 ° + row after it."""
    path = tmp_path / "swing.csv"
    rows = [f"{i / 100},{10 + i},{20 + i},{1000 * i},{i / 10},{5}" for i in range(200)]
    path.write_text("t_s,angle_deg,other_deg,tip_um,rate_dps,lever (deg)\n" + "\n".join(rows), encoding="utf-8")
    return path


@pytest.fixture
def bench() -> xr.Dataset:
    """Return a small recording with every kind of channel."""
    n, random = 30, np.random.default_rng(1)
    samples = {
        "time_s": np.arange(n) / 200,
        "drive_rad": random.normal(size=n),
        "gyro_rad_s": random.normal(size=(n, 3)),
        "tendon_current_a": random.normal(size=(n, 4)),
        "response": random.normal(size=n),
    }
    segments = [Segment("settle", 2.0, 3.1, 20.0, 0), Segment("steady", 2.0, 3.1, 20.0, 0)]
    return build_recording(samples, segments, [10, 20], provenance("twin", seed=1), {"response": "N*m"})


@pytest.mark.parametrize(
    ("response", "unit", "at_100"),
    [
        ("angle_deg:deg", "rad", math.radians(110)),
        ("angle_deg", "rad", math.radians(110)),  # by the unit in its name
        ("angle_deg:rad", "rad", 110.0),  # a written one goes before it
        ("angle_deg,other_deg:deg", "rad", math.radians(115)),  # the mean of both
        ("tip_um", "m", 0.1),
        ("rate_dps", "rad/s", math.radians(10)),
    ],
)
def test_a_response_comes_in_si_units_and_radians(swing: Path, response: str, unit: str, at_100: float) -> None:
    recording = read(swing, time="t_s", response=response)
    found = recording["torsion_rad" if unit == "rad" else "response"]
    assert (found.attrs["units"], float(found[100])) == (unit, pytest.approx(at_100))
    assert ("is an angular rate" in recording.attrs["import_notes"]) == (unit == "rad/s")


def test_columns_of_different_units_are_not_averaged(swing: Path) -> None:
    with pytest.raises(UnitError, match="have different units"):
        read(swing, time="t_s", response="angle_deg,tip_um")


def test_a_part_is_taken_in_the_file_s_own_time(swing: Path) -> None:
    time = read(swing, time="t_s", response="angle_deg", start_s=0.5, stop_s=1.0)["time_s"].values
    assert (time[0], time[-1], time.size) == (0.5, 1.0, 51)


def test_a_ring_down_becomes_one_ring_down_segment_of_unknown_drive(swing: Path) -> None:
    recording = read(swing, time="t_s", response="angle_deg", drive="lever (deg)")
    row = [recording[name].item() for name in ("kind", "row_size", "pretension_mm", "repeat")]
    assert (row, bool(np.isnan(recording["frequency_hz"].item()))) == (["ring-down", 200, 0.0, 0], True)
    assert float(recording["drive_rad"][0]) == pytest.approx(math.radians(5))


def test_a_sweep_becomes_one_steady_segment(swing: Path) -> None:
    recording = read(swing, time="t_s", response="angle_deg", drive="lever (deg)", kind="sweep")
    assert recording["kind"].values.tolist() == ["steady"]


def test_a_record_with_a_gap_is_split_into_segments_when_asked(swing: Path) -> None:
    lines = swing.read_text(encoding="utf-8").splitlines()
    swing.write_text("\n".join(lines[:81] + lines[101:]), encoding="utf-8")
    recording = read(swing, time="t_s", response="angle_deg", gaps="split")
    assert recording["row_size"].values.tolist() == [80, 100]
    assert "split at 1 gap into 2 pieces" in recording.attrs["import_notes"]
    assert read(swing, time="t_s", response="angle_deg", start_s=1.0).sizes["sample"] == 100


def test_bridged_gaps_leave_one_segment_and_the_samples_where_they_are(swing: Path) -> None:
    lines = swing.read_text(encoding="utf-8").splitlines()
    swing.write_text("\n".join(lines[:81] + lines[101:151] + lines[161:]), encoding="utf-8")
    recording = read(swing, time="t_s", response="angle_deg", gaps="bridge")
    kept = np.r_[0:80, 100:150, 160:200]
    assert recording["row_size"].values.tolist() == [170]
    assert recording["time_s"].values == pytest.approx(kept / 100)
    assert "2 gaps of about 30 missing samples bridged" in recording.attrs["import_notes"]
    assert recording.attrs["import_gaps"] == "bridge"


def test_cells_without_a_number_are_missing_samples_and_the_first_is_named(swing: Path) -> None:
    text = swing.read_text(encoding="utf-8")
    for row, cell in ((30, "sixty"), (31, ""), (120, "nan")):
        text = text.replace(f"\n{row / 100},{10 + row},", f"\n{row / 100},{cell},")
    swing.write_text(text, encoding="utf-8")
    recording = read(swing, time="t_s", response="angle_deg")
    assert recording["time_s"].values == pytest.approx(np.delete(np.arange(200), [30, 31, 120]) / 100)
    said = "3 rows without a number taken for missing samples: column 'angle_deg' holds 'sixty' in data row 31"
    assert said in recording.attrs["import_notes"]


def test_a_column_of_words_is_refused_with_the_first(swing: Path) -> None:
    swing.write_text(swing.read_text(encoding="utf-8").replace(",5\n", ",off\n"), encoding="utf-8")
    with pytest.raises(RecordingError, match=r"column 'lever \(deg\)' holds 'off' in data row 1"):
        read(swing, time="t_s", response="lever")


def test_a_row_without_a_time_below_the_data_is_left_out(swing: Path) -> None:
    swing.write_text(swing.read_text(encoding="utf-8") + "\n,109.5,,,,\n", encoding="utf-8")
    recording = read(swing, time="t_s", response="angle_deg")
    assert recording.sizes["sample"] == 200
    assert "1 row without a time left out" in recording.attrs["import_notes"]


def test_gaps_of_a_sweep_are_not_bridged(swing: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be bridged; split it"):
        read(swing, time="t_s", response="angle_deg", drive="lever", kind="sweep", gaps="bridge")


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"response": "angle"}, RecordingError, "no column 'angle', did you mean 'angle_deg'"),
        ({"time": "time"}, RecordingError, "no column 'time'"),
        ({"drive": "levr"}, RecordingError, "no column 'levr', did you mean 'lever \\(deg\\)'"),
        ({"time": "t_s,angle_deg"}, RecordingError, "time needs one column, found 2"),
        ({"response": "angle_deg:degg"}, UnitError, "unknown unit 'degg'"),
        ({"time": "t_s:mm"}, UnitError, "'mm' cannot be turned into 's'"),
        ({"start_s": 1.0, "stop_s": 0.5}, TimeError, "expected start before stop"),
        ({"start_s": 5.0}, TimeError, "no samples from 5 s .* runs from 0 s to 1.99 s"),
        ({"start_s": 1.95}, TimeError, "found 5 samples, expected at least 8"),
        ({"kind": "song"}, RecordingError, "unknown kind 'song', expected one of auto, ring-down, sweep"),
        ({"time": "lever (deg):s"}, TimeError, "is this the time column"),
    ],
)
def test_a_wrong_wish_is_answered_with_one_helpful_line(
    swing: Path, options: dict[str, object], error: type[SinewError], said: str
) -> None:
    wish = {"time": "t_s", "response": "angle_deg"} | options
    with pytest.raises(error, match=said) as caught:
        read(swing, **wish)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_an_exported_table_has_its_units_in_the_names(bench: xr.Dataset, tmp_path: Path) -> None:
    export_recording(bench, tmp_path / "out.csv", "csv")
    first, *rows = (line.split(",") for line in (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines())
    assert [row[2] for row in rows] == ["settle"] * 10 + ["steady"] * 20
    assert first == [
        *("time_s", "segment", "kind", "pretension_mm", "frequency_hz", "amplitude_deg", "repeat", "drive_rad"),
        *(f"tendon_{i}_current_a" for i in (1, 2, 3, 4)),
        *("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s", "response_n_m"),
    ]


@pytest.mark.parametrize("unit", ["N*m", "m", "V", "1", "kg/m**3"])
def test_an_exported_table_reads_back_unchanged(bench: xr.Dataset, tmp_path: Path, unit: str) -> None:
    bench["response"].attrs["units"] = unit
    export_recording(bench, tmp_path / "out.csv", "csv")
    column = (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()[0].split(",")[-1]
    back = read(tmp_path / "out.csv", time="time_s", response=column)["response"]
    assert (back.attrs["units"], back.values.tolist()) == (unit, bench["response"].values.tolist())


@pytest.mark.parametrize("to", ["csv", "mat"])
def test_an_export_to_a_place_that_cannot_be_is_refused_and_leaves_nothing(
    bench: xr.Dataset, tmp_path: Path, to: str
) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(FileError, match="choose a folder that you may write"):
        export_recording(bench, tmp_path / "file" / "out", to)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_matlab_file_holds_channels_segments_and_units(bench: xr.Dataset, tmp_path: Path) -> None:
    export_recording(bench, tmp_path / "out.mat", "mat")
    found = io.loadmat(tmp_path / "out.mat", simplify_cells=True)
    segments, units = found["segments"], found["units"]
    assert np.array_equal(found["gyro_rad_s"], bench["gyro_rad_s"].values)
    assert (segments["first"].tolist(), segments["last"].tolist()) == ([1, 11], [10, 30])
    assert segments["kind"].tolist() == ["settle", "steady"]
    assert (units["gyro_rad_s"], units["response"], units["pretension_mm"]) == ("rad/s", "N*m", "mm")


@with_data
@pytest.mark.parametrize("name", BEAMS)
def test_the_tip_of_a_silicone_beam_starts_where_its_source_says_and_has_even_stamps(name: str) -> None:
    tips = "Tip-1_x_m,Tip-2_x_m,Tip-3_x_m"
    recording = read(DATA / "silicone_beam_dragonskin10" / name, time="t_s", response=tips)
    assert 0.0592 <= float(recording["response"][0]) <= 0.0606
    assert "step 10 ms: even" in recording.attrs["import_notes"]


@with_data
@pytest.mark.parametrize("name", PENDULUMS)
def test_a_pendulum_log_in_serial_bursts_gets_the_step_that_its_source_states(name: str) -> None:
    recording = read(DATA / "torsion_spring_pendulum" / name, time="host_time_s", response="angle_deg:deg")
    steps = np.diff(recording["time_s"].values)
    assert 3.8505e-3 <= steps.min() <= steps.max() <= 3.8585e-3
    assert "stamped in bursts" in recording.attrs["import_notes"]


@with_data
@pytest.mark.parametrize("name", PENDULUMS)
def test_forty_samples_cut_from_a_real_log_in_bursts_are_missed(name: str, tmp_path: Path) -> None:
    lines = (DATA / "torsion_spring_pendulum" / name).read_text(encoding="utf-8").splitlines()
    (tmp_path / "cut.csv").write_text("\n".join(lines[:3000] + lines[3040:]), encoding="utf-8")
    with pytest.raises(TimeError, match=r"about (39|40|41) samples"):
        read(tmp_path / "cut.csv", time="host_time_s", response="angle_deg:deg")


@pytest.mark.parametrize("to", ["csv", "parquet", "mcap"])
def test_a_table_for_another_program_reads_back_with_its_times_and_values(
    bench: xr.Dataset, tmp_path: Path, to: str
) -> None:
    path = tmp_path / f"out.{to}"
    export_recording(bench, path, to)
    back = read(path, time="time_s", response="gyro_x_rad_s:rad/s")
    assert np.array_equal(back["response"].values, bench["gyro_rad_s"].values[:, 0])
    assert np.diff(back["time_s"].values) == pytest.approx(np.diff(bench["time_s"].values), abs=1e-9)


def test_a_message_of_an_mcap_file_is_a_sample_at_its_time(bench: xr.Dataset, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    export_recording(bench, tmp_path / "out.mcap", "mcap")
    with (tmp_path / "out.mcap").open("rb") as file:
        messages = [message for _, _, message in reader.make_reader(file).iter_messages()]
    told = [(message.log_time, json.loads(message.data)) for message in messages]
    assert [stamp for stamp, _ in told] == [round(1e9 * time) for time in bench["time_s"].values.tolist()]
    assert [row["drive_rad"] for _, row in told] == bench["drive_rad"].values.tolist()


def test_a_universal_file_has_a_set_for_every_channel_of_every_segment(bench: xr.Dataset, tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    bench = bench.assign(time_s=bench["time_s"] + 5000.0)
    export_recording(bench, tmp_path / "out.uff", "uff")
    sets = pyuff.UFF(str(tmp_path / "out.uff")).read_sets()
    told = {(one["id2"].strip(), one["id1"].strip()): one for one in sets}
    assert len(told) == len(sets) == 2 * (1 + 4 + 3 + 1)  # drive, currents, gyroscope, response
    steady = told["segment 1: steady", "response_n_m"]
    assert steady["data"] == pytest.approx(bench["response"].values[10:], rel=1e-11)  # twelve digits are written
    assert steady["x"] == pytest.approx(np.arange(20) / 200, rel=1e-5, abs=1e-9)  # six digits from its begin


def test_a_recording_that_begins_before_zero_has_its_first_message_at_zero(bench: xr.Dataset, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    export_recording(bench.assign(time_s=bench["time_s"] - 0.5), tmp_path / "out.mcap", "mcap")
    with (tmp_path / "out.mcap").open("rb") as file:
        messages = [message for _, _, message in reader.make_reader(file).iter_messages()]
    assert (messages[0].log_time, json.loads(messages[0].data)["time_s"]) == (0, -0.5)
