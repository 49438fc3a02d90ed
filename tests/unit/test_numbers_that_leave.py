"""One quantity has one uncertainty, wherever it is read."""

import re

import numpy as np
import pytest
from tests.unit.figures_sample import sample_results

from sinew.analysis.analysed import recording_result
from sinew.figures.page import measured_tables
from sinew.measure.files.tables import latex_table, tables_of
from sinew.measure.result import Table
from sinew.paper.campaign import summarise

PRETENSIONS, FREQUENCIES = (0.0, 12.0), np.linspace(2.0, 5.0, 13)
RESULTS = sample_results(PRETENSIONS, FREQUENCIES)
RESULTS["distortion"].values[:] = 0.0  # a point without it counts as not measured
FOUND = recording_result(RESULTS)
DOCUMENT = FOUND.to_dict()


def uncertainty(text: str) -> float:
    """Return what stands behind ± or in brackets, in units of the value."""
    if "±" in text:
        return float(text.split("±")[1])
    digits, last = re.fullmatch(r"(-?[\d.]+)\((\d+)\)", text).groups()  # type: ignore[union-attr]
    return int(last) * 10.0 ** -len(digits.partition(".")[2])


def page_cell(title: str, head: str) -> str:
    table = next(one for one in measured_tables(RESULTS) if one.title == title)
    return table.rows[0][table.head.index(head)]


def latex_cell(part: str, column: str) -> str:
    [table] = tables_of(DOCUMENT, [part], [column])
    line = next(one for one in latex_table(table).splitlines() if re.match(r" +-?[\d.]+\(", one))
    return line.strip().removesuffix("\\\\").strip()


@pytest.mark.parametrize(
    ("part", "name", "title", "head"),
    [
        ("resonance", "paper_resonance_hz", "Resonance", "resonance (Eq. 6) in Hz"),
        ("resonance", "paper_gain_peak", "Resonance", "gain"),
        ("resonance", "half_power_width_hz", "Resonance", "half-power width in Hz"),
        ("ring_down", "paper_decay_rate_per_s", "Ring-down", "λ in 1/s"),
    ],
)
def test_page_and_latex_say_the_uncertainty_of_the_document(part: str, name: str, title: str, head: str) -> None:
    std = DOCUMENT[part][0][name]["std"]
    said = [uncertainty(page_cell(title, head)), uncertainty(latex_cell(part, name))]
    assert said == pytest.approx([std, std], rel=0.15)  # one digit from 3.55 on


def test_a_terminal_says_the_uncertainty_of_the_document() -> None:
    table = next(one for one in FOUND.blocks() if isinstance(one, Table) and "gain" in one.columns)
    cells = [row[table.columns.index("gain")] for row in table.rows]
    expected = [row["gain_std"] for row in DOCUMENT["response"]]
    assert [uncertainty(cell) for cell in cells] == pytest.approx(expected, rel=0.15)


def test_the_standard_deviation_of_a_summary_is_that_of_the_document() -> None:
    rows = summarise(RESULTS, wall_s=1.0, simulated_s=1.0)["resonance"]["rows"]
    assert rows[0]["paper_resonance_hz"] == DOCUMENT["resonance"][0]["paper_resonance_hz"]
