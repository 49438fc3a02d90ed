"""Emergency stop: a bench brought to rest at once, whatever else is going on.

A thread is kept for it, so that nothing can queue before it, and everything it needs is loaded beforehand. A run that
is under way is asked first, for it holds the port; where it does not confirm in time its process is ended, whereupon
the motors' own watchdogs act within 0.1 s, and the bench is brought to its declared safe state from here.
"""

import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from sinew.apps.bench.bench_run import open_rig
from sinew.apps.dashboard.run_desk import Control, Process, Run, await_end
from sinew.bench.stops import StopReport, stop
from sinew.hardware import ports as _ports  # noqa: F401 - open_rig imports it late
from sinew.measure.errors import PortError, SinewError
from sinew.plan.rig import RigSpec

CONFIRM_S = 0.15
"""Within so long a run must confirm that it has stopped [s]."""

_DIES_S = 1.0
_PORT_S = 0.5
_LOOK_S = 0.01

_SETTLES_S = 1.5  # for a run that answered, and asks a motor again that did not
_AGAIN_S = 0.05

Rest = Callable[[str, RigSpec, str | None, Callable[[StopReport], None], Callable[[], bool]], StopReport]
"""What brings the bench behind a port to a state, None for the rig's own.

(port, rig, state, on_frozen, is_emergency) -> report; the last is asked again while the tension is let down.
"""


@dataclass(frozen=True)
class Outcome:
    """How a stop went. at: [s since 1970]. took: until the motors stood still, else until we gave up [s].

    was_emergency: whether it was one, and no ordinary stop.
    """

    is_safe: bool
    sentence: str
    at: float
    took: float
    was_emergency: bool = True


class Order:
    """A stop that was ordered. answer: what can be told once the motors stand still. end: once all is done.

    is_emergency: whether the motors are to stand for a while before the tension is let down.
    """

    def __init__(self, is_emergency: bool) -> None:
        self.answer: Future[Outcome] = Future()
        self.end: Future[Outcome] = Future()
        self.is_emergency = is_emergency
        self._lock = threading.RLock()
        self._at, self._start = time.time(), time.monotonic()

    def join(self, is_emergency: bool) -> bool:
        """Return whether this order stands for another one, too: not if it has ended.

        An emergency makes an emergency of it. An answer from before says nothing then, for the motors move again.
        """
        with self._lock:
            if self.end.done():
                return False
            if is_emergency and not self.is_emergency:
                if self.answer.done():
                    self.answer, self._start = Future(), time.monotonic()
                self.is_emergency = True
            return True

    def tell(self, is_safe: bool, sentence: str) -> None:
        """Answer, where that was not done before."""
        with self._lock:
            if not self.answer.done():
                took = time.monotonic() - self._start
                self.answer.set_result(Outcome(is_safe, sentence, self._at, took, self.is_emergency))

    def close(self, is_safe: bool, sentence: str) -> Outcome:
        """Tell the end, and return it."""
        with self._lock:
            self.tell(is_safe, sentence)
            outcome = Outcome(is_safe, sentence, self._at, self.answer.result().took, self.is_emergency)
            self.end.set_result(outcome)
            return outcome


