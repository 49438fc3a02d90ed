"""Resonance tracking: a drive law that keeps a joint in resonance, and what it should find on a rig.

Samples go in, lever command and pretension come out. Angles are in rad, times in s of one clock. The law knows no
devices: whoever runs it tells it each cycle what was measured and asks it what to do next.
"""

import cmath
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import brentq

from sinew.analysis.signal.signals import sensor_budget, torsion_chain
from sinew.analysis.tracked import ENTER_DEG, LEAVE_DEG, PATIENCE
from sinew.measure import events
from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.estimate import finite
from sinew.plan.plan import Group, Held, Plan, TendonMode, Track
from sinew.plan.rig import RigSpec
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.predict.linear import equivalent_of_rig
from sinew.solve.backbone import follow_backbones
from sinew.solve.programs import configure

# The pretension moves while the resonance is tracked: not at all, on a ramp, or after a frequency.

FASTEST_MM_S = 1.5
"""Fastest change of the pretension while the joint swings [mm/s]."""


class Ramp:
    """The pretension goes from one value to another [mm] in a time [s], after a lead [s]; it waits without a lock.
    Without another value it stays."""

    wanted_hz: None = None

    def __init__(self, first_mm: float, last_mm: float | None = None, duration: float = 0.0, lead: float = 0.0) -> None:
        self._mm, self._last, self._lead = first_mm, first_mm if last_mm is None else last_mm, lead
        self._speed = min(abs(self._last - first_mm) / duration, FASTEST_MM_S) if duration > 0 else FASTEST_MM_S

    def update(self, time: float, frequency_hz: float | None, step: float) -> float:
        """Return the pretension [mm] at a time since the start [s].

        frequency_hz: of the locked resonance, None while it is not. step: time since the last update [s].
        """
        if frequency_hz is not None and time >= self._lead:
            reach = self._speed * step
            self._mm += max(-reach, min(reach, self._last - self._mm))
        return self._mm


class Follow:
    """The pretension moves so that the resonance is at a commanded frequency: the outer loop.

    wanted: frequency [Hz] at a time since the start [s]. table_mm, table_hz: resonance over pretension as expected;
    only its slope and its start are used, the rest is the controller's. rate: K_o [1/s], at most a fifth of the phase
    loop's crossover.

    With f the locked resonance and s = df/dp of the table at f, dp/dt = (df_wanted/dt + K_o (f_wanted - f)) / s, at
    most `fastest` [mm/s] and within the table's range: the pretension is itself the integral, so it cannot wind up.
    """

    def __init__(
        self,
        wanted: Callable[[float], float],
        table_mm: Sequence[float],
        table_hz: Sequence[float],
        rate: float,
        fastest: float = FASTEST_MM_S,
    ) -> None:
        self._table_mm, self._table_hz = np.asarray(table_mm, dtype=float), np.asarray(table_hz, dtype=float)
        if self._table_mm.size < 2 or (np.diff(self._table_mm) <= 0).any() or (np.diff(self._table_hz) <= 0).any():
            raise ValueError("following a frequency needs a resonance that rises with pretension, at two or more")
        self._wanted, self._rate, self._fastest = wanted, rate, fastest
        self._mm = float(np.interp(wanted(0.0), self._table_hz, self._table_mm))
        self._before = wanted(0.0)
        self.wanted_hz: float | None = self._before

    def update(self, time: float, frequency_hz: float | None, step: float) -> float:
        """Return the pretension [mm], see `Ramp.update`. `wanted_hz` is then the frequency that is asked for."""
        commanded = self._wanted(time)
        moved, self._before, self.wanted_hz = commanded - self._before, commanded, commanded
        if frequency_hz is not None:
            change = (moved + self._rate * step * (commanded - frequency_hz)) / self.slope(frequency_hz)
            reach = self._fastest * step
            self._mm += max(-reach, min(reach, change))
            self._mm = min(max(self._mm, float(self._table_mm[0])), float(self._table_mm[-1]))
        return self._mm

    def slope(self, frequency_hz: float) -> float:
        """Return df/dp of the table [Hz/mm] where the resonance is at a frequency [Hz]."""
        slopes = np.diff(self._table_hz) / np.diff(self._table_mm)
        at = int(np.searchsorted(self._table_hz, frequency_hz)) - 1
        return float(slopes[min(max(at, 0), slopes.size - 1)])


