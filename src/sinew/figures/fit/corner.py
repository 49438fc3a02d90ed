"""Corner plot of what is known of several parameters together: each alone, and each pair."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from sinew.figures.fit.data import parameter_label, value_and_std
from sinew.figures.style import ACCENT, GREY, INK, in_style, new_figure
from sinew.identify.oscillator.fitted import Fit, number_names, physical_numbers
from sinew.identify.oscillator.model import free_mechanics
from sinew.measure.arrays import Array
from sinew.measure.estimate import NORMAL_90
from sinew.mechanics.laws import NUMBERS

# The parameters of a fit become a cloud: values, covariance and, where there are any, draws.


@dataclass(frozen=True)
class Cloud:
    """What is known of several parameters together.

    names: as in the document, m of them. value: shape (m,). covariance: shape (m, m). draws: shape (d, m), of a
    posterior or a bootstrap, or None. All in the units that the names state.
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array
    draws: Array | None = None

    @property
    def std(self) -> Array:
        """Return the standard deviations: of the draws, else by the covariance, shape (m,)."""
        if self.draws is not None:
            return np.asarray(self.draws.std(axis=0), dtype=float)
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)), dtype=float)

    @property
    def correlation(self) -> Array:
        """Return the correlations: of the draws, else by the covariance, shape (m, m)."""
        matrix = self.covariance if self.draws is None else np.atleast_2d(np.cov(self.draws.T))
        std = np.maximum(np.sqrt(np.maximum(np.diag(matrix), 0.0)), 1e-300)
        return np.asarray(np.clip(matrix / np.outer(std, std), -1.0, 1.0), dtype=float)

    def take(self, kept: Sequence[int]) -> "Cloud":
        """Return some of the parameters. kept: indices, in the order that is wanted."""
        k = list(kept)
        draws = None if self.draws is None else self.draws[:, k]
        return Cloud(tuple(self.names[i] for i in k), self.value[k], self.covariance[np.ix_(k, k)], draws)

    def drawn(self, names: Sequence[str], draws: ArrayLike) -> "Cloud":
        """Return the same parameters by draws, shape (d, n), of numbers of these names; those drawn in no way left out.

        The value becomes the median of the draws.
        """
        found = np.asarray(draws, dtype=float)
        mine = [i for i, name in enumerate(self.names) if name in names]
        chosen = found[:, [list(names).index(self.names[i]) for i in mine]]
        return replace(self.take(mine), value=np.median(chosen, axis=0), draws=chosen)


def cloud_of(fit: Fit) -> Cloud:
    """Return the mechanical parameters of a fit, in full where the inertia is known, else over the inertia.

    Numbers with an infinite variance are left out.
    """
    every, x = number_names(fit), fit.solution.values
    mechanical = free_mechanics(fit.model, fit.layout.parts[0].record)
    count = sum(entry.local in mechanical for entry in fit.layout.entries)
    without = tuple(name for name, number in NUMBERS.items() if not number.force)
    # `Fit.parameters` holds the numbers over the inertia first, then those in full where the inertia is known.
    over, full = every[:count], every[count : len(fit.parameters)]
    names = (*full, *(name for name in over if name.startswith(without))) if full else over
    steps = 1e-6 * np.maximum(np.abs(x), 1e-3)
    ends = [physical_numbers(fit, x + sign * np.diag(steps)) for sign in (1.0, -1.0)]
    slope = ((ends[0] - ends[1]) / (2.0 * steps[:, None])).T[[every.index(name) for name in names]]
    known = np.isfinite(np.diag(fit.covariance.matrix))
    matrix = slope[:, known] @ fit.covariance.matrix[np.ix_(known, known)] @ slope[:, known].T
    value = np.array([fit.parameters[name].value for name in names])
    told = [i for i in range(len(names)) if not slope[i, ~known].any() and matrix[i, i] > 0]
    return Cloud(tuple(names), value, matrix).take(told)


_SHARES = (0.5, 0.9)
_REACH = 3.2  # standard deviations on the axes
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


def _off(cloud: Cloud, k: int) -> Array:
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
        bell, ends = np.exp(-0.5 * fine**2), np.array([-NORMAL_90, NORMAL_90])
        axes.plot(fine, bell, color=ACCENT)
        inside = np.abs(fine) <= NORMAL_90
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


def ellipse(covariance: Array, share: float) -> Array:
    """Return the outline of the ellipse that holds a share of a normal distribution about zero, shape (2, 121).

    covariance: shape (2, 2). Its squared radius in standard deviations is -2 ln(1 - share) (chi square, two degrees).
    """
    size, turned = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    circle = np.sqrt(-2.0 * np.log1p(-share)) * np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(turned @ (np.sqrt(np.maximum(size, 0.0))[:, None] * circle))


def _smoothed(density: Array) -> Array:
    """Return a histogram smoothed by a short bell along both axes, so that its outlines do not fray."""
    bell = np.exp(-0.5 * (np.arange(-4, 5) / 1.3) ** 2)
    bell /= bell.sum()
    for axis in (0, 1):
        density = np.apply_along_axis(lambda row: np.convolve(row, bell, mode="same"), axis, density)
    return density


def _level(density: Array, share: float) -> float:
    """Return the density above which a share of all lies."""
    falling = np.sort(density.ravel())[::-1]
    inside = np.searchsorted(np.cumsum(falling), share * falling.sum())
    return float(falling[min(int(inside), falling.size - 1)])
