"""What tests see in a drawn figure: its panels, its lines, its type."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text


def drawn(figure: Figure | None) -> Figure:
    """Return the figure, which must not be left out."""
    assert figure is not None, "the figure is left out"
    return figure


def titled(figure: Figure, text: str) -> Axes:
    """Return the first panel with a text in its title."""
    return next(axes for axes in figure.axes if any(text in axes.get_title(loc=loc) for loc in ("left", "center")))


def labelled(axes: Axes, label: str) -> np.ndarray:
    """Return the points of the line with a label, shape (n, 2)."""
    line = next(line for line in axes.lines if line.get_label() == label)
    return np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float)


def bars(axes: Axes) -> dict[str, np.ndarray]:
    """Return the points of each row of error bars by its label, "" without one: x, value, both ends; shape (n, 4)."""
    found = {}
    for row in axes.containers:
        line, _, (bar, *_) = row.lines
        label, ends = str(row.get_label()), np.array(bar.get_segments())[:, :, 1]
        found["" if label.startswith("_") else label] = np.column_stack([*line.get_data(), ends]).astype(float)
    return found


def smallest_type(figures: Mapping[str, Figure]) -> tuple[float, str, str]:
    """Return the smallest size of type [pt] in the figures, the name of its figure, and what is written so small."""
    return min(
        (float(text.get_fontsize()), name, text.get_text())
        for name, figure in figures.items()
        for text in figure.findobj(Text)
        if text.get_text().strip()
    )
