"""The runs in a folder: a table with a row for each run and pretension, the search in it, and what changed over months.

A search is words and ranges with spaces between, all of which must hold: `aged f_r=3.2..3.4 pretension=6`. Ranges hold
at one and the same pretension.

A line over dates is one of weighted least squares. Runs scatter more than each knows of itself (a joint mounted anew,
another day's temperature), so each weighs by 1 / (own variance + variance between runs); the second is the one under
which the weighted squares of the residuals are as large as their degrees of freedom (Paule and Mandel 1982). The
slope's interval is Student's with n - 2 degrees of freedom, its variance times those squares over n - 2 where they are
more than that (Knapp and Hartung 2003). The mean of three repeats knows its own standard deviation badly: no run counts
as surer than the median of them, or one whose repeats agree by chance would draw the line. (Without that, 90 %
intervals over twelve runs of three repeats held the true slope 85 times in a hundred.)
"""

import json
import math
import os
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize, special

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, SpecError
from sinew.measure.estimate import NORMAL_90, Estimate, number, span
from sinew.measure.result import Field, Result, Rows
from sinew.measure.units import one_number
from sinew.measure.validation import write_text


class Quantity(NamedTuple):
    """What a run has found at a pretension. words: its title. unit: empty for a plain number. called: names in a query,
    the shortest first."""

    words: str
    unit: str
    called: tuple[str, ...]

    def head(self, between: str = " / ") -> str:
        """Return the head of a column of it: its name and its unit."""
        return f"{self.called[0]}{between}{self.unit}" if self.unit else self.called[0]


QUANTITIES: Mapping[str, Quantity] = {
    "resonance_hz": Quantity("frequency of the largest fundamental", "Hz", ("f_r", "fr")),
    "damping_ratio": Quantity("Lehr's damping", "", ("D", "damping")),
    "gain_peak": Quantity("largest gain", "", ("gain",)),
    "phase_90_hz": Quantity("frequency of 90° of lag", "Hz", ("f_90", "f90")),
    "half_power_width_hz": Quantity("half-power width", "Hz", ("width",)),
    "decay_frequency_hz": Quantity("frequency of the decay", "Hz", ("f_d", "fd")),
    "decay_rate_per_s": Quantity("decay rate", "1/s", ("rate", "decay")),
    "paper_resonance_hz": Quantity("frequency of the largest mean of peaks (Eq. 6)", "Hz", ("f_paper",)),
    "gain_peak_measured_drive": Quantity("largest gain over the measured lever", "", ("gain_measured",)),
    "energy_reduction": Quantity("share of a swing's energy that resonance saves", "", ("saved",)),
    "paper_stiffness_n_m_rad": Quantity("stiffness ω² I", "N m/rad", ("k", "stiffness")),
    "paper_damping_n_m_s_rad": Quantity("damping constant 2 λ I", "N m s/rad", ("d", "damping_constant")),
}
"""What is kept of each run at each pretension, by its name in results."""

COMMON = ("resonance_hz", "damping_ratio", "gain_peak")
"""The three that every list shows."""

_NAMES = [about.called[0] for about in QUANTITIES.values()]


def quantity_of(name: str) -> str:
    """Return the name in results of a quantity as people call it: fr, f_r, D, gain. Raises SpecError for another."""
    for same in (str, str.casefold):
        called = [key for key, about in QUANTITIES.items() if same(name) in map(same, (key, *about.called))]
        if len(called) == 1:  # D and d are two
            return called[0]
    near = "".join(f"; is {one} meant?" for one in get_close_matches(name, ["pretension", *_NAMES], 1))
    raise SpecError(f"found the quantity {name!r}, expected one of {', '.join(_NAMES)}{near}")


class Search(NamedTuple):
    """What is searched: beginnings of words, in lower case, in the text of a run; ranges of columns of the table."""

    words: tuple[str, ...]
    ranges: tuple[tuple[str, float, float], ...]


