"""The report is one page that holds everything, trusts no text, and leaves out what is not there."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.figures_pages import alternatives, asked_outside, outline
from tests.unit.figures_sample import SMALL, foreign_ring_down, sample_recording, sample_results

from sinew.figures.page import Table, measured_tables
from sinew.measure.errors import FileError
from sinew.paper.campaign import shares_plan, summarise
from sinew.paper.report import CAPTIONS, draw_figures, write_report
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig

POSTERIOR = {
    "drive.armature": {"unit": "kg*m^2", "prior90": [0.004, 0.02], "posterior90": [0.004, 0.018], "ratio": 0.875},
    "silicone.diameter": {"unit": "m", "prior90": [0.04, 0.08], "posterior90": [0.054, 0.058], "ratio": 0.1},
}
EFFECTS = [
    {
        "effect": "<b>no friction</b>",
        "resonance_hz_0": 3.0,
        "resonance_hz_12": None,
        "gain_0": 4.1,
        "gain_12": 2.9,
        "damping_0": 0.05,
        "damping_12": 0.031,
    }
]


def lead(page: str) -> str:
    return page.split('<p class="lead">')[1].split("</p>")[0]


def section(page: str, name: str) -> str:
    return page.split(f'<section id="{name}">')[1].split("</section>")[0]


def paper_page(folder: Path, results: xr.Dataset, rig: RigSpec | None = None) -> str:
    rig = load_rig("paper") if rig is None else rig
    summary = summarise(results, wall_s=1, simulated_s=1, rig=rig)
    return write_report(folder, results=results, summary=summary, rig=rig).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return draw_figures(sample_recording(*SMALL), sample_results(*SMALL), tmp_path_factory.mktemp("figures"), ("png",))


@pytest.fixture(scope="module")
def page(figures: list[Path], tmp_path_factory: pytest.TempPathFactory) -> str:
    results = sample_results(*SMALL).assign_attrs(content_hash="c0ffee", recording_hash="beef")
    rig = load_rig("paper")
    path = write_report(
        tmp_path_factory.mktemp("report"),
        results=results,
        figures=figures,
        summary=summarise(results, wall_s=12.0, simulated_s=5000.0, rig=rig),
        rig=rig,
        posterior=POSTERIOR,
        effects=EFFECTS,
        rebuild="make reproduce",
    )
    return path.read_text(encoding="utf-8")


def test_the_page_is_whole_and_asks_for_nothing_from_outside(page: str) -> None:
    assert (outline(page).open, asked_outside(page)) == ([], [])


def test_every_figure_is_in_the_page_with_words_for_those_who_cannot_see_it(page: str) -> None:
    assert alternatives(page) == [caption.alt for caption in CAPTIONS.values()]


def test_a_malicious_name_of_an_effect_that_is_off_is_text(tmp_path: Path) -> None:
    results = sample_results(*SMALL).assign_attrs(effects_off="<script>alert(1)</script>")
    page = write_report(tmp_path, results=results).read_text(encoding="utf-8")
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page


def test_effects_that_were_off_are_named_before_anything_else_and_beside_the_headline(
    page: str, tmp_path: Path
) -> None:
    results = sample_results(*SMALL).assign_attrs(effects_off="guide_friction sensor_noise")
    partly = paper_page(tmp_path, results)
    assert partly.index("Simulated without: guide_friction, sensor_noise.") < partly.index('class="lead"')
    assert "without guide_friction, sensor_noise" in lead(partly)
    assert "Simulated without" not in page


def test_the_headline_says_how_many_rows_were_fitted_and_put_in(page: str) -> None:
    count = section(page, "paper").count("<tr>") - 1
    assert f" of {count} rows within tolerance; 6 were fitted and 2 are inputs, of the {count - 8} that follow" in lead(
        page
    )


def test_a_rig_that_was_not_calibrated_claims_no_fitted_rows(tmp_path: Path) -> None:
    rig = load_rig("paper")
    rig = rig.with_values({name: row.value for name, row in rig.parameters()}, origin="assumed")
    assert "fitted" not in lead(paper_page(tmp_path, sample_results(*SMALL), rig))


def test_each_row_of_the_papers_table_has_its_role(page: str) -> None:
    table = section(page, "paper")
    assert re.search(r"gain at resonance at 0 mm</th>(?:(?!</tr>).)*<td>fitted</td>", table, re.DOTALL)
    assert re.search(r"stiffness k(?:(?!</tr>).)*<td>input</td>", table, re.DOTALL)
    assert re.search(r"λ does not rise[^<]*</th>(?:(?!</tr>).)*<td>follows</td>", table, re.DOTALL)


def test_the_sentence_above_the_effects_is_that_of_their_campaign(page: str) -> None:
    plan = shares_plan()
    assert plan.sweep is not None
    grid = np.asarray(plan.sweep.frequency_hz)
    said = section(page, "effects").replace("&nbsp;", " ").replace("\n", " ")
    assert f"{grid[0]:g} to {grid[-1]:g} Hz in steps of {grid[1] - grid[0]:.2f} Hz, one repeat" in said
    assert plan.sweep.repeats == 1
    assert " and ".join(f"{p:g}" for p in plan.pretension.pretension_mm) + " mm only" in said


def test_the_first_sentence_counts_what_lies_outside(tmp_path: Path) -> None:
    results = sample_results(*SMALL)
    results["paper_gain_peak"].values[0] = 9.0
    assert '<span class="bad">1 of ' in lead(paper_page(tmp_path, results))


def test_every_parameter_of_the_rig_is_listed_with_its_origin(page: str) -> None:
    for name, parameter in load_rig("paper").parameters():
        assert re.search(
            rf"<code>{re.escape(name)}</code>(?:(?!</tr>).)*<td>{parameter.origin}</td>", page, re.DOTALL
        ), name


def test_what_the_numbers_determine_comes_best_known_first(page: str) -> None:
    found = section(page, "determined")
    assert found.index("silicone.diameter") < found.index("drive.armature")
    assert "0.04 to 0.08" in found
    assert "0.054 to 0.058" in found
    assert re.findall(r'<td class="n">([^<]*)</td>', found) == ["10 %", "88 %"]


def test_how_to_rebuild_names_command_seed_and_hashes(page: str) -> None:
    for text in ("make reproduce", "sinew 0.1.0", '<td class="hash">7</td>', "c0ffee", "beef"):
        assert text in section(page, "rebuild")


def test_a_foreign_recording_gets_a_report_without_the_papers_sections_whatever_it_is_given(tmp_path: Path) -> None:
    recording, results = foreign_ring_down()
    path = write_report(
        tmp_path,
        results=results,
        figures=draw_figures(recording, results, tmp_path / "figures"),
        summary=summarise(sample_results(*SMALL), wall_s=1, simulated_s=1, rig=load_rig("paper")),
        rig=load_rig("paper"),
        posterior=POSTERIOR,
        effects=[{"effect": "no friction", **dict.fromkeys(SHARES, 1.0)}],
    )
    page = path.read_text(encoding="utf-8")
    assert not {"paper", "determined", "effects"} & set(re.findall(r'<section id="([^"]+)"', page))
    assert "<h1>Resonance report</h1>" in page
    assert "Source: an imported recording." in page


SHARES = ("resonance_hz_0", "resonance_hz_12", "gain_0", "gain_12", "damping_0", "damping_12")


def test_a_report_into_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(FileError, match=r"report\.html"):
        write_report(tmp_path / "out", results=foreign_ring_down()[1])


def _put(results: xr.Dataset, name: str, value: float, std_of_mean: float) -> None:
    """Put a mean of three repeats into the first pretension: they scatter by √3 of its standard deviation, and the
    interval is Student's, 2.92 of it."""
    columns = {"hz": value, "std_hz": math.sqrt(3) * std_of_mean}
    columns |= {"low_hz": value - 2.919986 * std_of_mean, "high_hz": value + 2.919986 * std_of_mean}
    for column, number_ in columns.items():
        results[f"{name}_{column}"].values[0] = number_