# The mode that is tracked is told by two numbers, and the gains of the loop follow from them.
#
# Near its resonance ω₀ a mode of decay rate λ = D ω₀ answers a drive of angular frequency Ω with a lag δ that obeys
#
#     dδ/dt = (Ω - ω₀) - λ (δ - π/2):
#
# a first-order lag with the slope dδ/dΩ = 1/λ and the group delay 1/λ. With a PI controller Ω = Ω_i - K_p e, dΩ_i/dt =
# -K_i e on the error e = δ - π/2, the open loop is
#
#     L(s) = (K_p s + K_i) / (s (s + λ)) · exp(-s τ),    τ = half a turn (the detector) and a cycle.
#
# K_p is as large as the delay allows: K_p τ is set. K_i = λ K_p would take the mode's pole out of the loop and leave
# the closed loop a slow one near λ wherever the damping is not exactly known; with twice as much both poles move
# together: s² + (λ + K_p) s + 2 λ K_p.

_GAIN_DELAY = 0.35  # K_p τ
_INTEGRAL_SHARE = 2.0  # K_i over λ K_p
_CYCLE_S = 0.0075  # from a sample to the goal that heeds it, and half of how long that goal stands


@dataclass(frozen=True, slots=True)
class Mode:
    """A mode: resonance frequency [Hz] and Lehr's damping ratio [1], at the amplitude at which it is tracked."""

    frequency_hz: float
    damping_ratio: float

    @property
    def decay_rate(self) -> float:
        """λ = D ω₀ [1/s]: dΩ/dδ at the resonance, and one over its group delay."""
        return self.damping_ratio * math.tau * self.frequency_hz


@dataclass(frozen=True, slots=True)
class LoopGains:
    """proportional: K_p [1/s]. integral: K_i [1/s²]. delay: of the detector and the cycle [s].
    crossover: angular frequency at which the open loop's gain is one [rad/s]."""

    proportional: float
    integral: float
    delay: float
    crossover: float


def design_loop(mode: Mode, gain_delay: float = _GAIN_DELAY) -> LoopGains:
    """Return the gains of the phase loop for a mode.

    gain_delay: K_p τ [rad]; 0.35 leaves a phase margin of 50° to 57° at the dampings of tendon joints.
    Raises ValueError for a mode without positive frequency and damping, which has no phase slope to stand on.
    """
    if not (mode.frequency_hz > 0 and mode.damping_ratio > 0):
        raise ValueError(
            f"found a mode of {mode.frequency_hz:g} Hz and damping {mode.damping_ratio:g}, expected both positive"
        )
    delay = 0.5 / mode.frequency_hz + _CYCLE_S
    proportional = gain_delay / delay
    integral = _INTEGRAL_SHARE * mode.decay_rate * proportional

    def loop(omega: float) -> complex:
        s = 1j * omega
        return (proportional * s + integral) / (s * (s + mode.decay_rate)) * cmath.exp(-s * delay)

    crossover = float(brentq(lambda omega: abs(loop(omega)) - 1.0, 1e-3 * proportional, 1e2 * (1.0 + proportional)))
    return LoopGains(proportional, integral, delay, crossover)


# The size of the swing is held: by the lever's command, by the lever, or by the torsion.

_LOG_STEP = 0.7  # of a decade's natural logarithm at most that one correction counts as


