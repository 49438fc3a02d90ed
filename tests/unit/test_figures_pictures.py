"""What the figures show is what the recording and the results hold."""

import functools
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.text import Text
from tests.unit.figures_sample import SMALL, Joint, drive_share, foreign_ring_down, sample_recording, sample_results

from sinew.figures.captions import CAPTIONS
from sinew.figures.damping import draw_damping
from sinew.figures.decay import draw_decay, linear_decay
from sinew.figures.drive_amplitude import draw_drive_amplitude, triangle_ceiling
from sinew.figures.drive_groups import draw_drive_groups
from sinew.figures.figures import FIGURES, build_figures, draw_figures
from sinew.figures.lissajous import draw_lissajous
from sinew.figures.motion import Motion, groups_of, motion_of, nearest
from sinew.figures.phase_portraits import draw_phase_portraits
from sinew.figures.response import draw_response
from sinew.figures.response_map import along_ridge, draw_response_map
from sinew.figures.spread import mean_and_spread
from sinew.figures.style import few, frequency_colours, pretension_colours
from sinew.measure.errors import FileError
from sinew.plan.toml import dump_rig, load_rig


@functools.cache
def recording() -> xr.Dataset:
    return sample_recording(*SMALL)


@functools.cache
def results() -> xr.Dataset:
    return sample_results(*SMALL)


@functools.cache
def figures() -> dict[str, Figure]:
    return dict(build_figures(recording(), results()))


def titled(figure: Figure, text: str) -> Axes:
    return next(axes for axes in figure.axes if any(text in axes.get_title(loc=loc) for loc in ("left", "center")))


def labelled(axes: Axes, label: str) -> np.ndarray:
    line = next(line for line in axes.lines if line.get_label() == label)
    return np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float)


def test_a_campaign_gives_every_figure_in_the_order_of_the_paper() -> None:
    assert list(figures()) == list(FIGURES)


def test_every_figure_has_a_caption_and_no_caption_lacks_its_figure() -> None:
    assert list(CAPTIONS) == list(FIGURES)


def test_every_figure_is_written_in_every_format(tmp_path: Path) -> None:
    paths = draw_figures(recording(), results(), tmp_path / "new" / "figures")
    assert [p.name for p in paths] == [f"{name}.{ending}" for name in FIGURES for ending in ("png", "pdf")]
    assert all(p.read_bytes()[:4] in (b"\x89PNG", b"%PDF") and p.stat().st_size > 10_000 for p in paths)


def test_two_processes_write_the_same_pictures_as_one(tmp_path: Path) -> None:
    one = draw_figures(recording(), results(), tmp_path / "one", formats=("png",))
    two = draw_figures(recording(), results(), tmp_path / "two", formats=("png",), workers=2)
    assert [p.read_bytes() for p in one] == [p.read_bytes() for p in two]


def test_a_folder_that_is_a_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "figures").write_text("")
    with pytest.raises(FileError, match="figures"):
        draw_figures(recording(), results(), tmp_path / "figures")


def test_results_without_ring_downs_skip_the_figures_of_damping() -> None:
    swept = results().drop_vars(
        [name for name in results().data_vars if results()[name].dims == ("pretension", "repeat")]
    )
    left_out = set(FIGURES) - {name for name, _ in build_figures(recording(), swept)}
    assert left_out == {"figure09_decay", "figure10_damping"}


def test_a_foreign_ring_down_gives_its_decay_alone() -> None:
    assert [name for name, _ in build_figures(*foreign_ring_down())] == ["figure09_decay"]


def test_a_foreign_response_keeps_its_unit_on_the_axis() -> None:
    figure = draw_decay(*foreign_ring_down())
    assert figure is not None
    assert titled(figure, "envelope").get_ylabel() == "response in mm"


def test_no_type_is_smaller_than_eight_points() -> None:
    sizes = [
        (text.get_fontsize(), name, text.get_text())
        for name, figure in figures().items()
        for text in figure.findobj(Text)
        if text.get_text().strip()
    ]
    assert min(sizes)[0] >= 8.0


