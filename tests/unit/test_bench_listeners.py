"""Live samples reach listeners, and no listener can hold up or end the run."""

import threading

import pytest
from tests.patience import LONG_S
from tests.unit.bench_journal import PLAN, Node, cycles

from sinew.bench.record.sample import Sample, Stream
from sinew.measure.events import Ended, Event

SAMPLES = cycles(PLAN.groups()[0], 0.0, Node())
BOUND_S = LONG_S


class Kept:
    """Keeps all it gets, in order; waits at its gate first."""

    def __init__(self, is_open: bool = True) -> None:
        self.items: list[Sample | Event] = []
        self.gate = threading.Event()
        self.arrived = threading.Event()
        if is_open:
            self.gate.set()

    def on_sample(self, sample: Sample) -> None:
        self.arrived.set()
        assert self.gate.wait(BOUND_S)
        self.items.append(sample)

    def on_event(self, event: Event) -> None:
        self.items.append(event)


class Broken(Kept):
    def on_sample(self, sample: Sample) -> None:
        raise KeyError("no such widget")


def test_every_listener_gets_everything_in_order() -> None:
    first, second = Kept(), Kept()
    stream = Stream([first, second])
    for sample in SAMPLES[:50]:
        stream.on_sample(sample)
    stream.on_event(Ended("all is recorded"))
    stream.close()
    assert first.items == second.items == [*SAMPLES[:50], Ended("all is recorded")]


def test_a_slow_listener_misses_the_oldest_and_the_drops_are_counted() -> None:
    slow, quick = Kept(is_open=False), Kept()
    stream = Stream([slow, quick], capacity=10)
    stream.on_sample(SAMPLES[0])
    assert slow.arrived.wait(BOUND_S)
    for sample in SAMPLES[1:31]:
        stream.on_sample(sample)
    dropped = stream.dropped[0]
    slow.gate.set()
    stream.close()
    assert (dropped, slow.items) == (20, [SAMPLES[0], *SAMPLES[21:31]])


def test_a_listener_that_fails_gets_nothing_more_and_says_why() -> None:
    broken, fine = Broken(), Kept()
    stream = Stream([broken, fine])
    for sample in SAMPLES[:5]:
        stream.on_sample(sample)
    stream.close()
    assert (stream.failures, fine.items) == (("KeyError: 'no such widget'", None), SAMPLES[:5])


def test_nothing_is_passed_on_after_the_end() -> None:
    kept = Kept()
    stream = Stream([kept])
    stream.close()
    stream.on_sample(SAMPLES[0])
    assert kept.items == []


def test_a_stream_without_room_is_refused() -> None:
    with pytest.raises(ValueError, match="found capacity 0, expected 1 or more"):
        Stream([], capacity=0)
