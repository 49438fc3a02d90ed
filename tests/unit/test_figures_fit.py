"""What the figures of an identification show is what the fit and its record hold."""

import functools
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from scipy import special
from tests.tables import rows
from tests.unit.figures_pages import alternatives, asked_outside
from tests.unit.figures_panels import drawn, labelled, smallest_type, titled
from tests.unit.identify_signals import OMEGA, dry_decay, motion, noisy, viscous

from sinew.figures.fit import (
    FIT_CAPTIONS,
    Cloud,
    autocorrelation,
    cloud_of,
    draw_corner,
    draw_residuals,
    ellipse,
    write_fit_page,
)
from sinew.figures.fit_data import (
    Trace,
    axis_label,
    draw_backbone,
    draw_fit,
    parameter_label,
    shown_unit,
    traces_of,
    value_and_std,
)
from sinew.identify.choice.comparison import HeldOut, Split, fit_and_predict, split_record
from sinew.identify.oscillator.backbone import fit_backbone
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.fitted import Fit, swing_of
from sinew.identify.oscillator.record import Record, make_record

TIME = np.arange(0, 6, 0.01)


def decay(response: np.ndarray) -> Record:
    return make_record(TIME, response, output_unit="rad")


@functools.cache
def duffing() -> Fit:
    """A hardening decay from 0.6 rad, whose frequency falls by a fifth, without noise."""
    force = viscous(0.02, cubic=400.0)
    return fit(decay(motion(force, lambda t: 0.0, TIME, (0.6, 0.0))[0]), "cubic")


@functools.cache
def rough() -> Fit:
    """A decay under dry friction alone, with a little noise."""
    return fit(decay(noisy(dry_decay(TIME, 0.5, 0.0, 2.0, 0.01), 1e-4, 11)), "coulomb")


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
    split, held_out = divided()
    found = held_out.fit
    decay_itself = fit_backbone(split.record.time_s, split.record.output)
    return {
        "fit_data": draw_fit(traces(), 3.0),
        "residuals": draw_residuals(traces(), 3.0),
        "corner": drawn(draw_corner(cloud_of(found))),
        "backbone": drawn(draw_backbone(swing_of(found), decay_itself, "rad")),
    }


def test_the_swing_of_a_hardening_spring_has_the_period_of_the_elliptic_integral() -> None:
    found = swing_of(duffing())
    assert found is not None
    k, c = duffing().parameters["stiffness_per_s2"].value, duffing().parameters["cubic_per_s2_rad2"].value
    d = duffing().parameters["damping_per_s"].value
    # x'' + k x + c x³ = 0 from rest at A (Landau and Lifshitz; Abramowitz and Stegun 16.23): T = 4 K(m)/sqrt(k + c A²).
    inner = k + c * found.amplitude**2
    omega = np.pi / 2 * np.sqrt(inner) / special.ellipk(c * found.amplitude**2 / (2 * inner))
    np.testing.assert_allclose(found.frequency_hz, np.sqrt(omega**2 - d**2 / 4) / (2 * np.pi), rtol=1e-9)


@pytest.mark.slow
def test_the_swing_of_a_fit_agrees_with_the_decay_that_it_was_fitted_to() -> None:
    record, model = duffing().records[0], swing_of(duffing())
    itself = fit_backbone(record.time_s, record.output)
    assert model is not None
    at = (itself.amplitude > 0.1) & (itself.amplitude < 0.5)
    expected = np.interp(itself.amplitude[at], model.amplitude, model.frequency_hz)
    np.testing.assert_allclose(itself.frequency_hz[at], expected, rtol=0.005)


def test_the_swing_of_a_pendulum_has_the_period_of_the_elliptic_integral() -> None:
    response = motion(lambda r, v: 0.4 * v + OMEGA**2 * np.sin(r), lambda t: 0.0, TIME, (2.0, 0.0))[0]
    found = swing_of(fit(decay(response), "pendulum"), largest=2.5)
    assert found is not None
    period = 4 / OMEGA * special.ellipk(np.sin(found.amplitude / 2) ** 2)
    expected = np.sqrt((2 * np.pi / period) ** 2 - 0.2**2) / (2 * np.pi)
    np.testing.assert_allclose(found.frequency_hz, expected, rtol=1e-4)


@pytest.mark.slow
def test_dry_friction_damps_a_swing_by_two_frictions_over_pi_times_the_restoring_force() -> None:
    found, numbers = swing_of(rough()), rough().parameters
    assert found is not None
    k, c, d = (numbers[name].value for name in ("stiffness_per_s2", "coulomb_rad_per_s2", "damping_per_s"))
    expected = d / (2 * np.sqrt(k)) + 2 * c / (np.pi * k * found.amplitude)
    np.testing.assert_allclose(found.damping_ratio, expected, rtol=1e-6)