def test_no_flat_panel_has_a_frame_above_or_to_the_right() -> None:
    flat = [a for f in figures().values() for a in f.axes if a.name != "3d" and a.get_label() != "<colorbar>"]
    shown = [a.spines[side].get_visible() for a in flat for side in ("top", "right")]
    assert len(flat) > 25
    assert not any(shown)


@pytest.mark.parametrize("colours", [pretension_colours, frequency_colours])
def test_colours_become_lighter_evenly_and_stay_dark_enough_for_white_paper(colours: object) -> None:
    rgb = colours(np.arange(13.0))[:, :3]  # type: ignore[operator]
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    lightness = 116 * np.cbrt(luminance) - 16
    assert np.diff(lightness).min() > 2.0
    assert 1.05 / (luminance.max() + 0.05) > 1.75


@pytest.mark.parametrize("count", [1, 2, 3, 7, 13, 31, 32])
@pytest.mark.parametrize("at_most", [3, 4, 7, 9])
def test_a_choice_of_few_keeps_the_first_and_the_last(count: int, at_most: int) -> None:
    chosen = few(count, at_most)
    assert (chosen[0], chosen[-1]) == (0, count - 1)
    assert chosen.size == len(set(chosen.tolist())) <= at_most


def test_mean_and_spread_leave_out_what_was_not_measured() -> None:
    mean, spread = mean_and_spread([[1.0, 3.0, np.nan], [5.0, np.nan, np.nan], [np.nan] * 3])
    np.testing.assert_allclose(mean, [2.0, 5.0, np.nan])
    np.testing.assert_allclose(spread, [np.sqrt(2.0), np.nan, np.nan])


def test_the_response_lines_are_means_over_repeats() -> None:
    left = titled(figures()["figure06_response"], "amplitude response")
    for p, pretension in enumerate(SMALL[0]):
        expected = results()["gain"].values[p].mean(axis=1)
        np.testing.assert_allclose(labelled(left, f"{pretension:g} mm")[:, 1], expected)


def test_the_tubes_are_one_standard_deviation_to_both_sides() -> None:
    left = titled(figures()["figure06_response"], "amplitude response")
    tubes = [c for c in left.collections if isinstance(c, PolyCollection)]
    values = results()["gain"].values
    for p, tube in enumerate(tubes):
        corners = tube.get_paths()[0].vertices
        for f, frequency in enumerate(SMALL[1]):
            at = corners[np.isclose(corners[:, 0], frequency), 1]
            spread = values[p, f].std(ddof=1)
            assert np.ptp(at) == pytest.approx(2 * spread)
    assert len(tubes) == len(SMALL[0])


def test_one_repeat_gives_lines_without_tubes() -> None:
    figure = draw_response(results().isel(repeat=[0]))
    assert figure is not None
    left = titled(figure, "amplitude response")
    assert len(left.lines) > len(SMALL[0])
    assert not left.collections


def test_a_foreign_gain_keeps_its_units_and_is_not_held_against_one() -> None:
    figure = draw_response(results().assign_attrs(response_unit="m", drive_unit="V"))
    assert figure is not None
    left = titled(figure, "amplitude response")
    assert left.get_ylabel() == "gain in m per V"
    assert not [line for line in left.lines if list(line.get_ydata()) == [1.0, 1.0]]


def test_a_sweep_too_short_for_a_resonance_still_shows_its_response() -> None:
    plain = [
        name for name in results().data_vars if results()[name].dims in (("pretension",), ("pretension", "repeat"))
    ]
    swept = results().drop_vars([name for name in plain if name != "pretension_mm"])
    drawn = [name for name, _ in build_figures(recording(), swept)]
    assert drawn == ["figure05_drive_groups", "figure06_response", "figure07_lissajous", "drive_amplitude"]


def test_the_lag_is_drawn_in_degrees() -> None:
    right = titled(figures()["figure06_response"], "phase difference")
    expected = np.rad2deg(results()["phase_lag_rad"].values[2].mean(axis=1))
    np.testing.assert_allclose(labelled(right, "8 mm")[:, 1], expected)


def test_the_ridge_of_the_map_is_the_resonance_over_pretension() -> None:
    above = titled(figures()["figure08_map"], "from above")
    assert any(
        np.array_equal(line.get_xdata(), results()["resonance_hz"].values)
        and np.array_equal(line.get_ydata(), SMALL[0])
        for line in above.lines
    )