class SwingControl:
    """Sets the amplitude of the lever's command.

    held: which amplitude is to be `wanted` [rad]: the command's own, or the measured one of lever or torsion.
    most: of the command [rad]. rise: time in which the command may grow from nothing to `most`, or fall [s].
    rate: of the correction [1/s], well below the mode's decay rate.
    The correction is an integrator of the amplitude's logarithm, so a loop of any gain settles alike; at `most` it
    stands still (anti-windup).
    """

    def __init__(self, held: Held, wanted: float, most: float, rise: float, rate: float) -> None:
        self._held, self._wanted, self._most, self._rise, self._rate = held, wanted, most, rise, rate
        self._aim = min(wanted, most)
        self.amplitude = 0.0

    @property
    def is_limited(self) -> bool:
        """Whether more than the largest command would be needed."""
        return self._held != "command" and self._aim >= self._most

    def update(self, measured: float | None, step: float) -> float:
        """Return the next amplitude of the command [rad].

        measured: amplitude of lever or torsion [rad], None where there is none or the phase is not locked yet.
        step: time since the last update [s].
        """
        if self._held != "command" and measured is not None and measured > 0:
            off = math.log(self._wanted / measured)
            self._aim *= math.exp(self._rate * step * max(-_LOG_STEP, min(_LOG_STEP, off)))
            self._aim = min(self._aim, self._most)
        reach = self._most * step / self._rise
        self.amplitude += max(-reach, min(reach, self._aim - self.amplitude))
        return self.amplitude


# The drive's frequency is moved until the torsion lags the lever by 90°.


def lag_error(lever: complex, torsion: complex) -> float:
    """Return by how much the torsion's lag behind the lever exceeds 90° [rad], in (-π, π].

    Positive above the resonance, negative below.
    """
    lag = math.atan2((lever * torsion.conjugate()).imag, (lever * torsion.conjugate()).real)
    return math.remainder(lag - 0.5 * math.pi, math.tau)


class PhaseLoop:
    """The PI controller of the angular frequency, within bounds.

    gains: of `design_loop`. start, low, high: angular frequencies [rad/s].
    fastest: how fast the frequency may change [rad/s²]: the mode must have time to answer.
    Anti-windup: while the frequency is at a bound, or changes as fast as it may, the integral does not move further
    that way.
    """

    def __init__(self, gains: LoopGains, start: float, low: float, high: float, fastest: float) -> None:
        self._gains, self._low, self._high, self._fastest = gains, low, high, fastest
        self._integral = self.omega = min(max(start, low), high)

    @property
    def is_limited(self) -> bool:
        """Whether the frequency stands at one of its bounds."""
        return self.omega in (self._low, self._high)

    def update(self, error: float, step: float, feed: float = 0.0) -> float:
        """Return the next angular frequency [rad/s].

        error: of the lag [rad]. step: time since the last update [s]. feed: known change of the resonance [rad/s].
        """
        self._integral += feed
        aim = self._integral - self._gains.integral * error * step
        wanted = aim - self._gains.proportional * error
        reach = self._fastest * step + abs(feed)
        allowed = min(max(wanted, self.omega - reach, self._low), self.omega + reach, self._high)
        if allowed == wanted or (wanted - allowed) * error > 0:
            self._integral = aim
        self._integral = min(max(self._integral, self._low), self._high)
        self.omega = allowed
        return allowed

    def coast(self) -> float:
        """Return the angular frequency [rad/s] that is kept while there is nothing to go by."""
        self._integral = self.omega
        return self.omega


# The drive's sine runs on: its frequency may change at any time, its phase never jumps.

_KEPT = 400  # pieces; two seconds of cycles, older times are told by the oldest piece


class Oscillator:
    """The sine A sin ψ(t) whose angular frequency is constant in pieces.

    time: at which its phase is zero [s]. omega: until it is changed [rad/s].
    A change acts from the latest time on that was asked for as a command, so what was sent stays true.
    """

    def __init__(self, time: float, omega: float) -> None:
        self._pieces: deque[tuple[float, float, float]] = deque([(time, 0.0, omega)], maxlen=_KEPT)
        self._latest = time
        self.amplitude = 0.0

    @property
    def omega(self) -> float:
        """Angular frequency from now on [rad/s]."""
        return self._pieces[-1][2]

    def phase(self, time: float) -> float:
        """Return ψ [rad] at a time [s], past or coming."""
        for since, phase, omega in reversed(self._pieces):
            if time >= since:
                return phase + omega * (time - since)
        since, phase, omega = self._pieces[0]
        return phase + omega * (time - since)

    def command(self, time: float) -> float:
        """Return the sine [rad] at a time [s] for which it is then fixed."""
        self._latest = max(self._latest, time)
        return self.amplitude * math.sin(self.phase(time))

    def change(self, omega: float) -> None:
        """Let the angular frequency be another one [rad/s] from the latest commanded time on."""
        if omega != self.omega:
            self._pieces.append((self._latest, self.phase(self._latest), omega))


