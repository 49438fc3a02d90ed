"""Change over months, and difference of two runs: lines over dates, and what stands out of the uncertainty.

A line over dates by weighted least squares. Runs scatter more than each knows of itself (a joint mounted anew, another
day's temperature), so each weighs by 1 / (own variance + variance between runs); the second is the one under which the
weighted squares of the residuals are as large as their degrees of freedom (Paule and Mandel 1982). The slope's interval
is Student's with n - 2 degrees of freedom, its variance times those squares over n - 2 where they are more than that
(Knapp and Hartung 2003). The mean of three repeats knows its own standard deviation badly: no run counts as surer than
the median of them, or one whose repeats agree by chance would draw the line. (Without that, 90 % intervals over twelve
runs of three repeats held the true slope 85 times in a hundred.)
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import scipy
from scipy import special

from sinew.analysis.run_index import COMMON, QUANTITIES
from sinew.measure.arrays import Array
from sinew.measure.estimate import NORMAL_90, Estimate, number, span

DAYS_OF_A_MONTH = 365.2425 / 12
"""Days in the month of a slope."""

FEWEST_RUNS = 3
"""So many runs a line with an interval needs at least."""

_SECONDS_OF_A_DAY = 86_400.0

_APART_DAYS = 0.5
"""How far first and last run are apart at least: as from an evening to the next morning. An afternoon is shorter, also
where it has midnight in it by UTC."""


@dataclass(frozen=True)
class Line:
    """A line over days. slope: per day. middle: its value at `centre` [day]; both independent of each other.

    between: standard deviation between runs beyond what each knows of itself. degrees_of_freedom: of both intervals.
    """

    slope: Estimate
    middle: Estimate
    centre: float
    between: float
    degrees_of_freedom: int

    def at(self, days: Array) -> Array:
        """Return the line, shape of days."""
        return np.asarray(self.middle.value + self.slope.value * (days - self.centre))

    def half(self, days: Array) -> Array:
        """Return half of the width of its 90 % interval, shape of days."""
        std = np.hypot(self.middle.std, self.slope.std * (days - self.centre))
        return np.asarray(float(special.stdtrit(self.degrees_of_freedom, 0.95)) * std)


def fit_line(days: Array, values: Array, stds: Array) -> Line:
    """Return the line through three or more points.

    days, values, stds: shape (n,), finite; stds: standard deviations that the runs know of themselves, zero allowed.
    Raises ValueError below three points, or where all are of one day.
    """
    if not _are_enough(days):
        raise ValueError(f"a line needs {FEWEST_RUNS} runs on 2 days, found {days.size} in {np.ptp(days):.2g} days")
    tiny = 1e-9 * max(float(np.abs(values).max()), 1e-140)  # whose square is still a number
    known = stds[stds > 0]
    own = np.maximum(stds, max(float(np.median(known)) if known.size else 0.0, tiny)) ** 2
    freedom = days.size - 2

    def fitted(between: float) -> tuple[float, float, float, Array, float]:
        weight = 1.0 / (own + between)
        centre = float(weight @ days / weight.sum())
        away = days - centre
        slope = float(weight @ (away * values) / (weight @ away**2))
        middle = float(weight @ values / weight.sum())
        squares = float(weight @ (values - middle - slope * away) ** 2)
        return slope, middle, centre, weight, squares

    between = 0.0
    if fitted(0.0)[-1] > freedom:
        most = float(np.ptp(values)) ** 2 * days.size + float(own.max())
        between = float(scipy.optimize.brentq(lambda one: fitted(one)[-1] - freedom, 0.0, most, rtol=1e-6))
    slope, middle, centre, weight, squares = fitted(between)
    scale = math.sqrt(max(1.0, squares / freedom))
    of_slope = scale / math.sqrt(float(weight @ (days - centre) ** 2))
    of_middle = scale / math.sqrt(float(weight.sum()))
    return Line(
        Estimate.student(slope, of_slope, freedom),
        Estimate.student(middle, of_middle, freedom),
        centre,
        math.sqrt(between),
        freedom,
    )


def _are_enough(days: Array) -> bool:
    return bool(days.size >= FEWEST_RUNS and np.ptp(days) >= _APART_DAYS)


@dataclass(frozen=True)
class Trend:
    """A quantity over months, at one pretension, of the runs of one rig and source.

    runs, started: name and begin (ISO 8601) of each run, oldest first. values: of each. line: None where there are too
    few. sentence: whether it changes.
    """

    quantity: str
    rig: str
    source: str
    pretension_mm: float
    runs: tuple[str, ...]
    started: tuple[str, ...]
    values: tuple[Estimate, ...]
    line: Line | None
    sentence: str

    @property
    def days(self) -> Array:
        """Days of the begins since 1970, shape (n,)."""
        return np.array([_days(one) for one in self.started])

    @property
    def title(self) -> str:
        """Name of the rig, where the runs come from if not from a bench, and the pretension."""
        of = "" if self.source in ("bench", "") else f" ({self.source})"
        return f"{self.rig or 'no rig'}{of}, {self.pretension_mm:g} mm"

    def to_json(self) -> dict[str, Any]:
        """Return it as `sinew runs --trend --json` prints it."""
        points = zip(self.runs, self.started, self.values, strict=True)
        line = self.line
        return {
            "quantity": self.quantity,
            "rig": self.rig,
            "source": self.source,
            "pretension_mm": self.pretension_mm,
            "points": [{"run": name, "started": at, self.quantity: value.to_json()} for name, at, value in points],
            "slope_per_month": None if line is None else line.slope.times(DAYS_OF_A_MONTH).to_json(),
            "between_runs_std": None if line is None else line.between,
            "differs_from_zero": None if line is None else _is_off_zero(line.slope),
            "sentence": self.sentence,
        }


def trends(runs: Iterable[Mapping[str, Any]], quantity: str) -> list[Trend]:
    """Return how a quantity changed, for each rig, source and pretension of some runs.

    runs: as `RunIndex.search` gives them. quantity: its name in results. Runs without a date, or without the quantity,
    are left out; those whose uncertainty is not known weigh by the scatter between runs alone.
    """
    groups: dict[tuple[str, str, float], list[tuple[str, str, Estimate]]] = {}
    for run in runs:
        if _days(run.get("started") or "") is None:
            continue
        for row in run["found"]:
            if quantity in row and row[quantity]["value"] is not None:
                key = run.get("rig") or "", run.get("source") or "", round(row["pretension_mm"], 6)
                groups.setdefault(key, []).append((run["started"], run["name"], _estimate(row[quantity])))
    return [_trend(quantity, *key, sorted(points, key=lambda one: one[:2])) for key, points in sorted(groups.items())]


def _trend(
    quantity: str, rig: str, source: str, pretension_mm: float, points: Sequence[tuple[str, str, Estimate]]
) -> Trend:
    started, runs, values = zip(*points, strict=True)
    days = np.array([_days(one) for one in started], dtype=float)
    line = None
    if _are_enough(days):
        stds = np.array([_std(one) for one in values])
        line = fit_line(days, np.array([one.value for one in values]), np.nan_to_num(stds))
    about = QUANTITIES[quantity]
    name = f"{about.called[0]} at {number(pretension_mm)} mm"
    if line is None:
        count = f"{days.size} run{'s' if days.size != 1 else ''}"
        short = " of one day" if days.size >= FEWEST_RUNS else ""
        sentence = f"{name}: {count}{short}, too few for a line; at least {FEWEST_RUNS} runs on 2 days are needed."
    else:
        slope = line.slope.times(DAYS_OF_A_MONTH)
        changes = "rises" if slope.value > 0 else "falls"
        unit = f"{about.unit} a month".strip()
        over = f"over {days.size} runs in {number(np.ptp(days) / DAYS_OF_A_MONTH, 2)} months"
        if _is_off_zero(slope):
            near, far = sorted((abs(slope.low), abs(slope.high)))
            ends = span(near, far)
            sentence = f"{name} {changes} by {number(abs(slope.value), 2)} {unit} (90 %: {ends}), {over}: not zero."
        else:
            ends = span(slope.low, slope.high, unit)
            sentence = f"{name} does not change beyond its uncertainty: {ends} (90 %), {over}; zero is among it."
    return Trend(quantity, rig, source, pretension_mm, runs, started, values, line, sentence)


def _is_off_zero(slope: Estimate) -> bool:
    return bool(slope.low > 0 or slope.high < 0)


def _days(moment: str) -> float | None:
    """Return a time (ISO 8601; UTC where no zone is named) as days since 1970; None where it is none."""
    try:
        at = datetime.fromisoformat(moment)
    except ValueError:
        return None
    at = at if at.tzinfo is not None else at.replace(tzinfo=UTC)
    return at.timestamp() / _SECONDS_OF_A_DAY


def _estimate(found: Mapping[str, Any]) -> Estimate:
    low, high = found["interval90"]
    return Estimate(*(math.nan if one is None else float(one) for one in (found["value"], found["std"], low, high)))


def _std(one: Estimate) -> float:
    """Return the standard deviation of which the 90 % interval is the normal one: what few repeats do not know counts.

    NaN where neither interval nor standard deviation is known.
    """
    half = 0.5 * (one.high - one.low)
    return half / NORMAL_90 if math.isfinite(half) else one.std


# Two runs differ in what they found at the pretensions that both have.


@dataclass(frozen=True)
class Difference:
    """What another run found, less what a first one did. quantity: its name in results. first, other: what they found.

    difference: normal, with the combined standard deviation of both, each the one of which its 90 % interval is the
    normal one. ratio: difference over that standard deviation; NaN where one is not known. is_significant: whether the
    90 % interval of the difference leaves zero out; None where that cannot be said.
    """

    quantity: str
    pretension_mm: float
    first: Estimate
    other: Estimate
    difference: Estimate
    ratio: float
    is_significant: bool | None

    @property
    def sentence(self) -> str:
        """Return how sure it is."""
        if self.is_significant is None:
            return "not known"
        return f"{'yes' if self.is_significant else 'no'}, {number(abs(self.ratio), 2)} σ"


def differences(
    first: Mapping[str, Any], other: Mapping[str, Any], quantities: Sequence[str] = COMMON
) -> list[Difference]:
    """Return in what two runs differ, at each pretension that both have. first, other: as `RunIndex.search` gives them.

    What both share, as the delay of one sensor, is counted in both: such differences are surer than is said.
    """
    rows = {round(row["pretension_mm"], 6): row for row in first["found"]}
    found = []
    for row in other["found"]:
        before = rows.get(round(row["pretension_mm"], 6), {})
        for quantity in quantities:
            if quantity in row and quantity in before:
                found.append(
                    _difference(quantity, row["pretension_mm"], _estimate(before[quantity]), _estimate(row[quantity]))
                )
    return found


def _difference(quantity: str, pretension_mm: float, first: Estimate, other: Estimate) -> Difference:
    by = other.value - first.value
    std = math.hypot(_std(first), _std(other))
    is_known = math.isfinite(std) and std > 0
    ratio = by / std if is_known else math.nan
    return Difference(
        quantity,
        pretension_mm,
        first,
        other,
        Estimate.normal(by, std if is_known else math.nan),
        ratio,
        abs(ratio) > NORMAL_90 if is_known else None,
    )


def by_chance(found: Sequence[Difference]) -> str:
    """Return how many of some differences are significant, and how many would be by chance if nothing had changed."""
    known = [one for one in found if one.is_significant is not None]
    significant = sum(bool(one.is_significant) for one in known)
    return (
        f"{significant} of {len(known)} differences are significant at 90 %; were nothing different, "
        f"{number(0.1 * len(known), 2)} at most would be so by chance."
    )
