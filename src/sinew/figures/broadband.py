"""The frequency response of a broadband record: gain by H1 and H2, lag and coherence, with the modes in them."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sinew.figures.style import ACCENT, GREY, INK, RED, in_style, new_figure, note_panel
from sinew.measure.arrays import Array
from sinew.measure.estimate import shown


@in_style
def draw_broadband(document: dict[str, Any]) -> Figure:
    """Return gain, lag and coherence over frequency, one above the other.

    document: of `sinew analyse --kind broadband` (`broadband_json`).
    """
    figure = new_figure(5.6)
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.6, 1.2, 0.8))
    drawn = (draw_lines, draw_lag_lines, draw_coherence)
    for axes, letter, title, draw in zip(panels, "abc", ("gain", "lag", "coherence"), drawn, strict=True):
        draw(axes, document)
        note_panel(axes, letter, title)
        if axes is not panels[-1]:
            axes.set_xlabel("")
    return figure


def draw_lines(axes: Axes, document: dict[str, Any]) -> Axes:
    """Draw |H1| with its 90 % interval, |H2|, and the gain of the fitted modes."""
    frequency, fitted = (_column(document, key) for key in ("frequency_hz", "fitted_gain"))
    axes.plot(frequency, _column(document, "gain_h2"), color=GREY, linewidth=0.9, label="H2")
    gain = _banded(axes, document, "gain", "H1")
    axes.plot(frequency, fitted, color=RED, linewidth=1.1, label="modes")
    for k, mode in enumerate(document["modes"]):
        natural = mode["natural_frequency_hz"]["value"]
        axes.axvline(natural, color=INK, linewidth=0.8, linestyle=":")
        words = f"{shown(mode['natural_frequency_hz'], 'Hz')}, D = {shown(mode['damping_ratio'])}"
        axes.annotate(words, (natural, 0.02 + 0.1 * k), (3, 0), ("data", "axes fraction"), "offset points", va="bottom")
    known = gain[_coherent(document)]
    pair = (str(document["response_unit"]), str(document["drive_unit"]))
    units = [f"({unit})" if "*" in unit or "/" in unit else unit for unit in pair]
    same = "" if units[0] == units[1] else f" in {'/'.join(units)}"
    axes.set(ylabel=f"response / drive{same}", yscale="log", ylim=(0.1 * known.min(), 3.0 * known.max()))
    axes.legend(loc="upper right", ncols=3)
    return _over_frequency(axes, document)


def draw_lag_lines(axes: Axes, document: dict[str, Any]) -> Axes:
    """Draw the lag of the response behind the drive by H1, with its 90 % interval, and that of the modes."""
    _banded(axes, document, "phase_lag_deg", "H1")
    lag = _column(document, "fitted_phase_lag_deg")
    axes.plot(_column(document, "frequency_hz"), _unbroken(lag), color=RED, linewidth=1.1, label="modes")
    axes.set(ylabel="lag in degrees", yticks=np.arange(-90, 271, 90), ylim=(-100, 280))
    return _over_frequency(axes, document)


def draw_coherence(axes: Axes, document: dict[str, Any]) -> Axes:
    """Draw the coherence, and the band in which modes were sought."""
    axes.axvspan(*document["band_hz"], color=GREY, alpha=0.15, linewidth=0, label="band of the modes")
    axes.plot(_column(document, "frequency_hz"), _column(document, "coherence"), color=ACCENT, label="γ²")
    axes.set(ylabel="coherence γ²", ylim=(0, 1.05))
    return _over_frequency(axes, document)


def _coherent(document: dict[str, Any]) -> NDArray[np.bool_]:
    """Return which lines are worth seeing: those of the band, and where half the response is due to the drive."""
    frequency, (low, high) = _column(document, "frequency_hz"), document["band_hz"]
    return np.asarray((_column(document, "coherence") > 0.5) | ((frequency >= low) & (frequency <= high)))


def _over_frequency(axes: Axes, document: dict[str, Any]) -> Axes:
    last = float(_column(document, "frequency_hz")[_coherent(document)].max())
    axes.set(xlabel="frequency in Hz", xlim=(0.0, 1.1 * last))
    return axes


def _column(document: dict[str, Any], key: str) -> Array:
    """Return one plain number of each line, NaN where it is not known, shape (f,)."""
    return np.array([np.nan if row[key] is None else row[key] for row in document["frequency_response"]], dtype=float)


def _banded(axes: Axes, document: dict[str, Any], key: str, label: str) -> Array:
    rows = document["frequency_response"]
    ends = np.array([row[key]["interval90"] for row in rows], dtype=float)
    value = np.array([row[key]["value"] for row in rows], dtype=float)
    frequency = _column(document, "frequency_hz")
    axes.fill_between(frequency, ends[:, 0], ends[:, 1], color=ACCENT, alpha=0.25, linewidth=0)
    axes.plot(frequency, _unbroken(value) if key == "phase_lag_deg" else value, color=ACCENT, label=label)
    return value


def _unbroken(lag: Array) -> Array:
    """Return lags [deg] with a gap where they jump by a turn."""
    jumps = np.abs(np.diff(lag, prepend=lag[:1])) > 180
    return np.where(jumps, np.nan, lag)
