"""This is where the lever's waveform is measured: its fundamental, and the odd harmonics of a drive at its limit."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.harmonics import HARMONICS, fit_harmonics
from sinew.analysis.sensor import delay_budget, drive_chain
from sinew.analysis.torsion import drive_channel
from sinew.measure.errors import RecordingError
from sinew.measure.recording import segment_slices
from sinew.plan.rig import RigSpec

__all__ = ["LeverMotion", "measure_lever"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class LeverMotion:
    """The measured lever over pretension and frequency, mean over the repeats.

    θ = a sin τ + Re Σ a s_h exp(jhτ), h odd and above one: amplitude a [rad], shape (p, f), NaN where nothing was
    measured; orders (h,); shares s_h, complex, shape (p, f, h), zero where they could not be resolved.
    """

    pretension_mm: Floats
    frequency_hz: Floats
    amplitude: Floats
    orders: NDArray[np.int64]
    shares: Complexes


def measure_lever(recording: xr.Dataset, rig: RigSpec | None = None) -> LeverMotion:
    """Return how the lever moved in the steady segments of a recording.

    rig: whose delay of the encoder is undone; None for a perfect one. Segments that are too short for their frequency
    are left out. Raises RecordingError where no angle of the lever was recorded.
    """
    drive = drive_channel(recording)
    if drive is None or drive.unit != "rad":
        raise RecordingError("the recording has no angle of the lever; record drive_rad, or compare by the command")
    steady = np.flatnonzero((recording["kind"].values == "steady") & np.isfinite(recording["frequency_hz"].values))
    budget, slices = delay_budget(recording, rig), segment_slices(recording)
    pretension, row = np.unique(recording["pretension_mm"].values[steady], return_inverse=True)
    frequency, column = np.unique(recording["frequency_hz"].values[steady], return_inverse=True)
    found = np.zeros((pretension.size, frequency.size, HARMONICS), dtype=complex)
    count = np.zeros((pretension.size, frequency.size))
    sizes = recording["row_size"].values[steady]
    for size in np.unique(sizes):
        mine = np.flatnonzero(sizes == size)
        samples = np.array([np.arange(slices[i].start, slices[i].stop) for i in steady[mine]])
        hertz = frequency[column[mine]]
        try:
            fitted = fit_harmonics(recording["time_s"].values[samples], drive.values[samples][:, None], hertz)
        except ValueError:
            continue
        order = np.arange(1, HARMONICS + 1) * hertz[:, None]
        waves = np.nan_to_num(fitted.coefficient[:, 0] / drive_chain(budget, order))
        turned = waves * np.exp(-1j * np.arange(1, HARMONICS + 1) * (np.angle(waves[:, :1]) + np.pi / 2))
        np.add.at(found, (row[mine], column[mine]), turned)
        np.add.at(count, (row[mine], column[mine]), 1)
    mean = np.divide(found, count[..., None], out=np.full_like(found, np.nan), where=count[..., None] > 0)
    amplitude = np.abs(mean[..., 0])
    orders = np.arange(3, HARMONICS + 1, 2)
    shares = np.divide(
        mean[..., orders - 1],
        amplitude[..., None],
        out=np.zeros_like(mean[..., orders - 1]),
        where=amplitude[..., None] > 0,
    )
    return LeverMotion(pretension, frequency, amplitude, orders, np.nan_to_num(shares))
