"""Single plots for a notebook: each takes a result and `ax`, one matplotlib axes, draws on it, and returns it.

Each is one panel. Without `ax` it makes a figure of its own. What is laid over one another stands on the same axes: a
prediction over a measurement is `sn.plot.prediction(predicted, sn.plot.response(analysed))`.

>>> import sinew as sn
>>> from matplotlib.figure import Figure
>>> axes = sn.plot.prediction(sn.predict("paper", 4, band_hz=(2.5, 4)), Figure().subplots())
>>> axes.get_xlabel()
'drive frequency in Hz'
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from sinew.analysis.analysed import analyse_recording
from sinew.analysis.results import Analysed, SpectrumResult
from sinew.figures.decay import draw_envelope
from sinew.figures.predicted import curves_of, draw_gains, draw_levels, draw_phases
from sinew.figures.response import draw_coherence, draw_gain, draw_lag, draw_lag_lines, draw_lines
from sinew.figures.style import ACCENT, GREY, INK, RED, in_style
from sinew.identify.forced import Forced
from sinew.measure.errors import RecordingError, SpecError
from sinew.predict.predicted import Predicted

if TYPE_CHECKING:
    from sinew.identify.identified import Identified
    from sinew.tune.pretension import Tuning


@in_style
def response(found: Analysed | xr.Dataset, ax: Axes | None = None) -> Axes:
    """Return axes with the gain over frequency: means with ±1 standard deviation, peaks marked, by pretension.

    Of a broadband record, and of hammer blows, H1 and H2 with the fitted modes.
    """
    return _over_frequency(found, ax, draw_lines, draw_gain)


@in_style
def phase(found: Analysed | xr.Dataset, ax: Axes | None = None) -> Axes:
    """Return axes with the lag of the torsion behind the drive over frequency [deg], by pretension."""
    return _over_frequency(found, ax, draw_lag_lines, draw_lag)


def _over_frequency(
    found: Analysed | xr.Dataset,
    ax: Axes | None,
    lines: Callable[[Axes, dict[str, Any]], Axes],
    sweep: Callable[[Axes, xr.Dataset], Axes],
) -> Axes:
    if isinstance(found, SpectrumResult):
        return lines(_axes(ax), found.to_dict())
    results = _sweep(found)
    return sweep(_axes(ax), results)


@in_style
def coherence(found: Analysed, ax: Axes | None = None) -> Axes:
    """Return axes with the coherence of a broadband record, or of several hammer blows, over frequency."""
    if not isinstance(found, SpectrumResult):
        raise RecordingError("there is no coherence to draw; it is of a broadband record or of hammer blows")
    return draw_coherence(_axes(ax), found.to_dict())


@in_style
def resonance(found: Analysed | xr.Dataset, ax: Axes | None = None) -> Axes:
    """Return axes with the resonance over pretension, with 90 % intervals."""
    results, axes = _sweep(found), _axes(ax)
    if "resonance_hz" not in results:
        raise RecordingError("there are too few frequencies for a resonance; measure more")
    value = results["resonance_hz"].values
    pretension = results["pretension_mm"].values
    ends = np.stack([value - results["resonance_low_hz"].values, results["resonance_high_hz"].values - value])
    axes.errorbar(pretension, value, np.nan_to_num(np.maximum(ends, 0.0)), color=ACCENT, marker="o")
    axes.set(xlabel="pretension in mm", ylabel="resonance in Hz")
    return axes


@in_style
def decay(found: Analysed, ax: Axes | None = None, pretension_mm: float = 0.0) -> Axes:
    """Return axes with the ring-down closest to a pretension [mm], its peaks and envelope, with the paper's numbers."""
    results = analyse_recording(found.recording) if found.dataset is None else found.dataset
    axes = _axes(ax)
    if not draw_envelope(axes, found.recording, results, pretension_mm):
        raise RecordingError("there is no ring-down to draw; record one, or draw the response")
    return axes


@in_style
def prediction(found: Predicted | Forced, ax: Axes | None = None) -> Axes:
    """Return axes with the predicted gain over frequency: dotted where unstable, rings at peaks, diamonds at folds.

    Of a fit the amplitude at every level of its drive, with 90 % bands.
    """
    if isinstance(found, Forced):
        return draw_levels(_axes(ax), found)
    return draw_gains(_axes(ax), curves_of(found))


@in_style
def predicted_phase(found: Predicted, ax: Axes | None = None) -> Axes:
    """Return axes with the predicted lag of the torsion behind the lever over frequency [deg]."""
    return draw_phases(_axes(ax), curves_of(found))


@in_style
def fit(found: "Identified", ax: Axes | None = None) -> Axes:
    """Return axes with the first record of a fit over time: measured, fitted, and what is left."""
    if found.fit is None:
        raise SpecError("this is the fit of a whole tendon joint; draw one of one degree of freedom")
    axes, record, fitted = _axes(ax), found.fit.records[0], found.fit.predicted[0]
    axes.plot(record.time_s, record.output, color=GREY, linewidth=2.0, label="measured")
    axes.plot(record.time_s, fitted, color=ACCENT, linewidth=1.0, label="fitted")
    axes.plot(record.time_s, record.output - fitted, color=RED, linewidth=0.8, label="left")
    axes.set(xlabel="time in s", ylabel="output" if record.output_unit == "1" else f"output in {record.output_unit}")
    axes.legend()
    return axes


@in_style
def tuning(found: "Tuning", ax: Axes | None = None) -> Axes:
    """Return axes with the resonance over pretension that a rig can be tuned to, and the settings with intervals."""
    axes, curve = _axes(ax), found.range.resonances
    axes.plot([one.pretension_mm for one in curve], [one.frequency_hz for one in curve], color=GREY)
    for one in found.settings:
        if one.pretension_mm is not None and one.frequency_hz is not None:
            at, where = one.pretension_mm, one.frequency_hz.value
            if math.isfinite(at.high - at.low):
                axes.plot([at.low, at.high], [where, where], color=ACCENT)
            axes.plot(at.value, where, "o", color="white", markeredgecolor=INK, zorder=5)
    axes.set(xlabel="pretension in mm", ylabel="resonance in Hz")
    return axes


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot  # a window or a notebook's cell; whoever gives axes does without

    return pyplot.subplots(layout="constrained")[1]


def _sweep(found: Analysed | xr.Dataset) -> xr.Dataset:
    results = found.dataset if isinstance(found, Analysed) else found
    if results is None or "gain" not in results:
        raise RecordingError("there is no sweep to draw; measure one, or draw the decay")
    return results
