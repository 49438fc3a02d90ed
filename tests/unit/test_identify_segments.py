"""Several segments of one joint: which model they support, together."""

import numpy as np
import pytest
from tests.unit.identify_signals import motion, noisy, viscous

from sinew.identify.oscillator.comparison import compare_segments
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


@pytest.mark.slow
def test_the_damping_law_is_found_with_every_segment_held_out_once_and_told_with_its_residuals() -> None:
    segments = [segment(f, i) for i, f in enumerate(FREQUENCIES_HZ)]
    compared = compare_segments(segments, ("linear", "loss-factor", "coulomb"))
    assert (compared.best.model.name, compared.decided) == ("linear", True)
    assert compared.rows[0].held_out.residual.size == sum(record.size for record in segments)
    assert compared.rows[0].rmse_test == pytest.approx(0.002, rel=0.15)  # the noise
    assert "residuals are" in compared.verdict


def test_two_segments_are_too_few() -> None:
    with pytest.raises(SpecError, match="found 2 segments"):
        compare_segments([segment(f, 0) for f in FREQUENCIES_HZ[:2]], ("linear",))
