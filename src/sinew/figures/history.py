"""Change over months as a drawing, and as a page with its table."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from sinew.analysis.history.search import QUANTITIES
from sinew.analysis.history.trend import Trend
from sinew.figures.page import Caption, Table, pictures, write_page
from sinew.figures.style import MARKERS, in_style, new_figure, pretension_colours, save_figure

_MOST_LINES = 12


@in_style
def draw_trends(found: Sequence[Trend]) -> Figure:
    """Return a quantity over dates with 90 % intervals, its lines and their 90 % bands; the first twelve of them."""
    figure = new_figure(3.6)
    axes = figure.subplots()
    shown = found[:_MOST_LINES]
    colours: Any = pretension_colours([one.pretension_mm for one in shown]) if shown else []
    for place, (one, colour) in enumerate(zip(shown, colours, strict=True)):
        dates: Any = np.array([datetime.fromisoformat(at) for at in one.started])
        values = np.array([value.value for value in one.values])
        ends = np.array([[value.value - value.low, value.high - value.value] for value in one.values]).T
        marker = MARKERS[place % len(MARKERS)]
        axes.errorbar(
            dates, values, np.nan_to_num(ends), fmt=marker, ms=3, lw=0.6, color=colour, alpha=0.7, label=one.title
        )
        if one.line is not None:
            days = one.days
            axes.plot(dates, one.line.at(days), color=colour, lw=1.6, zorder=4)
            middle, half = one.line.at(days), one.line.half(days)
            axes.fill_between(dates, middle - half, middle + half, color=colour, alpha=0.2, lw=0)
    about = QUANTITIES[found[0].quantity] if found else None
    if about is not None:
        axes.set_ylabel(about.head(" in "))
        axes.legend(loc="best")
    locator: Any = AutoDateLocator()  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    return figure


def save_trends(found: Sequence[Trend], path: Path) -> None:
    """Write the drawing (.svg, .png, .pdf), or a page with it and every number (.html). Raises FileError."""
    if path.suffix != ".html":
        save_figure(draw_trends(found), path.parent, path.stem, (path.suffix.removeprefix("."),))
        return
    (picture,) = save_figure(draw_trends(found), path.parent, path.stem, ("png",))
    try:
        write_trend_page(path, found, picture)
    finally:
        picture.unlink(missing_ok=True)


def write_trend_page(path: Path, found: Sequence[Trend], picture: Path) -> Path:
    """Write the page of some trends. picture: PNG of the drawing. Raises FileError."""
    sentences = [f"{one.title}: {one.sentence}" for one in found]
    caption = Caption(
        "Over months", "Each run with its 90 % interval; lines with their 90 % bands.", " ".join(sentences)
    )
    return write_page(
        path,
        "prediction.html",
        title="Change over months",
        about=f"{sum(len(one.runs) for one in found)} values of runs.",
        lead=" ".join(sentences),
        tables=[_table(one) for one in found],
        pictures=pictures([picture], {picture.stem: caption}),
        validity=[],
        rebuild="",
        origins=[],
    )


def _table(one: Trend) -> Table:
    about = QUANTITIES[one.quantity]
    head = ["run", "begin", about.head(" in ")]
    rows = [[name, at[:10], str(value)] for name, at, value in zip(one.runs, one.started, one.values, strict=True)]
    return Table(one.title, head, rows, "Value and 90 % interval.")