def test_the_numbers_on_the_map_keep_off_its_frame() -> None:
    above = titled(figures()["figure08_map"], "from above")
    (left, right), numbers = above.get_xlim(), [text for text in above.texts if text.get_text()]
    assert numbers
    assert all(left + 0.05 < text.get_position()[0] < right - 0.05 for text in numbers)


def test_the_mesh_of_the_map_reproduces_a_straight_response() -> None:
    f = np.array([1.5, 2.0, 3.0, 4.5, 6.0])
    gain = 0.3 * f + np.array([[0.0], [1.0], [2.0]])
    mesh, found = along_ridge(f, gain, np.array([3.0, np.nan, 4.0]))
    np.testing.assert_allclose(found, 0.3 * mesh + np.array([[0.0], [1.0], [2.0]]))


def test_the_mesh_of_the_map_never_overshoots_the_measured_gain() -> None:
    gain = results()["gain"].values.mean(axis=2)
    _, found = along_ridge(SMALL[1], gain, results()["resonance_hz"].values)
    assert (found.max(axis=1) <= gain.max(axis=1)).all()
    assert (found.min(axis=1) >= gain.min(axis=1)).all()


def test_the_map_is_drawn_where_one_resonance_is_unknown() -> None:
    unknown = results().copy(deep=True)
    unknown["resonance_hz"].values[1] = np.nan
    assert draw_response_map(unknown) is not None


def test_lissajous_curves_reach_the_true_amplitudes() -> None:
    middle = titled(figures()["figure07_lissajous"], "4 mm")
    joint = Joint.at(4.0)
    curves = [line for line in middle.lines if len(line.get_xdata()) > 100]
    chosen = SMALL[1][few(len(SMALL[1]), 9)]
    for line, f in zip(curves, chosen, strict=True):
        drive = 20.0 * float(drive_share(f))
        assert np.abs(line.get_xdata()).max() == pytest.approx(drive, rel=0.01)
        torsion = drive * abs(complex(joint.response(f)))
        assert np.abs(line.get_ydata()).max() == pytest.approx(torsion, rel=0.02, abs=0.2)


def test_the_fitted_ellipse_has_the_lag_of_the_joint() -> None:
    middle = titled(figures()["figure07_lissajous"], "4 mm")
    label = next(str(line.get_label()) for line in middle.lines if str(line.get_label()).startswith("ellipse"))
    found = re.fullmatch(r"ellipse at ([\d.]+) Hz: lag (\d+)°", label)
    assert found is not None
    expected = -np.angle(complex(Joint.at(4.0).response(np.asarray(float(found[1])))))
    assert float(found[2]) == pytest.approx(np.rad2deg(expected), abs=1.0)


def test_the_fitted_ellipse_lies_on_its_curve() -> None:
    middle = titled(figures()["figure07_lissajous"], "4 mm")
    ellipse = next(line for line in middle.lines if str(line.get_label()).startswith("ellipse"))
    size = [np.abs(np.asarray(values)).max() for values in ellipse.get_data()]
    curves = [[np.abs(np.asarray(v)).max() for v in line.get_data()] for line in middle.lines if line is not ellipse]
    assert min(np.abs(np.divide(size, curve) - 1).max() for curve in curves) < 0.02


def test_lissajous_curves_rise_below_resonance_and_fall_above_it() -> None:
    middle = titled(figures()["figure07_lissajous"], "4 mm")
    curves = [line for line in middle.lines if len(line.get_xdata()) > 100]
    slopes = [np.mean(np.asarray(line.get_xdata()) * np.asarray(line.get_ydata())) for line in (curves[0], curves[-1])]
    assert slopes[0] > 0 > slopes[1]


@pytest.mark.parametrize(("degrees", "product"), [(0, 0.5), (45, 0.5 * np.sqrt(0.5)), (90, 0.0), (180, -0.5)])
def test_ideal_shapes_have_the_lag_in_their_title(degrees: int, product: float) -> None:
    line = titled(figures()["figure07_lissajous"], f"{degrees}°").lines[0]
    x, y = np.asarray(line.get_xdata())[:-1], np.asarray(line.get_ydata())[:-1]
    assert np.mean(x * y) == pytest.approx(product, abs=1e-12)


