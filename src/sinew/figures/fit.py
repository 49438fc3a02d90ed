"""Page of a fitted model, the figure of what its fit leaves, and the corner plot of its parameters."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from sinew.figures.fit_data import (
    Trace,
    axis_label,
    draw_backbone,
    draw_fit,
    draw_over_pretension,
    draw_response_fit,
    parameter_label,
    shown_unit,
    traces_of,
    traces_of_joint,
    value_and_std,
)
from sinew.figures.page import Caption, Table, number, pictures, write_page
from sinew.figures.style import ACCENT, GREY, INK, RED, in_style, new_figure, note_panel
from sinew.identify.identified import Identified, joint_names
from sinew.identify.joint.fit import JointFit
from sinew.identify.oscillator.backbone import Backbone, fit_backbone
from sinew.identify.oscillator.fitted import Fit, number_names, physical_numbers, swing_of
from sinew.identify.oscillator.model import free_mechanics
from sinew.identify.oscillator.record import derivative_order
from sinew.identify.oscillator.start import dominant_omega
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, NORMAL_95, shown, span, typeset
from sinew.mechanics.laws import NUMBERS

# ---- corner plot of what is known of several parameters together: each alone, and each pair


# The parameters of a fit become a cloud: values, covariance and, where there are any, draws.


@dataclass(frozen=True)
class Cloud:
    """What is known of several parameters together.

    names: as in the document, m of them. value: shape (m,). covariance: shape (m, m). draws: shape (d, m), of a
    posterior or a bootstrap, or None. All in the units that the names state.
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array
    draws: Array | None = None

    @property
    def std(self) -> Array:
        """Return the standard deviations: of the draws, else by the covariance, shape (m,)."""
        if self.draws is not None:
            return np.asarray(self.draws.std(axis=0), dtype=float)
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)), dtype=float)

    @property
    def correlation(self) -> Array:
        """Return the correlations: of the draws, else by the covariance, shape (m, m)."""
        matrix = self.covariance if self.draws is None else np.atleast_2d(np.cov(self.draws.T))
        std = np.maximum(np.sqrt(np.maximum(np.diag(matrix), 0.0)), 1e-300)
        return np.asarray(np.clip(matrix / np.outer(std, std), -1.0, 1.0), dtype=float)

    def take(self, kept: Sequence[int]) -> "Cloud":
        """Return some of the parameters. kept: indices, in the order that is wanted."""
        k = list(kept)
        draws = None if self.draws is None else self.draws[:, k]
        return Cloud(tuple(self.names[i] for i in k), self.value[k], self.covariance[np.ix_(k, k)], draws)

    def drawn(self, names: Sequence[str], draws: ArrayLike) -> "Cloud":
        """Return the same parameters by draws, shape (d, n), of numbers of these names; those drawn in no way left out.

        The value becomes the median of the draws.
        """
        found = np.asarray(draws, dtype=float)
        mine = [i for i, name in enumerate(self.names) if name in names]
        chosen = found[:, [list(names).index(self.names[i]) for i in mine]]
        return replace(self.take(mine), value=np.median(chosen, axis=0), draws=chosen)


def cloud_of(fit: Fit) -> Cloud:
    """Return the mechanical parameters of a fit, in full where the inertia is known, else over the inertia.

    Numbers with an infinite variance are left out.
    """
    every, x = number_names(fit), fit.solution.values
    mechanical = free_mechanics(fit.model, fit.layout.parts[0].record)
    count = sum(entry.local in mechanical for entry in fit.layout.entries)
    without = tuple(name for name, number in NUMBERS.items() if not number.force)
    # `Fit.parameters` holds the numbers over the inertia first, then those in full where the inertia is known.
    over, full = every[:count], every[count : len(fit.parameters)]
    names = (*full, *(name for name in over if name.startswith(without))) if full else over
    steps = 1e-6 * np.maximum(np.abs(x), 1e-3)
    ends = [physical_numbers(fit, x + sign * np.diag(steps)) for sign in (1.0, -1.0)]
    slope = ((ends[0] - ends[1]) / (2.0 * steps[:, None])).T[[every.index(name) for name in names]]
    known = np.isfinite(np.diag(fit.covariance.matrix))
    matrix = slope[:, known] @ fit.covariance.matrix[np.ix_(known, known)] @ slope[:, known].T
    value = np.array([fit.parameters[name].value for name in names])
    told = [i for i in range(len(names)) if not slope[i, ~known].any() and matrix[i, i] > 0]
    return Cloud(tuple(names), value, matrix).take(told)


