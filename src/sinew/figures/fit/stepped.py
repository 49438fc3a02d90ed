"""A stepped sine beside its fit: gain and lag over frequency, and the backbone on which the peaks lie."""

import numpy as np
from matplotlib.figure import Figure

from sinew.figures.fit.data import axis_label, shown_unit
from sinew.figures.style import ACCENT, GREEN, GREY, INK, MARKERS, RED, in_style, new_figure, note_panel
from sinew.identify.oscillator.record import derivative_order
from sinew.identify.stepped.curves import backbone_of_response, response_curve
from sinew.identify.stepped.fit import ResponseFit
from sinew.solve.curves import wrapped_lag

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
        right.plot(frequency, np.degrees(wrapped_lag(np.conj(response))), color=colour)
        right.plot(points.frequency_hz, np.degrees(wrapped_lag(np.conj(points.response))), **look)
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
