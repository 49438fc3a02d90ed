"""What the figures of an identification show is what the fit and its record hold."""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from tests.tables import rows
from tests.unit.figures_pages import alternatives, asked_outside
from tests.unit.figures_panels import drawn, labelled, titled
from tests.unit.identify_signals import OMEGA, motion, noisy, viscous

from sinew.figures.fit import (
    FIT_CAPTIONS,
    Trace,
    autocorrelation,
    axis_label,
    draw_corner,
    draw_fit,
    draw_residuals,
    draws_of,
    parameter_label,
    shown_unit,
    traces_of,
    write_fit_page,
)
from sinew.identify.identified import Identified, identify
from sinew.identify.oscillator.comparison import HeldOut, Split, fit_and_predict, split_record
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import Record, make_record
from sinew.measure.estimate import typeset

TIME = np.arange(0, 6, 0.01)


def decay(response: np.ndarray) -> Record:
    return make_record(TIME, response, output_unit="rad")


@functools.cache
def divided() -> tuple[Split, HeldOut]:
    """A linear decay, its last third held out."""
    clean = motion(viscous(0.05), lambda t: 0.0, TIME, (0.4, 0.0))[0]
    split = split_record(decay(noisy(clean, 0.01, 12)), (0, 400), (400, 600))
    return split, fit_and_predict(split, "linear")


@functools.cache
def identified() -> Identified:
    return identify(divided()[0].record, "linear")


def traces() -> list[Trace]:
    split, held_out = divided()
    return traces_of(held_out.fit, split, held_out)


@functools.cache
def figures() -> dict[str, Figure]:
    return {
        "fit_data": draw_fit(traces(), 3.0),
        "residuals": draw_residuals(traces(), 3.0),
        "corner": drawn(draw_corner(draws_of(identified()))),
    }


def test_the_held_out_samples_are_those_of_the_test_range() -> None:
    [trace] = traces()
    assert (trace.time_s[trace.held][0], trace.time_s[trace.held][-1]) == pytest.approx((4.0, 5.99))


def test_a_test_range_before_the_training_range_is_a_trace_of_its_own() -> None:
    record = divided()[0].record
    split = split_record(record, (200, 600), (0, 200))
    first, second = traces_of(*(lambda h: (h.fit, split, h))(fit_and_predict(split, "linear")))
    assert (first.held.all(), second.held.any()) == (True, False)
    np.testing.assert_array_equal(first.measured, record.output[:200])


def test_blocks_that_were_held_out_show_what_was_predicted_without_them() -> None:
    split = split_record(divided()[0].record, None, None)
    held_out = fit_and_predict(split, "linear")
    [trace] = traces_of(fit(split.record, "linear"), split, held_out)
    np.testing.assert_allclose(trace.residual[trace.held], held_out.residual)


def test_the_whole_record_is_drawn_in_degrees() -> None:
    [trace], axes = traces(), titled(figures()["fit_data"], "whole record")
    measured = np.rad2deg(divided()[0].record.output)
    fitted = np.rad2deg(trace.fitted)
    for label, values in (("measured", measured), ("fitted", fitted), ("measured less fitted", measured - fitted)):
        np.testing.assert_allclose(labelled(axes, label), np.column_stack([TIME, values]), atol=1e-9)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time in s", "output in degrees")


def test_the_second_close_up_begins_with_the_held_out_part() -> None:
    assert titled(figures()["fit_data"], "held out").get_xlim()[0] == pytest.approx(4.0)


def test_several_segments_get_a_panel_each() -> None:
    [one] = traces()
    many = [Trace(one.time_s, one.measured, one.fitted, one.held, one.unit, f"{i} mm") for i in range(7)]
    titles = [axes.get_title(loc="left") for axes in draw_fit(many, 3.0).axes]
    assert [title for title in titles if title] == [f"{i} mm" for i in range(7)]


def test_alternating_residuals_are_anticorrelated() -> None:
    r = np.tile([1.0, -1.0], 50)
    trace = Trace(np.arange(100.0), r, np.zeros(100), np.zeros(100, dtype=bool), "1")
    found, count = autocorrelation([trace], 2)
    assert count == 100
    np.testing.assert_allclose(found, [-0.99, 0.98])


