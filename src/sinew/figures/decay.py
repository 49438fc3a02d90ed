"""Figures 9 and 10: a driven oscillation, its free decay with the fitted envelope, and damping over pretension."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from sinew.analysis.decay.free_decay import find_peaks
from sinew.analysis.decay.paper_method import large_peaks
from sinew.figures.motion import Group, Motion, at_pretension, groups_of, nearest, released_motion
from sinew.figures.style import ACCENT, GREEN, GREY, INK, RED, few, in_style, new_figure, note_panel
from sinew.measure.arrays import Array, mean_and_spread
from sinew.measure.errors import RecordingError


@dataclass(frozen=True)
class LinearDecay:
    """The linear second-order model (paper Eq. 2) laid over one measured decay.

    decay_rate: λ [1/s]; omega: damped angular frequency [rad/s]; from_s: where the free decay starts [s].
    cosine, sine: amplitudes [unit of the response] at the start of the record; rest [unit], drift [unit/s]: of the
    position it swings about.
    """

    decay_rate: float
    omega: float
    from_s: float
    cosine: float
    sine: float
    rest: float
    drift: float

    def baseline(self, time_s: Array) -> Array:
        """Return the position about which the response swings, (n,)."""
        return np.asarray(self.rest + self.drift * time_s)

    def at(self, time_s: Array) -> Array:
        """Return the model's response at times (n,) [s] from the start of the record."""
        swing = self.cosine * np.cos(self.omega * time_s) + self.sine * np.sin(self.omega * time_s)
        return np.asarray(np.exp(-self.decay_rate * time_s) * swing + self.baseline(time_s))


def linear_decay(motion: Motion, decay_rate: float, omega: float, start_s: float) -> LinearDecay:
    """Return the linear model with given λ [1/s] and ω [rad/s], laid over a motion from `start_s` on.

    Amplitude, phase, rest position and its drift are the least-squares ones.
    """
    free = motion.time_s >= start_s
    t = motion.time_s[free]
    fading = np.exp(-decay_rate * t)
    basis = np.column_stack([fading * np.cos(omega * t), fading * np.sin(omega * t), np.ones(t.size), t])
    weights = np.linalg.lstsq(basis, motion.torsion[free], rcond=None)[0]
    return LinearDecay(decay_rate, omega, start_s, *map(float, weights))


def about_rest(motion: Motion, model: LinearDecay) -> Motion:
    """Return the motion about the model's rest position where its own means nothing, else the motion itself."""
    return replace(motion, torsion=motion.torsion - model.baseline(motion.time_s)) if motion.is_integral else motion


@in_style
def draw_decay(recording: xr.Dataset, results: xr.Dataset, pretension_mm: float = 0.0) -> Figure | None:
    """Return Figure 9 of the paper at the pretension closest to `pretension_mm`, or None without a ring-down.

    Left: drive and torsion before and after the drive stops; right: the decay, its peaks, and the envelope with λ,
    ⟨ω⟩, D, Q, d and k by the paper's method.
    """
    found = _nearest_decay(recording, results, pretension_mm)
    if found is None:
        return None
    group, here, numbers = found
    whole = released_motion(recording, group, with_settle=True)
    figure = new_figure(3.1)
    left, right = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
    _draw_whole(left, about_rest(whole, linear_decay(whole, *numbers)))
    _draw_free(right, recording, group, here, numbers)
    note_panel(left, "a", "excitation and free decay" if group.settle is not None else "recorded oscillation")
    note_panel(right, "b", "envelope" + at_pretension(recording, group.segment.pretension_mm))
    return figure


def draw_envelope(axes: Axes, recording: xr.Dataset, results: xr.Dataset, pretension_mm: float = 0.0) -> bool:
    """Draw the decay closest to a pretension [mm], its peaks and envelope; return whether there is one."""
    found = _nearest_decay(recording, results, pretension_mm)
    if found is not None:
        _draw_free(axes, recording, *found)
    return found is not None


Numbers = tuple[float, float, float]


def _nearest_decay(
    recording: xr.Dataset, results: xr.Dataset, pretension_mm: float
) -> tuple[Group, xr.Dataset, Numbers] | None:
    """Return the ring-down closest to a pretension, its results, and rate [1/s], ω [rad/s] and start [s] among them."""
    group = nearest(groups_of(recording, "ring-down"), pretension_mm)
    if group is None or "paper_decay_rate_per_s" not in results:
        return None
    p = int(np.argmin(np.abs(results["pretension_mm"].values - group.segment.pretension_mm)))
    here = results.isel(pretension_mm=p, repeat=min(group.segment.repeat, results.sizes["repeat"] - 1))
    numbers = _linear_numbers(here)
    return (group, here, numbers) if np.isfinite(numbers).all() else None


def _linear_numbers(here: xr.Dataset) -> Numbers:
    """Return rate [1/s], ω [rad/s] and start [s] by the paper's method, or by the direct fit where that is withheld."""
    rate, omega = float(here["paper_decay_rate_per_s"]), float(here["paper_omega_rad_s"])
    if np.isnan(rate):
        rate, omega = float(here["decay_rate_per_s"]), 2.0 * np.pi * float(here["decay_frequency_hz"])
    return rate, omega, float(here["decay_start_s"])


