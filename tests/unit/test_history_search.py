"""The language of a search among runs: what it finds, and what it says of a query that is none."""

from pathlib import Path
from typing import Any

import pytest

from sinew.analysis.run_index import RunIndex
from sinew.measure.errors import SpecError


def estimate(value: float, half: float = 0.05) -> dict[str, Any]:
    return {"value": value, "std": half / 1.645, "interval90": [value - half, value + half]}


RUNS: dict[str, dict[str, Any]] = {
    "first": {
        "started": "2026-01-31T10:00:00+00:00",
        "rig": "paper",
        "tags": ["aged"],
        "notes": "after the 50% move",
        "found": [
            {"pretension_mm": 2.0, "resonance_hz": estimate(3.24), "gain_peak": estimate(2.5)},
            {"pretension_mm": 6.0, "resonance_hz": estimate(3.0), "damping_ratio": estimate(0.08)},
        ],
    },
    "second": {
        "started": "2026-02-01T10:00:00+00:00",
        "rig": "mine",
        "tags": ["ageddon", "new"],
        "notes": "Sehne Über Nacht",
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

    with RunIndex(runs, lambda folder: folder.name, read) as opened:
        opened.refresh()
        yield opened


@pytest.mark.parametrize(
    ("query", "names"),
    [
        ("", ["second", "first", "empty"]),
        ("f_r>3.2", ["second", "first"]),
        ("f_r>3.2 pretension=6", ["second"]),
        ("pretension=6 fr<=3", ["first"]),
        ("f_r=3.2", ["first"]),
        ("f_r=3.20", []),
        ("f_r=3.2..3.3", ["first"]),
        ("D<0.1", ["first"]),
        ("d<0.1", ["second"]),
        ("tag:aged", ["first"]),
        ("-tag:aged", ["second", "empty"]),
        ("rig:PAPER", ["first"]),
        ("notes:SEHNE", ["second"]),
        ("notes:ÜBER", ["second"]),
        ("hot", ["second"]),
        ("-hot begin>=2026", ["first"]),
        ("begin=2026-01", ["first"]),
        ("begin>2026-01", ["second"]),
        ("begin<=2026-01", ["first", "empty"]),
        ('"50% move"', ["first"]),
        ("5_%", []),
        ("state!=damaged", ["second", "first"]),
        ("reason:'", []),
    ],
)
def test_a_query_finds_the_runs_that_meet_all_of_it(index: RunIndex, query: str, names: list[str]) -> None:
    assert [row["name"] for row in index.search(query)] == names


def test_what_a_run_found_is_told_at_the_pretensions_that_meet_the_query(index: RunIndex) -> None:
    (first,) = index.search("gain>2 f_r>3.2")
    assert [row["pretension_mm"] for row in first["found"]] == [2.0]


def test_an_estimate_comes_back_as_it_was_read(index: RunIndex) -> None:
    (first,) = index.search("name:first gain>0")
    assert first["found"][0]["gain_peak"] == estimate(2.5)


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("f_q>3", "is f_r meant"),
        ("f_r>much", "expected a number"),
        ("f_r>", "without a value|a name, a sign and a value"),
        (">3", "expected a name"),
        ('"half', "quote without its end"),
        ("tag>3", "tag is text"),
        ("begin>soon", "expected a date"),
        ("-f_r>3", "turn the sign"),
        ("f_r>3..4", "expected a range"),
        ("f_r>nan", "expected a number"),
        ("f_r=0e999", "expected a number"),
        ("a " * 300, "600 characters"),
        ("a " * 40, "40 parts"),
    ],
)
def test_a_query_that_is_none_is_refused_with_what_was_expected(index: RunIndex, query: str, said: str) -> None:
    with pytest.raises(SpecError, match=said):
        index.search(query)
