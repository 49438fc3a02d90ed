"""The search among runs by words and ranges: what it finds, and what it says where it is not understood."""

from pathlib import Path
from typing import Any

import pytest

from sinew.analysis.runs import RunIndex
from sinew.measure.errors import SpecError


def estimate(value: float, half: float = 0.05) -> dict[str, Any]:
    return {"value": value, "std": half / 1.645, "interval90": [value - half, value + half]}


RUNS: dict[str, dict[str, Any]] = {
    "first": {
        "started": "2026-01-31T10:00:00+00:00",
        "rig": "paper",
        "plan": "aged",
        "sentence": "after the 50% move",
        "found": [
            {"pretension_mm": 2.0, "resonance_hz": estimate(3.24), "gain_peak": estimate(2.5)},
            {"pretension_mm": 6.0, "resonance_hz": estimate(3.0), "damping_ratio": estimate(0.08)},
        ],
    },
    "second": {
        "started": "2026-02-01T10:00:00+00:00",
        "rig": "mine",
        "plan": "Sehne Über Nacht",
        "state": "stopped",
        "sentence": "The run ended early: motor 3 is too hot",
        "found": [{"pretension_mm": 6.0, "resonance_hz": estimate(3.9), "paper_damping_n_m_s_rad": estimate(0.02)}],
    },
    "empty": {"started": "2025-12-01T10:00:00+00:00", "state": "damaged", "found": []},
}


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Any:
    runs = tmp_path_factory.mktemp("runs")
    for name in RUNS:
        (runs / name).mkdir()

    def read(folder: Path) -> dict[str, Any]:
        return {"name": folder.name, **RUNS[folder.name]}

    opened = RunIndex(runs, lambda folder: folder.name, read)
    opened.refresh()
    return opened


@pytest.mark.parametrize(
    ("search", "names"),
    [
        ("", ["second", "first", "empty"]),
        ("f_r=3.2..", ["second", "first"]),
        ("f_r=3.2.. pretension=6", ["second"]),
        ("pretension=6 fr=..3", ["first"]),
        ("f_r=3.2..3.3", ["first"]),
        ("f_r=3.3..3.2", ["first"]),
        ("D=..0.1", ["first"]),
        ("d=..0.1", ["second"]),
        ("aged", ["first"]),
        ("PAPER", ["first"]),
        ("ÜBER", ["second"]),
        ("hot 2026", ["second"]),
        ("2026-01", ["first"]),
        ("50% move", ["first"]),
        (".*", []),
    ],
)
def test_a_search_finds_the_runs_that_meet_all_of_it(index: RunIndex, search: str, names: list[str]) -> None:
    assert [row["name"] for row in index.search(search)] == names


def test_a_run_has_what_it_found_at_the_pretensions_in_the_ranges(index: RunIndex) -> None:
    (first,) = index.search("gain=2.. f_r=3.2..")
    assert [row["pretension_mm"] for row in first["found"]] == [2.0]


def test_the_table_has_a_row_for_each_run_and_pretension(index: RunIndex) -> None:
    table = index.table()
    assert table["run"].tolist() == ["second", "first", "first", "empty"]
    assert table["resonance_hz"].dropna().tolist() == [3.9, 3.24, 3.0]


@pytest.mark.parametrize(
    ("search", "said"),
    [
        ("f_q=3..", "is f_r meant"),
        ("f_r=much..", "expected words and ranges"),
        ("f_r=nan..4", "expected words and ranges"),
        ("f_r=", "expected words and ranges"),
        ("f_r=..", "expected words and ranges"),
        ("f_r=3.2", "expected words and ranges"),
        ("f_r>3", "expected words and ranges"),
        ("tag:aged", "expected one of f_r"),
    ],
)
def test_a_search_that_cannot_be_understood_is_refused(index: RunIndex, search: str, said: str) -> None:
    with pytest.raises(SpecError, match=said):
        index.search(search)