def test_the_band_of_a_swing_at_small_amplitude_is_the_interval_of_the_linear_part() -> None:
    found, numbers = swing_of(divided()[1].fit), divided()[1].fit
    assert found is not None
    half = 0.5 * (found.damping_ratio_high - found.damping_ratio_low)[0]
    assert half == pytest.approx(0.5 * (numbers.damping_ratio.high - numbers.damping_ratio.low), rel=1e-3)


def test_a_spring_that_pushes_away_has_no_swing() -> None:
    assert swing_of(duffing(), largest=np.inf) is None


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
        value, spread = value_and_std(one.value, one.std).split(" ± ")
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


def test_a_single_parameter_has_no_corner() -> None:
    assert draw_corner(Cloud(("loss_factor",), np.ones(1), np.eye(1))) is None


def test_the_backbone_has_a_curve_of_the_model_and_one_of_the_decay() -> None:
    left, right = figures()["backbone"].axes
    model, itself = labelled(left, "fitted model"), labelled(left, "decay, no model")
    np.testing.assert_allclose(model[:, 1], 3.0 * np.sqrt(1 - 0.05**2), rtol=0.002)
    np.testing.assert_allclose(np.median(itself[:, 1]), 3.0 * np.sqrt(1 - 0.05**2), rtol=0.01)
    assert 0.5 < itself[:, 0].max() / np.degrees(0.4) < 1.1
    np.testing.assert_allclose(labelled(right, "fitted model")[:, 1], 0.05, rtol=0.05)
    assert np.median(labelled(right, "decay, no model")[:, 1]) == pytest.approx(0.05, rel=0.1)
    assert [axes.get_ylabel() for axes in (left, right)] == ["frequency in Hz", "damping ratio"]
    assert {axes.get_xlabel() for axes in (left, right)} == {"amplitude in degrees"}


def test_neither_curve_means_no_backbone() -> None:
    assert draw_backbone(None, None, "rad") is None


def test_no_type_is_smaller_than_eight_points() -> None:
    assert smallest_type(figures())[0] >= 8.0


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


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (355.3142, 0.1712, "355.31 ± 0.17"),
        (0.10234, 0.0013, "0.1023 ± 0.0013"),
        (12345.6, 240.0, "12350 ± 240"),
        (2.0e-9, 3.0e-10, "(2.00 ± 0.30)e-09"),
        (-1.5, np.nan, "−1.5"),
    ],
)
def test_a_value_is_told_to_the_second_digit_of_its_standard_deviation(value: float, std: float, text: str) -> None:
    assert value_and_std(value, std) == text


def test_an_axis_names_its_unit_and_none_where_there_is_none() -> None:
    assert (axis_label("output", "m"), axis_label("output", "1")) == ("output in mm", "output")
    assert shown_unit("rad")[0] * np.pi == pytest.approx(180.0)


QUANTITY = {"value": 3.0, "std": 0.1, "interval90": [2.8, 3.2]}
DOCUMENT = {
    "model": "linear",
    "parameters": {"stiffness_per_s2": QUANTITY},
    "natural_frequency_hz": QUANTITY,
    "damping_ratio": {"value": None, "std": None, "interval90": [None, None]},
    "rmse": {"train": 0.01, "test": None},
    "unit": "V",
    "converged": False,
    "message": "",
    "unidentifiable": ["offset and quadratic term cannot be told apart in this record"],
    "compared": [{"model": "linear", "rmse_test": None, "bic": None}],
}


def test_the_page_holds_verdict_numbers_and_figures_and_nothing_from_elsewhere(tmp_path: Path) -> None:
    figures()["corner"].savefig(tmp_path / "corner.png")
    path = write_fit_page(tmp_path, DOCUMENT, sentences=["all is <well>"], figures=[tmp_path / "corner.png"])
    page = path.read_text(encoding="utf-8")
    assert "All is &lt;well&gt;." in page
    assert "Offset and quadratic term" in page
    assert "did not converge" in page
    assert asked_outside(page) == []
    assert FIT_CAPTIONS["corner"].see.split(".")[0] in page
    assert alternatives(page) == [FIT_CAPTIONS["corner"].alt]


def test_the_numbers_of_an_option_get_a_table_of_their_own(tmp_path: Path) -> None:
    path = write_fit_page(tmp_path, DOCUMENT | {"posterior": {"stiffness_per_s2": QUANTITY}}, sentences=["well"])
    assert "<h3>Posterior</h3>" in path.read_text(encoding="utf-8")
