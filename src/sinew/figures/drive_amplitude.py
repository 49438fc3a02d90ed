"""This is where the drive's reach is drawn: measured drive amplitude over frequency, for all pretensions."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from sinew.figures.response import draw_tubes
from sinew.figures.rig import rig_of
from sinew.figures.style import GREY, INK, RED, Floats, in_style, new_figure, note_panel, pretension_bar

__all__ = ["draw_drive_amplitude", "sine_ceiling", "triangle_ceiling"]


@in_style
def draw_drive_amplitude(recording: xr.Dataset, results: xr.Dataset) -> Figure | None:
    """Return measured drive amplitude [deg] over frequency, or None where the results hold no sweep.

    The dotted line is the nominal amplitude; rings mark the resonance at each pretension. Where the rig is known, a
    dashed line shows the largest sine whose peak speed stays under the motor's no-load speed, a dash-dotted one the
    fundamental of a triangle at that speed, which no drive exceeds that never runs faster.
    """
    if "drive_amplitude_rad" not in results or "drive_rad" not in recording:
        return None
    if not np.isfinite(results["drive_amplitude_rad"].values).any():
        return None
    frequency, pretension = results["frequency_hz"].values, results["pretension_mm"].values
    amplitude = np.rad2deg(results["drive_amplitude_rad"].values)
    figure = new_figure(3.2, 5.2)
    axes = figure.subplots()
    draw_tubes(axes, frequency, amplitude, pretension)
    nominal = recording["amplitude_deg"].values
    nominal = nominal[np.isfinite(nominal) & (recording["kind"].values == "steady")]
    top = float(np.nanmax(amplitude))
    if nominal.size:
        top = max(top, float(nominal.max()))
        axes.axhline(nominal.max(), color=GREY, linestyle=":", linewidth=1.2)
        axes.annotate("nominal", (frequency.max(), nominal.max()), **_ABOVE, color="#5a5a5a")
    speed = _no_load_speed(results)
    if speed is not None:
        fine = np.linspace(frequency.min(), frequency.max(), 120)
        sine, triangle = (ceiling(fine, speed) for ceiling in (sine_ceiling, triangle_ceiling))
        axes.plot(fine, np.rad2deg(sine), color=RED, linestyle="--", linewidth=1.1, label="sine at no-load speed")
        axes.plot(
            fine, np.rad2deg(triangle), color=RED, linestyle="-.", linewidth=1.1, label="triangle at no-load speed"
        )
        axes.legend(handles=axes.lines[-2:], loc="lower left", handlelength=2.6)
    if "resonance_hz" in results:
        height = np.rad2deg(results["drive_amplitude_at_resonance_rad"].values)
        where = results["resonance_hz"].values
        axes.plot(where, height, "o", markersize=3, color="white", markeredgecolor=INK, zorder=5)
    axes.set(xlabel="drive frequency in Hz", ylabel="measured drive amplitude in degrees")
    axes.set(xlim=(frequency.min(), frequency.max()), ylim=(0, 1.15 * top))
    note_panel(axes, "", "what the drive really does (rings: at resonance)")
    pretension_bar(figure, (axes,), pretension)
    return figure


_ABOVE: dict[str, Any] = {"xytext": (-2, 4), "textcoords": "offset points", "ha": "right", "fontsize": 8}


def sine_ceiling(frequency_hz: Floats, speed: float) -> Floats:
    """Return the amplitude [rad] of the sine at a frequency [Hz] whose peak speed is `speed` [rad/s]: ω₀/(2πf)."""
    return np.asarray(speed / (2 * np.pi * frequency_hz))


def triangle_ceiling(frequency_hz: Floats, speed: float) -> Floats:
    """Return the fundamental's amplitude [rad] of the triangle at constant speed [rad/s]: 2ω₀/(π²f).

    Its peak is ω₀/(4f), of which the fundamental is the share 8/π².
    """
    return np.asarray(2 * speed / (np.pi**2 * frequency_hz))


def _no_load_speed(results: xr.Dataset) -> float | None:
    """Return the drive's no-load speed at its supply voltage [rad/s], None where the rig is not known."""
    rig = rig_of(results)
    if rig is None:
        return None
    drive = rig.drive
    return float(drive.no_load_speed.value * drive.supply_voltage.value / drive.nominal_voltage.value)