# It is decided whether the loop is locked: by the phase error over whole cycles, with hysteresis.


class Lock:
    """Follows the phase error. is_locked: whether the loop is. cycles: of the drive until the first lock; NaN before.
    losses: how often the lock was lost.

    A lock begins with an error below `ENTER_DEG` over a whole turn of the drive, and ends with one above `LEAVE_DEG`
    over a whole turn, or after `PATIENCE` turns without a phase.
    """

    def __init__(self) -> None:
        self.is_locked = False
        self.cycles = math.nan
        self.losses = 0
        self._since = math.nan  # the drive's turns at which the error passed its threshold
        self._blind = math.nan

    def update(self, error: float | None, turns: float) -> bool:
        """Take the phase error [rad], or None where there is none, at so many turns of the drive; return is_locked."""
        if error is None:
            self._blind = turns if math.isnan(self._blind) else self._blind
            if turns - self._blind > PATIENCE and self.is_locked:
                self._lose()
            return self.is_locked
        self._blind = math.nan
        passed = abs(error) > math.radians(LEAVE_DEG) if self.is_locked else abs(error) < math.radians(ENTER_DEG)
        if not passed:
            self._since = math.nan
            return self.is_locked
        self._since = turns if math.isnan(self._since) else self._since
        if turns - self._since < 1.0:
            return self.is_locked
        if self.is_locked:
            self._lose()
        else:
            self.is_locked, self._since = True, math.nan
            self.cycles = turns if math.isnan(self.cycles) else self.cycles
        return self.is_locked

    def _lose(self) -> None:
        self.is_locked, self._since = False, math.nan
        self.losses += 1


# The newest turn of a signal becomes a phasor, whatever samples of it came.

_ORDERS = (1, 3)
_FEWEST = 12
_WIDEST = 1.0  # rad between neighbours: a fifth of a turn at most is guessed


class Fundamental:
    """Synchronous demodulation over one turn of the drive, by least squares.

    value(ψ) = offset + Re Σ c_h exp(j h ψ), h = 1 and 3, is fitted to the samples of the newest turn, each at the phase
    that the drive had when it was taken. Offset, third harmonic and (by the whole turn) most of the rest do not reach
    c_1; times may be uneven, and lost samples only make the fit a little noisier. The result belongs to the middle of
    the turn: it is half a period old.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float]] = deque()

    def add(self, phase: float, value: float) -> None:
        """Take a sample of a phase of the drive [rad]; one that is not newer than the last is left out."""
        if self._samples and phase <= self._samples[-1][0]:
            return
        self._samples.append((phase, value))
        while self._samples[0][0] < phase - math.tau:
            self._samples.popleft()

    def phasor(self, now: float) -> complex | None:
        """Return c_1 at the drive's present phase [rad], or None where the newest turn has too few samples."""
        phases = np.array([phase for phase, _ in self._samples])
        if phases.size < _FEWEST or now - phases[-1] > _WIDEST or phases[-1] - phases[0] < math.tau - _WIDEST:
            return None
        if np.diff(phases).max() > _WIDEST:
            return None
        values = np.array([value for _, value in self._samples])
        waves = [wave(order * phases) for order in _ORDERS for wave in (np.cos, np.sin)]
        design = np.stack([np.ones_like(phases), *waves], axis=1)
        # The normal equations of a nearly orthogonal basis: exact enough, and a quarter of the time of a QR.
        found = np.linalg.solve(design.T @ design, design.T @ values)
        return complex(found[1], -found[2])