def test_the_sweep_shows_each_group_settling_and_recorded() -> None:
    sweep = titled(figures()["figure05_drive_groups"], "outline")
    assert len(sweep.collections) == 2 * len(SMALL[1])


def test_the_sweep_names_its_pretension() -> None:
    assert "0 mm" in titled(figures()["figure05_drive_groups"], "outline").get_title(loc="left")


def test_the_outline_of_a_group_is_the_amplitude_of_its_drive() -> None:
    sweep = titled(figures()["figure05_drive_groups"], "outline")
    outlines = [c.get_paths()[0].vertices[:, 1] for c in sweep.collections]
    for f, outline in zip(SMALL[1], outlines[1::2], strict=True):
        assert outline.max() == pytest.approx(20.0 * float(drive_share(f)), rel=0.02)


def test_the_close_ups_are_of_the_lowest_a_middle_and_the_highest_frequency() -> None:
    titles = [axes.get_title(loc="left") for axes in figures()["figure05_drive_groups"].axes[1:]]
    assert titles[0] == "(b) 1.5 Hz"
    assert titles[-1] == "(d) 6 Hz"
    assert len(titles) == 3


def test_a_recording_without_drive_angle_has_no_driving_oscillation_to_show() -> None:
    assert draw_drive_groups(recording().drop_vars("drive_rad")) is None
    assert draw_lissajous(recording().drop_vars("drive_rad")) is None


def test_the_envelope_falls_with_the_decay_rate_of_the_results() -> None:
    right = titled(figures()["figure09_decay"], "envelope")
    time, envelope = labelled(right, "±A exp(−λt)").T
    middle = np.asarray(right.lines[2].get_ydata())
    half = (envelope - middle) / 2
    rate = np.log(half[0] / half[-1]) / (time[-1] - time[0])
    assert rate == pytest.approx(float(results()["paper_decay_rate_per_s"].values[0, 0]), rel=1e-6)


def test_the_envelope_passes_through_the_peaks() -> None:
    right = titled(figures()["figure09_decay"], "envelope")
    time, envelope = labelled(right, "±A exp(−λt)").T
    peaks = labelled(right, "peaks")
    assert len(peaks) > 8
    np.testing.assert_allclose(np.abs(peaks[:, 1]), np.interp(peaks[:, 0], time, envelope), atol=0.02 * envelope[0])


def test_the_torsion_before_and_after_the_stop_has_the_true_amplitude() -> None:
    left = titled(figures()["figure09_decay"], "excitation")
    time, torsion = labelled(left, "torsion φ").T
    joint = Joint.at(0.0)
    f = round(joint.natural_hz, 2)
    expected = 20.0 * float(drive_share(f)) * abs(complex(joint.response(f)))
    before = torsion[(time > -0.7) & (time < 0)]
    assert np.ptp(before) / 2 == pytest.approx(expected, rel=0.02)
    assert abs(torsion[time > 2.5].mean()) < 0.02 * expected


def test_the_linear_model_recovers_a_closed_form_decay() -> None:
    t = np.arange(0.0, 4.0, 0.005)
    y = 3.0 + 0.2 * t + np.exp(-1.3 * t) * (5.0 * np.cos(20.0 * t) - 2.0 * np.sin(20.0 * t))
    model = linear_decay(Motion(t, y, np.gradient(y, t), None, "degrees"), 1.3, 20.0, 0.0)
    found = (model.cosine, model.sine, model.rest, model.drift)
    np.testing.assert_allclose(found, (5.0, -2.0, 3.0, 0.2), rtol=1e-9)


def test_damping_panels_show_means_over_repeats_by_both_methods() -> None:
    panel = titled(figures()["figure10_damping"], "Lehr")
    drawn = {container.get_label(): np.asarray(container.lines[0].get_ydata()) for container in panel.containers}
    np.testing.assert_allclose(drawn["peaks (paper)"], results()["paper_lehr_damping"].values.mean(axis=1))
    np.testing.assert_allclose(drawn["direct fit"], results()["damping_ratio"].values.mean(axis=1))


