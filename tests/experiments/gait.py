"""Coverage of the intervals of a gait.

Made-up people walk with hidden numbers (`tests.experiments.walker`); counted is how often the 90 % intervals of stride
frequency and yaw amplitude hold them, over the number of strides and their likeness.
"""

from dataclasses import dataclass

import numpy as np
from tests.experiments.walker import Walker, walk

from sinew.measure.estimate import Estimate
from sinew.tune.gait import estimate_gait


@dataclass(frozen=True)
class Count:
    """Shares of runs, shape (2,), whose interval held frequency and yaw; and the relative errors' mean, (2,)."""

    strides: int
    likeness: float
    held: tuple[float, float]
    bias: tuple[float, float]


def count(strides: int, likeness: float, runs: int, seed: int) -> Count:
    """Return how often the intervals hold the truth in so many walks."""
    held, bias = np.zeros(2), np.zeros(2)
    for run in range(runs):
        generator = np.random.default_rng([seed, strides, run])
        walker = Walker(frequency_hz=generator.uniform(0.6, 1.15), likeness=likeness)
        bout = max(estimate_gait(walk(walker, strides, generator), "made up").bouts, key=lambda one: one.strides)
        told = (bout.stride_frequency_hz, walker.frequency_hz), (bout.yaw_amplitude_deg, walker.relative_deg)
        held += [_holds(e, truth) for e, truth in told]
        bias += [e.value / truth - 1 for e, truth in told]
    shares = held / runs
    return Count(
        strides,
        likeness,
        (float(shares[0]), float(shares[1])),
        (float(bias[0] / runs), float(bias[1] / runs)),
    )


def _holds(estimate: Estimate, truth: float) -> bool:
    return estimate.low <= truth <= estimate.high
