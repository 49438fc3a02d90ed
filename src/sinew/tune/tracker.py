"""This is where the parts of resonance tracking are one drive law: samples in, lever command and pretension out.

Angles are in rad, times in s of one clock. The law knows no devices: whoever runs it tells it each cycle what was
measured and asks it what to do next.
"""

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from sinew.tune.fundamental import Fundamental
from sinew.tune.lock import Lock, LockRule
from sinew.tune.mode import Mode, design_loop
from sinew.tune.oscillator import Oscillator
from sinew.tune.phase_loop import PhaseLoop, lag_error
from sinew.tune.pretension_path import PretensionPath
from sinew.tune.swing_control import Held, SwingControl

__all__ = ["Tracker", "TrackerSetting"]

_STILL = math.radians(0.3)  # a torsion below it has no phase worth following
_SLEW_PER_DECAY = 12.0  # the frequency may move through so many half widths in a mode's time constant
_RISE_S = 0.6


@dataclass(frozen=True)
class TrackerSetting:
    """What is tracked, and within what.

    mode: as expected; the gains follow from it. start_hz: first drive frequency. low_hz, high_hz: its bounds.
    wanted, held: amplitude that is held [rad], and of what. most: largest command [rad].
    chain: complex factor by which the sensor multiplies the torsion at a frequency [Hz]; see
    `sinew.analysis.sensor.torsion_chain`. hz_per_mm: expected slope of the resonance over pretension, fed forward while
    the pretension moves; 0: none.
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
    rule: LockRule = field(default_factory=LockRule)


class Tracker:
    """Holds the torsion's lag behind the measured lever at 90°.

    setting: of the loops. path: of the pretension. time: at which it begins [s].

    Lever and torsion rate are demodulated at the drive's own phase, each at the times at which it was measured; the
    torsion's phasor is the rate's over jω and the sensor's chain. So neither the servo's lag nor the delay of either
    sensor is in the phase. Without samples the drive coasts at the frequency, amplitude and pretension it has.
    """

    def __init__(self, setting: TrackerSetting, path: PretensionPath, time: float) -> None:
        mode = setting.mode
        self._setting, self._path, self._begin, self._now = setting, path, time, time
        gains = design_loop(mode)
        fastest = _SLEW_PER_DECAY * mode.decay_rate**2
        start, low, high = (math.tau * hz for hz in (setting.start_hz, setting.low_hz, setting.high_hz))
        self._loop = PhaseLoop(gains, start, low, high, fastest)
        self._oscillator = Oscillator(time, self._loop.omega)
        self._swing = SwingControl(setting.held, setting.wanted, setting.most, _RISE_S, mode.decay_rate / 3)
        self._lever, self._rate = Fundamental(), Fundamental()
        self.lock = Lock(setting.rule)
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

    def tell(self) -> Mapping[str, float | bool | None]:
        """Return the present state as it is shown and written down."""
        asked = self._path.wanted_hz
        return {
            "elapsed_s": self._now - self._begin,
            "is_locked": self.lock.is_locked,
            "is_coasting": self.is_coasting,
            "frequency_hz": self.frequency_hz,
            "phase_error_deg": _known(math.degrees(self.error)),
            "command_deg": math.degrees(self._oscillator.amplitude),
            "lever_deg": _known(math.degrees(self.lever)),
            "torsion_deg": _known(math.degrees(self.torsion)),
            "pretension_mm": self.pretension_mm,
            "wanted_hz": asked,
            "is_limited": self._loop.is_limited or self._swing.is_limited,
            "lock_cycles": _known(self.lock.cycles),
            "lock_losses": float(self.lock.losses),
        }

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


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
