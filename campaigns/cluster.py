"""A Dask cluster on a slow network, and its workers and scheduler killed: `python -m campaigns.cluster --kills 50`.

A scheduler and 1, 2 and 4 workers are begun on loopback; every link between them, and to this program, is delayed and
throttled. Tasks of a design and of a pose map are computed here and there: their numbers must be the same bit for bit,
and a task may cost at most a tenth more. Then workers and schedulers are killed with SIGKILL at random moments while
decays are analysed: only what was in flight may be computed again. Exit status 1 if something happened that may not.
What it costs is told as processor time, for other programs take the wall's. Takes ten minutes on two quiet cores.
"""

import asyncio
import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from campaigns.options import campaign_parser
from sinew.measure.tasks import CORES, HERE, Spread, digest_of, each_task

DELAY_S, BYTES_PER_S = 0.02, 2.5e6
"""Of the simulated network: each way, and of each connection (20 Mbit/s)."""

MOST_OVERHEAD = 0.10
"""Share by which a task may cost more on the cluster than here."""

LEAN = {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False", "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s"}
"""Environment of scheduler and workers, as the page on clusters has it: Dask looks after itself less often."""

KINDS = ("search", "propose", "poses")

_IDLE_S = 10.0
"""For so long a cluster without work is watched."""

_LINE = 30
"""Bytes of a line in a log of jobs, about."""

_BEGIN_S = 120.0
"""How long a scheduler and its workers may take to be there."""

_DECAYS = 2
"""In a job that is analysed between kills: some tenths of a second of a core."""


# ---- the slow network: what comes in at one port goes out to another, later and not faster than that


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    loop = asyncio.get_running_loop()
    line: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(maxsize=256)

    async def take() -> None:
        data = b"begin"
        while data:
            try:
                data = await reader.read(1 << 16)
            except OSError:
                data = b""
            await line.put((loop.time() + DELAY_S, data))

    taking = asyncio.create_task(take())
    free = 0.0
    with suppress(OSError):
        while True:
            due, data = await line.get()
            free = max(due, free + len(data) / BYTES_PER_S)
            await asyncio.sleep(max(0.0, free - loop.time()))
            if not data:
                break
            writer.write(data)
            await writer.drain()
    taking.cancel()
    writer.close()


async def _serve(links: Sequence[tuple[int, int]]) -> None:
    async def between(target: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            there, back = await asyncio.open_connection("127.0.0.1", target)
        except OSError:
            writer.close()
            return
        await asyncio.gather(_pump(reader, back), _pump(there, writer))

    for port, target in links:
        await asyncio.start_server(lambda r, w, to=target: between(to, r, w), "127.0.0.1", port)  # type: ignore[misc]
    await asyncio.Event().wait()


def _network(links: Sequence[tuple[int, int]]) -> None:
    asyncio.run(_serve(links))


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [int(one.getsockname()[1]) for one in sockets]
    for one in sockets:
        one.close()
    return ports


# ---- the cluster: processes that are begun, and ended by their own id


@dataclass
class Cluster:
    """A scheduler and workers of one thread each behind the slow network. address: of the scheduler, slow."""

    folder: Path
    count: int
    ports: list[int] = field(default_factory=list)
    scheduler: "subprocess.Popen[bytes] | None" = None
    workers: dict[int, "subprocess.Popen[bytes]"] = field(default_factory=dict)
    network: BaseProcess | None = None

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.ports[1]}"

    @contextmanager
    def running(self) -> Iterator["Cluster"]:
        """Begin all of it, and end it."""
        self.ports = _free_ports(2 + 2 * self.count)
        links = [(self.ports[i + 1], self.ports[i]) for i in range(0, len(self.ports), 2)]
        self.network = multiprocessing.get_context("spawn").Process(target=_network, args=(links,), daemon=True)
        self.network.start()
        try:
            self.begin()
            yield self
        finally:
            for process in (*self.workers.values(), self.scheduler):
                if process is not None:
                    process.kill()
                    process.wait()
            self.network.kill()
            self.network.join()

    def begin(self) -> None:
        """Begin a scheduler at its port, and the workers."""
        self.scheduler = self._begin("scheduler", "--host", "127.0.0.1", "--port", str(self.ports[0]), "--no-show")
        for number in range(self.count):
            self.begin_worker(number)

    def kill_scheduler(self) -> frozenset[int]:
        """Kill the scheduler, and the workers, which would end without it; return the ids of the workers."""
        assert self.scheduler is not None
        for process in (self.scheduler, *self.workers.values()):
            process.kill()
        for process in (self.scheduler, *self.workers.values()):
            process.wait()
        return frozenset(process.pid for process in self.workers.values())

    def begin_worker(self, number: int) -> None:
        """Begin a worker, which says of itself to be at its slow port."""
        own, slow = self.ports[2 + 2 * number : 4 + 2 * number]
        listen = ("--listen-address", f"tcp://127.0.0.1:{own}", "--contact-address", f"tcp://127.0.0.1:{slow}")
        self.workers[number] = self._begin("worker", self.address, "--nthreads", "1", "--no-nanny", *listen)

    def _begin(self, what: str, *options: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options, "--no-dashboard"]
        # Scheduler and workers load the jobs of this campaign, which no installed package holds.
        path = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = os.environ | {"PYTHONPATH": path} | LEAN
        with (self.folder / f"{what}.log").open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder, env=environment)

    def cpu_s(self) -> float:
        """Return the processor time of scheduler and workers so far."""
        assert self.scheduler is not None
        return sum(_cpu_s(one.pid) for one in (self.scheduler, *self.workers.values()))


