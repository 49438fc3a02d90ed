"""The look of all figures: sizes, type, colours, markers, and how they reach a file.

Figures are made for print: 180 mm wide (two columns), type of at least 8 points, no mathtext. Pretension and drive
frequency each have one sequential colour map, even in lightness, so that they survive grey printing and colour
blindness; both are cut before they become too light for white paper.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from sinew.measure.validation import write_atomically

WIDTH_IN = 7.1
INK, GREY, ACCENT, RED, GREEN = "#1a1a1a", "#8c8c8c", "#0b5fa5", "#c1272d", "#1b7f3b"
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

_STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#4d4d4d",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.color": "#4d4d4d",
    "ytick.color": "#4d4d4d",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "figure.dpi": 100.0,
    "pdf.fonttype": 42,
    "path.simplify_threshold": 0.3,
}
_DPI = 180

P = ParamSpec("P")
R = TypeVar("R")


def styled() -> AbstractContextManager[None]:
    """Return a context in which matplotlib draws in our style."""
    return mpl.rc_context(cast(Any, _STYLE))


def in_style(function: Callable[P, R]) -> Callable[P, R]:
    """Return the function, run in our style."""

    @functools.wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        with styled():
            return function(*args, **kwargs)

    return wrapped


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """Return an empty figure, two columns wide, that arranges its axes by itself."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


@functools.cache
def _cut(name: str) -> ListedColormap:
    return ListedColormap(mpl.colormaps[name](np.linspace(0.0, 0.8, 256)), name=f"{name}-cut")


def frequency_map() -> ListedColormap:
    """Return the colour map of drive frequency."""
    return _cut("plasma")


def pretension_colours(pretension_mm: ArrayLike) -> NDArray[np.float64]:
    """Return one colour (p, rgba) for each pretension, dark to light as pretension rises."""
    return _coloured(_cut("viridis"), pretension_mm)


def frequency_colours(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """Return one colour (f, rgba) for each drive frequency, dark to light as frequency rises."""
    return _coloured(frequency_map(), frequency_hz)


def _coloured(colours: ListedColormap, of: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(of, dtype=float)
    return np.asarray(colours(Normalize(values.min(), max(values.max(), values.min() + 1e-9))(values)))


def pretension_bar(figure: Figure, axes: Sequence[Axes], pretension_mm: ArrayLike) -> None:
    """Add the key from colour to pretension, one step for each measured pretension, right of the axes."""
    values = np.unique(np.asarray(pretension_mm, dtype=float))
    if values.size < 2:
        return
    middles = (values[:-1] + values[1:]) / 2
    edges = np.concatenate([[2 * values[0] - middles[0]], middles, [2 * values[-1] - middles[-1]]])
    colours = ListedColormap(pretension_colours(values))
    mappable = ScalarMappable(BoundaryNorm(edges, values.size), colours)
    bar = figure.colorbar(mappable, ax=list(axes), label="pretension in mm", aspect=32, pad=0.015, fraction=0.035)
    bar.set_ticks(list(values[few(values.size, 13)]))
    bar.ax.minorticks_off()
    bar.ax.tick_params(length=0)
    bar.outline.set_visible(False)


def few(count: int, at_most: int) -> NDArray[np.int64]:
    """Return at most so many indices into `count` entries, first and last among them.

    They are evenly spread where that leaves two thirds of `at_most` or more, else as evenly as rounding allows.
    """
    if count <= at_most:
        return np.arange(count)
    for size in range(at_most, max(2, 2 * at_most // 3 - 1), -1):
        if (count - 1) % (size - 1) == 0:
            return np.arange(0, count, (count - 1) // (size - 1))
    return np.unique(np.linspace(0, count - 1, at_most).round().astype(np.int64))


def note_panel(axes: Axes, letter: str, text: str) -> None:
    """Give a panel its letter and its title."""
    axes.set_title(f"({letter}) {text}" if letter else text)


def save_figure(figure: Figure, folder: Path, stem: str, formats: Sequence[str]) -> list[Path]:
    """Write a figure once for each format and return the paths. Raises FileError where the folder cannot be written."""
    paths = [folder / f"{stem}.{name}" for name in formats]
    with styled():
        figure.set_dpi(_DPI)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)  # once, for all files; `savefig` draws the figure a second time for each
        figure.set_layout_engine("none")
        for path, name in zip(paths, formats, strict=True):
            canvas = get_registered_canvas_class(name)(figure)
            metadata = {"CreationDate": None} if name == "pdf" else None
            write_atomically(path, functools.partial(getattr(canvas, f"print_{name}"), metadata=metadata))
    return paths


def save_figures(figures: Iterable[tuple[str, Figure]], folder: Path, formats: Sequence[str]) -> list[Path]:
    """Write (stem, figure) of each, drawn one after the other, and return the paths in their order.

    Raises FileError where the folder cannot be written.
    """
    return [path for stem, figure in figures for path in save_figure(figure, folder, stem, formats)]