def test_pairs_that_reach_into_the_held_out_part_do_not_count() -> None:
    r = np.concatenate([np.tile([1.0, -1.0], 50), np.full(100, 7.0)])
    trace = Trace(np.arange(200.0), r, np.zeros(200), np.arange(200) >= 100, "1")
    np.testing.assert_allclose(autocorrelation([trace], 2)[0], [-0.99, 0.98])


def test_the_band_of_the_autocorrelation_holds_95_percent_of_white_noise() -> None:
    generator, inside = np.random.default_rng(13), []
    for _ in range(40):
        r = generator.normal(size=400)
        found, count = autocorrelation([Trace(np.arange(400.0), r, 0 * r, np.zeros(400, dtype=bool), "1")], 20)
        inside.append(np.mean(np.abs(found) < 1.96 / np.sqrt(count)))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def test_draws_scatter_by_the_standard_deviations_of_the_parameters() -> None:
    found = identified()
    draws = draws_of(found)
    assert list(draws) == ["stiffness\nin 1/s²", "damping\nin 1/s"]
    for name, one in zip(draws, found.parameters.values(), strict=True):
        assert draws[name].std() == pytest.approx(one.std, rel=0.1)  # of 500 draws: three standard deviations
        assert draws[name].mean() == pytest.approx(one.value, abs=0.15 * one.std)


def test_draws_of_a_torque_on_an_angle_are_in_full_units() -> None:
    push = 0.2 * np.sin(OMEGA * TIME) + 0.1 * np.sin(0.5 * OMEGA * TIME)
    inertia = 0.01
    angle = motion(viscous(0.1), lambda t: float(np.interp(t, TIME, push)) / inertia, TIME)[0]
    record = make_record(TIME, noisy(angle, 0.001, 3), push, excitation="torque", output_unit="rad", input_unit="N*m")
    assert {name.split("\n")[0] for name in draws_of(identify(record, "linear"))} == {"stiffness", "damping", "inertia"}


def test_the_corner_holds_a_panel_for_each_pair_and_none_for_a_single_parameter() -> None:
    draws = draws_of(identified())
    figure = drawn(draw_corner(draws))
    assert len(figure.axes) == 4
    assert {axes.get_xlabel() for axes in figure.axes[2:]} == set(draws)
    assert draw_corner(draws.iloc[:, :1]) is None


@pytest.mark.parametrize(
    ("name", "words", "unit"),
    rows("""
        stiffness_per_s2 => stiffness => 1/s²
        cubic_per_s2_rad2 => cubic term => 1/(s² rad²)
        stiffness_n_m_per_rad => stiffness => N m/rad
        inertia_kg_m2 => inertia => kg m²
        loss_factor => loss factor =>
        natural_frequency_hz[4 mm] => natural frequency 4 mm => Hz
        input_gain_v_per_s2_a => input gain => V/(s² A)
        silicone.torsional_rigidity_n_m2 => silicone torsional rigidity => N m²
        stiffness_n_m_rad => stiffness => N m/rad
        damping_n_m_s_rad => damping => N m s/rad
        cubic_n_m_rad3 => cubic term => N m/rad³
        swing_cost_at_cheapest_j_rad2 => swing cost at cheapest => J/rad²
        omega_rad_s => omega => rad/s
    """),
)
def test_a_parameters_name_gives_its_words_and_its_unit(name: str, words: str, unit: str) -> None:
    assert parameter_label(name) == (words, unit)


def test_an_axis_names_its_unit_and_none_where_there_is_none() -> None:
    assert (axis_label("output", "m"), axis_label("output", "1")) == ("output in mm", "output")
    assert shown_unit("rad")[0] * np.pi == pytest.approx(180.0)


def test_the_page_holds_verdict_numbers_and_figures_and_nothing_from_elsewhere(tmp_path: Path) -> None:
    figures()["corner"].savefig(tmp_path / "corner.png")
    found = identify(divided()[0].record, "linear")
    told = replace(found, sentences=("all is <well>",), posterior={"loss_factor": found.damping_ratio})
    page = write_fit_page(tmp_path, told, figures=[tmp_path / "corner.png"]).read_text(encoding="utf-8")
    assert "All is &lt;well&gt;." in page
    assert typeset(found.parameters["stiffness_per_s2"].shown()) in page
    assert "<h3>Posterior</h3>" in page
    assert asked_outside(page) == []
    assert FIT_CAPTIONS["corner"].see.split(".")[0] in page
    assert alternatives(page) == [FIT_CAPTIONS["corner"].alt]
