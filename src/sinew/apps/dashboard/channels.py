"""This is where the samples of a journal become what the oscilloscope shows, in the units of a screen."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.plan.rig import RigSpec

__all__ = ["Channel", "LiveChannels"]

Floats = NDArray[np.float64]

_MEMORY_S = 3.0  # of the live torsion: long against a turn, short against a drift
_LONG_STEP_S = 0.05


@dataclass(frozen=True, slots=True)
class Channel:
    """A trace: its key, the label and the unit that stand beside it."""

    key: str
    label: str
    unit: str


class LiveChannels:
    """Turns rows of a run's journal into traces, batch after batch.

    The torsion is the gyroscope's rate, integrated by trapezoids with a leak of 3 s that takes the drift out: at 3 Hz
    it leads by 1° and is for the eye alone; what is measured comes from `sinew.analysis`.
    """

    def __init__(self, rig: RigSpec) -> None:
        self._tendons = rig.tendons.count
        self._force = rig.tendons.torque_constant.value / rig.tendons.pulley_radius.value
        self._radius = rig.tendons.pulley_radius.value
        self.channels = (
            Channel("drive_command", "lever, command", "°"),
            Channel("drive", "lever θ", "°"),
            Channel("torsion", "torsion φ", "°"),
            Channel("drive_current", "drive current", "A"),
            *(Channel(f"tendon_{i + 1}_current", f"current of tendon {i + 1}", "A") for i in range(self._tendons)),
            Channel("tilt", "tilt", "°"),
        )
        self._torsion, self._rate, self._time = 0.0, math.nan, math.nan

    def take(self, rows: dict[str, Floats]) -> Floats:
        """Return the traces (c, n), in the order of `channels`, of rows as `JournalReader.samples` gives them."""
        tendons = [rows[f"tendon_{i + 1}_current_a"] for i in range(self._tendons)]
        return np.stack(
            [
                np.degrees(rows["drive_command_rad"]),
                np.degrees(rows["drive_rad"]),
                np.degrees(self._integrate(rows["time_s"], rows["gyro_x_rad_s"])),
                rows["drive_current_a"],
                *tendons,
                np.degrees(rows["tilt_rad"]),
            ]
        )

    def tensions(self, traces: Floats) -> list[float]:
        """Return the tension of each tendon [N] at the newest row of some traces, from its motor's current."""
        currents = traces[4 : 4 + self._tendons, -1]
        return [float(max(0.0, current) * self._force) if np.isfinite(current) else math.nan for current in currents]

    def _integrate(self, time: Floats, rate: Floats) -> Floats:
        out = np.empty(time.size)
        for i, (now, value) in enumerate(zip(time.tolist(), rate.tolist(), strict=True)):
            step = now - self._time
            if math.isfinite(value) and math.isfinite(self._rate) and 0.0 < step < _LONG_STEP_S:
                self._torsion += 0.5 * (value + self._rate) * step
                self._torsion *= math.exp(-step / _MEMORY_S)
            if math.isfinite(now):
                self._time = now
            if math.isfinite(value):
                self._rate = value
            out[i] = self._torsion
        return out
