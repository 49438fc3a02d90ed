"""Lehr's damping by where its window begins: the table, and what holds for every window.

The paper stops the drive, lets the lever recoil ("parasitic") and fits an exponential through the peaks that follow;
from which peak on it does not say. A decay that is not exponential has another D in every window, and the window in
which D is constant over pretension is not the same for every rig. So D over pretension is told for several windows, and
a statement about it is one that all of them make.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sinew.analysis.signal.repeats import fit_trend, pool_repeats
from sinew.measure.arrays import Array, mean_of_known
from sinew.measure.estimate import Estimate, finite

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class DecayWindow:
    """D over pretension from one start of the decay on, by the paper's method.

    start_periods: after the stop of the drive, in its periods. pretension_mm: shape (p,). damping: D at each, with the
    interval of all repeats together. spread: (max - min)/mean of these. change: of the line through them over the whole
    range of pretension, relative to the mean. falling_rates: steps of pretension at which λ does not rise.
    """

    start_periods: float
    pretension_mm: Array
    damping: tuple[Estimate, ...]
    spread: float
    change: Estimate
    falling_rates: int

    @property
    def trend(self) -> str:
        """Return "rises", "falls", or "no trend" where the interval of the change holds zero or is not known."""
        if self.change.low > 0:
            return "rises"
        return "falls" if self.change.high < 0 else "no trend"

    def to_json(self) -> dict[str, Any]:
        """Return the window as plain numbers, lists and texts; what is not finite becomes null."""
        return {
            "start_periods": self.start_periods,
            "pretension_mm": [float(p) for p in self.pretension_mm],
            "lehr_damping": [one.to_json() for one in self.damping],
            "spread": finite(self.spread),
            "relative_change": self.change.to_json(),
            "trend": self.trend,
            "steps_at_which_the_decay_rate_does_not_rise": self.falling_rates,
        }


def decay_windows(results: "xr.Dataset") -> list[DecayWindow]:
    """Return D over pretension for every window of the results, the earliest first.

    results: of `sinew.analysis.analysed.analyse_recording`. Empty where they hold no planned ring-downs at two
    pretensions or more: only of those it is known when the drive was told to stop.
    """
    if "window_lehr_damping" not in results:
        return []
    table = []
    for k, start in enumerate(results["window_start_periods"].values):
        damping = np.asarray(results["window_lehr_damping"].values[:, :, k], dtype=float)
        known = np.isfinite(damping).any(axis=1)
        if np.count_nonzero(known) < 2:
            continue
        rates = np.asarray(results["window_decay_rate_per_s"].values[:, :, k], dtype=float)
        pretension = np.asarray(results["pretension_mm"].values, dtype=float)
        order = np.flatnonzero(known)[np.argsort(pretension[known])]
        table.append(_window(float(start), pretension[order], damping[order], rates[order]))
    return table


def _window(start: float, pretension: Array, damping: Array, rates: Array) -> DecayWindow:
    pooled = pool_repeats(damping.tolist(), [])
    mean = np.array([one.value for one in pooled.estimates])
    stds = np.array([one.std for one in pooled.estimates])
    stds = stds[np.isfinite(stds)]
    noise = float(np.sqrt(np.mean(stds**2))) if stds.size else math.nan
    line = fit_trend(pretension, mean, noise, pooled.degrees_of_freedom)
    change = line.slope.times(float(np.ptp(pretension)) / line.middle.value)
    spread = float(np.ptp(mean) / mean.mean())
    falling = int((np.diff(mean_of_known(rates)) <= 0).sum())
    return DecayWindow(start, pretension, pooled.estimates, spread, change, falling)


def windows_agree(table: list[DecayWindow]) -> bool:
    """Return whether one statement about D over pretension holds in all windows.

    They all rise, all fall or all show no trend, or at least one change lies inside all of their intervals: an
    exponential decay has one D, and its windows differ by chance alone.
    """
    if len({window.trend for window in table}) <= 1:
        return True
    known = [window.change for window in table if math.isfinite(window.change.low)]
    return max(one.low for one in known) <= min(one.high for one in known)


def describe_windows(table: list[DecayWindow]) -> str:
    """Return the sentence about D over pretension that holds for every window; empty without a table."""
    if not table:
        return ""
    changes = sorted(window.change.value for window in table)
    ends = f"{_change(changes[0])} and {_change(changes[-1])}"
    starts = f"from {table[0].start_periods:g} to {table[-1].start_periods:g} drive periods after its stop"
    spreads = sorted(window.spread for window in table)
    spread = f"its spread is {_percent(spreads[0])} to {_percent(spreads[-1])} of its mean"
    if windows_agree(table):
        return f"Wherever the decay is taken to begin, {starts}, D says the same: a change between {ends}; {spread}."
    return (
        "Whether D is constant over pretension is not determined: it depends on where the decay is taken to begin. "
        f"With starts {starts} D changes over the range by anything between {ends}; {spread}."
    )


def _change(share: float) -> str:
    return f"a {'rise' if share > 0 else 'fall'} of {_percent(abs(share))}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
