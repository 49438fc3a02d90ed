"""This is where the gain becomes a map over pretension and frequency, with the resonance as its ridge."""

import numpy as np
import xarray as xr

from sinew.measure.errors import RecordingError

__all__ = ["gain_map"]


def gain_map(results: xr.Dataset, by: str = "gain") -> xr.Dataset:
    """Return mean gain over repeats, its tube and its ridge (paper, figures 6 and 8).

    results: with a sweep part. by: gain (nominal drive, mean of peaks), gain_harmonic or gain_measured_drive.
    Variables: `gain` and `gain_std` (±1 standard deviation over repeats, NaN for one repeat), `phase_lag` and
    `phase_lag_std` [rad], all over (pretension_mm, frequency_hz); `ridge_hz` and `ridge_gain` over pretension_mm,
    from the resonance part, NaN where no peak was found. Both axes are index coordinates.
    Raises RecordingError where the results hold no sweep.
    """
    if by not in ("gain", "gain_harmonic", "gain_measured_drive"):
        raise ValueError(f"no such gain {by!r}; choose gain, gain_harmonic or gain_measured_drive")
    if "gain" not in results:
        raise RecordingError("these results hold no sweep, so there is no gain to map; analyse a recording with one")
    out = xr.Dataset(coords={name: results[name].variable for name in ("pretension_mm", "frequency_hz")})
    for name, source, unit in (("gain", by, "1"), ("phase_lag", "phase_lag_rad", "rad")):
        values = results[source].values
        valid = np.isfinite(values)
        count = valid.sum(axis=2)
        mean = np.where(count > 0, np.where(valid, values, 0.0).sum(axis=2) / np.maximum(count, 1), np.nan)
        spread = np.where(valid, values - mean[:, :, None], 0.0)
        std = np.where(count > 1, np.sqrt((spread**2).sum(axis=2) / np.maximum(count - 1, 1)), np.nan)
        out[name] = (("pretension_mm", "frequency_hz"), mean, {"units": unit})
        out[f"{name}_std"] = (("pretension_mm", "frequency_hz"), std, {"units": unit})
    measured = by == "gain_measured_drive"
    for name, source in (
        ("ridge_hz", "resonance_measured_drive_hz" if measured else "resonance_hz"),
        ("ridge_gain", "gain_peak_measured_drive" if measured else "gain_peak"),
    ):
        missing = np.full(results.sizes["pretension_mm"], np.nan)
        out[name] = ("pretension_mm", results[source].values if source in results else missing)
    return out
