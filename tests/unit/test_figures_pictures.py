"""The figures of a campaign together: which there are, how they are written, and what all of them keep to."""

from pathlib import Path

import numpy as np
import pytest
from tests.unit.figures_drawn import figures, recording, results
from tests.unit.figures_panels import drawn, smallest_type, titled
from tests.unit.figures_sample import foreign_ring_down

from sinew.figures.decay import draw_decay
from sinew.figures.style import frequency_colours, pretension_colours
from sinew.measure.arrays import mean_and_spread
from sinew.measure.errors import FileError
from sinew.paper.report import FIGURES, build_figures, draw_figures


def test_a_campaign_gives_every_figure_in_the_order_of_the_paper() -> None:
    assert list(figures()) == list(FIGURES)


@pytest.mark.slow
def test_every_figure_is_written_in_every_format(tmp_path: Path) -> None:
    paths = draw_figures(recording(), results(), tmp_path / "new" / "figures")
    assert [p.name for p in paths] == [f"{name}.{ending}" for name in FIGURES for ending in ("png", "pdf")]
    assert all(p.read_bytes()[:4] in (b"\x89PNG", b"%PDF") and p.stat().st_size > 10_000 for p in paths)


def test_a_folder_that_is_a_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "figures").write_text("")
    with pytest.raises(FileError, match="figures"):
        draw_figures(recording(), results(), tmp_path / "figures")


def test_results_without_ring_downs_skip_the_figures_of_damping() -> None:
    swept = results().drop_vars(
        [name for name in results().data_vars if results()[name].dims == ("pretension_mm", "repeat")]
    )
    left_out = set(FIGURES) - {name for name, _ in build_figures(recording(), swept)}
    assert left_out == {"figure09_decay", "figure10_damping"}


def test_a_sweep_too_short_for_a_resonance_still_shows_its_response() -> None:
    plain = [
        name
        for name in results().data_vars
        if results()[name].dims in (("pretension_mm",), ("pretension_mm", "repeat"))
    ]
    swept = results().drop_vars([name for name in plain if name != "pretension_mm"])
    left = [name for name, _ in build_figures(recording(), swept)]
    assert left == ["figure05_drive_groups", "figure06_response", "figure07_lissajous"]


def test_a_foreign_ring_down_gives_its_decay_alone() -> None:
    assert [name for name, _ in build_figures(*foreign_ring_down())] == ["figure09_decay"]


def test_a_foreign_response_keeps_its_unit_on_the_axis() -> None:
    assert titled(drawn(draw_decay(*foreign_ring_down())), "envelope").get_ylabel() == "response in mm"


def test_no_type_is_smaller_than_eight_points() -> None:
    assert smallest_type(figures())[0] >= 8.0


@pytest.mark.parametrize("colours", [pretension_colours, frequency_colours])
def test_colours_become_lighter_evenly_and_stay_dark_enough_for_white_paper(colours: object) -> None:
    rgb = colours(np.arange(13.0))[:, :3]  # type: ignore[operator]
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    lightness = 116 * np.cbrt(luminance) - 16
    assert np.diff(lightness).min() > 2.0
    assert 1.05 / (luminance.max() + 0.05) > 1.75


def test_mean_and_spread_leave_out_what_was_not_measured() -> None:
    mean, spread = mean_and_spread([[1.0, 3.0, np.nan], [5.0, np.nan, np.nan], [np.nan] * 3])
    np.testing.assert_allclose(mean, [2.0, 5.0, np.nan])
    np.testing.assert_allclose(spread, [np.sqrt(2.0), np.nan, np.nan])