def _draw_free(axes: Axes, recording: xr.Dataset, group: Group, here: xr.Dataset, numbers: Numbers) -> None:
    free = released_motion(recording, group)
    free = about_rest(free, linear_decay(free, *numbers))
    _draw_envelope(axes, free, linear_decay(free, *numbers))
    axes.text(0.98, 0.97, _quantities(here), transform=axes.transAxes, ha="right", va="top", linespacing=1.35)


def _draw_whole(axes: Axes, motion: Motion) -> None:
    angles = motion.unit == "degrees"
    if motion.drive is not None:
        axes.plot(motion.time_s, motion.drive, color=GREY, linewidth=1.2, label="drive θ")
    name = "torsion φ" if angles else "response"
    axes.plot(motion.time_s, motion.torsion, color=ACCENT, linewidth=1.2, label=name)
    end = motion.time_s[-1]
    if motion.time_s[0] < 0:
        end = min(end, 2.5)
        axes.axvline(0, color=INK, linewidth=0.9, linestyle=":")
        axes.annotate("drive stops", (0, 1), (4, -2), ("data", "axes fraction"), "offset points", va="top")
    axes.set(xlabel="time in s", ylabel="angle in degrees" if angles else motion.label)
    axes.set_xlim(max(motion.time_s[0], -1.5), end)
    shown = np.concatenate([y for y in (motion.torsion, motion.drive) if y is not None])
    span = float(np.ptp(shown))
    axes.set_ylim(shown.min() - 0.2 * span, shown.max() + 0.12 * span)
    axes.legend(loc="lower right", ncols=2, borderaxespad=0.1)


def _draw_envelope(axes: Axes, motion: Motion, model: LinearDecay) -> None:
    axes.plot(motion.time_s, motion.torsion, color=ACCENT, linewidth=1.1, label="measured")
    times, sizes = _peaks(motion, model)
    if times.size:
        fading = np.exp(-model.decay_rate * times)
        amplitude = float(sizes @ fading / (fading @ fading))
        fine = np.linspace(times[0], motion.time_s[-1], 200)
        for sign in (1, -1):
            envelope = model.baseline(fine) + sign * amplitude * np.exp(-model.decay_rate * fine)
            label = "±A exp(−λt)" if sign > 0 else None
            axes.plot(fine, envelope, color=RED, linewidth=1.2, linestyle="--", label=label)
        values = np.interp(times, motion.time_s, motion.torsion)
        axes.plot(times, values, "o", color="white", markeredgecolor=INK, markersize=4, label="peaks")
    axes.set(xlabel="time from the start of the record in s", ylabel=motion.label)
    axes.set_xlim(motion.time_s[0], motion.time_s[-1])
    axes.legend(loc="lower right", ncols=3, borderaxespad=0.1, columnspacing=1.2)
    span = float(np.abs(motion.torsion - model.baseline(motion.time_s)).max())
    axes.set_ylim(model.rest - 1.45 * span, model.rest + 1.4 * span)


def _peaks(motion: Motion, model: LinearDecay) -> tuple[Array, Array]:
    """Return times [s] and sizes about the rest position of the peaks of the free decay; none where none stand out."""
    try:
        found = find_peaks(motion.time_s, motion.torsion).between(model.from_s, motion.time_s[-1])
        times, heights = large_peaks(found, model.baseline(found.time_s))
        return times, np.abs(heights)
    except (RecordingError, IndexError):
        return np.empty(0), np.empty(0)


def _quantities(here: xr.Dataset) -> str:
    """Return the derived quantities of one decay, a line each; d and k only where the inertia was known."""
    if np.isnan(float(here["paper_decay_rate_per_s"])):
        rate, omega, _ = _linear_numbers(here)
        return f"λ = {rate:.3g} 1/s\nω = {omega:.4g} rad/s\nD = {float(here['damping_ratio']):.3g}\n(direct fit)"
    lines = [
        f"λ = {float(here['paper_decay_rate_per_s']):.3g} 1/s",
        f"⟨ω⟩ = {float(here['paper_omega_rad_s']):.4g} rad/s",
        f"D = {float(here['paper_lehr_damping']):.3g},  Q = {float(here['paper_quality']):.3g}",
    ]
    damping, stiffness = float(here["paper_damping_n_m_s_rad"]), float(here["paper_stiffness_n_m_rad"])
    if np.isfinite(damping) and np.isfinite(stiffness):
        lines += [f"d = {damping:.3g} N m s/rad", f"k = {stiffness:.3g} N m/rad"]
    return "\n".join(lines)


# Figure 10 is drawn: damping over pretension, and each decay under its linear model.

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
    def values(name: str) -> Array:
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


def _draw_bars(axes: Axes, pretension: Array, values: Array, **look: object) -> None:
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
    numbers = _linear_numbers(first)
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
