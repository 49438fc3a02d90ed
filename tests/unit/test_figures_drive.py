"""What the figures of the drive show is what was recorded of it, and what it can do at most."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from tests.unit.figures_drawn import figures, panel, recording, results
from tests.unit.figures_panels import drawn, labelled
from tests.unit.figures_sample import SMALL, drive_share

from sinew.figures.motion import draw_lissajous
from sinew.figures.response import draw_drive_amplitude, draw_drive_groups, triangle_ceiling
from sinew.plan.toml import dump_rig, load_rig


def styled(axes: Axes, style: str) -> np.ndarray:
    """Return the points of the line with a style, shape (n, 2)."""
    line = next(line for line in axes.lines if line.get_linestyle() == style)
    return np.column_stack(line.get_data()).astype(float)


def test_the_sweep_shows_each_group_settling_and_recorded() -> None:
    sweep = panel("figure05_drive_groups", "outline")
    assert len(sweep.collections) == 2 * len(SMALL[1])


def test_the_sweep_names_its_pretension() -> None:
    assert "0 mm" in panel("figure05_drive_groups", "outline").get_title(loc="left")


def test_the_outline_of_a_group_is_the_amplitude_of_its_drive() -> None:
    sweep = panel("figure05_drive_groups", "outline")
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


def test_the_nominal_amplitude_is_a_line_over_the_measured_ones() -> None:
    axes = figures()["drive_amplitude"].axes[0]
    levels = [line.get_ydata()[0] for line in axes.lines if len(line.get_xdata()) == 2]
    assert levels == [20.0]
    np.testing.assert_allclose(labelled(axes, "0 mm")[:, 1], 20.0 * drive_share(SMALL[1]), rtol=0.01)


def test_at_twelve_volts_a_drive_of_twenty_degrees_meets_its_no_load_speed_at_2_2_hz() -> None:
    rig = load_rig("paper").with_values({"drive.supply_voltage": 12.0})
    figure = drawn(draw_drive_amplitude(recording(), results().assign_attrs(rig=dump_rig(rig))))
    frequency, reach = styled(figure.axes[0], "--").T
    assert np.interp(-20.0, -reach, frequency) == pytest.approx(2.20, abs=0.01)


def test_the_ceiling_of_a_saturated_drive_is_the_fundamental_of_a_triangle_at_no_load_speed() -> None:
    speed, f = 4.8, 3.0
    t = np.arange(4096) / 4096 / f
    triangle = speed / (4 * f) * (1 - 4 * np.abs(f * t - 0.5))
    fundamental = 2 * abs(np.fft.rfft(triangle)[1]) / t.size
    assert float(triangle_ceiling(np.array([f]), speed)[0]) == pytest.approx(fundamental, rel=1e-5)


def test_the_ceiling_of_a_saturated_drive_lies_above_that_of_a_sine() -> None:
    figure = drawn(draw_drive_amplitude(recording(), results().assign_attrs(rig=dump_rig(load_rig("paper")))))
    sine, triangle = (styled(figure.axes[0], style)[:, 1] for style in ("--", "-."))
    np.testing.assert_allclose(triangle / sine, 4 / np.pi)
