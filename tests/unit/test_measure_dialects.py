"""Files of other labs: each is read without an option, or refused with the option that reads it."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from tests.unit.dialects import (
    BINARIES,
    DIALECTS,
    LVM,
    LVM_END,
    SMALL,
    STEP,
    SWING,
    TEXTS,
    TIME,
    Dialect,
    N,
    lvm_segment,
    rows,
)

from sinew.measure.errors import SinewError
from sinew.measure.read import look, read, read_table
from sinew.measure.units import canonical_unit

ALL = [pytest.param(one, id=one.name) for one in DIALECTS]
OPTIONED = [pytest.param(one, id=one.name) for one in DIALECTS if one.refusal]


def written(dialect: Dialect, folder: Path) -> Path:
    dialect.write(folder / dialect.name)
    return folder / dialect.name


@pytest.mark.parametrize("dialect", ALL)
def test_the_swing_in_a_file_is_read_with_its_times_and_its_unit(dialect: Dialect, tmp_path: Path) -> None:
    recording = read(written(dialect, tmp_path), **dialect.options)  # type: ignore[arg-type]
    unit, factor = canonical_unit(dialect.unit)
    channel = recording["torsion_rad" if unit == "rad" else "response"]
    assert channel.attrs["units"] == unit
    assert channel.values / factor == pytest.approx(dialect.values, abs=dialect.slack)
    assert np.diff(recording["time_s"].values) == pytest.approx(np.full(N - 1, STEP), abs=2e-6)


@pytest.mark.parametrize("dialect", OPTIONED)
def test_a_file_that_leaves_a_doubt_is_refused_with_the_option_that_settles_it(
    dialect: Dialect, tmp_path: Path
) -> None:
    with pytest.raises(SinewError, match=r"\S") as caught:
        read(written(dialect, tmp_path))
    assert dialect.refusal in str(caught.value)
    assert "\n" not in str(caught.value)


def test_look_says_what_only_its_reader_knows(tmp_path: Path) -> None:
    (angles,) = [one for one in TEXTS if one.name == "angles_only.txt"]
    found = look(written(angles, tmp_path)).to_dict()
    assert found["missing"] == ["--rate HZ"]
    assert shlex.split(found["command"])[3:5] == ["--rate", "HZ"]


def test_names_for_all_columns_must_be_as_many_as_there_are(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("".join(f"{i / 100},{i}\n" for i in range(9)))
    with pytest.raises(SinewError, match="a name of its own for each of the 2 columns: 1, 2"):
        read_table(tmp_path / "a.csv", columns="t,x,y")


def without_samples(path: Path, hole: str) -> Path:
    """Write the swing without a column of times, four samples missing: their lines are empty, or hold a word."""
    cells = [hole if 100 <= k < 104 else f"{x:.4f}" for k, x in enumerate(SWING)]
    if path.suffix == ".xlsx":
        openpyxl = pytest.importorskip("openpyxl")
        book = openpyxl.Workbook()
        for row, cell in enumerate(cells, start=2):
            book.active.cell(row, 1, cell if cell in ("", "nan") else float(cell))
        book.active.cell(1, 1, "angle_deg")
        book.save(path)
    elif path.suffix == ".lvm":
        lines = [*LVM, "Decimal_Separator\t.", "X_Columns\tNo", LVM_END, *lvm_segment(".", "deg"), "X_Value\tAngle"]
        path.write_text("\n".join([*lines, *(f"\t{cell}" for cell in cells)]) + "\n")
    else:
        path.write_text("\n".join(["angle_deg", *cells]) + "\n\n\n")
    return path


@pytest.mark.parametrize("hole", ["", "nan"])
@pytest.mark.parametrize("name", ["a.txt", "a.lvm", "a.xlsx"])
def test_missing_samples_keep_their_place_where_the_time_is_counted(tmp_path: Path, name: str, hole: str) -> None:
    rate = None if name == "a.lvm" else 1 / STEP
    recording = read(without_samples(tmp_path / name, hole), rate_hz=rate, gaps="split")
    kept = np.delete(np.arange(N), slice(100, 104))
    assert recording["time_s"].values == pytest.approx(kept * STEP)
    assert recording["torsion_rad"].values == pytest.approx(np.radians(SWING[kept]))


def test_an_empty_line_below_every_line_is_no_missing_sample(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes("\r\r\n".join(["angle_deg", *rows(SWING)]).encode())
    assert read(tmp_path / "a.txt", rate_hz=1 / STEP)["time_s"].values == pytest.approx(TIME)


def test_whole_stamps_without_a_unit_are_said_to_be_taken_for_seconds(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("\n".join(["stamp,angle_deg", *rows(4.0 * np.arange(N), SWING)]))
    notes = read(tmp_path / "a.csv").attrs["import_notes"]
    assert "whole numbers 4 apart, taken for seconds, for no unit is stated; where they are ms, say it" in notes


def test_runs_below_one_another_are_told_by_a_time_that_is_named_without_its_bracket(tmp_path: Path) -> None:
    twice = rows(np.concatenate([TIME, TIME]), np.concatenate([SWING, SMALL]))
    (tmp_path / "a.csv").write_text("\n".join(["Time (s),angle_deg", *twice]))
    recording = read(tmp_path / "a.csv", time="Time", run=2)
    assert recording["torsion_rad"].values == pytest.approx(np.radians(SMALL))


def test_lines_that_are_one_decimal_or_two_numbers_are_read_by_how_many_names_there_are(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("\n".join(f"{x:.2f}".replace(".", ",") for x in SWING))
    with pytest.raises(SinewError, match=r"lines as '20,00'.*--columns NAME for one, --columns NAME,NAME for two"):
        read(tmp_path / "a.txt", rate_hz=1 / STEP, response="1")
    one = read(tmp_path / "a.txt", rate_hz=1 / STEP, columns="angle_deg")
    assert one["torsion_rad"].values == pytest.approx(np.radians(SWING), abs=1e-4)
    assert list(read_table(tmp_path / "a.txt", columns="a,b").columns) == ["a", "b"]


@pytest.mark.parametrize("run", [0, 3, "third"])
def test_a_run_that_is_not_there_is_refused_with_the_list(tmp_path: Path, run: int | str) -> None:
    (below,) = [one for one in TEXTS if one.name == "runs_below.csv"]
    with pytest.raises(SinewError, match=r"has no run .*1 'part 1', 2 'part 2'"):
        read(written(below, tmp_path), run=run)


def test_a_clock_that_passes_midnight_goes_on(tmp_path: Path) -> None:
    times = [f"23:59:59.{k}00" for k in range(5, 10)] + [f"00:00:00.{k}00" for k in range(10)]
    (tmp_path / "a.csv").write_text("time,x\n" + "".join(f"{t},{k}\n" for k, t in enumerate(times)))
    assert read(tmp_path / "a.csv")["time_s"].values == pytest.approx(np.arange(15) / 10)


def test_a_format_whose_library_is_missing_is_refused_with_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tdms,) = [one for one in BINARIES if one.name == "labview.tdms"]
    file = written(tdms, tmp_path)
    monkeypatch.setitem(__import__("sys").modules, "nptdms", None)
    with pytest.raises(SinewError, match=r"npTDMS reads, and that is not installed; install it: .*\[files\]"):
        read(file)


def test_a_folder_that_rosbag2_wrote_is_read_as_the_bag_in_it(tmp_path: Path) -> None:
    (bag,) = [one for one in BINARIES if one.name == "bag.mcap"]
    written(bag, tmp_path)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 9\n")
    assert read(tmp_path, **bag.options).sizes["sample"] == N  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (b"SQLite format 3\0" + bytes(99), "ros2 bag convert"),
        (b"#ROSBAG V2.0\n" + bytes(99), "mcap convert"),
        (b"CDF\x01" + bytes(99), "export it as CSV"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
        (b'{"entries": [{"t": 0.0, "x"', "begins as JSON but cannot be read, it is cut short"),
        (b'{"mass": 0.5}', "JSON without a list of samples"),
        (b"PAR1" + bytes(99), "begins as a Parquet file but cannot be read, it is cut short"),
        (b"TDSm" + bytes(99), "begins as TDMS, a file of LabVIEW but cannot be read"),
        (b"\x89MCAP0\r\n" + bytes(99), r"MCAP file \(rosbag2\) but cannot be read"),
        (b"MATLAB 5.0 MAT-file" + bytes(300), "MATLAB but cannot be read"),
    ],
)
def test_a_damaged_or_foreign_file_is_refused_by_its_kind(tmp_path: Path, head: bytes, said: str) -> None:
    (tmp_path / "x.bin").write_bytes(head)
    with pytest.raises(SinewError, match=said):
        read_table(tmp_path / "x.bin")


DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
with_data = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not at ../shared/data")


@with_data
def test_a_real_table_below_a_block_of_settings_is_found_with_its_header() -> None:
    table = read_table(DATA / "silicone_tensile" / "Dragon_Skin_30.csv")
    assert list(table.columns[[0, 3]]) == ["Time (s)", "Engineering Strain"]
    assert table.iloc[0, 3] == 0.0446


@with_data
def test_a_real_swing_without_a_header_of_its_own_is_read_by_its_rate() -> None:
    file = DATA / "rotary_pendulum_swing" / "pendulum_free_swing_data_01.txt"
    recording = read(file, columns="angle_deg", rate_hz=1000)
    assert recording["torsion_rad"].values == pytest.approx(np.radians(np.loadtxt(file, skiprows=2)))
