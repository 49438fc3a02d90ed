"""Figures of a fitted model and its page: data and curves, what the fit leaves, its numbers together, steady states."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas.plotting import scatter_matrix

from sinew.figures.page import Caption, Table, pictures, result_tables, write_page
from sinew.figures.style import ACCENT, GREEN, GREY, INK, MARKERS, RED, few, in_style, new_figure, note_panel
from sinew.identify.identified import Identified, joint_names
from sinew.identify.joint.fit import JointFit
from sinew.identify.oscillator.comparison import HeldOut, Split
from sinew.identify.oscillator.model import Fit, free_mechanics, number_names, physical_numbers
from sinew.identify.oscillator.record import Record, dominant_omega
from sinew.identify.steady_fit import ResponseFit, response_curve
from sinew.measure.arrays import Array, Mask, wrapped_lag
from sinew.measure.estimate import NORMAL_95, span, typeset
from sinew.measure.units import named_unit
from sinew.mechanics.laws import NUMBERS

# What a fit found gets the words and units that a figure shows.

_SHOWN: dict[str, tuple[float, str]] = {
    "rad": (180 / math.pi, "degrees"),
    "rad/s": (180 / math.pi, "degrees/s"),
    "rad/s2": (180 / math.pi, "degrees/s²"),
    "m": (1e3, "mm"),
    "m/s2": (1.0, "m/s²"),
    "N*m": (1.0, "N m"),
    "1": (1.0, ""),
}
_WORDS = {name: number.word for name, number in NUMBERS.items() if number.absent}
_POWERS = {1: "", 2: "²", 3: "³", 4: "⁴", 6: "⁶"}


def shown_unit(unit: str) -> tuple[float, str]:
    """Return what a number in an SI unit is multiplied by for a figure, and the unit that is written there."""
    return _SHOWN.get(unit, (1.0, unit.replace("*", " ").replace("2", "²").replace("3", "³")))


def axis_label(quantity: str, unit: str) -> str:
    """Return the label of an axis for a quantity that is held in an SI unit: "output in degrees"."""
    shown = shown_unit(unit)[1]
    return f"{quantity} in {shown}" if shown else quantity


def parameter_label(name: str) -> tuple[str, str]:
    """Return words and unit of a parameter from its name: "stiffness_n_m_per_rad" gives ("stiffness", "N m/rad")."""
    stem, bracket, which = name.partition("[")
    words, *parts = named_unit(stem)
    top, bottom = ([f"{symbol}{_POWERS[power]}" for symbol, power in part] for part in parts)
    said = _WORDS.get(words[0], " ".join(words)) + (f" {which[:-1]}" if bracket else "")
    if not bottom:
        return said, " ".join(top)
    under = f"({' '.join(bottom)})" if len(bottom) > 1 else bottom[0]
    return said, f"{' '.join(top) or '1'}/{under}"


# A fit is laid out for drawing: measured and fitted output of each stretch, and what was held out.


@dataclass(frozen=True)
class Trace:
    """One stretch of an experiment and what a fit makes of it.

    time_s, measured, fitted: shape (n,), the latter two in `unit`. held: which samples were held out, shape (n,).
    unit: of the output, SI. title: its condition, empty where there is one stretch only.
    """

    time_s: Array
    measured: Array
    fitted: Array
    held: Mask
    unit: str
    title: str = ""

    @property
    def residual(self) -> Array:
        """Return measured less fitted, shape (n,)."""
        return self.measured - self.fitted


def traces_of(fit: Fit, split: Split | None = None, held_out: HeldOut | None = None) -> list[Trace]:
    """Return the stretches of a fit, in order of time.

    split, held_out: of a fit to one record, what was held out and how it was predicted. Where blocks were held out to
    compare models and then fitted too, they count as held out, and the prediction is that of the fit without them.
    """
    many = len(fit.records) > 1
    found = [
        Trace(record.time_s, record.output, fitted, ~selected, record.output_unit, _title(record) if many else "")
        for record, fitted, selected in zip(fit.records, fit.predicted, fit.selected, strict=True)
    ]
    if split is None or held_out is None:
        return found
    if split.interleaved:
        without = held_out.fit.predicted[0]
        return [replace(found[0], fitted=np.where(split.tested, without, found[0].fitted), held=split.tested)]
    if split.apart is not None:
        apart = split.apart
        every = np.ones(apart.size, dtype=bool)
        found.insert(0, Trace(apart.time_s, apart.output, apart.output - held_out.residual, every, apart.output_unit))
    return sorted(found, key=lambda trace: float(trace.time_s[0]))


def _title(record: Record) -> str:
    """Return the group of a record and, where the group does not tell it, how fast it swings."""
    if record.group.endswith("Hz"):
        return record.group
    leading = record if record.input is None else replace(record, output=record.input)
    return f"{record.group}, {dominant_omega(leading) / (2 * np.pi):.2f} Hz".removeprefix(", ")


def traces_of_joint(joint: JointFit) -> list[Trace]:
    """Return the segments of a fit of the tendon joint, without the samples at their ends that were not fitted."""
    found = []
    for one in joint.segments:
        selected, hertz = one.selected, one.swing.frequency_hz
        title = f"{one.swing.pretension_mm:g} mm" + (f", {hertz:.3g} Hz" if np.isfinite(hertz) else "")
        held = np.zeros(int(selected.sum()), dtype=bool)
        found.append(Trace(one.time_s[selected], one.measured[selected], one.predicted[selected], held, "rad/s", title))
    return found


_CLOSE_PERIODS = 5.0
_SHADE = "#f3e3c3"
_SEGMENTS = 12


@in_style
def draw_fit(traces: Sequence[Trace], frequency_hz: float, output: str = "output") -> Figure:
    """Return the figure of measured and fitted output.

    traces: one stretch, or a held-out one beside it: the whole above and two close-ups below, one of the largest motion
        and one of the held-out part, or of where the fit leaves most. Several segments: one small panel for each.
    frequency_hz: whose periods the close-ups are counted in. output: what the axis calls it.
    """
    if any(trace.title for trace in traces):
        return _draw_many(traces, frequency_hz, output)
    figure = new_figure(4.6)
    grid = figure.add_gridspec(2, 2)
    whole = figure.add_subplot(grid[0, :])
    zero = float(traces[0].time_s[0])
    for trace in traces:
        _draw(whole, trace, slice(None), zero, dense=True)
    whole.set(xlabel="time in s", ylabel=axis_label(output, traces[0].unit))
    ends = [float(trace.time_s[k]) - zero for trace in traces for k in (0, -1)]
    whole.set_xlim(min(ends), max(ends))
    low, high = whole.get_ylim()
    whole.set_ylim(low, high + 0.14 * (high - low))  # room for the letters of the close-ups
    note_panel(whole, "a", "the whole record")
    second = "held out of the fit" if _is_held_at_the_end(traces) else "where the fit leaves most"
    titles = ("largest motion", second)
    for k, ((which, where), title) in enumerate(zip(_windows(traces, frequency_hz), titles, strict=True)):
        axes = figure.add_subplot(grid[1, k])
        trace = traces[which]
        _draw(axes, trace, where, zero, dense=False)
        axes.set(xlabel="time in s", ylabel=axis_label(output, trace.unit))
        axes.set_xlim(trace.time_s[where][0] - zero, trace.time_s[where][-1] - zero)
        note_panel(axes, "bc"[k], title)
        _mark(whole, trace, where, zero, "bc"[k])
    _legend(figure, "outside lower center")
    return figure


def _draw(axes: Axes, trace: Trace, where: slice, zero: float, *, dense: bool) -> None:
    t, factor = trace.time_s[where] - zero, shown_unit(trace.unit)[0]
    measured, fitted = factor * trace.measured[where], factor * trace.fitted[where]
    for begin, end in _stretches(trace.held):
        first, last = trace.time_s[begin] - zero, trace.time_s[end - 1] - zero
        if last >= t[0] and first <= t[-1]:
            axes.axvspan(max(first, t[0]), min(last, t[-1]), color=_SHADE, linewidth=0, label="held out")
    if dense:
        axes.plot(t, measured, color=GREY, linewidth=1.8, label="measured")
    else:
        axes.plot(t, measured, "o", color=GREY, markersize=2.2, label="measured")
    axes.plot(t, fitted, color=ACCENT, linewidth=0.8 if dense else 1.1, label="fitted")
    axes.plot(t, measured - fitted, color=RED, linewidth=0.8, label="measured less fitted")
    axes.margins(x=0)


def _stretches(held: Mask) -> list[tuple[int, int]]:
    """Return begin and end (not included) of each run of samples that were held out."""
    steps = np.diff(np.concatenate([[False], held, [False]]).astype(int))
    return list(zip(np.flatnonzero(steps == 1).tolist(), np.flatnonzero(steps == -1).tolist(), strict=True))


def _is_held_at_the_end(traces: Sequence[Trace]) -> bool:
    return any(len(_stretches(trace.held)) == 1 for trace in traces)


def _windows(traces: Sequence[Trace], frequency_hz: float) -> list[tuple[int, slice]]:
    """Return trace and samples of the two close-ups."""
    longest = max(range(len(traces)), key=lambda i: traces[i].time_s.size - int(traces[i].held.sum()))
    trace = traces[longest]
    size = _samples(trace, frequency_hz)
    first = _around(int(np.argmax(np.abs(trace.measured - np.median(trace.measured)))), size, trace.time_s.size)
    if _is_held_at_the_end(traces):
        apart = next(i for i, one in enumerate(traces) if len(_stretches(one.held)) == 1)
        begin, end = _stretches(traces[apart].held)[0]
        return [(longest, first), (apart, slice(begin, min(end, begin + size)))]
    power = np.convolve(trace.residual**2, np.ones(size) / size, mode="same")
    power[max(0, first.start - size // 2) : first.stop + size // 2] = 0.0
    return [(longest, first), (longest, _around(int(np.argmax(power)), size, trace.time_s.size))]


def _samples(trace: Trace, frequency_hz: float) -> int:
    step = float(np.median(np.diff(trace.time_s)))
    return int(np.clip(round(_CLOSE_PERIODS / frequency_hz / step), 12, trace.time_s.size))


def _around(middle: int, size: int, count: int) -> slice:
    begin = int(np.clip(middle - size // 2, 0, max(0, count - size)))
    return slice(begin, min(count, begin + size))


def _mark(axes: Axes, trace: Trace, where: slice, zero: float, letter: str) -> None:
    """Mark above the whole record where a close-up is taken from."""
    left, right = (float(trace.time_s[where][k]) - zero for k in (0, -1))
    above = axes.get_xaxis_transform()
    axes.plot(
        [left, right], [1.0, 1.0], color=INK, linewidth=2.2, transform=above, clip_on=False, solid_capstyle="butt"
    )
    axes.annotate(letter, (0.5 * (left + right), 1.0), (0, -3), above, "offset points", ha="center", va="top")


def _legend(figure: Figure, where: Literal["outside lower center", "outside upper center"]) -> None:
    found: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(str(label), handle)
    order = ("measured", "fitted", "measured less fitted", "held out")
    entries = {name: found[name] for name in order if name in found}
    figure.legend(list(entries.values()), list(entries), loc=where, ncols=len(entries))


def _draw_many(traces: Sequence[Trace], frequency_hz: float, output: str) -> Figure:
    """Return small panels of several segments, at most twelve, of each its last periods (of a decay its first)."""
    shown = [traces[i] for i in few(len(traces), _SEGMENTS)]
    columns = min(4, len(shown))
    rows = -(-len(shown) // columns)
    figure = new_figure(1.0 + 1.35 * rows)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
    for k, (axes, trace) in enumerate(zip(grid, shown, strict=False)):
        size = min(trace.time_s.size, 2 * _samples(trace, frequency_hz))
        half = trace.time_s.size // 2
        fades = np.ptp(trace.measured[half:]) < 0.5 * np.ptp(trace.measured[:half])
        where = slice(0, size) if fades else slice(trace.time_s.size - size, trace.time_s.size)
        _draw(axes, trace, where, float(trace.time_s[0]), dense=False)
        axes.set_title(trace.title)
        if k % columns == 0:
            axes.set_ylabel(axis_label(output, trace.unit))
    for axes in grid[len(shown) :]:
        axes.axis("off")
    figure.supxlabel("time from the start of the segment in s", fontsize=8.5)
    _legend(figure, "outside upper center")
    return figure


# A stepped sine is drawn beside its fit: gain and lag over frequency.

_COLOURS = (ACCENT, RED, GREEN, INK, GREY)


@in_style
def draw_response_fit(fit: ResponseFit) -> Figure:
    """Return the figure of measured steady states, one marker a level, and the fitted curves through their folds."""
    figure = new_figure(3.0)
    left, right = figure.subplots(1, 2)
    unit = fit.points[0].output_unit
    factor = shown_unit(unit)[0]
    for part, points in enumerate(fit.points):
        colour, marker = _COLOURS[part % len(_COLOURS)], MARKERS[part % len(MARKERS)]
        frequency, response = response_curve(fit, part)
        drive, level = points.input_amplitude, float(np.median(points.input_amplitude))
        left.plot(frequency, factor * level * np.abs(response), color=colour)
        look = {"color": colour, "marker": marker, "linestyle": "none", "markerfacecolor": "none"}
        label = points.group.replace("*", " ") or "measured"
        left.plot(points.frequency_hz, factor * drive * np.abs(points.response), label=label, **look)
        right.plot(frequency, np.degrees(wrapped_lag(response)), color=colour)
        right.plot(points.frequency_hz, np.degrees(wrapped_lag(points.response)), **look)
    left.set(xlabel="frequency in Hz", ylabel=axis_label("amplitude", unit))
    left.set_ylim(bottom=0)
    right.set(xlabel="frequency in Hz", ylabel="lag in degrees")
    note_panel(left, "a", "steady states and fit")
    note_panel(right, "b", "lag behind the input")
    left.legend(loc="best")
    return figure


# What is known of the parameters together: draws by their covariance, or those of a posterior.

_MOST = 6  # parameters
_DRAWS = 500
_LINE = 14  # characters


def draws_of(found: Identified, seed: int = 0) -> pd.DataFrame:
    """Return draws of what a fit determines, a column for each number with the words and the unit of its axis.

    Of one degree of freedom in full where the inertia is known, else over the inertia; of a tendon joint its rig's
    parameters. Draws are those of the posterior, where there is one, else normal by the covariance.
    """
    rng = np.random.default_rng(seed)
    if found.joint is not None:
        names, count = joint_names(found.joint), len(found.joint.parameters)
        value = np.array([one.value for one in found.joint.parameters.values()])
        matrix = found.joint.covariance.matrix[:count, :count]
        known = np.isfinite(np.diag(matrix)) & (np.diag(matrix) > 0)
        drawn = rng.multivariate_normal(value[known], matrix[np.ix_(known, known)], _DRAWS)
        return _labelled(pd.DataFrame(drawn, columns=np.array(names)[known]))
    assert found.fit is not None
    fit, every = found.fit, number_names(found.fit)
    if found.draws is not None:
        table = pd.DataFrame(found.draws.draws, columns=list(found.draws.names))
    else:
        known = np.isfinite(np.diag(fit.covariance.matrix))
        x = np.tile(fit.solution.values, (_DRAWS, 1))
        x[:, known] = rng.multivariate_normal(x[0, known], fit.covariance.matrix[np.ix_(known, known)], _DRAWS)
        table = pd.DataFrame(physical_numbers(fit, x), columns=list(every))
    mechanical = free_mechanics(fit.model, fit.layout.parts[0].record)
    count = sum(entry.local in mechanical for entry in fit.layout.entries)
    without = tuple(name for name, number in NUMBERS.items() if not number.force)
    # `Fit.parameters` holds the numbers over the inertia first, then those in full where the inertia is known.
    over, full = every[:count], every[count : len(fit.parameters)]
    names = (*full, *(name for name in over if name.startswith(without))) if full else over
    return _labelled(table[[name for name in names if name in table and fit.parameters[name].std > 0]])


def _labelled(table: pd.DataFrame) -> pd.DataFrame:
    def label(name: str) -> str:
        words, unit = parameter_label(name.rpartition(".")[2])  # a rig's without its section
        return textwrap.fill(words, _LINE) + (f"\nin {unit}" if unit else "")

    return table.rename(columns=label)


@in_style
def draw_corner(draws: pd.DataFrame) -> Figure | None:
    """Return the draws of each pair of parameters, and a histogram of each, or None of fewer than two parameters. Of
    more than six the first six are drawn."""
    draws = draws.iloc[:, :_MOST]
    size = draws.shape[1]
    if size < 2:
        return None
    figure = new_figure(0.6 + 1.15 * size)
    panels = figure.subplots(size, size, squeeze=False)
    scatter_matrix(draws, ax=panels, color=ACCENT, alpha=0.3, s=6, hist_kwds={"color": ACCENT, "bins": 30})
    for axes in panels.flat:
        axes.grid(visible=False)
        axes.tick_params(axis="x", rotation=45)
    return figure


# Each figure of an identification gets its words, and the page its tables.

FIT_CAPTIONS = {
    "fit_data": Caption(
        "Fit against data",
        "Measured output (grey) and the fitted model's (blue), simulated from the measured input; in red what is left. "
        "Shaded: samples that were held out of the fit, where the line is a prediction. Of one record the whole and "
        "two close-ups, of several segments some periods of each.",
        "Measured and fitted output over time, with their difference and the held-out part shaded.",
    ),
    "residuals": Caption(
        "Residuals",
        "(a) Measured less fitted over time. (b) Its autocorrelation: the band holds 95 % of the bars where they are "
        "white noise; bars far outside mean that the model misses something, and the intervals above are widened for "
        "it. The verdict says whether their size goes with amplitude or frequency.",
        "Two panels: residuals over time, and their autocorrelation with its band.",
    ),
    "corner": Caption(
        "What is known of the parameters together",
        "Draws of the parameters as likely as the fit says: each alone on the diagonal, each pair beside it. A narrow "
        "slanting cloud means that the record tells a combination of the two better than either.",
        "A square of panels: histograms of the parameters on the diagonal, clouds of pairs beside it.",
    ),
    "response": Caption(
        "Steady states and fit",
        "(a) Amplitude of the output at each frequency, one colour a level of the drive: markers as measured, lines "
        "the fitted model's, through their folds where there are any. (b) Lag of the output behind the input.",
        "Two panels over frequency: amplitude with points and curves, and lag.",
    ),
}
"""By the name of the figure's files, in the order of the page."""