_SET_EXACTLY = 1e-6  # mm: what rounding makes of a pretension


def parse_search(text: str) -> Search:
    """Return what is searched. Raises SpecError, naming the part, where it cannot be understood."""
    words: list[str] = []
    ranges: list[tuple[str, float, float]] = []
    for part in text.split():
        if (found := re.fullmatch(r"([A-Za-z_]\w*)(=|[<>:!]=?)(.*)", part)) is None:
            words.append(part.casefold())
            continue
        name, sign, value = found.groups()
        column = "pretension_mm" if name.lower() in ("pretension", "pretension_mm", "p") else quantity_of(name)
        low, dots, high = value.partition("..")
        one = column == "pretension_mm" and not dots  # a pretension is a number that was set
        try:
            ends = one_number(low) if low or one else -math.inf, one_number(high) if high else math.inf
        except ValueError:
            ends = math.nan, math.nan
        if sign != "=" or not (one or (dots and value != "..")) or any(map(math.isnan, ends)):
            raise SpecError(
                f"found {part!r} in the search, expected words and ranges of numbers as f_r=3..3.4, f_r=3.2.. or "
                f"pretension=6, of pretension, {', '.join(_NAMES)}"
            )
        least, most = sorted((ends[0], ends[0]) if one else ends)
        near_mm = _SET_EXACTLY if one else 0.0
        ranges.append((column, least - near_mm, most + near_mm))
    return Search(tuple(words), tuple(ranges))


INDEX = ".index.json"
"""File in the folder of the runs that holds what was read of them."""

_VERSION = 3  # of what `read` gives; an index of another one is made again
_TEXTS = ("name", "started", "rig", "plan", "source", "state", "sentence")

Look = Callable[[Path], str | None]
"""Returns what tells whether a folder has changed, or None for one that holds no run; opens no file."""

Read = Callable[[Path], dict[str, Any]]
"""Returns what a run is and found: names and texts, and `found`, a list of
`{"pretension_mm", quantity: {"value", "std", "interval90"}}`; whatever it raises becomes a row, with the state
damaged, and may be trouble of the moment: it is read again at the next look."""


