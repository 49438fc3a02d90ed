"""What the figures of an identification show is what the fit and its record hold."""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from tests.tables import rows
from tests.unit.figures_pages import alternatives, asked_outside
from tests.unit.figures_panels import drawn, labelled, titled
from tests.unit.identify_signals import OMEGA, motion, noisy, viscous

from sinew.figures.fit import (
    FIT_CAPTIONS,
    Cloud,
    Trace,
    autocorrelation,
    axis_label,
    cloud_of,
    draw_corner,
    draw_fit,
    draw_residuals,
    ellipse,
    parameter_label,
    shown_unit,
    traces_of,
    write_fit_page,
)
from sinew.identify.identified import identify
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


def traces() -> list[Trace]:
    split, held_out = divided()
    return traces_of(held_out.fit, split, held_out)


@functools.cache
def figures() -> dict[str, Figure]:
    return {
        "fit_data": draw_fit(traces(), 3.0),
        "residuals": draw_residuals(traces(), 3.0),
        "corner": drawn(draw_corner(cloud_of(divided()[1].fit))),
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


def test_the_size_of_residuals_is_drawn_against_the_amplitude_of_each_period() -> None:
    axes = titled(figures()["residuals"], "against amplitude")
    fitted, held = (np.asarray(line.get_xydata()) for line in axes.lines)
    assert len(fitted) == 400 // 33
    assert fitted[:, 0].max() > 4 * held[:, 0].max()
    assert np.median(fitted[:, 1]) == pytest.approx(np.rad2deg(0.01), rel=0.2)  # of the noise


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_an_ellipse_holds_its_share_of_a_normal_distribution(share: float) -> None:
    covariance = np.array([[2.0, -0.9], [-0.9, 0.7]])
    draws = np.random.default_rng(14).multivariate_normal([0, 0], covariance, 20_000)
    outline = ellipse(covariance, share)
    reach = np.einsum("ij,ik,kj->j", outline, np.linalg.inv(covariance), outline)
    inside = np.einsum("ij,jk,ik->i", draws, np.linalg.inv(covariance), draws) < reach[0]
    assert np.ptp(reach) < 1e-9
    assert inside.mean() == pytest.approx(share, abs=0.01)


def test_the_cloud_of_a_fit_has_the_standard_deviations_of_its_parameters() -> None:
    found = divided()[1].fit
    cloud = cloud_of(found)
    assert cloud.names == tuple(found.parameters)
    np.testing.assert_allclose(cloud.std, [one.std for one in found.parameters.values()], rtol=1e-5)


def test_the_cloud_of_a_torque_on_an_angle_is_in_full_units() -> None:
    push = 0.2 * np.sin(OMEGA * TIME) + 0.1 * np.sin(0.5 * OMEGA * TIME)
    inertia = 0.01
    angle = motion(viscous(0.1), lambda t: float(np.interp(t, TIME, push)) / inertia, TIME)[0]
    record = make_record(TIME, angle, push, excitation="torque", output_unit="rad", input_unit="N*m")
    found = fit(record, "linear")
    cloud = cloud_of(found)
    assert set(cloud.names) == {"stiffness_n_m_per_rad", "damping_n_m_s_per_rad", "inertia_kg_m2"}
    np.testing.assert_allclose(cloud.std, [found.parameters[name].std for name in cloud.names], rtol=1e-4)


def test_draws_replace_the_covariance_of_the_parameters_they_are_of() -> None:
    generator = np.random.default_rng(15)
    draws = generator.multivariate_normal([1.0, 2.0], [[0.04, 0.03], [0.03, 0.09]], 4000)
    cloud = Cloud(("damping_per_s", "stiffness_per_s2"), np.zeros(2), np.eye(2)).drawn(
        ("stiffness_per_s2", "loss_factor", "damping_per_s"), np.column_stack([draws[:, 1], draws[:, 0], draws[:, 0]])
    )
    np.testing.assert_allclose(cloud.std, [0.2, 0.3], rtol=0.05)
    assert cloud.correlation[0, 1] == pytest.approx(0.5, abs=0.05)
    written = {text.get_text() for text in drawn(draw_corner(cloud)).findobj(Text)}
    assert f"ρ = {cloud.correlation[0, 1]:.2f}" in written


def test_the_corner_plot_tells_values_and_correlation() -> None:
    found, cloud = divided()[1].fit, cloud_of(divided()[1].fit)
    grid = np.reshape(np.array(figures()["corner"].axes), (2, 2))
    for k, name in enumerate(cloud.names):
        (words, unit), one = parameter_label(name), found.parameters[name]
        value, spread = typeset(one.shown()).split(" ± ")
        assert grid[k, k].get_title() == f"{words}\n{value} {unit}\n± {spread}"
        assert grid[1, k].get_xlabel() == words
    assert grid[0, 1].texts[0].get_text() == f"ρ = {cloud.correlation[0, 1]:.2f}".replace("-", "−")


def test_the_ellipses_of_the_corner_plot_reach_as_far_as_their_shares_and_lean_with_the_correlation() -> None:
    cloud = Cloud(("loss_factor", "inertia_kg_m2"), np.ones(2), np.array([[4.0, 1.5], [1.5, 1.0]]))
    pair = drawn(draw_corner(cloud)).axes[2]
    assert (pair.get_xlabel(), pair.get_ylabel()) == ("loss factor", "inertia")
    for outline, share in zip(pair.patches, (0.9, 0.5), strict=True):
        x, y = outline.get_xy().T  # type: ignore[attr-defined]
        assert x.max() == pytest.approx(np.sqrt(-2 * np.log(1 - share)), rel=1e-3)  # in standard deviations
        assert y[np.argmax(x)] / x.max() == pytest.approx(0.75, abs=0.03)


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
