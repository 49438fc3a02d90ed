"""The small campaign recorded, analysed and drawn, once for all tests of a process."""

import functools

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tests.unit.figures_panels import titled
from tests.unit.figures_sample import SMALL, sample_recording, sample_results

from sinew.paper.report import build_figures


@functools.cache
def recording() -> xr.Dataset:
    """Return the recording; not to be changed."""
    return sample_recording(*SMALL)


@functools.cache
def results() -> xr.Dataset:
    """Return the results; not to be changed."""
    return sample_results(*SMALL)


@functools.cache
def figures() -> dict[str, Figure]:
    """Return every figure of the campaign by its name."""
    return dict(build_figures(recording(), results()))


def panel(name: str, text: str) -> Axes:
    """Return the first panel of a figure with a text in its title."""
    return titled(figures()[name], text)
