"""Figures of the bent joint's response: the waterfall over pretensions."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinew.figures.space import draw_waterfall, write_bent
from sinew.plan.pose import Pose
from sinew.plan.toml import load_rig
from sinew.predict.coupled import Coupled, Motions, PredictedBent
from sinew.solve.branch import Branch

BAND_HZ = (2.0, 6.0)
HZ = np.linspace(*BAND_HZ, 81)


def curve(pretension_mm: float, torsion_deg: float, twice_deg: float) -> Coupled:
    """Return a response with a crest of the torsion at 3 Hz and more, and of the tilt in the plane above it."""

    def waves(order: int, crest_deg: float, at_hz: float) -> Any:
        harmonics = np.zeros((HZ.size, 4), dtype=complex)
        harmonics[:, order] = np.radians(crest_deg) / (1 + ((HZ - at_hz) / 0.3) ** 2)
        return harmonics

    at_hz = 3.0 + 0.1 * pretension_mm
    none: Any = np.zeros((HZ.size, 0))
    row: Any = np.zeros(HZ.size)
    tension = np.tile([[20.0, 60.0]], (HZ.size, 4, 1))
    torsion, twice, across = waves(1, torsion_deg, at_hz), waves(2, twice_deg, at_hz + 0.4), waves(1, 5.0, at_hz)
    branch = Branch(HZ, row, row, np.arange(0), none, row + 1, row, (), None, None, row, True, "")
    return Coupled(pretension_mm, np.full(4, 40.0), branch, Motions(torsion, twice, across, tension), None, None)


def found(*pretensions_mm: float) -> PredictedBent:
    curves = tuple(curve(mm, 30.0 + mm, 1.0 + 0.1 * mm) for mm in pretensions_mm)
    return PredictedBent(
        load_rig("paper"), Pose(bend_deg=30.0, azimuth_deg=90.0), 20.0, "position", (), BAND_HZ, curves
    )


def test_each_line_of_the_waterfall_rises_from_its_pretension_by_its_own_share_of_the_highest() -> None:
    torsion = draw_waterfall(found(0.0, 12.0)).axes[0]
    upper, lower = (
        np.asarray(line.get_ydata(), dtype=float) for line in torsion.lines if np.size(line.get_xdata()) > 2
    )
    assert np.nanmax(lower) / (np.nanmax(upper) - 12.0) == pytest.approx(30.0 / 42.0, rel=1e-3)


def test_a_curve_is_parted_where_points_were_left_out() -> None:
    whole = found(0.0, 12.0)
    parted = [replace(one, branch=replace(one.branch, holes=np.array([40]))) for one in whole.curves]
    for axes in draw_waterfall(replace(whole, curves=tuple(parted))).axes:
        drawn = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines if np.size(line.get_xdata()) > 2]
        assert [np.flatnonzero(np.isnan(row)).tolist() for row in drawn] == [[40], [40]]
        assert all(len(band.get_paths()) == 2 for band in axes.collections)


def test_a_waterfall_is_written_beside_the_curves_of_three_pretensions_and_not_of_one(tmp_path: Path) -> None:
    three = write_bent(found(0.0, 6.0, 12.0), tmp_path / "bent.png")
    one = write_bent(found(6.0), tmp_path / "alone.png")
    assert [path.name for path in three + one] == ["bent.png", "bent-waterfall.png", "alone.png"]
