"""This is where late stamps are told from missing samples, by the regular clock behind them.

A logger that samples regularly can still stamp badly: samples wait in a serial buffer while the host is busy, and
then many of them get almost the same stamp. Such stamps are late but never early, so the earliest of them lie on a
straight line over the sample index. A burst leaves that line and comes back to it; where samples are missing the
line itself jumps. Stamps alone cannot tell a serial buffer from a recorder that by design takes a few quick samples
and then sleeps.

In all functions `stamps` are the time stamps [s], shape (n,), not decreasing; `steps` their differences; `step` the
sampling step [s].
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

__all__ = ["Gap", "afters", "follows_line", "gaps_of_clock", "gaps_of_irregular", "has_clock", "is_even", "off_line"]

Floats = NDArray[np.float64]

# A pause counts as a gap from this many missing samples on: one or two leave honest stamps and little else.
_FEWEST_MISSING = 3
# Below this many samples a regular clock behind ragged stamps cannot be recognised.
_FEWEST_FOR_CLOCK = 64


@dataclass(frozen=True)
class Gap:
    """A stretch without samples.

    after: index of the last sample before the gap; start_s, stop_s: stamps around it [s].
    missing: about how many samples it lacks.
    """

    after: int
    start_s: float
    stop_s: float
    missing: int


def is_even(stamps: Floats, steps: Floats) -> tuple[bool, float]:
    """Return whether nine steps in ten are within half a step of the usual one, and that step [s]."""
    lag = _lag(stamps.size)
    step = float(np.median(stamps[lag:] - stamps[:-lag])) / lag or float(steps.mean())
    low, high = np.quantile(steps, 0.05, method="higher"), np.quantile(steps, 0.95, method="lower")
    return bool(low > 0.5 * step and high < 1.5 * step), step


def has_clock(stamps: Floats, steps: Floats) -> bool:
    """Return whether ragged stamps come from samples that were taken regularly.

    Steps without a clock add up like a random walk: over k steps their sum spreads sqrt(k) times as much as one of
    them. Stamps that are only late spread over k steps no more than they are late.
    """
    if stamps.size < _FEWEST_FOR_CLOCK:
        return False
    lag = _lag(stamps.size)
    low, high = np.quantile(stamps[lag:] - stamps[:-lag], (0.16, 0.84))
    one = np.minimum(steps, 2 * np.quantile(steps, 0.99)).std()
    return bool((high - low) / 2 < 0.4 * np.sqrt(lag) * one)


def _lag(samples: int) -> int:
    return max(1, min(256, samples // 16))


def gaps_of_clock(stamps: Floats, steps: Floats, step: float, even: bool) -> tuple[list[Gap], bool, float]:
    """Return (gaps, whether there were pauses without missing samples, refined step [s]) of regular samples."""
    gaps: list[Gap] = []
    bursts = False
    for _ in range(4):
        before = afters(gaps)
        gaps, bursts = _scan_pauses(stamps, steps, step, even)
        step = _common_slope(stamps, gaps)
        if afters(gaps) == before:
            break
    return gaps, bursts, step


def _scan_pauses(stamps: Floats, steps: Floats, step: float, even: bool) -> tuple[list[Gap], bool]:
    late = stamps - step * np.arange(stamps.size)
    late -= late[0]
    gaps: list[Gap] = []
    start, longest_burst = 0, 0.0
    for i in np.flatnonzero(steps > (_FEWEST_MISSING + 0.5) * step):
        pause = float(steps[i])
        reach = int(4 * pause / step)
        behind = late[max(start, i + 1 - max(reach, 16 if even else 128)) : i + 1]
        ahead = late[i + 1 : i + 1 + max(reach, 16 if even else 256)]
        missing = round((float(ahead.min()) - float(behind.min())) / step)
        if missing < _FEWEST_MISSING or _is_cut_short(ahead, pause, step, longest_burst):
            longest_burst = max(longest_burst, pause)
        else:
            missing = min(missing, round(pause / step) - 1)
            gaps.append(Gap(int(i), float(stamps[i]), float(stamps[i + 1]), missing))
            start = int(i) + 1
    return gaps if even else _merged(gaps), longest_burst > 0


def _merged(gaps: list[Gap]) -> list[Gap]:
    """Return gaps of bursty stamps, those inside one burst joined at the longest pause.

    The stamps between two pauses of a burst are all late, so how much is missing at which of them is not known.
    """
    merged: list[Gap] = []
    for gap in gaps:
        if merged and gap.after - merged[-1].after < _FEWEST_FOR_CLOCK:
            before = merged.pop()
            longer = max(before, gap, key=lambda g: g.stop_s - g.start_s)
            gap = replace(longer, missing=before.missing + gap.missing)  # noqa: PLW2901
        merged.append(gap)
    return merged


def _is_cut_short(ahead: Floats, pause: float, step: float, longest_burst: float) -> bool:
    """Return whether the record ends while the stamps after a pause are still catching up."""
    if ahead.size >= pause / step:
        return False
    if ahead.size < 3:
        return longest_burst > pause / 2
    return float(ahead[-1] - ahead[0]) < -0.3 * step * (ahead.size - 1)


def gaps_of_irregular(stamps: Floats, steps: Floats) -> list[Gap]:
    """Return the pauses that stand out from uneven steps."""
    usual = float(np.median(steps))
    limit = max((_FEWEST_MISSING + 0.5) * usual, 4 * float(np.quantile(steps, 0.95, method="lower")))
    mean = float(steps[steps <= limit].mean())
    found = np.flatnonzero(steps > limit)
    return [Gap(int(i), float(stamps[i]), float(stamps[i + 1]), round(float(steps[i]) / mean) - 1) for i in found]


def afters(gaps: Sequence[Gap]) -> list[int]:
    """Return the index of the last sample before each gap."""
    return [gap.after for gap in gaps]


def _piece_index(samples: int, gaps: Sequence[Gap]) -> NDArray[np.int64]:
    return np.searchsorted(np.asarray(afters(gaps), dtype=np.int64), np.arange(samples)).astype(np.int64)


def _centred(values: Floats, piece: NDArray[np.int64]) -> Floats:
    means = np.bincount(piece, weights=values) / np.bincount(piece)
    return np.asarray(values - means[piece], dtype=float)


def _common_slope(stamps: Floats, gaps: Sequence[Gap]) -> float:
    """Return the least-squares slope of stamp over index, one for all pieces, each with its own offset [s]."""
    piece = _piece_index(stamps.size, gaps)
    index = _centred(np.arange(stamps.size, dtype=float), piece)
    return float(index @ _centred(stamps, piece) / (index @ index))


def off_line(stamps: Floats, gaps: Sequence[Gap], step: float) -> Floats:
    """Return how far each stamp is from the line of its piece [s]; the line has slope `step` and the piece's mean."""
    return _centred(stamps - step * np.arange(stamps.size), _piece_index(stamps.size, gaps))


def follows_line(stamps: Floats, gaps: Sequence[Gap], step: float) -> bool:
    """Return whether no stamp strays from its line further than pauses explain (a rate that changes would)."""
    if len(gaps) > stamps.size // 8:
        return False
    pause = float(np.delete(np.diff(stamps), afters(gaps)).max())
    return bool(np.ptp(off_line(stamps, gaps, step)) <= 2 * pause + 4 * step)
