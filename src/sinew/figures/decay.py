"""This is where Figure 9 is drawn: a driven oscillation, its free decay, and the envelope fitted to it."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.analysis.envelope import large_peaks
from sinew.analysis.peaks import find_peaks
from sinew.figures.motion import Motion, at_pretension, groups_of, nearest, released_motion
from sinew.figures.style import ACCENT, GREY, INK, RED, Floats, in_style, new_figure, note_panel
from sinew.measure.errors import RecordingError

__all__ = ["LinearDecay", "about_rest", "draw_decay", "linear_decay"]


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

    def baseline(self, time_s: Floats) -> Floats:
        """Return the position about which the response swings, (n,)."""
        return np.asarray(self.rest + self.drift * time_s)

    def at(self, time_s: Floats) -> Floats:
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
    if "paper_decay_rate_per_s" not in results:
        return None
    group = nearest(groups_of(recording, "ring-down"), pretension_mm)
    if group is None:
        return None
    p = int(np.argmin(np.abs(results["pretension_mm"].values - group.segment.pretension_mm)))
    here = results.isel(pretension_mm=p, repeat=min(group.segment.repeat, results.sizes["repeat"] - 1))
    numbers = tuple(float(here[name]) for name in ("paper_decay_rate_per_s", "paper_omega_rad_s", "decay_start_s"))
    if not np.isfinite(numbers).all():
        return None
    free, whole = released_motion(recording, group), released_motion(recording, group, with_settle=True)
    figure = new_figure(3.1)
    left, right = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
    _draw_whole(left, about_rest(whole, linear_decay(whole, *numbers)))
    free = about_rest(free, linear_decay(free, *numbers))
    _draw_envelope(right, free, linear_decay(free, *numbers))
    right.text(0.98, 0.97, _quantities(here), transform=right.transAxes, ha="right", va="top", linespacing=1.35)
    note_panel(left, "a", "excitation and free decay" if group.settle is not None else "recorded oscillation")
    note_panel(right, "b", "envelope" + at_pretension(recording, group.segment.pretension_mm))
    return figure


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


def _peaks(motion: Motion, model: LinearDecay) -> tuple[Floats, Floats]:
    """Return times [s] and sizes about the rest position of the peaks of the free decay; none where none stand out."""
    try:
        found = find_peaks(motion.time_s, motion.torsion).between(model.from_s, motion.time_s[-1])
        times, heights = large_peaks(found, model.baseline(found.time_s))
        return times, np.abs(heights)
    except (RecordingError, IndexError):
        return np.empty(0), np.empty(0)


def _quantities(here: xr.Dataset) -> str:
    """Return the derived quantities of one decay, a line each; d and k only where the inertia was known."""
    lines = [
        f"λ = {float(here['paper_decay_rate_per_s']):.3g} 1/s",
        f"⟨ω⟩ = {float(here['paper_omega_rad_s']):.4g} rad/s",
        f"D = {float(here['paper_lehr_damping']):.3g},  Q = {float(here['paper_quality']):.3g}",
    ]
    damping, stiffness = float(here["paper_damping_n_m_s_rad"]), float(here["paper_stiffness_n_m_rad"])
    if np.isfinite(damping) and np.isfinite(stiffness):
        lines += [f"d = {damping:.3g} N m s/rad", f"k = {stiffness:.3g} N m/rad"]
    return "\n".join(lines)