_STILL = math.radians(0.3)  # a torsion below it has no phase worth following
_SLEW_PER_DECAY = 12.0  # the frequency may move through so many half widths in a mode's time constant
_RISE_S = 0.6


@dataclass(frozen=True)
class TrackerSetting:
    """What is tracked, and within what.

    mode: as expected; the gains follow from it. start_hz: first drive frequency. low_hz, high_hz: its bounds.
    wanted, held: amplitude that is held [rad], and of what. most: largest command [rad].
    chain: complex factor by which the sensor multiplies the torsion at a frequency [Hz]; see
    `sinew.analysis.signal.signals.torsion_chain`. hz_per_mm: expected slope of the resonance over pretension, fed
    forward while the pretension moves; 0: none.
    """

    mode: Mode
    start_hz: float
    low_hz: float
    high_hz: float
    wanted: float
    most: float
    held: Held = "command"
    chain: Callable[[float], complex] = field(default=lambda _: 1 + 0j)
    hz_per_mm: float = 0.0


class Tracker:
    """Holds the torsion's lag behind the measured lever at 90°.

    setting: of the loops. path: of the pretension. time: at which it begins [s].

    Lever and torsion rate are demodulated at the drive's own phase, each at the times at which it was measured; the
    torsion's phasor is the rate's over jω and the sensor's chain. So neither the servo's lag nor the delay of either
    sensor is in the phase. Without samples the drive coasts at the frequency, amplitude and pretension it has.
    """

    def __init__(self, setting: TrackerSetting, path: Ramp | Follow, time: float) -> None:
        mode = setting.mode
        self._setting, self._path, self._begin, self._now = setting, path, time, time
        gains = design_loop(mode)
        fastest = _SLEW_PER_DECAY * mode.decay_rate**2
        start, low, high = (math.tau * hz for hz in (setting.start_hz, setting.low_hz, setting.high_hz))
        self._loop = PhaseLoop(gains, start, low, high, fastest)
        self._oscillator = Oscillator(time, self._loop.omega)
        self._swing = SwingControl(setting.held, setting.wanted, setting.most, _RISE_S, mode.decay_rate / 3)
        self._lever, self._rate = Fundamental(), Fundamental()
        self.lock = Lock()
        self.pretension_mm = path.update(0.0, None, 0.0)
        self.error = self.lever = self.torsion = math.nan
        self.is_coasting = False

    @property
    def frequency_hz(self) -> float:
        """The drive's present frequency [Hz]."""
        return self._oscillator.omega / math.tau

    @property
    def turns(self) -> float:
        """How often the drive has turned since the start [1]."""
        return self._oscillator.phase(self._now) / math.tau

    def command(self, time: float) -> float:
        """Return the lever's command [rad] at a time [s]."""
        return self._oscillator.command(time)

    def take(self, now: float, lever_time: float, lever: float, rate_time: float, rate: float) -> None:
        """Take what one cycle brought, and decide what comes next.

        now: of the cycle [s]. lever [rad] at lever_time, rate of the torsion [rad/s] at rate_time [s]; NaN where
        nothing came. The same sample may come twice.
        """
        step, self._now = max(0.0, now - self._now), now
        for channel, time, value in ((self._lever, lever_time, lever), (self._rate, rate_time, rate)):
            if math.isfinite(time) and math.isfinite(value):
                channel.add(self._oscillator.phase(time), value)
        error = self._measure()
        self.is_coasting = error is None and self.turns > 2.0
        locked = self.lock.update(error, self.turns)
        before = self.pretension_mm
        if error is not None or self.turns < 2.0:
            measured = {"command": None, "lever": self.lever, "torsion": self.torsion}[self._setting.held]
            self._oscillator.amplitude = self._swing.update(measured if locked else None, step)
            settled = self.frequency_hz if locked else None
            self.pretension_mm = self._path.update(now - self._begin, settled, step)
        feed = math.tau * self._setting.hz_per_mm * (self.pretension_mm - before)
        omega = self._loop.coast() if error is None else self._loop.update(error, step, feed)
        self._oscillator.change(omega)

    def tell(self) -> events.Track:
        """Return the present state as it is shown and written down."""
        return events.Track(
            elapsed_s=self._now - self._begin,
            is_locked=self.lock.is_locked,
            is_coasting=self.is_coasting,
            frequency_hz=self.frequency_hz,
            phase_error_deg=finite(math.degrees(self.error)),
            command_deg=math.degrees(self._oscillator.amplitude),
            lever_deg=finite(math.degrees(self.lever)),
            torsion_deg=finite(math.degrees(self.torsion)),
            pretension_mm=self.pretension_mm,
            wanted_hz=self._path.wanted_hz,
            is_limited=self._loop.is_limited or self._swing.is_limited,
            lock_cycles=finite(self.lock.cycles),
            lock_losses=float(self.lock.losses),
        )

    def _measure(self) -> float | None:
        """Return the error of the lag [rad], None where the newest turn does not tell it."""
        turn = self._oscillator.phase(self._now)
        lever, rate = self._lever.phasor(turn), self._rate.phasor(turn)
        self.error = self.lever = self.torsion = math.nan
        if lever is None or rate is None:
            return None
        middle = self._oscillator.omega
        torsion = rate / (1j * middle * self._setting.chain(middle / math.tau))
        self.lever, self.torsion = abs(lever), abs(torsion)
        if min(self.lever, self.torsion) < _STILL or not cmath.isfinite(torsion):
            return None
        self.error = lag_error(lever, torsion)
        return self.error


