"""Attitude of the head over a recording: as it was recorded, or as gyroscope and accelerometer tell it.

Without a recorded orientation the filter vqf (Laidig and Seel, 2023, without magnetometer; forwards and backwards)
tells it: the gyroscope is integrated, its bias estimated, and the accelerometer leant on over three seconds. What
that is good for:

- What swings is the gyroscope's, and as good as that: its delay and its low-pass are those of the torsion, and are
  undone with the harmonics. The accelerometer has no say above a tenth of a hertz, so that the head's own
  acceleration, which at 4 Hz looks like ten degrees of tilt, averages out.
- Where the head leans on average is the accelerometer's: good to about half a degree in a record of some seconds, worse
  where the head swings all the time, for what a swing does to a chip off the axis does not average out (it is taken out
  where a rig says how far off the chip is).
- The turn about gravity is seen by no such filter. Of an upright or a bent head it is the torsion's rest, which is held
  to be zero: a line through the torsion of each stretch is taken for drift. A twist that stays is therefore not seen.
- The base is held to stand upright, with the x axis of frame B against gravity, and not to move.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from sinew.analysis.signal.signals import Channel, Signals, read_signals
from sinew.measure.arrays import Array
from sinew.measure.attitude import quaternion, swing_of, torsion_of, turned_about_x
from sinew.measure.errors import RecordingError
from sinew.measure.schema import Excitation
from sinew.plan.rig import RigSpec

_EARTH_TO_BASE = Rotation.from_matrix([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""The filter's earth has z upwards, the base has x."""

_SHORTEST = 16
_GAP_STEPS = 3.0


@dataclass(frozen=True)
class Attitude:
    """Orientation of H against B, unit quaternions (n, 4); NaN where a stretch is too short to tell.

    is_recorded: whether it was measured; else the filter told it, and the torsion's rest is a line through it.
    """

    orientation: Array
    is_recorded: bool


@dataclass(frozen=True)
class HeadMotion:
    """The head over time: stamps [s]; torsion, pitch and roll [rad], see `sinew.measure.attitude`; all (n,)."""

    time_s: Array
    torsion: Array
    pitch: Array
    roll: Array


def read_attitude(signals: Signals) -> Attitude | None:
    """Return the attitude of the head over a recording, None where neither it nor what tells it was recorded.

    Stretches without a gap between their samples are filtered by themselves.
    """
    if "orientation" in signals.recorded:
        return Attitude(np.asarray(signals.recorded["orientation"], dtype=float), True)
    if not {"gyro_rad_s", "acceleration_m_s2"} <= set(signals.recorded):
        return None
    gyro = np.asarray(signals.recorded["gyro_rad_s"], dtype=float)
    force = np.asarray(signals.recorded["acceleration_m_s2"], dtype=float)
    step = 1.0 / signals.budget.sample_hz
    found = np.full((gyro.shape[0], 4), np.nan)
    for start, stop in _stretches(signals):
        if stop - start >= _SHORTEST:
            found[start:stop] = _filtered(
                gyro[start:stop], _on_axis(gyro[start:stop], force[start:stop], signals), step
            )
    return Attitude(found, False)


def head_motion(recording: xr.Dataset | Signals, rig: RigSpec | None = None) -> HeadMotion:
    """Return torsion, pitch and roll of the head over a recording, of a bent head or an upright one.

    rig: that says how far the sensor is off the joint's axis; the delay of the gyroscope is not taken off here.
    Raises RecordingError where there is no orientation, and no gyroscope with accelerometer to tell it.
    """
    signals = read_signals(recording, rig)
    attitude = read_attitude(signals)
    if attitude is None:
        raise RecordingError("nothing tells how the head stands; expected orientation, or gyroscope and accelerometer")
    torsion, swing = np.full(signals.time_s.size, np.nan), np.full((signals.time_s.size, 2), np.nan)
    for start, stop in _stretches(signals):
        here = attitude.orientation[start:stop]
        if np.isfinite(here).all():
            if not attitude.is_recorded:
                here = without_drift(signals.time_s[start:stop], here)
            torsion[start:stop], swing[start:stop] = torsion_of(here), swing_of(here)
    return HeadMotion(signals.time_s, torsion, swing[:, 0], swing[:, 1])


_TILTS: dict[str, int] = {"pitch": 1, "impulse-pitch": 1, "roll": 2, "impulse-roll": 2}
"""About which axis of frame B what moves the head tilts it."""


def tilting(signals: Signals, excitation: Excitation) -> Signals | None:
    """Return the ring-downs of one excitation with the rate of the tilt that it excites for their response.

    That rate is the gyroscope's about y (pitch) or z (roll) of B, seen from the head in its pose. None where there
    are no such decays, or no gyroscope.
    """
    decays = signals.moved_by(excitation)
    if (
        signals.pose is None
        or "gyro_rad_s" not in signals.recorded
        or not any(True for _ in decays.of_kind("ring-down"))
    ):
        return None
    stands = quaternion(0.0, signals.pose.bend, signals.pose.azimuth)
    gyro = np.asarray(signals.recorded["gyro_rad_s"], dtype=float)
    rate = Rotation.from_quat(stands[0], scalar_first=True).apply(gyro)[:, _TILTS[excitation]]
    return replace(decays, response=Channel(np.ascontiguousarray(rate), "rad/s", True), drive=None)


def without_drift(time_s: Array, orientation: Array) -> Array:
    """Return orientations (n, 4) whose heading is put right: a line through the torsion is taken for its drift."""
    elapsed = time_s - time_s.mean()
    return turned_about_x(orientation, -np.polyval(np.polyfit(elapsed, torsion_of(orientation), 1), elapsed))


def _stretches(signals: Signals) -> list[tuple[int, int]]:
    """Return (first, last + 1) of the samples that follow one another without a gap; a group of a plan is one."""
    time = signals.time_s
    # A group begins where a settle or an idle record does; what comes before it ended with a pause, or with another
    # swing.
    begins = {0, time.size} | {where.start for segment, where in signals.segments if segment.kind in ("settle", "idle")}
    steps = np.diff(time)
    begins |= set((np.flatnonzero((steps <= 0) | (steps > _GAP_STEPS / signals.budget.sample_hz)) + 1).tolist())
    marks = sorted(begins)
    return list(pairwise(marks))


def _filtered(gyro: Array, force: Array, step_s: float) -> Array:
    from vqf import offlineVQF  # a recording of an upright head does without

    # The filter turns by the rate of a sample over the step before it, which alone would be half a step too early
    # (2.7° at 3 Hz and 200 samples a second): it gets the mean of the rate over that step, by the cubic through four
    # samples.
    far = np.pad(gyro, ((2, 1), (0, 0)), mode="edge")
    mean = (13.0 * (far[1:-2] + far[2:-1]) - far[:-3] - far[3:]) / 24.0
    found = offlineVQF(np.ascontiguousarray(mean), np.ascontiguousarray(force), None, step_s)
    here = _EARTH_TO_BASE * Rotation.from_quat(np.asarray(found["quat6D"]), scalar_first=True)
    return np.asarray(here.as_quat(scalar_first=True))


def _on_axis(gyro: Array, force: Array, signals: Signals) -> Array:
    """Return what the accelerometer would read on the joint's axis, (n, 3): less α x p + ω x (ω x p) of a chip at p."""
    if signals.rig is None:
        return force
    place = np.array([0.0, signals.rig.imu.mount_radius.value, 0.0])
    speeding = np.gradient(gyro, 1.0 / signals.budget.sample_hz, axis=0)
    return np.asarray(force - np.cross(speeding, place) - np.cross(gyro, np.cross(gyro, place)))