def _titled(results: xr.Dataset, title: str) -> Table:
    return next(table for table in measured_tables(results) if table.title == title)


def test_all_meanings_of_resonance_stand_side_by_side() -> None:
    results = sample_results(*SMALL)
    _put(results, "paper_resonance", 3.044, 0.004)
    _put(results, "resonance", 3.055, 0.004)
    table = _titled(results, "What resonance means")
    assert table.head[1:3] == ["mean of peaks (Eq. 6) in Hz", "fundamental in Hz"]
    assert table.rows[0][1:3] == ["3.044 ± 0.004", "3.055 ± 0.004"]
    assert "half of peak to peak" in table.note


def test_the_page_shows_d_for_every_start_of_the_decay_and_the_conclusion_for_all(tmp_path: Path) -> None:
    results = sample_results(*SMALL)
    rising = np.linspace(0.9, 1.1, 4)[:, None]
    results["window_lehr_damping"].values[:, :, 0] *= rising
    results["window_lehr_damping"].values[:, :, 5] /= rising
    page = paper_page(tmp_path, results)
    assert "Where the decay begins" in section(page, "measured")
    assert "Whether D is constant over pretension is not determined" in section(page, "measured")
    assert "our choice" in section(page, "measured")


def test_decays_that_are_not_exponential_are_counted_below_the_ring_downs() -> None:
    results = sample_results(*SMALL)
    assert _titled(results, "Ring-down").note == "Exponential within their noise: 12 of 12 decays."
    results["exponential"].values[0] = [0.0, 0.0, float("nan")]
    note = _titled(results, "Ring-down").note
    assert note.startswith("Exponential within their noise: 9 of 11 decays.")
    assert "damping depends on the amplitude" in note
