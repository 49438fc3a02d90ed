"""Listeners to live samples, whoever wants to see them, without ever holding up the bench."""

import threading
from collections import deque
from collections.abc import Sequence
from typing import Protocol

from sinew.bench.record.sample import Sample
from sinew.measure.events import Event

_CLOSE_S = 2.0

Item = Sample | Event


class Listener(Protocol):
    """Sees what happens on a bench: a dashboard, a progress line."""

    def on_sample(self, sample: Sample) -> None:
        """Take the sample of one cycle."""
        ...

    def on_event(self, event: Event) -> None:
        """Take what happened besides."""
        ...


class Stream:
    """Passes samples and events on to listeners, each in a thread of its own, and returns at once; itself a listener.

    listeners: who gets them. capacity: how many items may wait for a slow one; then the oldest is dropped.
    takes_samples: whether samples are passed on, too.
    Not for what must not be lost: that goes to the journal. A listener's Python code still takes its turns at the
    interpreter (a few milliseconds at most each); heavy work belongs into another process.
    """

    def __init__(self, listeners: Sequence[Listener], capacity: int = 400, *, takes_samples: bool = True) -> None:
        if capacity < 1:
            raise ValueError(f"found capacity {capacity}, expected 1 or more")
        self._channels = [_Channel(listener, capacity) for listener in listeners]
        self._sampled = self._channels if takes_samples else []

    @property
    def dropped(self) -> tuple[int, ...]:
        """How many items each listener has missed because it was too slow."""
        return tuple(channel.dropped for channel in self._channels)

    @property
    def failures(self) -> tuple[str | None, ...]:
        """Why each listener gets nothing any more; None while it works."""
        return tuple(channel.failure for channel in self._channels)

    def on_sample(self, sample: Sample) -> None:
        for channel in self._sampled:
            channel.put(sample)

    def on_event(self, event: Event) -> None:
        for channel in self._channels:
            channel.put(event)

    def close(self) -> None:
        """Let the listeners have what waits and end their threads; those that take longer than 2 s are left behind."""
        for channel in self._channels:
            channel.end()
        for channel in self._channels:
            channel.join()


class _Channel:
    """The queue and the thread of one listener."""

    def __init__(self, listener: Listener, capacity: int) -> None:
        self._listener, self._capacity = listener, capacity
        self._items: deque[Item] = deque()
        self._arrived = threading.Condition()
        self._ended = False
        self.dropped = 0
        self.failure: str | None = None
        self._thread = threading.Thread(target=self._run, name="listener", daemon=True)
        self._thread.start()

    def put(self, item: Item) -> None:
        with self._arrived:
            if self._ended or self.failure is not None:
                return
            if len(self._items) == self._capacity:
                self._items.popleft()
                self.dropped += 1
            self._items.append(item)
            self._arrived.notify()

    def end(self) -> None:
        with self._arrived:
            self._ended = True
            self._arrived.notify()

    def join(self) -> None:
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        while (item := self._next()) is not None:
            try:
                if isinstance(item, Sample):
                    self._listener.on_sample(item)
                else:
                    self._listener.on_event(item)
            except Exception as error:  # a listener's fault is its own: the run goes on without it
                self.failure = f"{type(error).__name__}: {error}"
                return

    def _next(self) -> Item | None:
        with self._arrived:
            while not self._items and not self._ended:
                self._arrived.wait()
            return self._items.popleft() if self._items else None
