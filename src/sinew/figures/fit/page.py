"""Page of a fitted model, and the figure of what its fit leaves."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.fit.corner import Cloud, cloud_of, draw_corner
from sinew.figures.fit.data import (
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
)
from sinew.figures.page import Caption, Table, number, pictures, write_page
from sinew.figures.style import ACCENT, GREY, INK, RED, in_style, new_figure, note_panel
from sinew.identify.identified import Identified, joint_names
from sinew.identify.joint.fit import JointFit
from sinew.identify.oscillator.backbone import Backbone, fit_backbone
from sinew.identify.oscillator.fitted import Fit, swing_of
from sinew.identify.oscillator.record import derivative_order
from sinew.identify.oscillator.start import dominant_omega
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_95

# Each figure of an identification gets its words.

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


_HEAD = ["quantity", "unit", "value", "standard deviation", "90 % from", "to"]
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
        low, high = one["interval90"] or (None, None)
        rows.append([words, unit, number(one["value"], 5), number(one["std"], 2), number(low, 5), number(high, 5)])
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
