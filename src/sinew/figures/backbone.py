"""This is where frequency and damping are drawn against amplitude: of the model, and of a decay without any model."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.figures.fit_data import axis_label, shown_unit
from sinew.figures.style import ACCENT, GREEN, in_style, new_figure, note_panel
from sinew.identify.decay.backbone import Backbone
from sinew.identify.joint.fit import JointFit
from sinew.identify.oscillator.fitted import Swing
from sinew.measure.arrays import Array


@in_style
def draw_backbone(model: Swing | None, decay: Backbone | None, unit: str, quantity: str = "amplitude") -> Figure | None:
    """Return the figure of frequency and damping over amplitude with 90 % bands, or None where there is neither.

    model: of the fitted model's free swing. decay: what the record itself says without a model, of a free decay.
    unit: of the motion, SI.
    """
    if model is None and decay is None:
        return None
    figure, factor = new_figure(3.0), shown_unit(unit)[0]
    left, right = figure.subplots(1, 2)
    if decay is not None:
        look = {"color": GREEN, "label": "decay, no model"}
        at = factor * decay.amplitude
        _draw_band(left, at, decay.frequency_hz, decay.frequency_low_hz, decay.frequency_high_hz, **look)
        _draw_band(right, at, decay.damping_ratio, decay.damping_ratio_low, decay.damping_ratio_high, **look)
    if model is not None:
        look = {"color": ACCENT, "label": "fitted model"}
        at = factor * model.amplitude
        _draw_band(left, at, model.frequency_hz, model.frequency_low_hz, model.frequency_high_hz, **look)
        _draw_band(right, at, model.damping_ratio, model.damping_ratio_low, model.damping_ratio_high, **look)
    curves = [one for one in (model, decay) if one is not None]
    _frame(left, [c.frequency_hz for c in curves], 0.01)
    _frame(right, [c.damping_ratio for c in curves], 0.2)
    for axes, letter, label, title in (
        (left, "a", "frequency in Hz", "frequency"),
        (right, "b", "damping ratio", "damping"),
    ):
        axes.set(xlabel=axis_label(quantity, unit), ylabel=label)
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
