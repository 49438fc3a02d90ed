"""This is where motion is drawn over itself: torsion rate over torsion at resonance, for several pretensions."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.analysis.portrait import phase_portrait
from sinew.figures.motion import Group, Motion, groups_of, motion_of, nearest
from sinew.figures.rig import rig_of
from sinew.figures.style import INK, WIDTH_IN, few, in_style, new_figure, note_panel, pretension_colours

__all__ = ["draw_phase_portraits"]


@in_style
def draw_phase_portraits(recording: xr.Dataset, results: xr.Dataset, at_most: int = 4) -> Figure | None:
    """Return phase portraits at the resonance of some pretensions, or None where the results hold no resonance.

    The dashed ellipse is a harmonic oscillation of the same frequency and amplitude; what departs from it is
    anharmonic (paper, section 5.2.3). Even harmonics bend the portrait to one side, the third squeezes it evenly.
    """
    groups = groups_of(recording, "steady")
    if "resonance_hz" not in results or not groups:
        return None
    known = np.flatnonzero(np.isfinite(results["resonance_hz"].values))
    if known.size == 0:
        return None
    chosen = known[few(known.size, at_most)]
    pretension = results["pretension_mm"].values
    colours = pretension_colours(pretension)
    figure = new_figure(2.6, min(WIDTH_IN, 0.7 + 1.6 * chosen.size))
    label = ""
    row = figure.subplots(1, chosen.size, sharex=True, sharey=True, squeeze=False)[0]
    for i, (axes, p) in enumerate(zip(row, chosen, strict=True)):
        group = nearest(groups, pretension[p], float(results["resonance_hz"].values[p]))
        assert group is not None
        motion = motion_of(recording, group)
        label = motion.label
        _draw_portrait(axes, motion, group.segment.frequency_hz, tuple(colours[p]))
        title = f"{pretension[p]:g} mm, {group.segment.frequency_hz:.3g} Hz"
        note_panel(axes, "abcdefgh"[i], f"{title}\n{_shares(recording, group)}")
    figure.supxlabel(label, fontsize=8.5)
    row[0].set_ylabel("rate dφ/dt in degrees/s" if "degrees" in label else "rate per second")
    return figure


def _shares(recording: xr.Dataset, group: Group) -> str:
    """Return what departs from the ellipse, to one side and to both, as a share of the fundamental."""
    alone = recording.isel(sample=group.record, segment=[group.index])
    portrait = phase_portrait(alone, 0, rig_of(recording))
    even, third = 100 * portrait.even_share.value, 100 * portrait.third_share.value
    return f"even {even:.1f} %, 3rd {third:.1f} %"


def _draw_portrait(axes: Axes, motion: Motion, frequency_hz: float, colour: tuple[float, ...]) -> None:
    """Draw one portrait and the harmonic ellipse of the same fundamental."""
    omega = 2 * np.pi * frequency_hz
    basis = np.column_stack([np.sin(omega * motion.time_s), np.cos(omega * motion.time_s), np.ones(motion.time_s.size)])
    weights = np.linalg.lstsq(basis, motion.torsion, rcond=None)[0]
    amplitude = float(np.hypot(weights[0], weights[1]))
    t = np.linspace(0, 2 * np.pi, 121)
    axes.plot(motion.torsion - weights[2], motion.rate, color=colour, linewidth=1.8)
    axes.plot(amplitude * np.sin(t), omega * amplitude * np.cos(t), color=INK, linestyle=(0, (4, 3)), linewidth=0.8)
    axes.margins(0.08)