class RunIndex:
    """The index of a folder of runs. look, read: how a folder is looked at and read.

    What was read lies in a file in the folder, where that may be written. The folders are the truth: the file is made
    from them and may be deleted at any time. Of several programs that write it at once, one file stays, whole.
    """

    def __init__(self, runs: Path, look: Look, read: Read) -> None:
        self.runs, self._look, self._read = runs, look, read
        self._rows: dict[str, tuple[str, dict[str, Any]]] = {}  # stamp and row of each run, by name
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):  # it is made again
            stored = json.loads((runs / INDEX).read_text(encoding="utf-8"))
            if stored["version"] == _VERSION:
                self._rows = {name: (str(stamp), dict(row)) for name, (stamp, row) in stored["runs"].items()}

    def refresh(
        self, *, most_s: float | None = None, progress: Callable[[float, float], None] = lambda _done, _total: None
    ) -> int:
        """Read the folders that are new or have changed, forget those that are gone, and return how many are left out.

        Left out is what was not read in the time there was, or has a name that cannot be printed. most_s: no folder is
        begun after so long [s]; the rest waits for the next refresh. progress: gets (done, total). Raises FileError
        where the folder cannot be listed.
        """
        began = time.monotonic()
        stamps, left = self._folders()
        before = self._rows
        self._rows = {name: row for name, row in before.items() if name in stamps}
        wanted = [
            name
            for name, stamp in stamps.items()
            if name not in before or before[name][0] != stamp or before[name][1].get("state") == "running"
        ]
        done = 0
        for name in wanted:
            if most_s is not None and time.monotonic() - began > most_s:
                break
            self._rows[name] = self._read_row(self.runs / name, stamps[name])
            done += 1
            progress(done, len(wanted))
        if (done or len(self._rows) < len(before)) and self.runs.is_dir():
            with suppress(FileError):  # of a folder that may not be written the table is in memory
                write_text(self.runs / INDEX, json.dumps({"version": _VERSION, "runs": self._rows}))
        return len(wanted) - done + left

    def _folders(self) -> tuple[dict[str, str], int]:
        """Return the stamp of each folder with a run, by name, and how many folders were not looked at."""
        try:
            with os.scandir(self.runs) as entries:
                folders = [one.name for one in entries if one.name[0] != "." and one.is_dir(follow_symlinks=False)]
        except FileNotFoundError:
            return {}, 0
        except OSError as error:
            raise FileError(f"cannot list {self.runs}: {error.strerror or error}; name a folder of runs") from error
        names = sorted(name for name in folders if name.isprintable())
        stamps = {name: stamp for name in names if (stamp := self._look(self.runs / name)) is not None}
        return stamps, len(folders) - len(names)

    def _read_row(self, folder: Path, stamp: str) -> tuple[str, dict[str, Any]]:
        try:
            row = self._read(folder)
        except Exception as trouble:  # whatever lies in a folder, the others are listed
            reason = " ".join(str(trouble).split()) or type(trouble).__name__
            return "", {"name": folder.name, "state": "damaged", "sentence": reason, "found": []}
        return stamp, row | {"name": folder.name, "found": sorted(row["found"], key=lambda one: one["pretension_mm"])}

    def table(self) -> pd.DataFrame:
        """Return a row for each run and pretension, the newest run first; one row of NaN for a run that found nothing.

        `run`, `text` that words are searched in, `index` in what the run found, `pretension_mm`, and each quantity.
        """
        lines = []
        for _, row in self._rows.values():
            about = {"run": row["name"], "started": row.get("started") or ""}
            about["text"] = "\n".join(str(row.get(one) or "") for one in _TEXTS).casefold()
            for index, one in enumerate(row["found"] or [{}]):
                values = {name: estimate["value"] for name, estimate in one.items() if name in QUANTITIES}
                lines.append(about | {"place": index, "pretension_mm": one.get("pretension_mm")} | values)
        frame = pd.DataFrame(lines, columns=["run", "started", "text", "place", "pretension_mm", *QUANTITIES])
        frame = frame.astype(dict.fromkeys(("pretension_mm", *QUANTITIES), float))
        return frame.sort_values(["run", "place"]).sort_values("started", ascending=False, kind="stable")

    def search(self, text: str = "") -> list[dict[str, Any]]:
        """Return the runs that a search finds, the newest first: what `read` said of each, and `found`.

        found: what it measured at the pretensions that are in the ranges, see `Read`.
        Raises SpecError where the search cannot be understood.
        """
        wanted, frame = parse_search(text), self.table()
        for word in wanted.words:
            # Where a word begins: aged is not in damaged.
            frame = frame[frame["text"].str.contains(rf"(?<!\w){re.escape(word)}")]
        for column, low, high in wanted.ranges:
            frame = frame[frame[column].between(low, high)]
        found = []
        for name, places in list(frame.groupby("run", sort=False)["place"]):
            row = self._rows[str(name)][1]
            found.append(row | {"found": [row["found"][index] for index in places if index < len(row["found"])]})
        return found


# What a quantity did over months.

DAYS_OF_A_MONTH = 365.2425 / 12
"""Days in the month of a slope."""

FEWEST_RUNS = 3
"""So many runs a line with an interval needs at least."""

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

    def at(self, days: Array) -> tuple[Array, Array]:
        """Return the line and half of the width of its 90 % interval, each of the shape of days."""
        std = np.hypot(self.middle.std, self.slope.std * (days - self.centre))
        half = float(special.stdtrit(self.degrees_of_freedom, 0.95)) * std
        return self.middle.value + self.slope.value * (days - self.centre), half


