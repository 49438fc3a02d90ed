"""Several segments of one joint: which model they support, together."""

from functools import cache

import numpy as np
import pytest
from tests.unit.identify_signals import motion, noisy, viscous

from sinew.identify.oscillator.comparison import Comparison, compare_segments
from sinew.identify.oscillator.record import Record, make_record
from sinew.measure.errors import SpecError

TIME = np.arange(0, 4, 0.01)
FREQUENCIES_HZ = (2.2, 2.8, 3.2, 3.9)


def segment(frequency_hz: float, seed: int) -> Record:
    """Return a segment in which a lever of 0.6 of the inertia swings by 0.1 rad."""
    w = 2 * np.pi * frequency_hz
    push = lambda t: 0.6 * 0.1 * w**2 * np.sin(w * t)  # noqa: E731
    r = motion(viscous(0.1), push, TIME)[0]
    return make_record(
        TIME,
        noisy(r, 0.002, seed),
        0.1 * np.sin(w * TIME),
        excitation="lever",
        output_unit="rad",
        input_unit="rad",
    )


@cache
def segments() -> tuple[Record, ...]:
    return tuple(segment(f, i) for i, f in enumerate(FREQUENCIES_HZ))


@cache
def compared() -> Comparison:
    return compare_segments(segments(), ("linear", "loss-factor", "coulomb"))


@pytest.mark.slow
def test_the_damping_law_of_the_segments_is_found_and_decided() -> None:
    assert (compared().best.model.name, compared().decided) == ("linear", True)


@pytest.mark.slow
def test_every_segment_is_held_out_once() -> None:
    assert compared().rows[0].held_out.residual.size == sum(record.size for record in segments())


@pytest.mark.slow
def test_the_held_out_error_of_the_right_model_is_the_noise() -> None:
    assert compared().rows[0].rmse_test == pytest.approx(0.002, rel=0.15)


@pytest.mark.slow
def test_the_verdict_tells_of_the_recording_and_of_the_residuals() -> None:
    assert "residuals are" in compared().verdict


def test_two_segments_are_too_few() -> None:
    with pytest.raises(SpecError, match="found 2 segments"):
        compare_segments(segments()[:2], ("linear",))
