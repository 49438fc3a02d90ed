"""Requests to pause a run, to go on, or to end it, by whoever steers it: a signal, a socket, a dashboard.

Requests come from other threads or from signal handlers, so each is one assignment and waits for nothing. The run looks
at them before every cycle and between the steps that have none.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from sinew.bench.errors import StoppedError
from sinew.bench.stops import StopReport

SafeState = Literal["hold", "release"]


@dataclass(frozen=True, slots=True)
class Halt:
    """Why a run is to end. state: in which to leave the rig, or None for its declared one. is_emergency: at once.

    asked_s: when it was asked for [s, the run's clock].
    """

    reason: str
    state: SafeState | None
    is_emergency: bool
    asked_s: float


class Steering:
    """What was asked of a run.

    now: the run's clock [s]. can_pause: whether it takes a pause; one that tracks a resonance does not.
    halt: why the run is to end, or None. pause_asked: whether it is to rest after the group under way.
    has_begun: whether motors may be under power by this run. stopped: what is known of the stop since its first stage
    was over; None before. is_over: whether the stop is done.
    """

    def __init__(self, now: Callable[[], float], *, can_pause: bool = True) -> None:
        self._now = now
        self.can_pause = can_pause
        self.halt: Halt | None = None
        self.pause_asked = False
        self.has_begun = False
        self.stopped: StopReport | None = None
        self.is_over = False
        self._frozen = threading.Event()

    def request_pause(self) -> None:
        """Have the run rest after the group under way. One that cannot pause goes on."""
        self.pause_asked = self.can_pause

    def request_resume(self) -> None:
        """Have a run that rests, or is to rest, go on."""
        self.pause_asked = False

    def request_stop(self, reason: str, state: SafeState | None = None) -> None:
        """End the run at the next cycle; the first request counts. state: to leave the rig in; None: as declared."""
        if self.halt is None:
            self.halt = Halt(reason, state, False, self._now())

    def request_emergency(self, reason: str) -> None:
        """End the run at once: before the next step of whatever it is at, letting the tension down among it."""
        if not self.emergency_asked():
            if self.stopped is not None and self.stopped.declared == "release" and not self.is_over:
                self._frozen = threading.Event()  # the motors stood, and move again; before the request, or it is lost
            self.halt = Halt(reason, None, True, self._now())

    def emergency_asked(self) -> bool:
        """Return whether the run is to end at once."""
        return self.halt is not None and self.halt.is_emergency

    def check(self) -> None:
        """Raise StoppedError if the run is to end."""
        if self.halt is not None:
            raise StoppedError(self.halt.reason)

    def note_frozen(self, report: StopReport) -> None:
        """Take that the first stage of the stop is over, or that of an emergency that came in between."""
        self.stopped = report
        self._frozen.set()

    def note_over(self, report: StopReport) -> None:
        """Take that the stop is done."""
        self.is_over = True
        self.note_frozen(report)

    def await_frozen(self, timeout_s: float) -> StopReport | None:
        """Return what is known of the stop when its first stage is over; None where that takes longer [s]."""
        return self.stopped if self._frozen.wait(timeout_s) else None
