"""What the figures of decay and damping show is what the ring-downs hold."""

import numpy as np
import pytest
from tests.unit.figures_drawn import panel, recording, results
from tests.unit.figures_panels import labelled
from tests.unit.figures_sample import SMALL, Joint, drive_share

from sinew.figures.decay import draw_damping, linear_decay
from sinew.figures.motion import Motion


def test_the_envelope_falls_with_the_decay_rate_of_the_results_and_passes_through_the_peaks() -> None:
    right = panel("figure09_decay", "envelope")
    time, envelope = labelled(right, "±A exp(−λt)").T
    middle = np.asarray(right.lines[2].get_ydata())
    half = (envelope - middle) / 2
    rate = np.log(half[0] / half[-1]) / (time[-1] - time[0])
    assert rate == pytest.approx(float(results()["paper_decay_rate_per_s"].values[0, 0]), rel=1e-6)
    peaks = labelled(right, "peaks")
    assert len(peaks) > 8
    np.testing.assert_allclose(np.abs(peaks[:, 1]), np.interp(peaks[:, 0], time, envelope), atol=0.02 * envelope[0])


def test_the_torsion_before_and_after_the_stop_has_the_true_amplitude() -> None:
    left = panel("figure09_decay", "excitation")
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
    model = linear_decay(Motion(t, y, None, "degrees"), 1.3, 20.0, 0.0)
    found = (model.cosine, model.sine, model.rest, model.drift)
    np.testing.assert_allclose(found, (5.0, -2.0, 3.0, 0.2), rtol=1e-9)


def test_damping_panels_show_means_over_repeats_by_both_methods() -> None:
    containers = panel("figure10_damping", "Lehr").containers
    means = {container.get_label(): np.asarray(container.lines[0].get_ydata()) for container in containers}
    np.testing.assert_allclose(means["peaks (paper)"], results()["paper_lehr_damping"].values.mean(axis=1))
    np.testing.assert_allclose(means["direct fit"], results()["damping_ratio"].values.mean(axis=1))


@pytest.mark.parametrize("pretension", SMALL[0])
def test_each_decay_lies_under_its_linear_model(pretension: float) -> None:
    axes = panel("figure10_damping", f"{pretension:g} mm:")
    measured, model = labelled(axes, "measured"), labelled(axes, "linear model")
    off = model[:, 1] - np.interp(model[:, 0], *measured.T)
    assert np.sqrt(np.mean(off**2)) < 0.04 * np.abs(measured[:, 1]).max()


def test_ring_downs_at_one_pretension_give_no_damping_over_pretension() -> None:
    assert draw_damping(recording(), results().isel(pretension_mm=[0])) is None
