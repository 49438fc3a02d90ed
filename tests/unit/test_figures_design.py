"""Figures of designed joints: every computed joint is drawn, proposals are numbered, both ends have their curve."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from tests.unit.figures_panels import labelled

from sinew.figures.tuned import EndCurves, draw_design_curves, draw_design_front
from sinew.measure.estimate import Estimate
from sinew.solve.branch import Branch


def joint(shape: str, energy: float, *, front: bool, feasible: bool = True) -> Any:
    size = {"volume_cm3": 1e3 * energy, "tension_n": 100 - 200 * energy}
    return SimpleNamespace(name=shape, shape=shape, energy_j=energy, on_front=front, feasible=feasible, **size)


def curve(peak_hz: float) -> Branch:
    frequency = np.linspace(0.5, 1.3, 41)
    amplitude = np.radians(7 / (1 + (20 * (frequency / peak_hz - 1)) ** 2))
    one = np.ones_like(frequency)
    waves = amplitude[:, None].astype(complex)
    return Branch(
        frequency, amplitude, one, np.array([1]), waves, one + 0j, 0.5 * one, (), None, None, 0 * one, True, ""
    )


def test_every_joint_is_a_mark_in_both_panels_and_proposals_have_their_number() -> None:
    evaluated = [joint("circle", 0.2, front=True), joint("annulus", 0.3, front=False)]
    evaluated.append(joint("ellipse", 0.25, front=False, feasible=False))
    figure = draw_design_front(evaluated, evaluated[:1])
    for axes, at in zip(figure.axes, ([200.0, 300.0, 250.0], [60.0, 40.0, 50.0]), strict=True):
        marks = np.array([np.ravel(line.get_data()) for line in axes.lines], dtype=float)
        np.testing.assert_allclose(marks, np.column_stack([at, [200.0, 300.0, 250.0]]))  # mJ
        assert [text.get_text() for text in axes.texts] == ["1"]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["circle", "annulus", "ellipse", "dominated", "breaks a limit"]


def test_a_proposal_has_both_curves_and_what_the_twin_found() -> None:
    ends = [SimpleNamespace(wanted_hz=hertz, pretension_mm=mm) for hertz, mm in ((0.7, 2.0), (1.1, 8.0))]
    found = [(Estimate(0.7, 0.0, 0.7, 0.7), 7.0), (Estimate(*[np.nan] * 4), np.nan)]
    confirmed = [SimpleNamespace(measured_hz=one, yaw_deg=yaw) for one, yaw in found]
    proposal: Any = SimpleNamespace(name="annulus of 40 mm", ends=ends, confirmed=confirmed)
    figure = draw_design_curves([EndCurves(proposal, (curve(0.7), curve(1.1)))], 7.0)
    axes = figure.axes[0]
    for end, one in (("lower", curve(0.7)), ("upper", curve(1.1))):
        points = np.column_stack([one.frequency_hz, np.degrees(one.amplitude)])
        np.testing.assert_allclose(labelled(axes, f"{end} end, predicted"), points)
    (ring,) = [line for line in axes.lines if line.get_marker() == "o"]
    assert np.array(ring.get_data())[:, 0].tolist() == [0.7, 7.0]
    assert axes.get_ylabel() == "torsion in degrees"
