"""The Lissajous curves show the closed motion of a linear joint, with its lag and size."""

import re

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from tests.unit.figures_drawn import panel, recording
from tests.unit.figures_sample import SMALL, Joint, drive_share

from sinew.figures.motion import Motion, groups_of, motion_of, nearest
from sinew.figures.style import few
from sinew.plan.toml import dump_rig, load_rig


def measured(axes: Axes) -> list[Line2D]:
    """Return the curves of whole periods, lowest frequency first."""
    return [line for line in axes.lines if len(line.get_xdata()) > 100]


def fitted(axes: Axes) -> Line2D:
    """Return the ellipse that was fitted to one of the curves."""
    return next(line for line in axes.lines if str(line.get_label()).startswith("ellipse"))


def test_lissajous_curves_reach_the_true_amplitudes() -> None:
    joint = Joint.at(4.0)
    chosen = SMALL[1][few(len(SMALL[1]), 9)]
    for line, f in zip(measured(panel("figure07_lissajous", "4 mm")), chosen, strict=True):
        drive = 20.0 * float(drive_share(f))
        assert np.abs(line.get_xdata()).max() == pytest.approx(drive, rel=0.01)
        torsion = drive * abs(complex(joint.response(f)))
        assert np.abs(line.get_ydata()).max() == pytest.approx(torsion, rel=0.02, abs=0.2)


def test_the_fitted_ellipse_has_the_lag_of_the_joint() -> None:
    label = str(fitted(panel("figure07_lissajous", "4 mm")).get_label())
    found = re.fullmatch(r"ellipse at ([\d.]+) Hz: lag (\d+)°", label)
    assert found is not None
    expected = -np.angle(complex(Joint.at(4.0).response(np.asarray(float(found[1])))))
    assert float(found[2]) == pytest.approx(np.rad2deg(expected), abs=1.0)


def test_the_fitted_ellipse_lies_on_its_curve() -> None:
    middle = panel("figure07_lissajous", "4 mm")
    ellipse = fitted(middle)
    size = [np.abs(np.asarray(values)).max() for values in ellipse.get_data()]
    curves = [[np.abs(np.asarray(v)).max() for v in line.get_data()] for line in middle.lines if line is not ellipse]
    assert min(np.abs(np.divide(size, curve) - 1).max() for curve in curves) < 0.02


@pytest.mark.parametrize(("degrees", "product"), [(0, 0.5), (45, 0.5 * np.sqrt(0.5)), (90, 0.0), (180, -0.5)])
def test_ideal_shapes_have_the_lag_in_their_title(degrees: int, product: float) -> None:
    line = panel("figure07_lissajous", f"{degrees}°").lines[0]
    x, y = np.asarray(line.get_xdata())[:-1], np.asarray(line.get_ydata())[:-1]
    assert np.mean(x * y) == pytest.approx(product, abs=1e-12)


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
