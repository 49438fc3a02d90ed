"""This is where torsion over drive becomes an ellipse, and the ellipse a phase."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.measure.errors import RecordingError

__all__ = ["Ellipse", "fit_ellipse", "lissajous_phase"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Ellipse:
    """A Lissajous ellipse: drive = drive_amplitude·cos ψ, torsion = torsion_amplitude·cos(ψ - lag).

    drive_amplitude, torsion_amplitude: half extents, in the units of the motion.
    lag_rad: of the torsion behind the drive, positive lag, in (-π/2, 3π/2].
    area: enclosed by one period, π·drive_amplitude·torsion_amplitude·sin(lag): positive where the drive does work.
    """

    drive_amplitude: float
    torsion_amplitude: float
    lag_rad: float
    area: float

    def curve(self, points: int = 181) -> tuple[Floats, Floats]:
        """Return (drive, torsion) of the ellipse, closed, each of shape (points,)."""
        angle = np.linspace(0.0, 2.0 * np.pi, points)
        return self.drive_amplitude * np.cos(angle), self.torsion_amplitude * np.cos(angle - self.lag_rad)


def lissajous_phase(drive: Floats, torsion: Floats, step_rad: Floats, periods: Floats) -> Floats:
    """Return the lag of figures over whole periods, (s,) from drive and torsion of shape (s, n).

    step_rad: phase between samples ΩT, shape (s,). periods: whole periods in the record, shape (s,).
    The area by the shoelace formula is π a b sin(lag) per period (a polygon on the ellipse is short by
    sin(ΩT)/(ΩT), undone here), the mean product a b cos(lag)/2; their quotient is the tangent of the lag in the right
    quadrant and, unlike arcsin(area/(π a b)), well conditioned where the lag is 90°.
    """
    x = drive - drive.mean(axis=1, keepdims=True)
    y = torsion - torsion.mean(axis=1, keepdims=True)
    area = _shoelace(x, y) * (step_rad / np.sin(step_rad)) / periods
    return _wrapped(np.arctan2(area / np.pi, 2.0 * (x * y).mean(axis=1)))


def _shoelace(x: Floats, y: Floats) -> Floats:
    """Return ∮ x dy over closed polygons, shape (s,): positive counter-clockwise, as torsion behind drive runs."""
    return np.asarray(0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))


def _wrapped(lag: Floats) -> Floats:
    """Return a lag moved into (-π/2, 3π/2], so that 0 and π both lie well inside."""
    return np.asarray(1.5 * np.pi - np.mod(1.5 * np.pi - lag, 2.0 * np.pi))


def fit_ellipse(motion: xr.Dataset) -> Ellipse:
    """Return the ellipse of one steady motion (see `sinew.analysis.torsion.steady_motion`).

    The half extents are √2 times the root mean square of each signal, the lag is that of `lissajous_phase`.
    Raises RecordingError where the recording has no drive.
    """
    if "drive" not in motion:
        raise RecordingError(
            "a Lissajous figure needs a measured drive and this recording has none; add a drive column"
        )
    x, y = motion["drive"].values[None], motion["torsion"].values[None]
    periods = np.array([float(motion.attrs["periods"])])
    lag = float(lissajous_phase(x, y, 2.0 * np.pi * periods / x.shape[1], periods)[0])
    a, b = (float(np.sqrt(2.0) * np.std(z)) for z in (x, y))
    return Ellipse(a, b, lag, float(np.pi * a * b * np.sin(lag)))