def fit_line(days: Array, values: Array, stds: Array) -> Line | None:
    """Return the line through the values of runs, None of fewer than three or of one day.

    days, values, stds: shape (n,), finite; stds: standard deviations that the runs know of themselves, zero allowed.
    """
    if days.size < FEWEST_RUNS or np.ptp(days) < _APART_DAYS:
        return None
    tiny = 1e-9 * max(float(np.abs(values).max()), 1e-140)  # whose square is still a number
    known = stds[stds > 0]
    own = np.maximum(stds, max(float(np.median(known)) if known.size else 0.0, tiny)) ** 2
    freedom = days.size - 2

    def fitted(between: float) -> tuple[float, float, float, Array, float]:
        weight = 1.0 / (own + between)
        centre, middle = (float(weight @ one / weight.sum()) for one in (days, values))
        away = days - centre
        slope = float(weight @ (away * values) / (weight @ away**2))
        return slope, middle, centre, weight, float(weight @ (values - middle - slope * away) ** 2)

    between = 0.0
    if fitted(0.0)[-1] > freedom:
        most = float(np.ptp(values)) ** 2 * days.size + float(own.max())
        between = float(optimize.brentq(lambda one: fitted(one)[-1] - freedom, 0.0, most, rtol=1e-6))
    slope, middle, centre, weight, squares = fitted(between)
    scale = math.sqrt(max(1.0, squares / freedom))
    of_slope, of_middle = (scale / np.sqrt([weight @ (days - centre) ** 2, weight.sum()])).tolist()
    ends = Estimate.student(slope, of_slope, freedom), Estimate.student(middle, of_middle, freedom)
    return Line(*ends, centre, math.sqrt(between), freedom)


@dataclass(frozen=True, repr=False)
class TrendPoint(Result):
    """What one run found. started: its begin (ISO 8601)."""

    run: Annotated[str, Field("run")]
    started: Annotated[str, Field("begin")]
    value: Annotated[Estimate, Field("value", "interval")]


@dataclass(frozen=True, repr=False)
class Trend(Result):
    """A quantity over months, at one pretension, of the runs of one rig and source.

    title: name of the rig, where the runs come from if not from a bench, and the pretension. points: oldest first.
    slope_per_month, between_runs_std, differs_from_zero, line: None where there are too few runs.
    """

    title: Annotated[str, Field("of")]
    quantity: Annotated[str, Field("", "detail")]
    rig: Annotated[str, Field("", "detail")]
    source: Annotated[str, Field("", "detail")]
    pretension_mm: Annotated[float, Field("", "detail")]
    points: Annotated[Rows[TrendPoint], Field("", "detail")]
    runs: Annotated[int, Field("runs")]
    slope_per_month: Annotated[Estimate | None, Field("a month (90 %)", "interval", unit="")]
    between_runs_std: Annotated[float | None, Field("between runs")]
    differs_from_zero: Annotated[bool | None, Field("", "detail")]
    sentence: Annotated[str, Field("", "sentence")]
    line: Line | None

    @property
    def days(self) -> Array:
        """Days of the begins since 1970, shape (n,)."""
        return np.array([_days(one.started) for one in self.points])


def trends(runs: Iterable[Mapping[str, Any]], quantity: str) -> list[Trend]:
    """Return how a quantity changed, for each rig, source and pretension of some runs.

    runs: as `RunIndex.search` gives them. quantity: its name in results. Runs without a date, or without the quantity,
    are left out; those whose uncertainty is not known weigh by the scatter between runs alone.
    """
    groups: dict[tuple[str, str, float], list[TrendPoint]] = {}
    for run in runs:
        for row in run["found"] if _days(run.get("started") or "") is not None else ():
            if quantity in row:
                key = run.get("rig") or "", run.get("source") or "", round(row["pretension_mm"], 6)
                point = TrendPoint(run["name"], run["started"], Estimate.from_json(row[quantity]))
                groups.setdefault(key, []).append(point)
    return [_trend(quantity, *key, points) for key, points in sorted(groups.items())]


