"""Tables of results in LaTeX and CSV, read back."""

import csv
import io
import math
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import sinew as sn
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate, parenthesised
from sinew.measure.files.tables import Rows, csv_table, latex_table, tables_of

DOCUMENT: dict[str, Any] = {
    "kind": "recording",
    "resonance": [
        {"pretension_mm": 0.0, "resonance_hz": Estimate(3.0213, 0.0203, 2.98, 3.06).to_json(), "settled": True},
        {
            "pretension_mm": 6.0,
            "resonance_hz": Estimate(3.5844, math.nan, math.nan, math.nan).to_json(),
            "settled": False,
        },
    ],
    "energy": {"idle_power_w": 0.3, "pretensions": [{"pretension_mm": 6.0, "note": "50 % of λ_1 & more"}]},
    "parameters": {"stiffness_n_m_rad": Estimate.normal(4.531, 0.027).to_json()},
}


def read(text: str) -> tuple[float, float]:
    r"""Return (value, uncertainty) of siunitx's "3.021(20)e+03", the digits in brackets counting from the last one."""
    digits, brackets, power = re.fullmatch(r"(-?[\d.]+)\((\d+)\)(?:e([+-]\d+))?", text).groups()  # type: ignore[union-attr]
    last = 10.0 ** -len(digits.partition(".")[2])
    scale = 10.0 ** int(power or 0)
    return float(digits) * scale, int(brackets) * last * scale


@given(st.floats(1e-6, 1e9), st.floats(1.01e-3, 0.5), st.sampled_from([1, -1]))
def test_a_number_with_its_uncertainty_in_brackets_reads_back(size: float, share: float, sign: int) -> None:
    value, std = sign * size, share * size
    told, half = read(parenthesised(value, std))
    assert abs(told - value) <= 0.51 * std
    assert half == pytest.approx(std, rel=0.14)  # one digit from 3.55 on rounds by half of it


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (3.0213, 0.0203, "3.021(20)"),
        (2.306, 0.0415, "2.31(4)"),
        (12340.0, 123.0, "12340(120)"),
        (-1.23456e8, 4.4e6, "-1.23(4)e+08"),
        (3.5844, 0.0, "3.584"),
    ],
)
def test_digits_follow_the_uncertainty(value: float, std: float, text: str) -> None:
    assert parenthesised(value, std) == text


def test_every_list_of_rows_and_group_of_quantities_is_a_table() -> None:
    found = tables_of(DOCUMENT)
    assert [one.name for one in found] == ["resonance", "energy_pretensions", "parameters"]
    assert r"50 \% of $\lambda$\_1 \& more" in latex_table(found[1])
    assert r"stiffness / \unit{N.m/rad} & 4.531(27) \\" in latex_table(found[2])


def test_a_latex_table_has_siunitx_numbers_and_units() -> None:
    lines = latex_table(tables_of(DOCUMENT, ["resonance"])[0]).splitlines()
    assert lines[4].strip() == r"\begin{tabular}{S[table-format=1.0] S[table-format=1.3(2)] l}"
    heads = (r"{\shortstack{pretension \\ / \unit{mm}}}", r"{\shortstack{resonance \\ / \unit{Hz}}}", "settled")
    assert lines[6].strip() == f"{' & '.join(heads)} \\\\"
    assert [lines[8].strip(), lines[9].strip()] == [r"0 & 3.021(20) & yes \\", r"6 & 3.584 & no \\"]


@pytest.mark.parametrize(
    ("cells", "room"),
    [
        ([12.5, -3.25], "-2.2"),
        ([1.2e-7, -4.0e12], "-1.3e-2"),
        ([2.0, Estimate.normal(12340.0, 123.0).to_json()], "5.0(3)"),
        ([2.0, math.inf, None], "1.0"),
    ],
)
def test_a_column_of_numbers_has_room_for_the_digits_of_all(cells: list[Any], room: str) -> None:
    text = latex_table(Rows("mine", ("gain",), tuple((cell,) for cell in cells)))
    assert f"{{S[table-format={room}]}}" in text


def test_what_is_no_number_stands_in_braces_in_a_column_of_numbers() -> None:
    text = latex_table(Rows("mine", ("gain",), ((2.0,), (math.inf,), (None,), (-4.0e12,))))
    assert [line.strip() for line in text.splitlines()[8:12]] == [
        r"2 \\", r"{$\infty$} \\", r"{--} \\", r"-4.000e12 \\",
    ]  # fmt: skip


def test_a_table_that_is_longer_than_a_page_breaks_with_its_heading_on_each() -> None:
    text = latex_table(Rows("mine", ("gain",), ((2.0,),) * 41))
    assert text.startswith(r"\begin{longtable}")
    assert text.count("{gain}") == 2
    assert text.index(r"\endfirsthead") < text.index(r"\endhead") < text.index("    2 ")


def test_the_columns_that_are_named_stand_in_their_order_where_a_table_has_them() -> None:
    [one] = tables_of(DOCUMENT, columns=["settled", "resonance_hz"])
    assert (one.name, one.columns, one.rows[1][0]) == ("resonance", ("settled", "resonance_hz"), False)
    with pytest.raises(SpecError, match="found no column 'gain', expected some of pretension_mm, resonance_hz"):
        tables_of(DOCUMENT, columns=["gain"])


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("cubic_per_s2_rad2", "1/(s^2.rad^2)"),
        ("stiffness_n_m_per_rad", "N.m/rad"),
        ("quadratic_per_s2_rad", "1/(s^2.rad)"),
        ("coulomb_rad_per_s2", "rad/s^2"),
        ("damping_n_m_s_rad", "N.m.s/rad"),
        ("cubic_n_m_rad3", "N.m/rad^3"),
        ("swing_cost_j_rad2", "J/rad^2"),
        ("inertia_kg_m2", "kg.m^2"),
        ("omega_rad_s", "rad/s"),
    ],
)
def test_the_unit_of_a_quantity_is_that_of_its_name(name: str, unit: str) -> None:
    [line] = [one for one in latex_table(Rows("mine", (name,), ((2.0,),))).splitlines() if r"\unit" in one]
    assert rf"\unit{{{unit}}}" in line


def test_a_number_and_its_standard_deviation_side_by_side_are_one_quantity() -> None:
    [one] = tables_of({"response": [{"gain": 1.4, "gain_std": 0.0123, "settled": True}]})
    assert one.columns == ("gain", "settled")
    assert r"1.400(12) & yes \\" in latex_table(one)


def test_a_csv_table_reads_back_with_every_digit() -> None:
    rows = list(csv.DictReader(io.StringIO(csv_table(tables_of(DOCUMENT, ["resonance"])[0]))))
    told = DOCUMENT["resonance"][0]["resonance_hz"]
    names = ("resonance_hz", "resonance_hz_std", "resonance_hz_low90", "resonance_hz_high90")
    assert [float(rows[0][name]) for name in names] == [told["value"], told["std"], *told["interval90"]]
    assert (rows[1]["resonance_hz"], rows[1]["resonance_hz_std"]) == ("3.5844", "")


def test_each_table_gets_a_csv_file_of_its_own(tmp_path: Path) -> None:
    files = sn.export_table(DOCUMENT, tmp_path / "mine.csv")
    assert [one.name for one in files] == ["mine-resonance.csv", "mine-energy_pretensions.csv", "mine-parameters.csv"]


def test_a_part_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(SpecError, match="expected one of resonance, energy_pretensions, parameters"):
        tables_of(DOCUMENT, ["gain"])
