"""One HTML page from a template, which needs nothing beside itself, and the rows of its tables."""

import base64
import functools
import math
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from sinew.analysis.decay.paper_method import decay_windows, describe_windows
from sinew.analysis.runs import QUANTITIES, Trend
from sinew.analysis.signal.repeats import interval_rows
from sinew.figures.style import MARKERS, in_style, new_figure, pretension_colours, save_figure
from sinew.measure import estimate
from sinew.measure.estimate import DIGITS, Estimate, typeset
from sinew.measure.result import Result
from sinew.measure.result import Table as Shown
from sinew.measure.validation import write_text
from sinew.plan.rig import RigSpec

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Caption:
    """The words of one figure.

    title: for a heading. see: what is drawn. alt: what somebody hears who cannot see it.
    paper: what the paper shows there, or why the figure is added.
    """

    title: str
    see: str
    alt: str
    paper: str = ""


@functools.cache
def _environment() -> Environment:
    loader = FileSystemLoader(Path(__file__).parent / "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"number": number, "fixed": fixed}
    return environment


def write_page(path: Path, template: str, **context: Any) -> Path:
    """Write a template with what it is given, atomically, and return the path.

    Raises FileError where the folder cannot be written.
    """
    write_text(path, _environment().get_template(template).render(**context))
    return path


def pictures(paths: Iterable[Path], captions: Mapping[str, Caption]) -> list[dict[str, Any]]:
    """Return name, caption and base64 text of the PNGs among some files, as the templates take them."""
    found = []
    for path in paths:
        if path.suffix == ".png":
            plain = path.stem.replace("_", " ")
            caption = captions.get(path.stem, Caption(plain, "", plain))
            data = base64.b64encode(path.read_bytes()).decode("ascii")
            found.append({"name": path.stem, "caption": caption, "data": data})
    return found


# What was measured at each pretension: columns of the report's tables, and a sentence below each.

MEANINGS = "What resonance means"

Column = tuple[str, str, float]
"""Head of a column, the quantity of the results in it, and the factor to its unit."""

_MEANINGS: tuple[Column, ...] = (
    ("mean of peaks (Eq. 6) in Hz", "paper_resonance_hz", 1.0),
    ("fundamental in Hz", "resonance_hz", 1.0),
    ("fundamental by measured drive in Hz", "resonance_measured_drive_hz", 1.0),
    ("90° lag in Hz", "phase_90_hz", 1.0),
)
_DECAY: tuple[Column, ...] = (
    ("λ in 1/s", "paper_decay_rate_per_s", 1.0),
    ("⟨ω⟩ in rad/s", "paper_omega_rad_s", 1.0),
    ("D (paper)", "paper_lehr_damping", 1.0),
    ("D (direct fit)", "damping_ratio", 1.0),
    ("d in N m s/rad", "paper_damping_n_m_s_rad", 1.0),
    ("k in N m/rad", "paper_stiffness_n_m_rad", 1.0),
)
_ENERGY: tuple[Column, ...] = (
    ("drive in W", "drive_power_at_resonance_w", 1.0),
    ("copper in W", "copper_at_resonance_w", 1.0),
    ("gear and friction in W", "gear_at_resonance_w", 1.0),
    ("mechanical in W", "mechanical_at_resonance_w", 1.0),
    ("tendon motors in W", "holding_at_resonance_w", 1.0),
    ("drive in J per cycle", "energy_per_cycle_at_resonance_j", 1.0),
    ("J per cycle and rad²", "swing_cost_at_resonance_j_rad2", 1.0),
    ("trend in J per cycle and rad²", "trend_cost_at_resonance_j_rad2", 1.0),
    ("reduction in %", "energy_reduction", 100.0),
    ("with tendon motors in %", "energy_reduction_with_holding", 100.0),
    ("pays from a swing in °", "break_even_rad", 180 / math.pi),
    ("cheapest at Hz", "cheapest_hz", 1.0),
    ("reduction there in %", "cheapest_reduction", 100.0),
    ("current against a line in %", "line_reduction", 100.0),
)


def energy_note(results: "xr.Dataset") -> str:
    """Return what the columns mean, and what is in none of them; empty without the energy part."""
    if "energy_reduction" not in results or not np.isfinite(results["drive_power_w"].values).any():
        return ""
    idle, rest = float(results.attrs.get("idle_power_w", math.nan)), results["rest_power_w"].values
    text = (
        "At the resonance of the gain, by duty, current and voltage of the servos. The trend: what spring and inertia "
        "would need for the same swing of the head if neither helped the other; the reduction is the share of it that "
        "resonance saves. A negative last column means more current than on a straight line through the currents off "
        "resonance (the paper's proposal, at the nominal drive amplitude and not at equal swing)."
    )
    if np.isfinite(rest).any():
        ends = rest[np.isfinite(rest)][[0, -1]]
        text += f" At rest all motors draw {ends[0]:.2g} W at the first and {ends[1]:.2g} W at the last pretension."
    if math.isfinite(idle):
        text += f" The servos' electronics, {idle:.2g} W by data sheet, are in none of these numbers."
    return text


@dataclass(frozen=True)
class Table:
    """A table of text: title, head, rows of the same length (the first cell names the row), and a sentence below."""

    title: str
    head: list[str]
    rows: list[list[str]]
    note: str


def result_tables(found: Result, name: str = "") -> list[Table]:
    """Return the tables of a result, as its text has them. name: of the result, where a page has several."""
    tables = [one for one in found.blocks() if isinstance(one, Shown)]
    return [
        Table(
            ": ".join(filter(None, (name, one.title))),
            list(one.columns),
            [[*map(typeset, row)] for row in one.rows],
            "",
        )
        for one in tables
    ]


def number(value: float | None, digits: int = DIGITS) -> str:
    """Return a number with so many significant digits, a dash for what is not known."""
    return typeset(estimate.number(value if value is None or math.isfinite(value) else None, digits))


def fixed(value: float | None, decimals: int) -> str:
    """Return a number with so many decimals, a dash for what is not known."""
    return typeset(estimate.fixed(value if value is None or math.isfinite(value) else None, decimals))


def measured_tables(results: "xr.Dataset") -> list[Table]:
    """Return what was measured at each pretension: of sweep, ring-downs and energy, each where there is one."""
    tables = []
    notes = (str(results.attrs.get("resonance_notes", "")), _MEANT, _verdict(results), energy_note(results))
    parts = (
        ("Resonance", _resonance(results)),
        (MEANINGS, _MEANINGS),
        ("Ring-down", _DECAY),
        ("Energy", _ENERGY),
    )
    for (title, columns), note in zip(parts, notes, strict=True):
        known = [column for column in columns if column[1] in results and np.isfinite(results[column[1]]).any()]
        if not known:
            continue
        means = interval_rows(results, [name for _, name, _ in known])
        rows = [
            [number(row["pretension_mm"]), *(_mean(row[name], factor) for _, name, factor in known)]
            for row in means
            if any(math.isfinite(row[name].value) for _, name, _ in known)
        ]
        tables.append(Table(title, ["p in mm", *(head for head, _, _ in known)], rows, note))
    return tables


def _mean(one: Estimate, factor: float) -> str:
    """Return a mean as "value ± std", the standard deviation that of the mean, in a unit that is 1/factor as large."""
    return typeset(one.times(factor).shown())


def window_table(results: "xr.Dataset", *, ends: bool = False) -> Table | None:
    """Return D over pretension by where the decay begins, a row for each start; None without planned ring-downs.

    ends: only of the first and the last pretension, for a terminal.
    """
    windows = decay_windows(results)
    if not windows:
        return None
    pretensions = sorted({float(p) for window in windows for p in window.pretension_mm})
    pretensions = pretensions[:: max(1, len(pretensions) - 1)] if ends else pretensions
    head = ["start in drive periods", *(f"D at {number(p)} mm" for p in pretensions)]
    rows = []
    for window in windows:
        at = dict(zip(window.pretension_mm.tolist(), window.damping, strict=True))
        cells = [typeset(at[p].shown_interval()) if p in at else "–" for p in pretensions]
        rows.append([number(window.start_periods), *cells, *_window_cells(window.to_json())])
    return Table("Where the decay begins", [*head, *_WINDOW_HEAD], rows, describe_windows(windows))


_WINDOW_HEAD = ("spread in %", "change over the range in %", "trend")


def _window_cells(window: Mapping[str, Any]) -> list[str]:
    """Return spread, change over the range with its interval, and trend of a window of `DecayWindow.to_json`."""
    change = window["relative_change"]
    value, low, high = (None if x is None else 100 * x for x in (change["value"], *change["interval90"]))
    spread = None if window["spread"] is None else 100 * window["spread"]
    return [number(spread, 2), typeset(estimate.interval(value, low, high)), str(window["trend"])]


_MEANT = (
    "Eq. 6 is the paper's: the largest mean of peaks over the nominal drive. A prediction's half of peak to peak is "
    "the same of a motion that repeats exactly. The fundamental leaves the harmonics out, the measured drive is the "
    "joint's own input, and 90° is where that drive gives most power."
)


def _verdict(results: "xr.Dataset") -> str:
    """Return how many of the decays are exponential, and what follows where some are not; empty without ring-downs."""
    if "exponential" not in results:
        return ""
    judged = results["exponential"].values[np.isfinite(results["exponential"].values)]
    text = f"Exponential within their noise: {int(judged.sum())} of {judged.size} decays."
    if judged.sum() == judged.size:
        return text
    return text + " Where a decay is not, its damping depends on the amplitude; λ, ⟨ω⟩, D, d and k are means over it."


def _resonance(results: "xr.Dataset") -> Sequence[Column]:
    if "resonance_hz" not in results:
        return []
    units = [str(results.attrs.get(name, "rad")) for name in ("response_unit", "drive_unit")]
    scale, drive = (180 / math.pi, "degrees") if units[1] == "rad" else (1.0, units[1])
    per = "" if units[0] == units[1] else f" in {units[0]} per {units[1]}"
    return [
        ("resonance (Eq. 6) in Hz", "paper_resonance_hz", 1.0),
        (f"gain{per}", "paper_gain_peak", 1.0),
        (f"gain by measured drive{per}", "gain_peak_measured_drive", 1.0),
        ("half-power width in Hz", "half_power_width_hz", 1.0),
        (f"drive in {drive}", "drive_amplitude_at_resonance_rad", scale),
    ]


def _readable(unit: str) -> str:
    """Return a unit as print has it, nothing for a plain number."""
    return "" if unit == "1" else unit.replace("*", " ").replace("^2", "²").replace("^3", "³")


def parameter_rows(rig: RigSpec) -> list[dict[str, str]]:
    """Return name, value, unit, origin, bounds and note of every parameter of a rig, as text."""
    return [
        {
            "name": name,
            "value": number(parameter.value, 5),
            "unit": _readable(parameter.unit),
            "origin": parameter.origin,
            "bounds": f"{number(parameter.bounds[0])} to {number(parameter.bounds[1])}",
            "note": parameter.note,
        }
        for name, parameter in rig.parameters()
    ]


def determined_rows(posterior: Mapping[str, Mapping[str, Any]]) -> list[dict[str, str]]:
    """Return name, unit, 90 % before and with the paper's numbers, and what is left, as text, the best known first."""
    return [
        {
            "name": name,
            "unit": _readable(str(row["unit"])),
            **{key: " to ".join(map(number, row[f"{key}90"])) for key in ("prior", "posterior")},
            "left": f"{100 * row['ratio']:.0f} %",
        }
        for name, row in sorted(posterior.items(), key=lambda item: float(item[1]["ratio"]))
    ]


# Trends over months are drawn, and written as a page.

_MOST_LINES = 12


@in_style
def draw_trends(found: Sequence[Trend]) -> Figure:
    """Return a quantity over dates with 90 % intervals, its lines and their 90 % bands; the first twelve of them."""
    figure = new_figure(3.6)
    axes = figure.subplots()
    shown = found[:_MOST_LINES]
    colours: Any = pretension_colours([one.pretension_mm for one in shown]) if shown else []
    for index, (one, colour) in enumerate(zip(shown, colours, strict=True)):
        dates: Any = np.array([datetime.fromisoformat(point.started) for point in one.points])
        values, low, high = np.array([(at.value.value, at.value.low, at.value.high) for at in one.points]).T
        ends = np.array([values - low, high - values])
        marker = MARKERS[index % len(MARKERS)]
        axes.errorbar(
            dates, values, np.nan_to_num(ends), fmt=marker, ms=3, lw=0.6, color=colour, alpha=0.7, label=one.title
        )
        if one.line is not None:
            middle, half = one.line.at(one.days)
            axes.plot(dates, middle, color=colour, lw=1.6, zorder=4)
            axes.fill_between(dates, middle - half, middle + half, color=colour, alpha=0.2, lw=0)
    about = QUANTITIES[found[0].quantity] if found else None
    if about is not None:
        axes.set_ylabel(about.head(" in "))
        left = len(found) - len(shown)
        axes.legend(loc="best", title=f"{len(shown)} of {len(found)} are drawn" if left else None)
    locator: Any = AutoDateLocator()  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    return figure


def save_trends(found: Sequence[Trend], path: Path) -> None:
    """Write the drawing (.svg, .png, .pdf), or a page with it and every number (.html). Raises FileError."""
    if path.suffix != ".html":
        save_figure(draw_trends(found), path.parent, path.stem, (path.suffix.removeprefix("."),))
        return
    with tempfile.TemporaryDirectory() as folder:
        (picture,) = save_figure(draw_trends(found), Path(folder), path.stem, ("png",))
        write_trend_page(path, found, picture)


def write_trend_page(path: Path, found: Sequence[Trend], picture: Path) -> Path:
    """Write the page of some trends. picture: PNG of the drawing. Raises FileError."""
    sentences = [f"{one.title}: {one.sentence}" for one in found]
    drawn = "Each run with its 90 % interval; lines with their 90 % bands."
    if len(found) > _MOST_LINES:
        drawn += f" The first {_MOST_LINES} of {len(found)} are drawn; the tables below hold all."
    caption = Caption("Over months", drawn, " ".join(sentences))
    return write_page(
        path,
        "prediction.html",
        title="Change over months",
        about=f"{sum(one.runs for one in found)} values of runs.",
        lead=" ".join(sentences),
        tables=[_table(one) for one in found],
        pictures=pictures([picture], {picture.stem: caption}),
        validity=[],
        rebuild="",
        origins=[],
    )


def _table(one: Trend) -> Table:
    about = QUANTITIES[one.quantity]
    head = ["run", "begin", about.head(" in ")]
    rows = [[at.run, at.started[:10], str(at.value)] for at in one.points]
    return Table(one.title, head, rows, "Value and 90 % interval.")