def write_fit_page(
    folder: Path,
    found: Identified,
    *,
    figures: Sequence[Path] = (),
    about: str = "",
    rebuild: str = "",
    origins: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write fit.html into a folder, atomically, and return its path.

    figures: the PNGs among them are put into the page. about: what was fitted, a sentence. rebuild: the command that
    makes all of this again. origins: (name, value) of what it was made from.
    Raises FileError where the folder cannot be written.
    """
    tables = result_tables(found)
    if found.posterior is not None:
        rows = [
            [" ".join(parameter_label(name)), typeset(one.shown()), typeset(span(one.low, one.high))]
            for name, one in found.posterior.items()
        ]
        tables.append(Table("Posterior", ["quantity", "median ± std", "5 % to 95 % of the draws"], rows, ""))
    return write_page(
        folder / "fit.html",
        "prediction.html",
        title="Identification",
        about=about,
        lead=" ".join(one if one.endswith(".") else f"{one}." for one in found.blocks() if isinstance(one, str)),
        tables=tables,
        pictures=pictures(figures, FIT_CAPTIONS),
        validity=[],
        rebuild=rebuild,
        origins=list(origins),
    )


# What a fit leaves: over time, its spectrum, and over the inputs.

_PERIODS = 2.0
_FEWEST_LAGS, _MOST_LAGS = 20, 400
_DOTTED = 80  # lags up to which each gets a dot


@in_style
def draw_residuals(traces: Sequence[Trace], frequency_hz: float) -> Figure:
    """Return the figure of measured less fitted.

    traces: of a fit, several segments one behind the other. frequency_hz: whose period makes lags and blocks.
    The autocorrelation is of the fitted samples, held-out ones are drawn in another colour.
    """
    figure = new_figure(2.6)
    over, lags = figure.subplots(1, 2)
    _draw_over_time(over, traces)
    _draw_lags(lags, traces, frequency_hz)
    return figure


def _step(traces: Sequence[Trace]) -> float:
    return float(np.median(np.diff(traces[0].time_s)))


def _draw_over_time(axes: Axes, traces: Sequence[Trace]) -> None:
    begin, any_held, factor = 0.0, False, shown_unit(traces[0].unit)[0]
    for trace in traces:
        t = trace.time_s - trace.time_s[0] + begin if trace.title else trace.time_s - traces[0].time_s[0]
        for held, colour in ((False, ACCENT), (True, RED)):
            chosen = trace.held == held
            axes.plot(t[chosen], factor * trace.residual[chosen], ".", color=colour, markersize=1.6, rasterized=True)
        any_held = any_held or bool(trace.held.any())
        begin = float(t[-1])
    axes.axhline(0, color=INK, linewidth=0.7)
    if any_held:
        for name, colour in (("fitted", ACCENT), ("held out", RED)):
            axes.plot([], [], "o", color=colour, markersize=4, label=name)
        axes.legend(loc="upper right", ncols=2, borderaxespad=0.1, handletextpad=0.1)
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.15 * (high - low))
    axes.set_xlabel("recorded time in s" if traces[0].title else "time in s")
    axes.set_ylabel(axis_label("measured less fitted", traces[0].unit))
    axes.margins(x=0.01)
    note_panel(axes, "a", "over time")


def autocorrelation(traces: Sequence[Trace], lags: int) -> tuple[Array, int]:
    """Return the autocorrelation of the fitted samples' residuals at lags 1 to `lags`, shape (lags,), and their number.

    Pairs that reach over a held-out sample or from one stretch to the next are left out.
    """
    mean = float(np.mean(np.concatenate([trace.residual[~trace.held] for trace in traces])))
    products, power, count = np.zeros(lags), 0.0, 0
    for trace in traces:
        r = np.where(trace.held, 0.0, trace.residual - mean)
        power += float(r @ r)
        count += int((~trace.held).sum())
        most = min(lags, r.size - 1)
        products[:most] += [float(r[k:] @ r[:-k]) for k in range(1, most + 1)]
    return products / max(power, 1e-300), count


def _draw_lags(axes: Axes, traces: Sequence[Trace], frequency_hz: float) -> None:
    step, shortest = _step(traces), min(trace.time_s.size for trace in traces)
    wanted = max(_FEWEST_LAGS, round(_PERIODS / frequency_hz / step))
    lags = max(2, min(wanted, _MOST_LAGS, shortest // 3))
    found, count = autocorrelation(traces, lags)
    at = 1e3 * step * np.arange(1, lags + 1)
    band = NORMAL_95 / np.sqrt(count)
    axes.axhspan(-band, band, color=GREY, alpha=0.3, linewidth=0, label="95 % of white noise")
    axes.vlines(at, 0, found, color=ACCENT, linewidth=min(1.2, 80 / lags))
    if lags <= _DOTTED:
        axes.plot(at, found, "o", color=ACCENT, markersize=2.2)
    axes.axhline(0, color=INK, linewidth=0.7)
    low, high = min(-3 * band, 1.15 * float(found.min())), max(4 * band, 1.3 * float(found.max()))
    axes.set(
        xlabel="lag in ms", ylabel="correlation", xlim=(0, float(at[-1]) * 1.02), ylim=(max(low, -1), min(high, 1.3))
    )
    axes.legend(loc="upper right", borderaxespad=0.1)
    note_panel(axes, "b", "autocorrelation")


# An identification's figures.


def draw_identified(found: Identified) -> dict[str, Figure]:
    """Return the figures of an identification, by name: those of `FIT_CAPTIONS` that it has."""
    if found.response is not None:
        return {"response": draw_response_fit(found.response)}
    if found.joint is not None:
        traces, output = traces_of_joint(found.joint), "rate"
    else:
        assert found.fit is not None
        traces, output = traces_of(found.fit, found.split, found.held_out), "output"
    frequency = found.natural_frequency_hz.value
    if not math.isfinite(frequency) and found.fit is not None:
        frequency = dominant_omega(found.fit.records[0]) / (2 * math.pi)
    drawn = {"fit_data": draw_fit(traces, frequency, output), "residuals": draw_residuals(traces, frequency)}
    corner = draw_corner(draws_of(found))
    return drawn if corner is None else drawn | {"corner": corner}