_SHARES = (0.5, 0.9)
_REACH = 3.2  # standard deviations on the axes
_MOST = 6
_BINS = 34
_LINE = 14  # characters


@in_style
def draw_corner(cloud: Cloud) -> Figure | None:
    """Return the corner plot of a cloud, or None where fewer than two parameters are known.

    On the diagonal the distribution of each parameter, below it the regions that hold 50 % and 90 % of each pair, above
    it the correlations. Axes count standard deviations from the value in the title. Draws make histograms and regions
    of highest density, a covariance makes normal distributions and ellipses. Of more than six parameters the first six
    are drawn.
    """
    cloud = cloud.take(range(min(len(cloud.names), _MOST)))
    m = len(cloud.names)
    if m < 2:
        return None
    figure = new_figure(0.6 + 1.15 * m)
    grid = figure.subplots(m, m, squeeze=False)
    for row in range(m):
        for column in range(m):
            axes = grid[row, column]
            if column > row:
                axes.axis("off")
                told = f"ρ = {cloud.correlation[row, column]:.2f}".replace("-", "−")
                axes.text(0.5, 0.5, told, ha="center", va="center", color=INK, transform=axes.transAxes)
                continue
            if row == column:
                _draw_alone(axes, cloud, row)
            else:
                _draw_pair(axes, cloud, column, row)
            _name_axes(axes, cloud, row, column)
    figure.supxlabel("standard deviations from the value", fontsize=8.5)
    return figure


def _name_axes(axes: Axes, cloud: Cloud, row: int, column: int) -> None:
    last, ticks = len(cloud.names) - 1, (-2, 0, 2)
    axes.set_xlim(-_REACH, _REACH)
    axes.set_xticks(ticks)
    axes.grid(visible=False)
    if row == column:
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
    else:
        axes.set_ylim(-_REACH, _REACH)
        axes.set_yticks(ticks)
    axes.tick_params(labelbottom=row == last, labelleft=column == 0 and row > 0)
    if row == last:
        axes.set_xlabel(_words(cloud.names[column]))
    if column == 0 and row > 0:
        axes.set_ylabel(_words(cloud.names[row]))


def _words(name: str) -> str:
    """Return what a parameter is called in lines short enough for a panel, a rig's without its section."""
    return textwrap.fill(parameter_label(name.rpartition(".")[2])[0], _LINE)


def _off(cloud: Cloud, k: int) -> Array:
    """Return the draws of one parameter in standard deviations from its value, shape (d,)."""
    assert cloud.draws is not None
    return np.asarray((cloud.draws[:, k] - cloud.value[k]) / cloud.std[k])


def _draw_alone(axes: Axes, cloud: Cloud, k: int) -> None:
    words, unit = _words(cloud.names[k]), parameter_label(cloud.names[k])[1]
    value, spread = value_and_std(float(cloud.value[k]), float(cloud.std[k])).split(" ± ")
    axes.set_title(f"{words}\n{value} {unit}".rstrip() + f"\n± {spread}", loc="center", fontsize=8.0)
    if cloud.draws is not None:
        off = _off(cloud, k)
        axes.hist(off, bins=_BINS, range=(-_REACH, _REACH), color=ACCENT, alpha=0.45)
        ends = np.quantile(off, [0.05, 0.95])
    else:
        fine = np.linspace(-_REACH, _REACH, 161)
        bell, ends = np.exp(-0.5 * fine**2), np.array([-NORMAL_90, NORMAL_90])
        axes.plot(fine, bell, color=ACCENT)
        inside = np.abs(fine) <= NORMAL_90
        axes.fill_between(fine[inside], 0, bell[inside], color=ACCENT, alpha=0.25, linewidth=0)
    for end in ends:
        axes.axvline(float(end), color=GREY, linestyle=":", linewidth=0.9)
    axes.set_ylim(bottom=0)


