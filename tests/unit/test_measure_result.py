"""Results tell themselves, and whatever file holds a measurement is read."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.unit.figures_sample import sample_recording

from sinew.analysis.analysed import analyse
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.files.netcdf import save_dataset, save_recording
from sinew.measure.read import read
from sinew.measure.result import Detail, Field, Result, Rows, Table


@dataclass(frozen=True, repr=False)
class Weighed(Result):
    """A result of two lines."""

    name: str

    def blocks(self) -> list[Table | str]:
        return [Table((self.name, "mass/kg"), [("<head>", "0.5 ± 0.1")], "a & b"), "1 < 2."]


def test_python_shows_the_tables_and_sentences_of_a_result() -> None:
    lines = repr(Weighed("part")).splitlines()
    assert [line.split() for line in lines if line and "─" not in line] == [
        ["a", "&", "b"],
        ["part", "mass/kg"],
        ["<head>", "0.5", "±", "0.1"],
        ["1", "<", "2."],
    ]


def test_a_notebook_shows_them_escaped() -> None:
    html = Weighed("<script>")._repr_html_()
    assert "<script>" not in html
    assert "<caption>a &amp; b</caption>" in html
    assert "<td>&lt;head&gt;</td><td>0.5 ± 0.1</td>" in html
    assert "<p>1 &lt; 2.</p>" in html


@dataclass(frozen=True, repr=False)
class Part(Result):
    """One row: with a unit from the whole, a share in percent, and a part that may not be there."""

    force: Annotated[Estimate, Field("force", unit="[drive_unit]")]
    share: Annotated[Estimate | None, Field("share", unit="%")] = None
    hidden_s: Detail = None


@dataclass(frozen=True, repr=False)
class Whole(Result, kind="whole", title="the whole"):
    """A result of every kind of field."""

    frequency_hz: Annotated[Estimate, Field("frequency")]
    stiffness_n_m_rad: Annotated[float, Field("stiffness")]
    parts: Annotated[Rows[Part], Field("parts")]
    numbers: Annotated[Mapping[str, Estimate], Field("")]
    is_sure: Annotated[bool, Field("sure", "sentence")]
    drive_unit: Annotated[str, Field("", "detail")]
    drift: Annotated[float | None, Field("drift", "sentence")]
    later: Annotated[Part | None, Field("")] = None
    picture: "object" = None


WHOLE = Whole(
    Estimate.normal(3.021, 0.012),
    0.4,
    Rows([Part(Estimate.normal(2.0, 0.1), Estimate.normal(0.872, 0.006)), Part(Estimate.normal(4.0, 0.1))]),
    {"damping_per_s": Estimate.normal(1.2, 0.1)},
    True,
    "N",
    None,
    picture=object(),
)


def test_the_text_comes_from_titles_units_and_roles() -> None:
    assert [line.split("  ")[0] for line in str(WHOLE).splitlines() if line.strip("─")] == [
        *("the whole", "frequency/Hz", "stiffness/(N m/rad)"),
        *("parts", "force/N", "2.00 ± 0.10", "4.00 ± 0.10"),
        *("the whole", "damping/(1/s)", "sure: yes"),
    ]
    assert "87.2 ± 0.6" in str(WHOLE)


def test_json_leaves_out_what_is_for_python_and_what_there_is_not() -> None:
    document = WHOLE.to_dict()
    assert next(iter(document)) == "kind"
    assert "picture" not in document
    assert "later" not in document
    assert document["drift"] is None
    assert set(document["parts"][1]) == {"force"}
    json.dumps(document, allow_nan=False)


def test_a_result_comes_back_from_its_json() -> None:
    again = Whole.from_dict(json.loads(json.dumps(WHOLE.to_dict())))
    assert again == replace(WHOLE, picture=None)


def test_rows_become_a_dataframe_and_latex() -> None:
    table = WHOLE.parts.to_dataframe()
    assert list(table.columns) == ["force", "force_std", "force_low90", "force_high90", *SHARE]
    assert table["force"].tolist() == [2.0, 4.0]
    assert WHOLE.to_dataframe("parts").equals(table)
    assert "2.00(10)" in WHOLE.to_latex("parts")
    assert WHOLE.parts[1:] == Rows(WHOLE.parts[1:])


SHARE = ("share", "share_std", "share_low90", "share_high90")


@dataclass(frozen=True, repr=False)
class Mark(Result):
    """What is one cell where it stands in a row."""

    hertz: Annotated[float, Field("hertz")]

    def cell(self) -> str:
        return f"{self.hertz:g} Hz"


@dataclass(frozen=True, repr=False)
class Curve(Result):
    """A row with rows of its own: marks, of which each is a word, and parts, of which each has columns."""

    folds: Annotated[Rows[Mark], Field("folds")]
    parts: Annotated[Rows[Part], Field("parts")]


def test_rows_in_a_row_are_one_cell_where_each_has_a_word_and_no_column_else() -> None:
    parts = Rows([Part(Estimate(1.0, 0.1, 0.8, 1.2))])
    table = Rows([Curve(Rows([Mark(3.0), Mark(4.5)]), parts), Curve(Rows([]), parts)]).table()
    assert table is not None
    assert (list(table.columns), [list(row) for row in table.rows]) == (["folds"], [["3 Hz; 4.5 Hz"], ["none"]])


def test_a_field_that_the_class_says_already_is_refused() -> None:
    with pytest.raises(TypeError, match="has a field kind"):

        class Twice(Result, kind="twice"):
            kind: str


def test_a_recording_and_its_results_are_read_by_what_the_file_holds(tmp_path: Path) -> None:
    recording = sample_recording((0.0,), np.array([2.6, 3.0, 3.6]))
    found = analyse(recording)
    assert isinstance(found.dataset, xr.Dataset)
    save_recording(recording, tmp_path / "recording.nc")
    save_dataset(found.dataset, tmp_path / "results.nc")
    assert read(tmp_path / "recording.nc").sizes["sample"] == recording.sizes["sample"]
    xr.testing.assert_equal(read(str(tmp_path / "results.nc")), found.dataset)


def test_a_table_whose_columns_are_not_named_is_refused_with_those_it_has() -> None:
    with pytest.raises(SpecError, match=r"\(response=\) and phi or psi may be it; there are stamp, phi, psi"):
        read(pd.DataFrame({"stamp": [0.0, 1.0], "phi": [1.0, 2.0], "psi": [1.0, 2.0]}), time="stamp")


def test_a_recording_is_not_told_its_columns(tmp_path: Path) -> None:
    save_recording(sample_recording((0.0,), np.array([2.6, 3.0, 3.6])), tmp_path / "a.nc")
    with pytest.raises(SpecError, match="knows its columns"):
        read(tmp_path / "a.nc", time="t")
    with pytest.raises(SpecError, match="gaps are for tables"):
        read(tmp_path / "a.nc", gaps="split")
