"""How long a test waits: as long as an idle computer would need, counted by the share of a core that is to be had."""

import subprocess
import sys

import pytest
from tests.patience import MOST, Patience, finished, share, until


class Computer:
    """A clock that goes on by a second at each look, and a load."""

    def __init__(self, share: float) -> None:
        self._now, self._share = 0.0, share

    def looks(self, seconds: float) -> int:
        """Return how many looks patience for so many seconds lasts."""
        patience = Patience(seconds, self._clock, lambda: self._share)
        return next(count for count in range(1, 10_000) if patience.is_over())

    def _clock(self) -> float:
        self._now += 1.0
        return self._now


@pytest.mark.parametrize(("share", "looks"), [(1.0, 10), (0.2, 50)])
def test_patience_lasts_longer_as_less_of_a_core_is_to_be_had(share: float, looks: int) -> None:
    assert Computer(share).looks(10.0) == pytest.approx(looks, abs=0 if share == 1 else 1)


def test_it_is_bounded_whatever_the_load() -> None:
    assert Computer(1e-6).looks(10.0) == pytest.approx(10 * MOST, abs=1)


def test_the_share_falls_as_programs_want_the_cores() -> None:
    before = share()
    busy = [subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(8)]
    try:
        found = until(lambda: share() if share() < 0.7 else 0.0)
    finally:
        for process in busy:
            process.kill()
            process.wait()
    assert 0 < found < max(before, 0.7)


def test_what_does_not_come_is_told() -> None:
    with pytest.raises(AssertionError, match="no such thing"):
        until(lambda: False, 0.05, "no such thing")


def test_a_command_that_hangs_is_ended() -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        finished([sys.executable, "-S", "-c", "import time; time.sleep(600)"], 0.2)