def _draw_pair(axes: Axes, cloud: Cloud, x: int, y: int) -> None:
    if cloud.draws is None:
        pair = cloud.correlation[np.ix_([x, y], [x, y])]
        for share, alpha in zip(_SHARES[::-1], (0.22, 0.45), strict=True):
            axes.fill(*ellipse(pair, share), color=ACCENT, alpha=alpha, linewidth=0)
    else:
        right, up = _off(cloud, x), _off(cloud, y)
        density, edges, _ = np.histogram2d(right, up, bins=_BINS, range=[[-_REACH, _REACH]] * 2)
        smooth = _smoothed(density)
        levels = sorted({_level(smooth, share) for share in _SHARES})
        axes.plot(right, up, ".", color=GREY, markersize=1.0, alpha=0.35, rasterized=True)
        if smooth.max() > levels[-1]:
            middle = 0.5 * (edges[1:] + edges[:-1])
            shades = [to_rgba(ACCENT, alpha) for alpha in (0.3, 0.55)[-len(levels) :]]
            axes.contourf(middle, middle, smooth.T, levels=[*levels, float(smooth.max())], colors=shades)
    axes.plot(0, 0, "+", color=INK, markersize=6)


def ellipse(covariance: Array, share: float) -> Array:
    """Return the outline of the ellipse that holds a share of a normal distribution about zero, shape (2, 121).

    covariance: shape (2, 2). Its squared radius in standard deviations is -2 ln(1 - share) (chi square, two degrees).
    """
    size, turned = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    circle = np.sqrt(-2.0 * np.log1p(-share)) * np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(turned @ (np.sqrt(np.maximum(size, 0.0))[:, None] * circle))


def _smoothed(density: Array) -> Array:
    """Return a histogram smoothed by a short bell along both axes, so that its outlines do not fray."""
    bell = np.exp(-0.5 * (np.arange(-4, 5) / 1.3) ** 2)
    bell /= bell.sum()
    for axis in (0, 1):
        density = np.apply_along_axis(lambda row: np.convolve(row, bell, mode="same"), axis, density)
    return density


def _level(density: Array, share: float) -> float:
    """Return the density above which a share of all lies."""
    falling = np.sort(density.ravel())[::-1]
    inside = np.searchsorted(np.cumsum(falling), share * falling.sum())
    return float(falling[min(int(inside), falling.size - 1)])


# Each figure of an identification gets its words.

# ---- the page, and what the fit leaves


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
        "it. (c) Size of the residuals in each period against the amplitude there: a trend means a law that depends on "
        "amplitude. (d) Their distribution beside a normal one of the same spread.",
        "Four panels: residuals over time, autocorrelation with band, size over amplitude, histogram.",
    ),
    "corner": Caption(
        "What is known of the parameters together",
        "On the diagonal each parameter alone, 90 % between the dotted lines; below it the regions that hold 50 % and "
        "90 % of each pair, above it the correlation. A narrow slanting region means that the record tells a "
        "combination of the two better than either. Axes count standard deviations from the value in the title.",
        "A triangle of panels: distributions of the parameters on the diagonal, regions of pairs below it.",
    ),
    "backbone": Caption(
        "Backbone",
        "Damped frequency and damping ratio of the free swing against its amplitude, with pointwise 90 % bands. Blue: "
        "the fitted model's. Green, where the record is a free decay: from the decay itself, without a model of the "
        "joint. A curve that leaves the other's band speaks against the model.",
        "Frequency and damping ratio over amplitude, each a line with a band.",
    ),
    "response": Caption(
        "Steady states and fit",
        "(a) Amplitude of the output at each frequency, one colour a level of the drive: markers as measured, lines "
        "the fitted model's, through their folds where there are any; dashed the backbone, on which the motion lags "
        "the drive's force by 90°. (b) Lag of the output behind the input.",
        "Two panels over frequency: amplitude with points, curves and backbone, and lag.",
    ),
    "pretension": Caption(
        "Frequency and damping over pretension",
        "Natural frequency and damping ratio of the fitted joint at each pretension of the recording, at the amplitude "
        "it swung with; bars are 90 % intervals.",
        "Natural frequency and damping ratio over pretension with bars.",
    ),
}
"""By the name of the figure's files, in the order of the page."""


