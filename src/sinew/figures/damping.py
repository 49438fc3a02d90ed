"""This is where Figure 10 is drawn: damping over pretension, and each decay under its linear model."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from sinew.figures.decay import about_rest, linear_decay
from sinew.figures.motion import Group, groups_of, nearest, released_motion
from sinew.figures.spread import mean_and_spread
from sinew.figures.style import ACCENT, GREEN, GREY, INK, Floats, few, in_style, new_figure, note_panel

__all__ = ["draw_damping"]

_WINDOW_S = 2.5


@in_style
def draw_damping(recording: xr.Dataset, results: xr.Dataset, at_most: int = 7) -> Figure | None:
    """Return Figure 10 of the paper, or None with ring-downs at fewer than two pretensions.

    Above: λ, ⟨ω⟩ and D over pretension, mean ± standard deviation over repeats, by the paper's method and by the
    direct time-domain fit. Below: decays of the first repeat with the linear model (Eq. 2) of the same λ and ⟨ω⟩.
    """
    if "paper_decay_rate_per_s" not in results:
        return None
    known = np.flatnonzero(np.isfinite(results["paper_decay_rate_per_s"].values).any(axis=1))
    groups = groups_of(recording, "ring-down")
    if known.size < 2 or not groups:
        return None
    here = results.isel(pretension_mm=known)
    figure = new_figure(5.4)
    above, below = np.ravel(figure.subfigures(2, 1, squeeze=False, height_ratios=(1.0, 1.35), hspace=0.03))
    _draw_quantities(above.subplots(1, 3), here)
    _draw_decays(below, recording, groups, here.isel(pretension_mm=few(known.size, at_most)))
    return figure


def _draw_quantities(row: NDArray[np.object_], results: xr.Dataset) -> None:
    def values(name: str) -> Floats:
        return np.asarray(results[name].values, dtype=float)

    rows = [
        ("λ in 1/s", "decay coefficient λ", values("paper_decay_rate_per_s"), values("decay_rate_per_s")),
        (
            "⟨ω⟩ in rad/s",
            "angular frequency ⟨ω⟩",
            values("paper_omega_rad_s"),
            2 * np.pi * values("decay_frequency_hz"),
        ),
        ("D", "Lehr's damping D", values("paper_lehr_damping"), values("damping_ratio")),
    ]
    pretension = values("pretension_mm")
    outline = {"marker": "s", "markersize": 6.5, "color": INK, "markerfacecolor": "white"}
    for axes, letter, (label, title, paper, direct) in zip(row, "abc", rows, strict=True):
        _draw_bars(axes, pretension, direct, label="direct fit", **outline)
        _draw_bars(axes, pretension, paper, marker="o", markersize=3.2, color=ACCENT, label="peaks (paper)")
        axes.set(xlabel="pretension in mm", ylabel=label)
        note_panel(axes, letter, title)
    both = np.concatenate([rows[2][2].ravel(), rows[2][3].ravel()])
    row[2].set_ylim(0, 1.3 * float(np.nanmax(both)))
    row[0].legend(loc="lower right", borderaxespad=0.1)


def _draw_bars(axes: Axes, pretension: Floats, values: Floats, **look: object) -> None:
    mean, spread = mean_and_spread(values)
    bars = np.where(np.isfinite(spread), spread, 0.0)
    axes.errorbar(pretension, mean, bars, linestyle="none", capsize=2.5, elinewidth=1.0, **look)  # type: ignore[arg-type]


def _draw_decays(figure: SubFigure, recording: xr.Dataset, groups: list[Group], results: xr.Dataset) -> None:
    count = results.sizes["pretension_mm"]
    columns = min(4, count + 1)
    rows = -(-(count + 1) // columns)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    grid[0].yaxis.set_major_locator(MaxNLocator(4))
    for p, axes in enumerate(grid[:count]):
        label = _draw_one(axes, recording, groups, results.isel(pretension_mm=p))
        axes.tick_params(labelbottom=p + columns >= count)
        if p % columns == 0:
            axes.set_ylabel(label)
    for axes in grid[count:]:
        axes.axis("off")
    grid[-1].legend(*grid[0].get_legend_handles_labels(), loc="center", handlelength=2.4)
    figure.supxlabel("time from the start of the record in s", fontsize=8.5)


def _draw_one(axes: Axes, recording: xr.Dataset, groups: list[Group], here: xr.Dataset) -> str:
    """Draw one decay of the first repeat with its model, and return the axis label."""
    group = nearest(groups, float(here["pretension_mm"]))
    assert group is not None
    first = here.isel(repeat=min(group.segment.repeat, here.sizes["repeat"] - 1))
    numbers = tuple(float(first[name]) for name in ("paper_decay_rate_per_s", "paper_omega_rad_s", "decay_start_s"))
    motion = released_motion(recording, group)
    model = None
    if np.isfinite(numbers).all():
        motion = about_rest(motion, linear_decay(motion, *numbers))
        model = linear_decay(motion, *numbers)
    t = motion.time_s[motion.time_s <= _WINDOW_S]
    axes.plot(t, motion.torsion[: t.size], color=GREY, linewidth=2.4, label="measured")
    if model is not None:
        free = t[t >= model.from_s - 1e-9]
        axes.plot(free, model.at(free), color=GREEN, linewidth=1.0, label="linear model")
    mean = float(mean_and_spread(here["paper_lehr_damping"].values)[0])
    axes.set_title(f"{float(here['pretension_mm']):g} mm:  D = {mean:.3f}")
    return motion.label
