"""Energy of a wanted motion: by the map of a campaign per cycle, and of a recorded power between two times."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.interpolate import RegularGridInterpolator

from sinew.analysis.signal.repeats import combine_repeats
from sinew.analysis.sweep.energy import cost_of_swing
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate


@dataclass(frozen=True)
class MotionEnergy:
    """Energy per cycle of a motion [J], mean over its cycles: drive alone, tendon motors alone, both."""

    drive: Estimate
    holding: Estimate
    total: Estimate


def energy_per_cycle(
    results: xr.Dataset, frequency_hz: ArrayLike, pretension_mm: ArrayLike, torsion_rad: ArrayLike
) -> MotionEnergy:
    """Return what a head swing costs per cycle by the map of a campaign, with a 90 % interval over its repeats.

    results: with powers, of two pretensions at least. frequency_hz, pretension_mm, torsion_rad (amplitude of the head):
    of each cycle of the motion, or one number for all.

    Drive: energy per cycle and squared swing of the map, times the squared swing. The map is interpolated in its
    logarithm, linearly between pretensions and frequencies. Coulomb friction does not go with the square: the energy
    of a swing much smaller than the campaign's comes out too small. Holding: power of the tendon motors over the
    cycle's time, as it was while the campaign's head swung.
    Raises RecordingError where the results hold no powers, or the motion leaves the map.
    """
    if "drive_power_w" not in results or results.sizes["pretension_mm"] < 2:
        raise RecordingError(
            "these results hold no powers at two pretensions or more; analyse a campaign that recorded the drive's "
            "duty and current, with its rig"
        )
    parts = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (frequency_hz, pretension_mm, torsion_rad)))
    frequency, pretension, swing = (np.atleast_1d(part).astype(float) for part in parts)
    axes = (results["pretension_mm"].values, results["frequency_hz"].values)
    f = axes[1][None, :, None]
    power, hold, amplitude = (results[name].values for name in ("drive_power_w", "holding_power_w", "amplitude_rad"))
    cost = np.log(cost_of_swing(power, f, amplitude))
    points = np.stack([pretension, frequency], axis=1)
    drive, holding = [], []
    for repeat in range(cost.shape[2]):
        try:
            read = RegularGridInterpolator(axes, cost[..., repeat])(points)
            held = RegularGridInterpolator(axes, np.nan_to_num(hold[..., repeat]))(points)
        except ValueError as error:
            raise RecordingError(
                f"the motion leaves the map of the campaign: {axes[0][0]:g} to {axes[0][-1]:g} mm, {axes[1][0]:g} to "
                f"{axes[1][-1]:g} Hz; measure further, or ask for less"
            ) from error
        drive.append(float(np.mean(np.exp(read) * swing**2)))
        holding.append(float(np.mean(held / frequency)))
    return MotionEnergy(*(_estimate(np.array(x)) for x in (drive, holding, np.add(drive, holding))))


def _estimate(repeats: Array) -> Estimate:
    """Return mean and interval over repeats, (r,)."""
    found = combine_repeats(repeats[None], np.full((1, repeats.size), np.nan))
    return Estimate(*(float(x[0]) for x in (found.value, found.std_of_value, found.low, found.high)))


def energy_between(time_s: Array, power_w: Array, edges_s: Array) -> Array:
    """Return the energy [J] between successive times, (e - 1,): of the cycles of a motion whose frequency moves.

    time_s, power_w: (n,). edges_s: where cycles begin and end, (e,), inside the record. Trapezoidal rule on the actual
    stamps, with the power at the edges linear between samples.
    """
    steps = 0.5 * (power_w[1:] + power_w[:-1]) * np.diff(time_s)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    place = np.clip(np.searchsorted(time_s, edges_s, side="right") - 1, 0, time_s.size - 2)
    begin, height = time_s[place], power_w[place]
    inside = edges_s - begin
    slope = (power_w[place + 1] - height) / (time_s[place + 1] - begin)
    at_edges = total[place] + inside * (height + 0.5 * slope * inside)
    return np.diff(at_edges)
