"""Coverage of the intervals of a gait: `python -m campaigns.gait --runs 300`.

Made-up people walk with hidden numbers (`campaigns.walker`); counted is how often the 90 % intervals of stride
frequency, yaw amplitude and the trunk's lag hold them, over the number of strides and their likeness.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.walker import Walker, walk
from sinew.measure.estimate import Estimate
from sinew.tune.gait import estimate_gait

SETTINGS = ((14, 0.4), (24, 0.0), (24, 0.4), (24, 0.6), (45, 0.4), (100, 0.5))
"""Strides walked, and how alike neighbours are."""


@dataclass(frozen=True)
class Count:
    """Shares of runs, shape (3,), whose interval held frequency, yaw and lag; and the relative errors' mean, (2,)."""

    strides: int
    likeness: float
    held: tuple[float, float, float]
    bias: tuple[float, float]


def count(strides: int, likeness: float, runs: int, seed: int) -> Count:
    """Return how often the intervals hold the truth in so many walks."""
    held, bias = np.zeros(3), np.zeros(2)
    for run in range(runs):
        generator = np.random.default_rng([seed, strides, run])
        walker = Walker(frequency_hz=generator.uniform(0.6, 1.15), likeness=likeness)
        bout = max(estimate_gait(walk(walker, strides, generator), "made up").bouts, key=lambda one: one.strides)
        assert bout.trunk_lag_deg is not None
        told = (bout.frequency_hz, walker.frequency_hz), (bout.yaw_deg, walker.relative_deg)
        held += [_holds(e, truth) for e, truth in (*told, (bout.trunk_lag_deg, walker.trunk_lag_deg))]
        bias += [e.value / truth - 1 for e, truth in told]
    shares = held / runs
    return Count(
        strides,
        likeness,
        (float(shares[0]), float(shares[1]), float(shares[2])),
        (float(bias[0] / runs), float(bias[1] / runs)),
    )


def _holds(estimate: Estimate, truth: float) -> bool:
    return estimate.low <= truth <= estimate.high


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of a count."""
    parser = argparse.ArgumentParser(description="coverage of the 90 % intervals of a gait")
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    print("strides  likeness  frequency  yaw    lag    bias of frequency, yaw")
    for strides, likeness in SETTINGS:
        one = count(strides, likeness, asked.runs, asked.seed)
        shares = "  ".join(f"{100 * share:5.1f}" for share in one.held)
        print(f"{strides:7d}  {likeness:8.1f}  {shares}  {one.bias[0]:+.4f}, {one.bias[1]:+.4f}", flush=True)


if __name__ == "__main__":
    main()
