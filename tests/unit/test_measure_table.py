"""Text tables as they come: delimiters, headers, junk, and the line each fault is answered with."""

from pathlib import Path

import pandas as pd
import pytest
from tests.tables import rows

from sinew.measure.errors import FileError, RecordingError
from sinew.measure.files.names import find_columns
from sinew.measure.files.text import notes_of
from sinew.measure.read import numbers, read_table


def table_file(folder: Path, text: str | bytes, name: str = "t.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


DELIMITERS = {
    "comma": "t,a\n0,1.5\n1,2.5\n",
    "semicolon": "t;a\n0;1.5\n1;2.5\n",
    "tab": "t\ta\n0\t1.5\n1\t2.5\n",
    "blanks": "t a\n0 1.5\n1 2.5\n",
    "decimal comma": "t;a\n0;1,5\n1;2,5\n",
    "quotes": '"t","a"\n0,1.5\n1,2.5\n',
    "trailing delimiter": "t,a,\n0,1.5,\n1,2.5,\n",
}
SURROUNDINGS = {
    "windows": "t, a\r\n0, 1.5\r\n1, 2.5\r\n",
    "comment": "# from the bench\n\nt,a\n0,1.5\n1,2.5\n",
    "header in a comment": "# t,a\n0,1.5\n1,2.5\n",
    "byte order mark": "\ufefft,a\n0,1.5\n1,2.5\n",
    "empty lines": "t,a\n0,1.5\n\n1,2.5\n\n",
}
TEXTS = DELIMITERS | SURROUNDINGS


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
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
        (b"t,a\n", "holds no table"),
        (b"# nothing here\n", "holds no table"),
        (b"0,1\n1,2\n", "holds no table"),
        (b"Walking 96 to 114 s, with 2 turns\nand no table of numbers\n", "holds no table"),
        (bytes(range(256)) * 20, "binary data"),
        (b"\x89HDF\r\n\x1a\n" + bytes(200), "HDF5 or NetCDF"),
        (b"PK\x03\x04" + bytes(200), "an Excel file"),
    ],
    ids=["empty", "blank", "header only", "comments", "no header", "prose", "junk", "hdf5", "excel"],
)
def test_a_file_that_is_no_table_is_refused_with_the_reason(tmp_path: Path, content: bytes, said: str) -> None:
    with pytest.raises(FileError) as caught:
        read_table(table_file(tmp_path, content))
    assert said in str(caught.value)


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


@pytest.mark.parametrize(
    ("head", "spec", "said"),
    rows(r"""
        time_s,angle_deg => angel_deg:deg => 'angel_deg'.* 'angle_deg'\?.* time_s
        t,Tip-1,Tip-2 => Tip-1,Tip-9:m => no column 'Tip-9'
    """),
    ids=["missing, with the closest and all names", "the missing one of several"],
)
def test_a_column_that_is_not_there_once_is_refused(tmp_path: Path, head: str, spec: str, said: str) -> None:
    table = read_table(table_file(tmp_path, f"{head}\n{','.join('0' for _ in head.split(','))}\n"))
    with pytest.raises(RecordingError, match=said):
        find_columns(table, spec)


def test_a_line_that_is_no_row_is_left_out_and_shown(tmp_path: Path) -> None:
    table = read_table(table_file(tmp_path, "t,a\n0,1\n1,2\n1,2,3\n3,4\nlogger restarted\n5,6\n"))
    assert numbers(table, "a").tolist() == [1, 2, 4, 6]
    assert "2 lines of no numbers left out, the first is data row 3: '1,2,3'" in notes_of(table)[0]


def test_two_columns_of_one_name_are_numbered(tmp_path: Path) -> None:
    assert list(read_table(table_file(tmp_path, "t,a,a\n0,1,2\n1,2,3\n")).columns) == ["t", "a", "a 2"]


def test_a_word_among_decimal_commas_leaves_the_numbers_that_they_are(tmp_path: Path) -> None:
    table = read_table(table_file(tmp_path, "t;a\n0,0;1,5\n0,1;oops\n0,2;2,5\n0,3;1.003,5\n0,4;4\n0,5;5\n"))
    assert pd.to_numeric(table["a"], errors="coerce").dropna().tolist() == [1.5, 2.5, 1003.5, 4, 5]


@pytest.mark.parametrize(("cell", "said"), [("oops", "'oops'"), ("", "NaN or an empty cell"), ("inf", "infinity")])
def test_a_cell_without_a_number_is_refused_by_row_and_column(tmp_path: Path, cell: str, said: str) -> None:
    table = read_table(table_file(tmp_path, f"t,a\n0,1\n1,{cell}\n2,3\n3,4\n4,5\n"))
    with pytest.raises(RecordingError, match=f"column 'a' holds {said} in data row 2"):
        numbers(table, "a")
