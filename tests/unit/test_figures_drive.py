"""What the figures of the drive show is what was recorded of it, and what it can do at most."""

import pytest
from tests.unit.figures_drawn import panel, recording
from tests.unit.figures_sample import SMALL, drive_share

from sinew.figures.motion import draw_lissajous
from sinew.figures.response import draw_drive_groups


def test_the_sweep_shows_each_group_settling_and_recorded() -> None:
    sweep = panel("figure05_drive_groups", "outline")
    assert len(sweep.collections) == 2 * len(SMALL[1])


def test_the_outline_of_a_group_is_the_amplitude_of_its_drive() -> None:
    sweep = panel("figure05_drive_groups", "outline")
    outlines = [c.get_paths()[0].vertices[:, 1] for c in sweep.collections]
    for f, outline in zip(SMALL[1], outlines[1::2], strict=True):
        assert outline.max() == pytest.approx(20.0 * float(drive_share(f)), rel=0.02)


def test_a_recording_without_drive_angle_has_no_driving_oscillation_to_show() -> None:
    assert draw_drive_groups(recording().drop_vars("drive_rad")) is None
    assert draw_lissajous(recording().drop_vars("drive_rad")) is None
