"""This is where what is known of several parameters together is drawn: each alone, and each pair."""

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from sinew.figures.fit_cloud import Cloud
from sinew.figures.fit_labels import parameter_label, value_and_std
from sinew.figures.style import ACCENT, GREY, INK, Floats, in_style, new_figure

__all__ = ["draw_corner", "ellipse"]

_SHARES = (0.5, 0.9)
_REACH = 3.2  # standard deviations on the axes
_NORMAL90 = 1.6448536269514722
_MOST = 6
_BINS = 34
_LINE = 14  # characters


@in_style
def draw_corner(cloud: Cloud) -> Figure | None:
    """Return the corner plot of a cloud, or None where fewer than two parameters are known.

    On the diagonal the distribution of each parameter, below it the regions that hold 50 % and 90 % of each pair, above
    it the correlations. Axes count standard deviations from the value in the title. Draws make histograms and regions
    of highest density, a covariance makes normal distributions and ellipses. Of more than six parameters the first six
    are drawn.
    """
    cloud = cloud.take(range(min(len(cloud.names), _MOST)))
    m = len(cloud.names)
    if m < 2:
        return None
    figure = new_figure(0.6 + 1.15 * m)
    grid = figure.subplots(m, m, squeeze=False)
    for row in range(m):
        for column in range(m):
            axes = grid[row, column]
            if column > row:
                axes.axis("off")
                told = f"ρ = {cloud.correlation[row, column]:.2f}".replace("-", "−")
                axes.text(0.5, 0.5, told, ha="center", va="center", color=INK, transform=axes.transAxes)
                continue
            if row == column:
                _draw_alone(axes, cloud, row)
            else:
                _draw_pair(axes, cloud, column, row)
            _name_axes(axes, cloud, row, column)
    figure.supxlabel("standard deviations from the value", fontsize=8.5)
    return figure


def _name_axes(axes: Axes, cloud: Cloud, row: int, column: int) -> None:
    last, ticks = len(cloud.names) - 1, (-2, 0, 2)
    axes.set_xlim(-_REACH, _REACH)
    axes.set_xticks(ticks)
    axes.grid(visible=False)
    if row == column:
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
    else:
        axes.set_ylim(-_REACH, _REACH)
        axes.set_yticks(ticks)
    axes.tick_params(labelbottom=row == last, labelleft=column == 0 and row > 0)
    if row == last:
        axes.set_xlabel(_words(cloud.names[column]))
    if column == 0 and row > 0:
        axes.set_ylabel(_words(cloud.names[row]))


def _words(name: str) -> str:
    """Return what a parameter is called in lines short enough for a panel, a rig's without its section."""
    return textwrap.fill(parameter_label(name.rpartition(".")[2])[0], _LINE)


def _off(cloud: Cloud, k: int) -> Floats:
    """Return the draws of one parameter in standard deviations from its value, shape (d,)."""
    assert cloud.draws is not None
    return np.asarray((cloud.draws[:, k] - cloud.value[k]) / cloud.std[k])


def _draw_alone(axes: Axes, cloud: Cloud, k: int) -> None:
    words, unit = _words(cloud.names[k]), parameter_label(cloud.names[k])[1]
    value, spread = value_and_std(float(cloud.value[k]), float(cloud.std[k])).split(" ± ")
    axes.set_title(f"{words}\n{value} {unit}".rstrip() + f"\n± {spread}", loc="center", fontsize=8.0)
    if cloud.draws is not None:
        off = _off(cloud, k)
        axes.hist(off, bins=_BINS, range=(-_REACH, _REACH), color=ACCENT, alpha=0.45)
        ends = np.quantile(off, [0.05, 0.95])
    else:
        fine = np.linspace(-_REACH, _REACH, 161)
        bell, ends = np.exp(-0.5 * fine**2), np.array([-_NORMAL90, _NORMAL90])
        axes.plot(fine, bell, color=ACCENT)
        inside = np.abs(fine) <= _NORMAL90
        axes.fill_between(fine[inside], 0, bell[inside], color=ACCENT, alpha=0.25, linewidth=0)
    for end in ends:
        axes.axvline(float(end), color=GREY, linestyle=":", linewidth=0.9)
    axes.set_ylim(bottom=0)


def _draw_pair(axes: Axes, cloud: Cloud, x: int, y: int) -> None:
    if cloud.draws is None:
        pair = cloud.correlation[np.ix_([x, y], [x, y])]
        for share, alpha in zip(_SHARES[::-1], (0.22, 0.45), strict=True):
            axes.fill(*ellipse(pair, share), color=ACCENT, alpha=alpha, linewidth=0)
    else:
        right, up = _off(cloud, x), _off(cloud, y)
        density, edges, _ = np.histogram2d(right, up, bins=_BINS, range=[[-_REACH, _REACH]] * 2)
        smooth = _smoothed(density)
        levels = sorted({_level(smooth, share) for share in _SHARES})
        axes.plot(right, up, ".", color=GREY, markersize=1.0, alpha=0.35, rasterized=True)
        if smooth.max() > levels[-1]:
            middle = 0.5 * (edges[1:] + edges[:-1])
            shades = [to_rgba(ACCENT, alpha) for alpha in (0.3, 0.55)[-len(levels) :]]
            axes.contourf(middle, middle, smooth.T, levels=[*levels, float(smooth.max())], colors=shades)
    axes.plot(0, 0, "+", color=INK, markersize=6)


def ellipse(covariance: Floats, share: float) -> Floats:
    """Return the outline of the ellipse that holds a share of a normal distribution about zero, shape (2, 121).

    covariance: shape (2, 2). Its squared radius in standard deviations is -2 ln(1 - share) (chi square, two degrees).
    """
    size, turned = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    circle = np.sqrt(-2.0 * np.log1p(-share)) * np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(turned @ (np.sqrt(np.maximum(size, 0.0))[:, None] * circle))


def _smoothed(density: Floats) -> Floats:
    """Return a histogram smoothed by a short bell along both axes, so that its outlines do not fray."""
    bell = np.exp(-0.5 * (np.arange(-4, 5) / 1.3) ** 2)
    bell /= bell.sum()
    for axis in (0, 1):
        density = np.apply_along_axis(lambda row: np.convolve(row, bell, mode="same"), axis, density)
    return density


def _level(density: Floats, share: float) -> float:
    """Return the density above which a share of all lies."""
    falling = np.sort(density.ravel())[::-1]
    inside = np.searchsorted(np.cumsum(falling), share * falling.sum())
    return float(falling[min(int(inside), falling.size - 1)])
