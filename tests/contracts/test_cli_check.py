"""`sinew check`: what it previews, and how it refuses."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from tests.contracts.virtual_run import spoken
from tests.tables import rows

from sinew.apps.cli import main
from sinew.plan.toml import dump_plan, load_plan


@pytest.fixture
def refused_plan(tmp_path: Path) -> Path:
    plan = load_plan("short").model_copy(deep=True)
    text = dump_plan(plan).replace("pretension_mm = [0, 6, 12]", "pretension_mm = [0, 6, 25]")
    path = tmp_path / "beyond.toml"
    path.write_text(text, encoding="utf-8")
    return path


@cache
def short() -> dict[str, Any]:
    """Return the document of the short plan."""
    return dict(json.loads(spoken("check", "short", "--json")[1]))


def test_the_document_has_the_keys_of_the_reference() -> None:
    named = "plan rig ok duration_s bench_s groups samples full_amplitude_hz drive tension torsion wire findings"
    assert set(short()) == set(named.split())


def test_the_time_of_a_cycle_on_the_wire_is_told_beside_its_limit() -> None:
    # 268 bytes of ten bits at 1 Mbaud; 80 % of the 5 ms.
    assert short()["wire"] == {"cycle_ms": 2.68, "limit_ms": 4.0}


def test_each_frequency_and_each_pretension_has_its_row() -> None:
    found, plan = short(), load_plan("short")
    assert plan.sweep is not None
    assert found["ok"] is True
    assert [row["frequency_hz"] for row in found["drive"]] == list(plan.sweep.frequency_hz)
    assert [row["pretension_mm"] for row in found["tension"]] == [0, 6, 12]
    tensions, torsions = ([row[name] for row in found[name.split("_")[0]]] for name in ("tension_n", "torsion_deg"))
    assert tensions == sorted(set(tensions))
    assert torsions == sorted(set(torsions), reverse=True)


@cache
def paper() -> tuple[int, str]:
    """Return the status of the paper's plan on the paper's rig, and what a person is told of it."""
    return spoken("check", "plans/paper.toml", "--rig", "rigs/paper.toml")[:2]


def test_the_papers_plan_on_the_papers_rig_is_not_refused() -> None:
    status, said = paper()
    assert (status, "REFUSED" in said) == (0, False)
    assert "sweep asks for 20° at 6 Hz" in said
    assert "ms at 1 Mbaud" in said


def test_a_refused_plan_ends_with_status_2_and_its_sentence(
    refused_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(["check", str(refused_plan)])
    out, err = capsys.readouterr()
    assert status == 2
    assert "plan asks for a pretension of 25 mm, the rig allows 0 to 16 mm" in err
    assert "REFUSED: " in out
    main(["check", str(refused_plan), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (found["ok"], found["findings"][0]["severity"]) == (False, "refuse")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    rows("""
        repeats = 1 => repeats = 100000000 => found 100000000, expected less than or equal to 100000
        repeats = 1 => repeats = 90000 => expected at most 100000; lower repeats
        [0, 6, 12] => [4, 4] => pretension_mm: found 4 more than once
        settle_s = => settle_s = 9000 # => settle_s: found 9000, expected less than or equal to 3600
    """),
)
def test_an_absurd_plan_is_refused_before_it_is_unrolled(
    old: str, new: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = dump_plan(load_plan("short"))
    assert old in text
    (tmp_path / "plan.toml").write_text(text.replace(old, new), encoding="utf-8")
    assert main(["check", str(tmp_path / "plan.toml")]) == 2
    assert sentence in capsys.readouterr().err
