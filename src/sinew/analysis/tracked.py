"""A tracked swing looked at afterwards, turn by turn: frequency, phase, amplitudes, pretension."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from sinew.analysis.signal.signals import DelayBudget, Signals, drive_chain, read_signals, torsion_chain
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.plan.rig import RigSpec

_ORDERS = (1, 3)
_FEWEST_ROWS = 16
_MOST_GAP = 0.15  # of a turn
_BLOCKS = 5
_FIRST_ROWS = 4  # the pretension may move from the begin on


@dataclass(frozen=True)
class TrackedPoint:
    """Where a joint resonated while it was tracked: a point of its backbone.

    frequency_hz: at which the torsion's fundamental lags the measured lever by 90°. torsion_deg, lever_deg: amplitudes
    of the fundamentals. phase_error_deg: root mean square over the turns of the lag less 90°. damping_ratio: Lehr's, of
    the equivalent linear joint, which at that phase is I_l θ/(2 I φ). pretension_mm: mean. turns: how many were used.
    """

    pretension_mm: float
    frequency_hz: Estimate
    torsion_deg: Estimate
    lever_deg: Estimate
    damping_ratio: Estimate
    phase_error_deg: float
    turns: int


def tracked_turns(recording: xr.Dataset, segment: int, rig: RigSpec) -> xr.Dataset:
    """Return a tracking segment turn by turn, over `turn`: time_s (middle, since the segment's begin), frequency_hz,
    phase_error_rad (lag less 90°), lever_rad, torsion_rad (amplitudes), pretension_mm.

    Turns are counted by the rising zeros of the command. Lever and rate are fitted in each by offset and harmonics 1
    and 3; the delays of both sensors are undone. A turn with a hole in it is left out.
    Raises RecordingError where the segment is not tracking, lacks a channel, or holds no whole turn.
    """
    signals = read_signals(recording, rig)
    (asked, where), lever, rate = signals.segments[segment], signals.drive, signals.response
    command = signals.recorded.get("drive_command_rad")
    if asked.kind != "tracking" or command is None or lever is None or not rate.is_rate:
        raise RecordingError(f"segment {segment} is {asked.kind}, expected tracking with command, lever and gyroscope")
    time = signals.time_s[where]
    both = np.stack([lever.values[where], rate.values[where]], axis=1)
    pretension = _pretension(signals, where, asked.pretension_mm, rig)
    zeros = _rising_zeros(time, command[where].astype(float))
    rows = []
    for begin, end in pairwise(zeros.tolist()):
        mine = slice(*np.searchsorted(time, (begin, end)))
        found = _turn(time[mine], both[mine], begin, end, signals.budget)
        if found is not None:
            rows.append((0.5 * (begin + end) - time[0], 1 / (end - begin), *found, float(pretension[mine].mean())))
    if not rows:
        raise RecordingError(f"segment {segment} holds no whole turn of the drive; track longer")
    names = ("time_s", "frequency_hz", "phase_error_rad", "lever_rad", "torsion_rad", "pretension_mm")
    return xr.Dataset({name: ("turn", column) for name, column in zip(names, np.array(rows).T, strict=True)})


def _rising_zeros(time: Array, command: Array) -> Array:
    at = np.flatnonzero((command[:-1] < 0) & (command[1:] >= 0))
    share = -command[at] / (command[at + 1] - command[at])
    return np.asarray(time[at] + share * (time[at + 1] - time[at]))


def _turn(
    time: Array, signals: Array, begin: float, end: float, budget: DelayBudget
) -> tuple[float, float, float] | None:
    """Return (phase error [rad], amplitudes of lever and torsion [rad]) of one turn; None where it has holes."""
    longest = float(np.diff(time, prepend=begin, append=end).max())
    if time.size < _FEWEST_ROWS or longest > _MOST_GAP * (end - begin):
        return None
    hertz = 1 / (end - begin)
    phase = math.tau * hertz * (time - begin)
    waves = [wave(order * phase) for order in _ORDERS for wave in (np.cos, np.sin)]
    found = np.linalg.lstsq(np.stack([np.ones_like(phase), *waves], axis=1), signals, rcond=None)[0]
    lever, rate = found[1] - 1j * found[2]
    lever = lever / complex(drive_chain(budget, hertz))
    torsion = rate / (1j * math.tau * hertz * complex(torsion_chain(budget, hertz)))
    lag = float(np.angle(lever * np.conj(torsion)))
    return math.remainder(lag - 0.5 * math.pi, math.tau), abs(lever), abs(torsion)


def _pretension(signals: Signals, where: slice, begin: float, rig: RigSpec) -> Array:
    """Return the pretension of every row [mm]: that of the begin, and what the motors took up since its begin.

    What their position loops give way under load is added, as the plan counts by goals.
    """
    recorded = signals.recorded
    if "tendon_rad" not in recorded:
        return np.full(where.stop - where.start, begin)
    tendons = rig.tendons
    horn = recorded["tendon_rad"][where].astype(float).mean(axis=1) * tendons.pulley_radius.value
    current = recorded["tendon_current_a"][where].astype(float).mean(axis=1)
    give = current * tendons.tension(1.0) / tendons.servo_stiffness.value
    goal = horn + give
    rest = goal[:_FIRST_ROWS].mean()
    return np.asarray(begin + 1e3 * (goal - rest))


def tracked_point(turns: xr.Dataset, rig: RigSpec, share: float = 0.5) -> TrackedPoint:
    """Return the point of the backbone that a stretch of turns at one pretension holds.

    turns: of `tracked_turns`. share: of them, the last ones, that are used; the others belong to the start.
    Neighbouring turns are not independent, so standard deviations are of the means of five blocks, and Student's
    interval has four degrees of freedom. The frequency's has the uncertainty of the delay budget in it: a phase wrong
    by ε moves it by ε D f.
    Raises RecordingError where fewer than ten turns are left.
    """
    count = int(share * turns.sizes["turn"])
    if count < 2 * _BLOCKS:
        raise RecordingError(f"{count} turns are left to measure, expected {2 * _BLOCKS} or more; track longer")
    mine = turns.isel(turn=slice(-count, None))
    hertz, torsion, lever = (mine[name].values for name in ("frequency_hz", "torsion_rad", "lever_rad"))
    half = rig.inertia.lever.value / (rig.inertia.head.value + rig.inertia.lever.value) / 2
    damping = _mean(half * lever / torsion)
    frequency = _mean(hertz)
    delay = math.tau * frequency.value * rig.imu.delay_std.value * damping.value * frequency.value
    return TrackedPoint(
        pretension_mm=float(mine["pretension_mm"].mean()),
        frequency_hz=_widened(frequency, delay),
        torsion_deg=_mean(np.degrees(torsion)),
        lever_deg=_mean(np.degrees(lever)),
        damping_ratio=damping,
        phase_error_deg=float(np.degrees(np.sqrt(np.mean(mine["phase_error_rad"].values ** 2)))),
        turns=count,
    )


def _mean(values: Array) -> Estimate:
    means = np.array([block.mean() for block in np.array_split(values, _BLOCKS)])
    return Estimate.student(float(values.mean()), float(means.std(ddof=1) / math.sqrt(_BLOCKS)), _BLOCKS - 1)


def _widened(estimate: Estimate, std: float) -> Estimate:
    """Return an estimate with another, normal uncertainty added in squares, to its interval as well."""
    half = math.hypot(estimate.high - estimate.value, NORMAL_90 * std)
    value = estimate.value
    return Estimate(value, math.hypot(estimate.std, std), value - half, value + half)
