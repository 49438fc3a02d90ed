"""This is where the drive's frequency is moved until the torsion lags the lever by 90°."""

import math

from sinew.tune.mode import LoopGains

__all__ = ["PhaseLoop", "lag_error"]


def lag_error(lever: complex, torsion: complex) -> float:
    """Return by how much the torsion's lag behind the lever exceeds 90° [rad], in (-π, π].

    Positive above the resonance, negative below.
    """
    lag = math.atan2((lever * torsion.conjugate()).imag, (lever * torsion.conjugate()).real)
    return math.remainder(lag - 0.5 * math.pi, math.tau)


class PhaseLoop:
    """The PI controller of the angular frequency, within bounds.

    gains: of `sinew.tune.mode.design_loop`. start, low, high: angular frequencies [rad/s].
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