_HEAD = ["quantity", "unit", "value ± std", "90 % interval"]
_NOTES = {
    "posterior": "From the draws: median, standard deviation, and the 5 % and 95 % quantiles.",
    "bootstrap": "From refitting draws of whole repeats: what changes from one repeat to the next is in these.",
    "profile": "It ends where the smallest sum of squares, all other numbers fitted anew, has risen by the 90 % limit.",
}


def write_fit_page(
    folder: Path,
    document: Mapping[str, Any],
    *,
    sentences: Sequence[str],
    figures: Sequence[Path] = (),
    about: str = "",
    rebuild: str = "",
    origins: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write fit.html into a folder, atomically, and return its path.

    document: of `sinew identify`, see the reference of its JSON. sentences: the first is the verdict. figures: the PNGs
    among them are put into the page. about: what was fitted, a sentence. rebuild: the command that makes all of this
    again. origins: (name, value) of what it was made from.
    Raises FileError where the folder cannot be written.
    """
    return write_page(
        folder / "fit.html",
        "fit.html",
        title="Identification",
        about=about,
        verdict=_sentence(sentences[0]) if sentences else "",
        converged=bool(document["converged"]),
        tables=_tables(document),
        compared=document["compared"],
        rmse=document["rmse"],
        unit=document["unit"],
        sentences=[_sentence(one) for one in sentences[1:]],
        unidentifiable=[_sentence(one) for one in document["unidentifiable"]],
        pictures=pictures(figures, FIT_CAPTIONS),
        rebuild=rebuild,
        origins=list(origins),
    )


def _tables(document: Mapping[str, Any]) -> list[Table]:
    whole = {name: document[name] for name in ("natural_frequency_hz", "damping_ratio")} | dict(document["parameters"])
    note = "Standard deviations and intervals hold for residuals as coloured as they are."
    tables = [Table(f"Model {document['model']}", _HEAD, _rows(whole), note)]
    for key, text in _NOTES.items():
        rows = document.get(key)
        if rows:
            found = {name: one for name, one in rows.items() if isinstance(one, Mapping) and "interval90" in one}
            if found:
                tables.append(Table(key.capitalize(), _HEAD, _rows(found), text))
    for peak in document.get("peaks", ()):
        rows = _rows({name: one for name, one in peak.items() if name != "input_amplitude"})
        tables.append(Table(f"Peak at a drive of {number(peak['input_amplitude'], 3)}", _HEAD, rows, ""))
    return tables


def _rows(quantities: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    rows = []
    for name, one in quantities.items():
        words, unit = parameter_label(name)
        rows.append([words, unit, typeset(shown(one)), typeset(span(*(one["interval90"] or (None, None))))])
    return rows


def _sentence(text: str) -> str:
    """Return a sentence as print has it, from one that begins small and ends without a full stop."""
    whole = text[:1].upper() + text[1:]
    return whole if whole.endswith((".", "?", "!")) else f"{whole}."


# What a fit leaves: over time, its spectrum, and over the inputs.

_PERIODS = 2.0
_FEWEST_LAGS, _MOST_LAGS = 20, 400
_DOTTED = 80  # lags up to which each gets a dot


@in_style
def draw_residuals(traces: Sequence[Trace], frequency_hz: float) -> Figure:
    """Return the figure of measured less fitted.

    traces: of a fit, several segments one behind the other. frequency_hz: whose period makes lags and blocks.
    The autocorrelation and the histogram are of the fitted samples, held-out ones are drawn in another colour.
    """
    figure = new_figure(4.6)
    (over, lags), (against, spread) = figure.subplots(2, 2)
    _draw_over_time(over, traces)
    _draw_lags(lags, traces, frequency_hz)
    _draw_amplitudes(against, traces, frequency_hz)
    _draw_histogram(spread, traces)
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


def _draw_amplitudes(axes: Axes, traces: Sequence[Trace], frequency_hz: float) -> None:
    factor, size = shown_unit(traces[0].unit)[0], max(4, round(1.0 / frequency_hz / _step(traces)))
    for held, colour in ((False, ACCENT), (True, RED)):
        points = [point for trace in traces for point in _blocks(trace, size, held)]
        if points:
            axes.plot(*(factor * np.array(points)).T, "o", color=colour, markersize=3.0, alpha=0.6, markeredgewidth=0)
    axes.set_xlabel(axis_label("amplitude of the output", traces[0].unit))
    axes.set_ylabel(axis_label("rms of residuals", traces[0].unit))
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    note_panel(axes, "c", "against amplitude, each period a point")


def _blocks(trace: Trace, size: int, held: bool) -> list[tuple[float, float]]:
    """Return (amplitude of the output, rms of the residuals) of every whole period that is all held out, or not."""
    found = []
    for begin in range(0, trace.time_s.size - size + 1, size):
        block = slice(begin, begin + size)
        if np.all(trace.held[block] == held):
            rms = float(np.sqrt(np.mean(trace.residual[block] ** 2)))
            found.append((float(np.sqrt(2.0) * trace.measured[block].std()), rms))
    return found


def _draw_histogram(axes: Axes, traces: Sequence[Trace]) -> None:
    factor = shown_unit(traces[0].unit)[0]
    values = factor * np.concatenate([trace.residual[~trace.held] for trace in traces])
    count, edges, _ = axes.hist(values, bins=int(np.clip(np.sqrt(values.size), 8, 40)), color=ACCENT, alpha=0.45)
    mean, std = float(values.mean()), float(values.std())
    fine = np.linspace(mean - 4 * std, mean + 4 * std, 200)
    width = float(edges[1] - edges[0])
    bell = values.size * width * np.exp(-0.5 * ((fine - mean) / max(std, 1e-300)) ** 2) / max(std, 1e-300)
    axes.plot(fine, bell / np.sqrt(2 * np.pi), color=INK, linewidth=1.1, label="normal, same spread")
    axes.set_ylim(top=1.25 * max(float(np.max(count)), float(bell.max() / np.sqrt(2 * np.pi))))
    axes.set_xlabel(axis_label("measured less fitted", traces[0].unit))
    axes.set_ylabel("samples")
    axes.legend(loc="upper right", borderaxespad=0.1)
    note_panel(axes, "d", "distribution")


# An identification's figures.


def draw_identified(found: Identified) -> dict[str, Figure]:
    """Return the figures of an identification, by name: those of `FIT_CAPTIONS` that it has."""
    drawn = _joint_figures(found.joint) if found.joint is not None else {}
    if found.fit is not None:
        drawn = _fit_figures(found, found.fit)
    if found.response is not None:
        drawn = {"response": draw_response_fit(found.response)}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _fit_figures(found: Identified, fit: Fit) -> dict[str, Figure | None]:
    record = fit.records[0]
    frequency = fit.natural_frequency_hz.value
    if not math.isfinite(frequency):
        frequency = dominant_omega(record) / (2 * math.pi)
    traces = traces_of(fit, found.split, found.held_out)
    cloud = cloud_of(fit)
    if found.posterior is not None:
        cloud = cloud.drawn(found.posterior.names, found.posterior.draws)
    return {
        "fit_data": draw_fit(traces, frequency),
        "residuals": draw_residuals(traces, frequency),
        "corner": draw_corner(cloud),
        "backbone": draw_backbone(swing_of(fit), _decay(fit), record.motion_unit),
    }


def _decay(fit: Fit) -> Backbone | None:
    """Return the backbone of the first free decay without a model, or None where the record is none."""
    record = fit.records[0]
    if record.input is not None or derivative_order(record.output_unit):
        return None
    try:
        return fit_backbone(record.time_s, record.output)
    except RecordingError:
        return None


def _joint_figures(joint: JointFit) -> dict[str, Figure | None]:
    traces = traces_of_joint(joint)
    first = joint.at_pretension("natural_frequency_hz", joint.pretension_mm[0]).value
    count = len(joint.parameters)
    value = np.array([one.value for one in joint.parameters.values()])
    cloud = Cloud(joint_names(joint), value, joint.covariance.matrix[:count, :count])
    kept = [k for k in range(count) if np.isfinite(cloud.covariance[k, k]) and cloud.covariance[k, k] > 0]
    pretension = draw_over_pretension(joint) if len(joint.pretension_mm) > 1 else None
    return {
        "fit_data": draw_fit(traces, first, "rate"),
        "residuals": draw_residuals(traces, first),
        "corner": draw_corner(cloud.take(kept)),
        "pretension": pretension,
    }
