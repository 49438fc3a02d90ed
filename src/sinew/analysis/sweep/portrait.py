"""Phase portraits of torsion and its rate, and how anharmonic the joint is by them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from sinew.analysis.signal.attitude import steady_motion
from sinew.analysis.signal.harmonics import fit_harmonics
from sinew.analysis.signal.signals import Signals, read_signals, torsion_chain
from sinew.measure.arrays import Array, wrapped_lag
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate

if TYPE_CHECKING:
    from sinew.plan.rig import RigSpec


@dataclass(frozen=True)
class Portrait:
    """The orbit (φ, φ̇) of one steady segment over whole periods, and what bends it out of an ellipse.

    motion: see `sinew.analysis.signal.attitude.steady_motion`; the torsion counts from its mean.
    even_share: √(|X₂|² + |X₄|²)/|X₁|: zero for every joint that is the same to both sides.
    third_share: |X₃|/|X₁|: the squeeze of a symmetric hardening or softening.
    half_area_asymmetry: (A₊ - A₋)/(A₊ + A₋) of the areas enclosed at φ > 0 and φ < 0, mean and scatter over periods.
    """

    motion: xr.Dataset
    even_share: Estimate
    third_share: Estimate
    half_area_asymmetry: Estimate


def phase_portrait(recording: xr.Dataset | Signals, segment: int, rig: "RigSpec | None" = None) -> Portrait:
    """Return the phase portrait of one steady segment (paper, section 5.2.3).

    segment: its number in the recording. rig: whose sensor chain is undone, at each harmonic for the shares.
    Raises RecordingError where the segment is not steady, has no frequency or holds no whole period.
    """
    signals = read_signals(recording, rig)
    motion, response, (_, where) = steady_motion(signals, segment), signals.response, signals.segments[segment]
    frequency = np.array([motion.attrs["frequency_hz"]])
    fitted = fit_harmonics(signals.time_s[where][None], response.values[where][None, None], frequency)
    order = np.arange(1, fitted.coefficient.shape[2] + 1) * frequency
    chain = torsion_chain(signals.budget, order) * (order if response.is_rate else 1.0)
    size = np.nan_to_num(np.abs(fitted.coefficient[0, 0] / chain))
    noise = np.nan_to_num(fitted.std[0, 0] / np.abs(chain))
    even = np.hypot(size[1], size[3])
    share = (size[1] * noise[1] + size[3] * noise[3]) / even if even > 0 else noise[1]
    return Portrait(
        motion,
        Estimate.normal(even / size[0], share / size[0]),
        Estimate.normal(size[2] / size[0], noise[2] / size[0]),
        _half_area_asymmetry(motion),
    )


def _half_area_asymmetry(motion: xr.Dataset) -> Estimate:
    """Return the asymmetry of the enclosed areas: ∮ φ̇ dφ is ∫ φ̇² dt, here over φ > 0 less φ < 0, of their sum.

    A sample that lies across φ = 0 counts to both sides by its share.
    """
    time, angle, rate = (motion[name].values for name in ("time_s", "torsion", "rate"))
    step = np.gradient(time)
    reach = np.maximum(0.5 * np.abs(rate) * step, 1e-300)
    side = np.clip((angle - angle.mean()) / reach, -1.0, 1.0)
    period = np.floor((time - time[0]) * motion.attrs["frequency_hz"] + 1e-9).astype(int)
    period = np.minimum(period, motion.attrs["periods"] - 1)
    work = rate**2 * step
    values = np.bincount(period, weights=side * work) / np.bincount(period, weights=work)
    if values.size < 2:
        return Estimate(float(values[0]), float("nan"), float("nan"), float("nan"))
    return Estimate.student(float(values.mean()), float(values.std(ddof=1) / np.sqrt(values.size)), values.size - 1)


# Torsion over drive becomes an ellipse, and the ellipse a phase.


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

    def curve(self, points: int = 181) -> tuple[Array, Array]:
        """Return (drive, torsion) of the ellipse, closed, each of shape (points,)."""
        angle = np.linspace(0.0, 2.0 * np.pi, points)
        return self.drive_amplitude * np.cos(angle), self.torsion_amplitude * np.cos(angle - self.lag_rad)


def lissajous_phase(drive: Array, torsion: Array, step_rad: Array, periods: Array) -> Array:
    """Return the lag of figures over whole periods, (s,) from drive and torsion of shape (s, n).

    step_rad: phase between samples ΩT, shape (s,). periods: whole periods in the record, shape (s,).
    The area by the shoelace formula is π a b sin(lag) per period (a polygon on the ellipse is short by
    sin(ΩT)/(ΩT), undone here), the mean product a b cos(lag)/2; their quotient is the tangent of the lag in the right
    quadrant and, unlike arcsin(area/(π a b)), well conditioned where the lag is 90°.
    """
    x = drive - drive.mean(axis=1, keepdims=True)
    y = torsion - torsion.mean(axis=1, keepdims=True)
    area = _shoelace(x, y) * (step_rad / np.sin(step_rad)) / periods
    return wrapped_lag(2.0 / x.shape[1] * np.vecdot(x, y) - 1j * area / np.pi)


def _shoelace(x: Array, y: Array) -> Array:
    """Return ∮ x dy over closed polygons, shape (s,): positive counter-clockwise, as torsion behind drive runs."""
    inside = np.vecdot(x[:, :-1], y[:, 1:]) - np.vecdot(x[:, 1:], y[:, :-1])
    return np.asarray(0.5 * (inside + x[:, -1] * y[:, 0] - x[:, 0] * y[:, -1]))


def fit_ellipse(motion: xr.Dataset) -> Ellipse:
    """Return the ellipse of one steady motion (see `sinew.analysis.signal.attitude.steady_motion`).

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
