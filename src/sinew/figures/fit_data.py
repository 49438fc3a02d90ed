"""Figures of a fitted model: data and curves, steady states, and how frequency and damping go with amplitude."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.style import ACCENT, GREEN, GREY, INK, MARKERS, RED, few, in_style, new_figure, note_panel
from sinew.identify.choice.comparison import HeldOut, Split
from sinew.identify.joint.fit import JointFit
from sinew.identify.oscillator.backbone import Backbone
from sinew.identify.oscillator.fitted import Fit, Swing
from sinew.identify.oscillator.record import Record, derivative_order
from sinew.identify.oscillator.start import dominant_omega
from sinew.identify.stepped.curves import backbone_of_response, response_curve
from sinew.identify.stepped.fit import ResponseFit
from sinew.measure.arrays import Array, Mask, wrapped_lag
from sinew.measure.estimate import pair, typeset
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
    stem, bracket, place = name.partition("[")
    words, *parts = named_unit(stem)
    top, bottom = ([f"{symbol}{_POWERS[power]}" for symbol, power in part] for part in parts)
    said = _WORDS.get(words[0], " ".join(words)) + (f" {place[:-1]}" if bracket else "")
    if not bottom:
        return said, " ".join(top)
    under = f"({' '.join(bottom)})" if len(bottom) > 1 else bottom[0]
    return said, f"{' '.join(top) or '1'}/{under}"


def value_and_std(value: float, std: float) -> str:
    """Return "value ± std" with the digits that the std gives, the value alone where the std is not known."""
    return typeset(pair(value, std))


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
        Trace(record.time_s, record.output, fitted, ~kept, record.output_unit, _title(record) if many else "")
        for record, fitted, kept in zip(fit.records, fit.predicted, fit.kept, strict=True)
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
        kept, hertz = one.kept, one.swing.frequency_hz
        title = f"{one.swing.pretension_mm:g} mm" + (f", {hertz:.3g} Hz" if np.isfinite(hertz) else "")
        held = np.zeros(int(kept.sum()), dtype=bool)
        found.append(Trace(one.time_s[kept], one.measured[kept], one.predicted[kept], held, "rad/s", title))
    return found


_CLOSE_PERIODS = 5.0
_SHADE = "#f3e3c3"
_MOST = 12


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
    shown = [traces[i] for i in few(len(traces), _MOST)]
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


# How frequency and damping of a decay go with its amplitude.


@in_style
def draw_backbone(model: Swing | None, decay: Backbone | None, unit: str) -> Figure | None:
    """Return the figure of frequency and damping over amplitude with 90 % bands, or None where there is neither.

    model: of the fitted model's free swing. decay: what the record itself says without a model, of a free decay.
    unit: of the motion, SI.
    """
    if model is None and decay is None:
        return None
    figure, factor = new_figure(3.0), shown_unit(unit)[0]
    left, right = figure.subplots(1, 2)
    for one, color, label in ((decay, GREEN, "decay, no model"), (model, ACCENT, "fitted model")):
        if one is not None:
            at, look = factor * one.amplitude, {"color": color, "label": label}
            _draw_band(left, at, one.frequency_hz, one.frequency_low_hz, one.frequency_high_hz, **look)
            _draw_band(right, at, one.damping_ratio, one.damping_ratio_low, one.damping_ratio_high, **look)
    curves = [one for one in (model, decay) if one is not None]
    _frame(left, [c.frequency_hz for c in curves], 0.01)
    _frame(right, [c.damping_ratio for c in curves], 0.2)
    for axes, letter, label, title in (
        (left, "a", "frequency in Hz", "frequency"),
        (right, "b", "damping ratio", "damping"),
    ):
        axes.set(xlabel=axis_label("amplitude", unit), ylabel=label)
        axes.set_xlim(left=0)
        axes.ticklabel_format(axis="y", useOffset=False)
        note_panel(axes, letter, f"{title} of the free swing")
    left.legend(loc="best")
    return figure


def _draw_band(axes: Axes, at: Array, value: Array, low: Array, high: Array, *, color: str, label: str) -> None:
    axes.fill_between(at, low, high, color=color, alpha=0.2, linewidth=0)
    axes.plot(at, value, color=color, label=label)


def _frame(axes: Axes, values: list[Array], smallest: float) -> None:
    """Show the curves, bands cut where they open; never less than a small share of the value from top to bottom."""
    known = np.concatenate([value[np.isfinite(value)] for value in values])
    low, high = float(known.min()), float(known.max())
    room = max(0.5 * (high - low), smallest * abs(0.5 * (high + low)), 1e-12)
    axes.set_ylim(max(low - room, 0.0) if low > 0 else low - room, high + room)


@in_style
def draw_over_pretension(joint: JointFit) -> Figure:
    """Return the figure of natural frequency and damping ratio of a tendon joint over pretension, with 90 % bars."""
    figure = new_figure(3.0)
    panels = (
        ("natural_frequency_hz", "a", "natural frequency", "frequency in Hz"),
        ("damping_ratio", "b", "damping", "damping ratio"),
    )
    for axes, (name, letter, title, label) in zip(figure.subplots(1, 2), panels, strict=True):
        found = [joint.at_pretension(name, one) for one in joint.pretension_mm]
        value = np.array([one.value for one in found])
        bars = np.abs(np.array([[one.low, one.high] for one in found]).T - value)
        axes.errorbar(
            joint.pretension_mm, value, np.nan_to_num(bars), fmt="o-", color=ACCENT, capsize=2.5, elinewidth=1.0
        )
        axes.set(xlabel="pretension in mm", ylabel=label)
        axes.set_ylim(bottom=0)
        note_panel(axes, letter, title)
    return figure


# A stepped sine is drawn beside its fit: gain and lag over frequency, and the backbone on which the peaks lie.

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
    if not derivative_order(unit) and fit.frame == "relative":
        largest = int(np.argmax([np.max(np.abs(p.response) * p.input_amplitude) for p in fit.points]))
        backbone = backbone_of_response(fit, part=largest)
        left.plot(backbone.frequency_hz, factor * backbone.amplitude, color=GREY, linestyle="--", label="backbone")
    left.set(xlabel="frequency in Hz", ylabel=axis_label("amplitude", unit))
    left.set_ylim(bottom=0)
    right.set(xlabel="frequency in Hz", ylabel="lag in degrees")
    note_panel(left, "a", "steady states and fit")
    note_panel(right, "b", "lag behind the input")
    left.legend(loc="best")
    return figure
