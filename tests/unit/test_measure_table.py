"""Text tables as they come: delimiters, headers, junk, and the line each fault is answered with."""

from pathlib import Path

import pytest

from sinew.measure.errors import FileError, RecordingError
from sinew.measure.files.csv import find_columns, numbers, read_table


def table_file(folder: Path, text: str | bytes, name: str = "t.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("t,a\n0,1.5\n1,2.5\n", id="comma"),
        pytest.param("t;a\n0;1.5\n1;2.5\n", id="semicolon"),
        pytest.param("t\ta\n0\t1.5\n1\t2.5\n", id="tab"),
        pytest.param("t a\n0 1.5\n1 2.5\n", id="blanks"),
        pytest.param("t;a\n0;1,5\n1;2,5\n", id="decimal comma"),
        pytest.param("t, a\r\n0, 1.5\r\n1, 2.5\r\n", id="windows"),
        pytest.param("# from the bench\n\nt,a\n0,1.5\n1,2.5\n", id="comment"),
        pytest.param("# t,a\n0,1.5\n1,2.5\n", id="header in a comment"),
        pytest.param('"t","a"\n0,1.5\n1,2.5\n', id="quotes"),
        pytest.param("t,a,\n0,1.5,\n1,2.5,\n", id="trailing delimiter"),
        pytest.param("\ufefft,a\n0,1.5\n1,2.5\n", id="byte order mark"),
        pytest.param("t,a\n0,1.5\n\n1,2.5\n\n", id="empty lines"),
    ],
)
def test_a_table_is_read_whatever_its_delimiters(tmp_path: Path, text: str) -> None:
    table = read_table(table_file(tmp_path, text))
    assert (list(table.columns), numbers(table, "a").tolist()) == (["t", "a"], [1.5, 2.5])


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
def test_a_degree_sign_in_a_header_is_read_from_common_encodings(tmp_path: Path, encoding: str) -> None:
    path = table_file(tmp_path, "t,angle (°)\n0,1\n".encode(encoding))
    assert list(read_table(path).columns) == ["t", "angle (°)"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty; expected a header line"),
        (b"  \n\n", "is empty; expected a header line"),
        (b"t,a\n", "has a header but no rows"),
        (b"# nothing here\n", "holds only comments"),
        (b"0,1\n1,2\n", "has no header: its first line is '0,1'"),
        (bytes(range(256)) * 20, "binary data"),
        (b"\x89HDF\r\n\x1a\n" + bytes(200), "HDF5 or NetCDF"),
        (b"PK\x03\x04" + bytes(200), "an Excel file"),
        (b"t,a\n0,1\n1,2\n1,2,3\n", "is not a table of 2 columns as its header says"),
        (b"a,b,c\n0\n1\n", "is not a table of 3 columns as its header says (most rows have 1)"),
        (b"Run 7 of the bench\nt,a\n0,1\n1,2\n", "lines above it must start with #"),
    ],
    ids=[
        "empty",
        "blank",
        "header only",
        "comments",
        "no header",
        "junk",
        "hdf5",
        "excel",
        "ragged",
        "short",
        "preamble",
    ],
)
def test_a_file_that_is_no_table_is_refused_with_the_reason(tmp_path: Path, content: bytes, said: str) -> None:
    with pytest.raises(FileError) as caught:
        read_table(table_file(tmp_path, content))
    assert said in str(caught.value)


def test_an_absent_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"cannot read .*absent\.csv: No such file"):
        read_table(tmp_path / "absent.csv")


def test_a_folder_is_refused_as_a_table(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="is a folder, expected a CSV file"):
        read_table(tmp_path)


@pytest.mark.parametrize(
    ("spec", "found"),
    [
        ("a", (["a"], None)),
        ("a:deg", (["a"], "deg")),
        ("a,b", (["a", "b"], None)),
        ("a, b : mm", (["a", "b"], "mm")),
        ("x:y", (["x:y"], None)),
        ("x:y:mm", (["x:y"], "mm")),
        ("p,q", (["p,q"], None)),
    ],
)
def test_a_specification_names_columns_and_a_unit(tmp_path: Path, spec: str, found: tuple[list[str], str]) -> None:
    table = read_table(table_file(tmp_path, 'a,b,x:y,"p,q"\n0,1,2,3\n'))
    assert find_columns(table, spec) == found


def test_a_missing_column_is_answered_with_the_closest_and_all_names(tmp_path: Path) -> None:
    table = read_table(table_file(tmp_path, "time_s,angle_deg\n0,1\n"))
    with pytest.raises(RecordingError, match=r"'angel_deg'.* 'angle_deg'\?.* time_s"):
        find_columns(table, "angel_deg:deg")


def test_the_missing_one_of_several_columns_is_named(tmp_path: Path) -> None:
    table = read_table(table_file(tmp_path, "t,Tip-1,Tip-2\n0,1,2\n"))
    with pytest.raises(RecordingError, match="no column 'Tip-9'"):
        find_columns(table, "Tip-1,Tip-9:m")


def test_a_column_that_occurs_twice_is_refused_when_it_is_asked_for(tmp_path: Path) -> None:
    table = read_table(table_file(tmp_path, "t,a,a\n0,1,2\n"))
    with pytest.raises(RecordingError, match="column 'a' occurs 2 times"):
        find_columns(table, "a")


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("oops", "column 'a' holds 'oops' in data row 2, expected a number"),
        ("", "column 'a' holds NaN or an empty cell in data row 2"),
        ("nan", "column 'a' holds NaN or an empty cell in data row 2"),
        ("inf", "column 'a' holds infinity in data row 2"),
    ],
)
def test_a_cell_without_a_number_is_refused_by_row_and_column(tmp_path: Path, cell: str, said: str) -> None:
    table = read_table(table_file(tmp_path, f"t,a\n0,1\n1,{cell}\n2,3\n"))
    with pytest.raises(RecordingError, match=said):
        numbers(table, "a")


def test_a_row_of_units_is_recognised_for_what_it_may_be(tmp_path: Path) -> None:
    table = read_table(table_file(tmp_path, "t,a\ns,deg\n0,1\n"))
    with pytest.raises(RecordingError, match="if this row holds units, delete it"):
        numbers(table, "a")


def test_rows_outside_the_selection_are_not_judged(tmp_path: Path) -> None:
    table = read_table(table_file(tmp_path, "t,a\n0,\n1,2\n2,3\n"))
    assert numbers(table, "a", slice(1, 3)).tolist() == [2, 3]
