"""A Dask cluster on loopback: the same numbers, and what a killed worker and a killed scheduler cost."""

import time
from pathlib import Path

import pytest
from campaigns.cluster import Cluster, Kill, begun_in_vain, decays, run_job

from sinew.measure import tasks
from sinew.measure.errors import SpecError
from sinew.measure.tasks import Spread, each_task, run_tasks

COUNT = 8

LEFT = "ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
"""What Dask leaves behind."""


def begun(log: Path) -> list[int]:
    """Return the numbers of the jobs that were begun, as often as they were."""
    rows = [line.split() for line in log.read_text(encoding="utf-8").splitlines()]
    return sorted(int(number) for _, what, number, _ in rows if what == "begun")


@pytest.fixture
def cluster(tmp_path: Path) -> Cluster:
    pytest.importorskip("distributed", reason="needs dask.distributed, the extra `cluster`")
    return Cluster(tmp_path, 2)


@pytest.mark.slow
@pytest.mark.filterwarnings(*LEFT)
def test_a_killed_worker_costs_its_own_task_and_no_number_changes(cluster: Cluster, tmp_path: Path) -> None:
    alone = run_tasks(run_job, decays(tmp_path / "alone.log", COUNT, 0))
    log, found, received = tmp_path / "jobs.log", {}, {}
    with cluster.running():
        for place, bits in each_task(run_job, decays(log, COUNT, 0), Spread(cluster.address)):
            found[place], received[place] = bits, time.monotonic()
            if len(found) == 2:
                time.sleep(0.5)  # Dask's client says within 10 ms which results are here
                worker = cluster.workers[0]
                worker.kill()
                worker.wait()
                kill = Kill("worker", time.monotonic(), frozenset({worker.pid}))
    assert [found[place] for place in range(COUNT)] == alone
    # What the worker was at, or had done and not handed over, is begun once more, and nothing else.
    assert begun_in_vain(log.read_text(encoding="utf-8"), received, [kill]) == []


@pytest.mark.slow
@pytest.mark.filterwarnings(*LEFT)
def test_after_a_killed_scheduler_the_same_command_computes_what_is_missing(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs = decays(tmp_path / "jobs.log", COUNT, 0)
    with cluster.running():
        spread = Spread(cluster.address, keep=tmp_path / "kept.sqlite")
        coming = each_task(run_job, jobs, spread)
        received = [next(coming)[0], next(coming)[0]]
        cluster.kill_scheduler()
        with monkeypatch.context() as impatient:
            impatient.setattr(tasks, "_PATIENCE_S", 1.0)
            with pytest.raises(SpecError, match="the same command goes on from it"):
                received.extend(place for place, _ in coming)
        cluster.begin()
        found = dict(each_task(run_job, jobs, spread))
    assert sorted(found) == list(range(COUNT))
    again = begun(tmp_path / "jobs.log")
    assert all(again.count(place) == 1 for place in received)
    assert max(map(again.count, range(COUNT))) <= 2  # also of those that were done and on their way here


def test_a_job_that_was_begun_again_without_a_kill_is_found() -> None:
    log = "1.0 begun 0 11\n2.0 ended 0 11\n3.0 begun 0 12\n4.0 ended 0 12\n"
    assert begun_in_vain(log, {0: 5.0}, []) == ["job 0 was begun again though nothing that held it was killed"]


def test_a_job_whose_process_was_killed_may_be_begun_again() -> None:
    log = "1.0 begun 0 11\n1.0 begun 1 12\n3.0 begun 0 13\n4.0 ended 0 13\n4.0 ended 1 12\n"
    assert begun_in_vain(log, {0: 5.0, 1: 5.0}, [Kill("worker", 2.0, frozenset({11}))]) == []
