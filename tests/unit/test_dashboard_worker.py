"""The worker of a page server: other processes, one call at a time, only the newest of a slider's requests."""

import asyncio
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.patience import LONG_S, until

from sinew.apps.dashboard import worker as worker_module
from sinew.apps.dashboard.worker import CALLS, POOLS, Call, Worker, WorkerError, unless_left
from sinew.measure.errors import SpecError

_HERE = "tests.unit.dashboard_calls"


def is_gone(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch) -> Iterator[Worker]:
    calls = {
        name: Call(_HERE, "quick", LONG_S)
        for name in ("process", "priority", "die_once", "die", "fail", "note", "fill")
    }
    monkeypatch.setattr(worker_module, "CALLS", {**CALLS, **calls, "hang": Call(_HERE, "quick", 0.5)})
    made = Worker()
    yield made
    made.close()


@pytest.fixture
def sized(worker: Worker, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Worker]]:
    """Gives a worker whose quick pool is of another size."""
    made: list[Worker] = []

    def of(**size: Any) -> Worker:
        monkeypatch.setattr(worker_module, "POOLS", {**POOLS, "quick": POOLS["quick"]._replace(**size)})
        made.append(Worker())
        return made[-1]

    yield of
    for one in made:
        one.close()


def test_that_process_gives_way_to_a_control_loop(worker: Worker) -> None:
    assert asyncio.run(worker.call("priority")) > os.getpriority(os.PRIO_PROCESS, 0)


def test_an_error_that_a_user_can_put_right_comes_back_as_it_is(worker: Worker) -> None:
    with pytest.raises(SpecError, match="there is no plan 'none'"):
        asyncio.run(worker.call("read_library", "plans", "none"))


def test_any_other_error_comes_back_as_a_sentence(worker: Worker) -> None:
    with pytest.raises(WorkerError, match=r"^this failed .*no such thing"):
        asyncio.run(worker.call("fail"))


def test_what_would_fill_the_memory_ends_as_a_sentence(worker: Worker) -> None:
    with pytest.raises(WorkerError, match="more memory than a page may have"):
        asyncio.run(worker.call("fill"))


def test_of_the_requests_of_a_slider_that_wait_only_the_newest_is_run(worker: Worker, tmp_path: Path) -> None:
    notes = tmp_path / "notes"

    async def slide() -> list[str | None]:
        await worker.call("process")
        first = asyncio.create_task(worker.call("note", str(notes), "0", key="slider"))
        while not notes.exists():
            await asyncio.sleep(0.005)
        later = [asyncio.create_task(worker.call("note", str(notes), str(i), key="slider")) for i in range(1, 6)]
        await asyncio.sleep(0.05)  # each of them has its turn in this loop, and is queued then
        Path(f"{notes}.go").touch()
        return await asyncio.gather(first, *later)

    assert asyncio.run(slide()) == ["0", None, None, None, None, "5"]
    assert notes.read_text(encoding="utf-8").split() == ["0", "5"]


def test_a_process_that_ends_is_started_again_once(worker: Worker, tmp_path: Path) -> None:
    assert asyncio.run(worker.call("die_once", str(tmp_path / "mark"))) == "answered"


def test_a_process_that_ends_twice_is_said_and_does_not_stand_in_the_way(worker: Worker) -> None:
    async def twice() -> int:
        with pytest.raises(WorkerError, match="ended twice"):
            await worker.call("die")
        return int(await worker.call("process"))

    assert asyncio.run(twice()) != os.getpid()


def test_what_takes_too_long_is_ended_and_does_not_stand_in_the_way(worker: Worker) -> None:
    async def patient() -> int:
        before = int(await worker.call("process"))
        with pytest.raises(WorkerError, match=r"more than 0\.5 s"):
            await worker.call("hang")
        return before - int(await worker.call("process"))

    assert asyncio.run(patient()) != 0


def test_a_process_that_nobody_asks_ends_and_the_next_call_has_another(sized: Callable[..., Worker]) -> None:
    impatient = sized(idle_s=0.05)

    async def pause() -> tuple[int, int]:
        before = int(await impatient.call("process"))
        begun = time.monotonic()
        while not is_gone(before):
            await asyncio.sleep(0.01)
        assert time.monotonic() - begun < POOLS["quick"].idle_s
        return before, int(await impatient.call("process"))

    before, after = asyncio.run(pause())
    assert before != after


def test_a_call_that_nobody_waits_for_any_more_is_cut_off(sized: Callable[..., Worker], tmp_path: Path) -> None:
    pages, notes = sized(is_cut=True), tmp_path / "notes"

    async def leave() -> bool:
        before, left = int(await pages.call("process")), asyncio.Event()
        asked = asyncio.create_task(unless_left(pages.call("note", str(notes), "0"), left.wait()))
        while not notes.exists():  # it is under way, and goes on until it is told to end
            await asyncio.sleep(0.01)
        left.set()
        with pytest.raises(asyncio.CancelledError):
            await asked
        return bool(await asyncio.to_thread(until, lambda: is_gone(before)))

    assert asyncio.run(leave())


def test_closing_ends_the_processes(worker: Worker) -> None:
    process = asyncio.run(worker.call("process"))
    worker.close()
    until(lambda: is_gone(process))


@pytest.mark.parametrize("name", sorted(CALLS))
def test_every_call_is_a_function_with_a_docstring_and_has_a_pool(name: str) -> None:
    import importlib

    assert CALLS[name].pool in POOLS
    assert getattr(importlib.import_module(CALLS[name].module), name).__doc__


def test_what_a_start_and_a_save_need_waits_behind_nothing_that_takes_long() -> None:
    waits = [call.most_s for call in CALLS.values() if call.pool == CALLS["preview_document"].pool]
    assert CALLS["rig_text"].pool == CALLS["preview_document"].pool
    assert max(waits) == CALLS["preview_document"].most_s
