"""Several segments of one joint: which model they support, together, and what pretensions share."""

from functools import cache

import numpy as np
import pytest
from tests.unit.identify_signals import OMEGA, motion, noisy, viscous

from sinew.identify.choice.comparison import Comparison, compare_segments, predict, varying_mechanics
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import Record, make_record
from sinew.measure.errors import SpecError

TIME = np.arange(0, 4, 0.01)
FREQUENCIES_HZ = (2.2, 2.8, 3.2, 3.9)
STIFFER = 1.3  # the second pretension's stiffness over the first's


def segment(frequency_hz: float, omega: float, group: str, seed: int) -> Record:
    """Return a segment in which a lever of 0.6 of the inertia swings by 0.1 rad."""
    w = 2 * np.pi * frequency_hz
    push = lambda t: 0.6 * 0.1 * w**2 * np.sin(w * t)  # noqa: E731
    r = motion(viscous(0.1, omega=omega), push, TIME)[0]
    return make_record(
        TIME,
        noisy(r, 0.002, seed),
        0.1 * np.sin(w * TIME),
        excitation="lever",
        output_unit="rad",
        input_unit="rad",
        group=group,
    )


@cache
def segments() -> tuple[Record, ...]:
    soft = [segment(f, OMEGA, "0 mm", i) for i, f in enumerate(FREQUENCIES_HZ)]
    stiff = [segment(f, OMEGA * STIFFER**0.5, "4 mm", 10 + i) for i, f in enumerate(FREQUENCIES_HZ)]
    return (*soft, *stiff)


@cache
def compared() -> Comparison:
    return compare_segments(segments()[:4], ("linear", "loss-factor", "coulomb"))


@pytest.mark.slow
def test_the_damping_law_of_the_segments_is_found_and_decided() -> None:
    assert (compared().best.model.name, compared().decided) == ("linear", True)


@pytest.mark.slow
def test_every_segment_is_held_out_once() -> None:
    assert compared().rows[0].held_out.residual.size == sum(record.size for record in segments()[:4])


@pytest.mark.slow
def test_the_held_out_error_of_the_right_model_is_the_noise() -> None:
    assert compared().rows[0].rmse_test == pytest.approx(0.002, rel=0.15)


@pytest.mark.slow
def test_the_verdict_tells_of_the_recording_and_of_the_residuals() -> None:
    assert "residuals are" in compared().verdict


def test_pretensions_have_their_own_stiffness_and_share_the_lever() -> None:
    found = compare_segments(segments(), ("linear",)).best.parameters
    stiffness = [found[f"stiffness_per_s2[{group}]"] for group in ("0 mm", "4 mm")]
    truth = [OMEGA**2, OMEGA**2 * STIFFER]
    assert all(abs(one.value - true) < 4 * one.std for one, true in zip(stiffness, truth, strict=True))
    assert found["lever_inertia_ratio"].value == pytest.approx(0.6, rel=0.01)


def test_a_segment_is_predicted_with_the_mechanics_of_its_own_pretension() -> None:
    taught = fit([*segments()[:3], *segments()[4:7]], "linear", varying=varying_mechanics(segments()))
    off = segments()[7].output - predict(taught, segments()[7])
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.002, rel=0.2)


def test_a_pretension_that_the_fit_does_not_know_is_not_predicted() -> None:
    taught = fit(segments()[:6], "linear", varying=("stiffness",))
    stranger = segment(3.0, OMEGA, "8 mm", 99)
    with pytest.raises(SpecError, match="8 mm"):
        predict(taught, stranger)


def test_two_segments_are_too_few() -> None:
    with pytest.raises(SpecError, match="found 2 segments"):
        compare_segments(segments()[:2])


def test_a_pretension_with_a_single_segment_is_refused_with_its_name() -> None:
    with pytest.raises(SpecError, match="4 mm"):
        compare_segments(segments()[:5])