def _cpu_s(what: int | str) -> float:
    """Return the processor time of a process, or of a thread "self/task/ID", so far [s]."""
    words = Path(f"/proc/{what}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


# ---- what is computed


class Job(NamedTuple):
    """A task that writes down when it began and ended, by a clock that all processes share."""

    function: Callable[[Any], Any]
    task: Any
    number: int
    log: Path


def run_job(job: Job) -> tuple[str, float]:
    """Return a digest of what a job's function gives, to the last bit, and the processor time that it took [s].

    Threads that were there before it (a worker's talk with its scheduler) are not the job's.
    """
    _write(job.log, "begun", job.number)
    beside = [f"self/task/{one.native_id}" for one in threading.enumerate() if one is not threading.current_thread()]
    before = time.process_time() - sum(map(_cpu_s, beside))
    result = job.function(job.task)
    took = time.process_time() - sum(map(_cpu_s, beside)) - before
    _write(job.log, "ended", job.number)
    return digest_of(result), took


def _write(log: Path, what: str, number: int) -> None:
    with log.open("a", encoding="utf-8") as file:
        file.write(f"{time.monotonic()} {what} {number} {os.getpid()}\n")


def design_and_poses(log: Path, each: int, kinds: Sequence[str] = KINDS) -> list[Job]:
    """Return jobs of a design (search, exact evaluation) and of a pose map, each of seconds; so many of each kind."""
    from sinew.plan.toml import dump_rig, load_rig
    from sinew.predict.joints.design import shear_modulus_of
    from sinew.predict.workspace import fill_strip, planes_of
    from sinew.tune.candidate import DesignTarget
    from sinew.tune.design import blocks_of, drafts_of, propose, search_block

    rig, target = load_rig("paper"), DesignTarget((0.7, 1.1), 7.0, 0.25)
    text, base = dump_rig(rig), {"base": shear_modulus_of(rig)}
    blocks = blocks_of(text, target, base, ["circle", "annulus", "ellipse", "circle"], 64, 0)[:each]
    drafts = drafts_of([search_block(blocks[0])], text, target, each) if "propose" in kinds else []
    strips = [strip for plane in planes_of(rig, [0.0, 6.0], 2.5, "position") for strip in plane.strips()][:each]
    work: dict[str, tuple[Callable[[Any], Any], Sequence[Any]]] = {
        "search": (search_block, blocks),
        "propose": (propose, drafts),
        "poses": (fill_strip, strips),
    }
    asked = [(function, task) for function, tasks in (work[kind] for kind in kinds) for task in tasks]
    return [Job(function, task, number, log) for number, (function, task) in enumerate(asked)]


def decays(log: Path, count: int, seed: int) -> list[Job]:
    """Return jobs of a campaign: a few decays each, analysed."""
    from campaigns.decays import KINDS

    kinds = list(KINDS)
    work = [tuple((kinds[(i + k) % len(kinds)], seed + i) for k in range(_DECAYS)) for i in range(count)]
    return [Job(analyse_decays, task, number, log) for number, task in enumerate(work)]


def analyse_decays(task: Sequence[tuple[str, int]]) -> list[tuple[Any, ...]]:
    """Return what becomes of some records of `campaigns.decays`, without the time that it took."""
    from campaigns.decays import try_one

    found = [try_one(one) for one in task]
    return [(one.kind, one.seed, one.refusal, one.fault, one.off) for one in found]


# ---- cost, and numbers, with 1, 2 and 4 workers


class Cost(NamedTuple):
    """Of all jobs once. workers: 0 is this process. cpu_s: of every process that took part. task_s: of the tasks
    alone, where they ran. wall_s: from the first to the last. digests: by job. idle: share of a core that the cluster
    takes when there is no work."""

    workers: int
    cpu_s: float
    task_s: float
    wall_s: float
    digests: tuple[str, ...]
    idle: float = 0.0

    @property
    def around_s(self) -> float:
        """Processor time beside the tasks' own [s]."""
        return self.cpu_s - self.task_s

    @property
    def waited_s(self) -> float:
        """What of that went by while other programs had the processors [s]: the wall beyond the tasks' own time, on as
        many cores as there are workers or processors, idle."""
        cores = min(self.workers, os.cpu_count() or 1) or 1
        return self.idle * max(0.0, self.wall_s - self.task_s / cores)


def cost_of(jobs: Sequence[Job], spread: Spread, workers: int, others: Callable[[], float] = lambda: 0.0) -> Cost:
    """Return what all jobs cost. others: processor time of the processes beside this one."""
    cpu, wall = time.process_time() + others(), time.perf_counter()
    found = dict(each_task(run_job, jobs, spread))
    took = time.perf_counter() - wall, time.process_time() + others() - cpu
    digests, seconds = zip(*(found[place] for place in range(len(jobs))), strict=True)
    return Cost(workers, took[1], sum(seconds), took[0], digests)


def measure(folder: Path, counts: Sequence[int], each: int, kinds: Sequence[str]) -> Iterator[Cost]:
    """Yield the costs here and on clusters of some sizes, each after everything was compiled or read."""
    jobs = design_and_poses(folder / "jobs.log", each, kinds)
    first = list({job.function: job for job in reversed(jobs)}.values())
    list(each_task(run_job, first))
    yield cost_of(jobs, HERE, 0)
    for count in counts:
        with Cluster(folder, count).running() as cluster:
            _load_on_all(cluster, first)
            before = cluster.cpu_s(), time.monotonic()
            time.sleep(_IDLE_S)
            idle = (cluster.cpu_s() - before[0]) / (time.monotonic() - before[1])
            yield cost_of(jobs, Spread(cluster.address), count, cluster.cpu_s)._replace(idle=idle)


def _load_on_all(cluster: Cluster, jobs: Sequence[Job]) -> None:
    """Have every worker do these jobs, when all are there."""
    from distributed import Client

    until = time.monotonic() + _BEGIN_S
    while True:
        try:
            client = Client(cluster.address, timeout=5, set_as_default=False)
            break
        except OSError:  # it is not there yet
            if time.monotonic() > until:
                raise
            time.sleep(0.2)
    with client:
        client.wait_for_workers(cluster.count, timeout=_BEGIN_S)
        each = [
            client.map(run_job, jobs, workers=[one], pure=False)
            for one in client.scheduler_info(n_workers=-1)["workers"]
        ]
        client.gather(each)


def line(one: Cost, here: Cost) -> str:
    """Return what a task costs, and whether the numbers are the same."""
    count = len(here.digests)
    if one is here:
        return (
            f"{count} tasks of a design and a pose map, {here.cpu_s / count:.2f} s of a core each here; network "
            f"{1e3 * DELAY_S:g} ms each way, {8e-6 * BYTES_PER_S:g} Mbit/s; load {os.getloadavg()[0]:.1f}"
        )
    return (
        f"  {one.workers} workers: {1e3 * overhead(one, here) * here.cpu_s / count:.0f} ms of processor around a "
        f"task, {overhead(one, here):.1%} of what it takes here (with what went by while other programs had the "
        f"processors: {overhead(one, here, waited=True):.1%}); its own {one.task_s / here.task_s - 1:+.1%}; idle "
        f"{one.idle:.1%} of a core; wall {one.wall_s:.2f} s for {here.wall_s:.2f} s here; "
        f"{'the same numbers' if one.digests == here.digests else 'OTHER NUMBERS'}"
    )


def overhead(one: Cost, here: Cost, *, waited: bool = False) -> float:
    """Return the processor time of cluster and client around the tasks, beyond that of this process alone, as a share
    of what the tasks take here. waited: with what a busy computer's other programs made it wait."""
    return (one.around_s - (0.0 if waited else one.waited_s) - here.around_s) / here.cpu_s


def costs_wrong(costs: Sequence[Cost]) -> list[str]:
    """Return what of it may not be."""
    here = costs[0]
    wrong = [f"{one.workers} workers give other numbers" for one in costs[1:] if one.digests != here.digests]
    shares = [(one.workers, overhead(one, here)) for one in costs[1:]]
    return wrong + [f"{n} workers: {share:.1%} around a task" for n, share in shares if share > MOST_OVERHEAD]


# ---- kills


class Kill(NamedTuple):
    """A kill. at: time of the common clock. pids: of the workers that were computing and ended by it."""

    what: str
    at: float
    pids: frozenset[int]


class Loss(NamedTuple):
    """What a kill cost. computing: jobs that a killed process was at; waiting: that it had ended and not handed over.
    again: how many of both were begun a second time."""

    kill: Kill
    computing: int
    waiting: int
    again: int


@dataclass
class Series:
    """Kills while jobs are computed, and what became of it."""

    losses: list[Loss]
    wrong: list[str]
    wall_s: float


def kill_series(folder: Path, kills: int, seed: int, longest_s: float, workers: int = 2) -> Series:
    """Kill workers and schedulers at random moments while jobs are computed, until there were so many kills or so long
    a time has gone."""
    log, chance = folder / "kills.log", np.random.default_rng([seed, kills])
    log.touch()
    jobs = decays(log, 12, seed)
    expected = [run_job(job._replace(log=folder / "alone.log"))[0] for job in jobs[:2]]
    done: list[Kill] = []
    received: dict[int, float] = {}
    begin = time.monotonic()
    with Cluster(folder, workers).running() as cluster:
        ended = threading.Event()
        killer = threading.Thread(
            target=_kill_at_random, args=(cluster, log, chance, kills, done, ended, begin + longest_s)
        )
        killer.start()
        try:
            found = {}
            spread = Spread(cluster.address, keep=folder / "kept.sqlite")
            while len(done) < kills and time.monotonic() < begin + longest_s:
                for place, (bits, _) in each_task(run_job, jobs, spread):
                    received.setdefault(place, time.monotonic())
                    found[place] = bits
                    if time.monotonic() > begin + longest_s:
                        break
                jobs = jobs + [job._replace(number=job.number + len(jobs)) for job in decays(log, 12, seed + len(jobs))]
        finally:
            ended.set()
            killer.join()
    losses, wrong = accounts(log.read_text(encoding="utf-8"), received, done)
    if any(found.get(place, bits) != bits for place, bits in enumerate(expected)):
        wrong.append("a job gave other numbers than here")
    return Series(losses, wrong, time.monotonic() - begin)


def _kill_at_random(
    cluster: Cluster,
    log: Path,
    chance: np.random.Generator,
    kills: int,
    done: list[Kill],
    ended: threading.Event,
    until: float,
) -> None:
    """Kill a worker or, every third time, the scheduler, and begin another, again and again."""
    while len(done) < kills and time.monotonic() < until and not ended.is_set():
        before, more = log.stat().st_size, _LINE * int(chance.integers(1, 9))
        while log.stat().st_size < before + more and not ended.wait(0.05):
            pass  # work goes on, however slow the computer is
        if ended.wait(float(chance.uniform(0.0, 1.0))):
            return
        at = time.monotonic()
        if chance.random() < 1 / 3:
            done.append(Kill("scheduler", at, cluster.kill_scheduler()))
            cluster.begin()
        else:
            number = int(chance.integers(cluster.count))
            process = cluster.workers[number]
            process.kill()
            process.wait()
            done.append(Kill("worker", at, frozenset({process.pid})))
            cluster.begin_worker(number)


def accounts(log: str, received: dict[int, float], kills: Sequence[Kill]) -> tuple[list[Loss], list[str]]:
    """Return what each kill cost, and what happened that may not: a job that was begun again although it was here, or
    with no kill of who was at it."""
    begun: dict[int, list[tuple[float, int]]] = {}
    ended: dict[int, list[tuple[float, int]]] = {}
    for line in log.splitlines():
        when, what, job, process = line.split()
        {"begun": begun, "ended": ended}[what].setdefault(int(job), []).append((float(when), int(process)))
    flying: list[Counter[str]] = [Counter() for _ in kills]
    wrong = []
    for number, times in begun.items():
        for i, (at, pid) in enumerate(times):
            until = received.get(number, float("inf"))
            mine = [k for k, kill in enumerate(kills) if pid in kill.pids and at <= kill.at < until]
            if mine:
                over = any(pid == other and at <= end <= kills[mine[0]].at for end, other in ended.get(number, ()))
                flying[mine[0]]["waiting" if over else "computing"] += 1
            if i + 1 < len(times):
                if mine:
                    flying[mine[0]]["again"] += 1
                else:
                    wrong.append(f"job {number} was begun again though nothing that held it was killed")
    losses = [
        Loss(kill, found["computing"], found["waiting"], found["again"])
        for kill, found in zip(kills, flying, strict=True)
    ]
    wrong += [
        f"{loss.again} jobs were computed again of {loss.computing + loss.waiting} in flight"
        for loss in losses
        if loss.again > loss.computing + loss.waiting
    ]
    return losses, wrong


def text(series: Series) -> str:
    """Return what kills cost."""
    lines = [f"{len(series.losses)} kills in {series.wall_s:.0f} s; load {os.getloadavg()[0]:.1f}"]
    for what in ("worker", "scheduler"):
        mine = [loss for loss in series.losses if loss.kill.what == what]
        if mine:
            lines.append(
                f"  {len(mine)} of a {what}: {sum(one.computing for one in mine)} tasks were being computed, "
                f"{sum(one.waiting for one in mine)} on their way back, {sum(one.again for one in mine)} were computed "
                f"again, at most {max(one.again for one in mine)} for a kill"
            )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its tables, and return the exit status."""
    parser = campaign_parser("cluster", __doc__, count=50, of="kills")
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2, 4], help="sizes of the clusters [1 2 4]")
    parser.add_argument("--each", type=int, default=4, help="tasks of each kind whose cost is measured, up to 4 [4]")
    parser.add_argument("--kinds", nargs="*", default=KINDS, choices=KINDS, help="of those tasks [all]")
    parser.add_argument("--for-s", type=float, default=150.0, help="kills end after this time, whatever is left [150]")
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that nothing that was begun is left behind
    os.environ.setdefault(CORES, "1")  # as a worker has
    wrong: list[str] = []
    document: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        if given.workers:
            costs: list[Cost] = []
            for one in measure(Path(folder), given.workers, given.each, given.kinds):
                costs.append(one)
                print(line(one, costs[0]), flush=True)
            wrong += costs_wrong(costs)
            document["costs"] = [one._asdict() for one in costs]
        if given.kills:
            series = kill_series(Path(folder), given.kills, given.seed, given.for_s)
            print(text(series), flush=True)
            wrong += series.wrong
            document["losses"] = [loss._asdict() | {"kill": loss.kill.what} for loss in series.losses]
            if len(series.losses) < given.kills:
                wrong.append(f"only {len(series.losses)} of {given.kills} kills in {series.wall_s:.0f} s")
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(json.dumps(document | {"wrong": wrong}, indent=1) + "\n", encoding="utf-8")
    for sentence in wrong:
        print(f"!! {sentence}")
    return 1 if wrong else 0


if __name__ == "__main__":
    # What workers are handed they know by the module's name, not by that of the program.
    from campaigns.cluster import main as named

    sys.exit(named())
