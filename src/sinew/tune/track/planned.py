"""This is where a plan's tracking, and what is expected of the rig, become the drive law of one motion."""

from collections.abc import Sequence
from math import radians

import numpy as np

from sinew.analysis.signal.sensor import DelayBudget, torsion_chain
from sinew.measure.errors import SpecError
from sinew.plan.plan import Group, Plan, Track
from sinew.plan.rig import RigSpec
from sinew.tune.track.expected import ExpectedBackbone, resonance_slope
from sinew.tune.track.tracker import Follow, PretensionPath, Ramp, Stand, Tracker, TrackerSetting, design_loop

__all__ = ["planned_tracker", "sensor_budget"]

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
