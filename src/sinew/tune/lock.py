"""This is where it is decided whether the loop is locked: by the phase error over whole cycles, with hysteresis."""

import math
from dataclasses import dataclass

__all__ = ["Lock", "LockRule"]


@dataclass(frozen=True, slots=True)
class LockRule:
    """enter, leave: phase errors [rad] below which, over `cycles` of the drive, a lock begins, and above which, over as
    many, it ends. patience: cycles without a phase after which it ends as well."""

    enter: float = math.radians(6.0)
    leave: float = math.radians(30.0)
    cycles: float = 1.0
    patience: float = 4.0


class Lock:
    """Follows the phase error. is_locked: whether the loop is. cycles: of the drive until the first lock; NaN before.
    losses: how often the lock was lost."""

    def __init__(self, rule: LockRule | None = None) -> None:
        self._rule = rule or LockRule()
        self.is_locked = False
        self.cycles = math.nan
        self.losses = 0
        self._since = math.nan  # the drive's turns at which the error passed its threshold
        self._blind = math.nan

    def update(self, error: float | None, turns: float) -> bool:
        """Take the phase error [rad], or None where there is none, at so many turns of the drive; return is_locked."""
        rule = self._rule
        if error is None:
            self._blind = turns if math.isnan(self._blind) else self._blind
            if turns - self._blind > rule.patience and self.is_locked:
                self._lose()
            return self.is_locked
        self._blind = math.nan
        passed = abs(error) > rule.leave if self.is_locked else abs(error) < rule.enter
        if not passed:
            self._since = math.nan
            return self.is_locked
        self._since = turns if math.isnan(self._since) else self._since
        if turns - self._since < rule.cycles:
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