def _trend(quantity: str, rig: str, source: str, pretension_mm: float, points: list[TrendPoint]) -> Trend:
    points.sort(key=lambda one: (one.started, one.run))
    days = np.array([_days(one.started) for one in points])
    stds = np.nan_to_num([_std(one.value) for one in points])
    line = fit_line(days, np.array([one.value.value for one in points]), stds)
    name, unit = f"{QUANTITIES[quantity].called[0]} at {number(pretension_mm)} mm", QUANTITIES[quantity].unit
    slope = between = changes = None
    if line is None:
        count = f"{days.size} run{'s' if days.size != 1 else ''}{' of one day' if days.size >= FEWEST_RUNS else ''}"
        said = f"{name}: {count}, too few for a line; at least {FEWEST_RUNS} runs on 2 days are needed."
    else:
        slope, between = line.slope.times(DAYS_OF_A_MONTH), line.between
        changes, unit = is_off_zero(slope), f"{unit} a month".strip()
        over = f"over {days.size} runs in {number(np.ptp(days) / DAYS_OF_A_MONTH, 2)} months"
        near, far = sorted((abs(slope.low), abs(slope.high)))
        verb, ends = "rises" if slope.value > 0 else "falls", span(slope.low, slope.high, unit)
        said = f"{name} {verb} by {number(abs(slope.value), 2)} {unit} (90 %: {span(near, far)}), {over}: not zero."
        if not changes:
            said = f"{name} does not change beyond its uncertainty: {ends} (90 %), {over}; zero is among it."
    of = "" if source in ("bench", "") else f" ({source})"
    title, rows = f"{rig or 'no rig'}{of}, {pretension_mm:g} mm", Rows(points)
    return Trend(title, quantity, rig, source, pretension_mm, rows, days.size, slope, between, changes, said, line)


def is_off_zero(one: Estimate) -> bool | None:
    """Return whether the 90 % interval of a number leaves zero out; None where it has none."""
    return bool(one.low > 0 or one.high < 0) if math.isfinite(one.low) else None


def _days(moment: str) -> float | None:
    """Return a time (ISO 8601; UTC where no zone is named) as days since 1970; None where it is none."""
    try:
        at = datetime.fromisoformat(moment)
    except ValueError:
        return None
    at = at if at.tzinfo is not None else at.replace(tzinfo=UTC)
    return at.timestamp() / 86_400.0  # seconds of a day


def _std(one: Estimate) -> float:
    """Return the standard deviation of which the 90 % interval is the normal one: what few repeats do not know counts.

    NaN where neither interval nor standard deviation is known.
    """
    half = 0.5 * (one.high - one.low)
    return half / NORMAL_90 if math.isfinite(half) else one.std


# Two runs differ in what they found at the pretensions that both have.


class Difference(NamedTuple):
    """What another run found, less what a first one did. quantity: its name in results. first, other: what they found.

    difference: normal, with the combined standard deviation of both, each the one of which its 90 % interval is the
    normal one; NaN where one is not known. It is significant where it `is_off_zero`.
    """

    quantity: str
    pretension_mm: float
    first: Estimate
    other: Estimate
    difference: Estimate


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
        for quantity in (one for one in quantities if one in row and one in before):
            one, two = Estimate.from_json(before[quantity]), Estimate.from_json(row[quantity])
            by = Estimate.normal(two.value - one.value, math.hypot(_std(one), _std(two)) or math.nan)
            found.append(Difference(quantity, row["pretension_mm"], one, two, by))
    return found


def by_chance(found: Sequence[Difference]) -> str:
    """Return how many of some differences are significant, and how many would be by chance if nothing had changed."""
    known = [off for one in found if (off := is_off_zero(one.difference)) is not None]
    return (
        f"{sum(known)} of {len(known)} differences are significant at 90 %; were nothing different, "
        f"{number(0.1 * len(known), 2)} at most would be so by chance."
    )
