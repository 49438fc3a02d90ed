"""Results tell themselves, and whatever file holds a measurement is read."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.unit.figures_sample import sample_recording

from sinew.analysis.analysed import analyse
from sinew.measure.errors import SpecError
from sinew.measure.files.netcdf import save_dataset, save_recording
from sinew.measure.read import read
from sinew.measure.told import Table, Told


@dataclass(frozen=True, repr=False)
class Weighed(Told):
    """A result of two lines."""

    name: str

    def told(self) -> list[Table | str]:
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