# What tracking should find on a rig, said beforehand: resonance, damping, amplitudes.
#
# It is the backbone by prediction: the steady motions at which the torsion's fundamental lags the lever's by 90°, over
# the amplitude of the drive. The loop's gains, its first frequency and what the pretension is worth follow from it.

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

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON holds it, angles in degrees, all to seven digits."""
        curves = {
            "frequency_hz": self.frequency_hz,
            "torsion_deg": np.degrees(self.torsion),
            "lever_deg": np.degrees(self.lever),
            "command_deg": np.degrees(self.command),
            "damping_ratio": self.damping_ratio,
        }
        along = {name: [float(f"{value:.7g}") for value in curve] for name, curve in curves.items()}
        return {"pretension_mm": self.pretension_mm, **along}

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> "ExpectedBackbone":
        """Return what `to_json` gave."""
        curves = ("frequency_hz", "damping_ratio", "command_deg", "lever_deg", "torsion_deg")
        frequency, damping, *angles = (np.array(row[name], dtype=float) for name in curves)
        return cls(float(row["pretension_mm"]), frequency, damping, *(np.radians(angle) for angle in angles))


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

_OUTER_SHARE = 0.2  # of the phase loop's crossover


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
    amplitude = math.radians(group.amplitude_deg)
    mode = min(expected, key=lambda one: abs(one.pretension_mm - group.pretension_mm)).mode(track.held, amplitude)
    moves = track.pretension_to_mm is not None
    budget = sensor_budget(rig)
    setting = TrackerSetting(
        mode=mode,
        start_hz=mode.frequency_hz if track.start_hz is None else track.start_hz,
        low_hz=track.low_hz,
        high_hz=track.high_hz,
        wanted=amplitude,
        most=math.radians(rig.limits.drive_amplitude_deg),
        held=track.held,
        chain=lambda hertz: complex(torsion_chain(budget, hertz)),
        hz_per_mm=resonance_slope(expected, track.held, amplitude) if moves else 0.0,
    )
    rate = _OUTER_SHARE * design_loop(mode).crossover
    return Tracker(setting, _path(group, track, expected, amplitude, rate), time)


def _path(
    group: Group, track: Track, expected: Sequence[ExpectedBackbone], amplitude: float, rate: float
) -> Ramp | Follow:
    if track.pretension_to_mm is None:
        return Ramp(group.pretension_mm)
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