@pytest.mark.parametrize("pretension", SMALL[0])
def test_each_decay_lies_under_its_linear_model(pretension: float) -> None:
    axes = titled(figures()["figure10_damping"], f"{pretension:g} mm:")
    measured, model = labelled(axes, "measured"), labelled(axes, "linear model")
    off = model[:, 1] - np.interp(model[:, 0], *measured.T)
    assert np.sqrt(np.mean(off**2)) < 0.04 * np.abs(measured[:, 1]).max()


def test_ring_downs_at_one_pretension_give_no_damping_over_pretension() -> None:
    assert draw_damping(recording(), results().isel(pretension=[0])) is None


def test_the_nominal_amplitude_is_a_line_over_the_measured_ones() -> None:
    axes = figures()["drive_amplitude"].axes[0]
    levels = [line.get_ydata()[0] for line in axes.lines if len(line.get_xdata()) == 2]
    assert levels == [20.0]
    np.testing.assert_allclose(labelled(axes, "0 mm")[:, 1], 20.0 * drive_share(SMALL[1]), rtol=0.01)


def test_at_twelve_volts_a_drive_of_twenty_degrees_meets_its_no_load_speed_at_2_2_hz() -> None:
    rig = load_rig("paper").with_values({"drive.supply_voltage": 12.0})
    figure = draw_drive_amplitude(recording(), results().assign_attrs(rig=dump_rig(rig)))
    assert figure is not None
    frequency, reach = next(line for line in figure.axes[0].lines if line.get_linestyle() == "--").get_data()
    assert np.interp(-20.0, -np.asarray(reach), np.asarray(frequency)) == pytest.approx(2.20, abs=0.01)


def test_the_ceiling_of_a_saturated_drive_is_the_fundamental_of_a_triangle_at_no_load_speed() -> None:
    speed, f = 4.8, 3.0
    t = np.arange(4096) / 4096 / f
    triangle = speed / (4 * f) * (1 - 4 * np.abs(f * t - 0.5))
    fundamental = 2 * abs(np.fft.rfft(triangle)[1]) / t.size
    assert float(triangle_ceiling(np.array([f]), speed)[0]) == pytest.approx(fundamental, rel=1e-5)


def test_the_ceiling_of_a_saturated_drive_lies_above_that_of_a_sine() -> None:
    figure = draw_drive_amplitude(recording(), results().assign_attrs(rig=dump_rig(load_rig("paper"))))
    assert figure is not None
    sine, triangle = (
        next(np.asarray(line.get_ydata()) for line in figure.axes[0].lines if line.get_linestyle() == style)
        for style in ("--", "-.")
    )
    np.testing.assert_allclose(triangle / sine, 4 / np.pi)


def test_the_portrait_of_a_linear_joint_is_an_ellipse_of_its_frequency() -> None:
    figure = figures()["phase_portraits"]
    for axes, p in zip(figure.axes, range(len(SMALL[0])), strict=True):
        f = SMALL[1][np.argmin(np.abs(SMALL[1] - results()["resonance_hz"].values[p]))]
        torsion, rate = (np.asarray(values) for values in axes.lines[0].get_data())
        size = 20.0 * float(drive_share(f)) * abs(complex(Joint.at(SMALL[0][p]).response(f)))
        np.testing.assert_allclose(np.hypot(torsion, rate / (2 * np.pi * f)), size, rtol=0.03)


def test_no_resonance_means_no_portraits() -> None:
    unknown = results().copy(deep=True)
    unknown["resonance_hz"].values[:] = np.nan
    assert draw_phase_portraits(recording(), unknown) is None


def test_the_sensor_delay_is_undone_in_the_motion() -> None:
    rig = load_rig("paper")
    group = nearest(groups_of(recording(), "steady"), 4.0, 3.3)
    assert group is not None
    plain = motion_of(recording(), group)
    corrected = motion_of(recording().assign_attrs(rig=dump_rig(rig)), group)

    def lag(motion: Motion) -> float:
        assert motion.drive is not None
        wave = np.exp(-2j * np.pi * 3.3 * motion.time_s)
        return float(np.angle((motion.drive @ wave) / (motion.torsion @ wave)))

    assert 0.007 < (lag(plain) - lag(corrected)) / (2 * np.pi * 3.3) < 0.013
