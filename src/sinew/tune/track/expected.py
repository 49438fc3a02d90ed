"""What tracking should find on a rig, said beforehand: resonance, damping, amplitudes.

It is the backbone by prediction: the steady motions at which the torsion's fundamental lags the lever's by 90°, over
the amplitude of the drive. The loop's gains, its first frequency and what the pretension is worth follow from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians

import numpy as np

from sinew.analysis.signal.signals import DelayBudget, torsion_chain
from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.plan.plan import Group, Held, Plan, TendonMode, Track
from sinew.plan.rig import RigSpec
from sinew.predict.describing import equivalent_of_rig
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.solve.backbone import follow_backbones
from sinew.tune.track.tracker import Follow, Mode, PretensionPath, Ramp, Stand, Tracker, TrackerSetting, design_loop
from sinew.twin.cache import configure

_BAND_HZ = (1.0, 6.0)


@dataclass(frozen=True)
class ExpectedBackbone:
    """The predicted backbone at one pretension [mm], over growing drive, each (n,): frequency_hz, damping_ratio of the
    equivalent linear joint, amplitudes of the fundamentals of command, lever and torsion [rad]."""

    pretension_mm: float
    frequency_hz: Array
    damping_ratio: Array
    command: Array
    lever: Array
    torsion: Array

    def mode(self, held: Held, amplitude: float) -> Mode:
        """Return the mode where an amplitude of command, lever or torsion is held [rad]; at the curve's end beyond."""
        along = getattr(self, held)
        return Mode(
            float(np.interp(amplitude, along, self.frequency_hz)),
            float(np.interp(amplitude, along, self.damping_ratio)),
        )

    def torsion_at(self, held: Held, amplitude: float) -> float:
        """Return the amplitude of the torsion [rad] where one of command, lever or torsion is held [rad]."""
        return float(np.interp(amplitude, getattr(self, held), self.torsion))

    def frequency_at(self, torsion: float) -> float:
        """Return the predicted resonance [Hz] at an amplitude of the torsion [rad]; NaN beyond the curve."""
        inside = self.torsion[0] <= torsion <= self.torsion[-1] * 1.02
        return float(np.interp(torsion, self.torsion, self.frequency_hz)) if inside else float("nan")


def expect_backbones(
    rig: RigSpec,
    pretension_mm: Sequence[float],
    largest_deg: float,
    *,
    mode: TendonMode = "position",
    band_hz: tuple[float, float] = _BAND_HZ,
) -> tuple[ExpectedBackbone, ...]:
    """Return the predicted backbone at each pretension, up to an amplitude of the command [deg].

    band_hz: where resonances are sought. Raises SpecError where the rig resonates nowhere in it.
    """
    configure()
    problem = joint_problem(rig, list(pretension_mm), largest_deg, band_hz, mode=mode)
    found = []
    for mm, backbone in zip(pretension_mm, follow_backbones(problem, band_hz, RESOLUTION), strict=True):
        curve = backbone.curve
        if curve.frequency_hz.size < 2:
            raise SpecError(f"no resonance of rig {rig.name} is predicted at {mm:g} mm: {curve.message}")
        command = backbone.share * np.radians(largest_deg)
        damping = equivalent_of_rig(curve, curve.drive, rig).damping_ratio
        found.append(ExpectedBackbone(mm, curve.frequency_hz, damping, command, np.abs(curve.drive), curve.fundamental))
    return tuple(found)


def resonance_slope(backbones: Sequence[ExpectedBackbone], held: Held, amplitude: float) -> float:
    """Return the mean slope of the resonance over pretension [Hz/mm], with an amplitude held [rad]; 0 of one alone."""
    if len(backbones) < 2:
        return 0.0
    ends = [one.mode(held, amplitude).frequency_hz for one in (backbones[0], backbones[-1])]
    return (ends[1] - ends[0]) / (backbones[-1].pretension_mm - backbones[0].pretension_mm)


# A plan's tracking, and what is expected of the rig, become the drive law of one motion.

_NODE_HZ = 200.0
_OUTER_SHARE = 0.2  # of the phase loop's crossover


def sensor_budget(rig: RigSpec) -> DelayBudget:
    """Return the delays of a rig's sensor at its own rate."""
    imu = rig.imu
    return DelayBudget(_NODE_HZ, imu.low_pass.value, imu.residual_delay.value, imu.average_samples)


def planned_tracker(
    group: Group, plan: Plan, rig: RigSpec, expected: Sequence[ExpectedBackbone], time: float
) -> Tracker:
    """Return the law that tracks in a group of a plan, from a time on [s].

    expected: backbones of the rig at pretensions that hold the group's, in rising order.
    Raises SpecError where the plan does not track, or wants a frequency that is not expected on its way.
    """
    track = plan.track
    if track is None:
        raise SpecError(f"plan {plan.name} has no [track]")
    amplitude = radians(group.amplitude_deg)
    mode = min(expected, key=lambda one: abs(one.pretension_mm - group.pretension_mm)).mode(track.held, amplitude)
    moves = track.pretension_to_mm is not None
    budget = sensor_budget(rig)
    setting = TrackerSetting(
        mode=mode,
        start_hz=mode.frequency_hz if track.start_hz is None else track.start_hz,
        low_hz=track.low_hz,
        high_hz=track.high_hz,
        wanted=amplitude,
        most=radians(rig.limits.drive_amplitude_deg),
        held=track.held,
        chain=lambda hertz: complex(torsion_chain(budget, hertz)),
        hz_per_mm=resonance_slope(expected, track.held, amplitude) if moves else 0.0,
    )
    rate = _OUTER_SHARE * design_loop(mode).crossover
    return Tracker(setting, _path(group, track, expected, amplitude, rate), time)


def _path(
    group: Group, track: Track, expected: Sequence[ExpectedBackbone], amplitude: float, rate: float
) -> PretensionPath:
    if track.pretension_to_mm is None:
        return Stand(group.pretension_mm)
    if track.wanted_hz is None:
        return Ramp(group.pretension_mm, track.pretension_to_mm, track.duration_s, track.lead_s)
    first, last = track.wanted_hz
    table = [one.mode(track.held, amplitude).frequency_hz for one in expected]
    if min(first, last) < table[0] or max(first, last) > table[-1]:
        raise SpecError(
            f"found wanted frequencies of {first:g} and {last:g} Hz, expected {table[0]:.2f} to {table[-1]:.2f} Hz, "
            f"which is what {expected[0].pretension_mm:g} to {expected[-1].pretension_mm:g} mm can reach"
        )
    times = (track.lead_s, track.lead_s + track.duration_s)

    def wanted(time: float) -> float:
        return float(np.interp(time, times, (first, last)))

    return Follow(wanted, [one.pretension_mm for one in expected], table, rate)
