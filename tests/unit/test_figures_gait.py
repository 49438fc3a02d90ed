"""The figure of a gait shows each bout's mean cycle, its amplitude and the band."""

import numpy as np
import pytest
from campaigns.walker import Walker, walk
from tests.unit.figures_panels import drawn

from sinew.figures.tuned import draw_gait_yaw
from sinew.tune.gait import GaitTarget, estimate_gait, target_of_numbers, target_of_walks


@pytest.fixture(scope="module")
def target() -> GaitTarget:
    walks = [
        estimate_gait(walk(Walker(frequency_hz=f), 25, np.random.default_rng(i)), f"{f} Hz")
        for i, f in enumerate((0.8, 1.0))
    ]
    return target_of_walks(walks)


def test_each_bout_has_its_mean_cycle_over_the_whole_stride(target: GaitTarget) -> None:
    figure = drawn(draw_gait_yaw(target))
    lines = [line for line in figure.axes[0].lines if not str(line.get_label()).startswith("_")]
    means = [bout.cycles_deg.mean(axis=0) for one in target.walks for bout in one.bouts]
    assert [np.asarray(line.get_ydata())[:-1].tolist() for line in lines] == [mean.tolist() for mean in means]
    assert lines[0].get_xdata()[[0, -1]] == pytest.approx([0, 100])  # type: ignore[index, call-overload]


def test_a_cycle_begins_where_its_fundamental_is_greatest(target: GaitTarget) -> None:
    for bout in (bout for one in target.walks for bout in one.bouts):
        phase = 2 * np.pi * np.arange(64) / 64
        angle = np.angle(bout.cycles_deg.mean(axis=0) @ np.exp(-1j * phase))
        assert abs(angle) <= np.pi / 64 + 1e-9  # half a point of the cycle


def test_each_bout_is_a_mark_of_its_amplitude_over_its_frequency_beside_the_band(target: GaitTarget) -> None:
    cycle, over = drawn(draw_gait_yaw(target)).axes
    marks = [np.column_stack(line.get_data())[0].tolist() for line in over.lines if line.get_linestyle() == "None"]
    bouts = [bout for one in target.walks for bout in one.bouts]
    assert marks == [[bout.frequency_hz.value, bout.yaw_deg.value] for bout in bouts]
    (band,) = over.patches
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx(target.band_hz)  # type: ignore[attr-defined]
    assert (cycle.get_xlabel(), cycle.get_ylabel()) == ("share of the stride in %", "yaw in degrees")
    assert (over.get_xlabel(), over.get_ylabel()) == ("stride frequency in Hz", "yaw amplitude in degrees")


def test_a_target_of_numbers_has_no_figure() -> None:
    assert draw_gait_yaw(target_of_numbers((0.7, 1.1), 7)) is None
