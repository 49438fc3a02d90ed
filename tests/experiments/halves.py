"""Halves of real decays.

Each record of the folder is analysed whole, then cut in the middle between the first and the last of its peaks that
stand out of the noise: the early part has the large swings, the late one the small. Both are analysed as if they were
records of their own. An interval that knows of its model's misfit meets that of the other half though the oscillation
is not linear.

A record is a table of numbers, of any separator, with or without a decimal comma and a header. Its first column is
the time, in seconds (microseconds where the steps exceed a thousand; a single column is sampled at 1 kHz), its stamps
straightened as those of an import; the response is the column that swings most. Rows with an empty field are left
out, of equal times the first is kept.
"""

from dataclasses import dataclass

from sinew.analysis.decay.ring_down import RingDown, analyse_ring_down
from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate

QUANTITIES = ("frequency_hz", "damping_ratio")


@dataclass(frozen=True)
class Halves:
    """What the two halves of a decay say of one quantity."""

    quantity: str
    early: Estimate
    late: Estimate

    @property
    def meet(self) -> bool:
        """Return whether the two 90 % intervals overlap."""
        return self.early.low <= self.late.high and self.late.low <= self.early.high


def halves_of(time_s: Array, values: Array, whole: RingDown, **of_response: object) -> list[Halves]:
    """Return frequency and damping ratio of both halves of a decay, both of shape (n,) as they were analysed whole.

    of_response: unit and is_rate, as for `analyse_ring_down`. Raises SinewError where a half cannot be analysed.
    """
    middle = 0.5 * (whole.peak_time_s[0] + whole.peak_time_s[-1])
    early = (time_s >= whole.start_s) & (time_s <= middle)
    late = (time_s >= middle) & (time_s <= whole.stop_s)
    first, second = (
        analyse_ring_down(time_s[part], values[part], **of_response)  # type: ignore[arg-type]
        for part in (early, late)
    )
    return [Halves(name, getattr(first, name), getattr(second, name)) for name in QUANTITIES]