class Emergency:
    """The thread that brings a bench to rest. control: asks a run. rest: stops a bench that no run holds.

    elsewhere: gives the folder of a run that was begun in a terminal and may hold the bench, if any. is_emulated:
    whether the bench is, so that nothing moves where there is no port.
    """

    def __init__(
        self, control: Control, rest: Rest, elsewhere: Callable[[], Path | None], is_emulated: bool = False
    ) -> None:
        self._control, self._rest, self._elsewhere, self._is_emulated = control, rest, elsewhere, is_emulated
        self._thread = ThreadPoolExecutor(1, "emergency")
        self._thread.submit(int).result()
        self._lock = threading.Lock()
        self._order: Order | None = None
        self.last: Outcome | None = None

    @property
    def is_under_way(self) -> bool:
        """Whether the bench is being brought to rest right now."""
        order = self._order
        return order is not None and not order.end.done()

    def order(
        self, run: Run | None, port: str | None, spec: RigSpec, state: str | None = None, *, is_emergency: bool = True
    ) -> Order:
        """Bring the bench to rest, and return what will tell how that goes; a second order joins the first.

        run: that holds the port, if any. state: hold or release; None: the rig's own. is_emergency: the motors stand
        for a while before the tension is let down.
        """
        with self._lock:
            if self._order is None or not self._order.join(is_emergency):
                self._order = Order(is_emergency)
                self._thread.submit(self._act, self._order, run, port, spec, state)
            return self._order

    def close(self) -> None:
        """Let go of the thread once it has done its work."""
        self._thread.shutdown()

    def _act(self, order: Order, run: Run | None, port: str | None, spec: RigSpec, state: str | None) -> None:
        is_safe, sentence = False, "the stop broke off; switch the supply off"
        try:
            is_safe, sentence = self._stop(order, run, port, spec, state)
        finally:
            self.last = order.close(is_safe, sentence)

    def _stop(
        self, order: Order, run: Run | None, port: str | None, spec: RigSpec, state: str | None
    ) -> tuple[bool, str]:
        before = ""
        if run is not None and run.process.poll() is None:
            confirmed = self._confirmed(run.folder, run.process)
            if confirmed is not None:
                return True, confirmed
            run.process.send_signal(signal.SIGKILL)
            if not await_end(run.process, _DIES_S):
                return False, f"the run {run.name} does not end (process {run.process.pid}); switch the supply off"
            before = f"the run {run.name} did not confirm and was ended; "
        there = self._elsewhere() if run is None else None
        said = self._ask(there) if there is not None else None
        if port is None:
            what = "emulated bench is there" if self._is_emulated else "bench is connected here"
            return bool(before) or self._is_emulated, f"{before}no {what}, so no motor was told anything"
        rig = spec if run is None else run.specs.rig

        def tell_frozen(report: StopReport) -> None:
            if len(report.frozen) == 1 + rig.tendons.count:
                order.tell(True, f"{before}all motors stand still; {state or rig.limits.safe_state} follows")

        try:
            report = self._rest(port, rig, state, tell_frozen, lambda: order.is_emergency)
        except SinewError as trouble:
            if there is not None and said is not None:  # that run holds the port
                return said[0], f"the run {there.name}, begun in a terminal: {said[1]}"
            return False, f"{before}{trouble}; switch the supply off"
        return report.is_safe, f"{before}{report.sentence()}"

    def _confirmed(self, folder: Path, process: Process) -> str | None:
        """Return what a run says that confirms, else None.

        One that does not answer in time has no more; one that does, though a motor has not confirmed to it, goes on
        asking that motor, which is better than to end it.
        """
        end = time.monotonic() + _SETTLES_S
        while (answer := self._ask(folder)) is not None:
            is_safe, sentence = answer
            if is_safe:
                return sentence
            if time.monotonic() >= end or await_end(process, _AGAIN_S):
                break
        return None

    def _ask(self, folder: Path) -> tuple[bool, str] | None:
        """Return what a run answers within the time it has: whether the motors stand, and a sentence; else None.

        Nothing it does can hold us up.
        """
        answers: Future[tuple[bool, str] | None] = Future()

        def ask() -> None:
            try:
                answer = self._control(folder, "emergency", timeout_s=CONFIRM_S)
                answers.set_result((answer.get("ok") is True, str(answer.get("sentence", ""))))
            except Exception:  # whatever is wrong with the run, what comes next is its end
                answers.set_result(None)

        threading.Thread(target=ask, daemon=True).start()
        try:
            return answers.result(CONFIRM_S)
        except TimeoutError:
            return None


def bring_to_rest(
    port: str,
    spec: RigSpec,
    state: str | None,
    on_frozen: Callable[[StopReport], None],
    is_emergency: Callable[[], bool] = lambda: True,
) -> StopReport:
    """Bring the bench behind a port to a state, hold or release; None: the rig's declared one.

    on_frozen: called once the motors were told to stand still. is_emergency: whether they are to stand for a while
    before the tension is let down; it is asked again while that goes on. The port of a run that was ended may be taken
    for a moment yet. Raises PortError if it stays so.
    """
    end = time.monotonic() + _PORT_S
    while True:
        try:
            with open_rig(port, spec) as (bench, clock):
                declared = state or spec.limits.safe_state
                return stop(
                    bench, clock, declared, on_frozen, is_emergency=is_emergency(), emergency_asked=is_emergency
                )
        except PortError:
            if time.monotonic() >= end:
                raise
        time.sleep(_LOOK_S)
