"""What viewers cost. `python -m campaigns.viewers --hours 2` streams a journal that is written faster than time to four
viewers and follows the memory of the pages' server; `--cycles 60` runs an emulated bench in real time with four viewers
and without, and lays the begins of its cycles side by side; `--live 60` does so with the dashboard as it ships and a
Chromium that draws its live page by software, oscilloscope and joint, on the same computer; `--hours 12 --browser 60`
lets Chromium watch so many hours within so many seconds, and tells the frames of an oscilloscope with eight traces and
the memory of server, page and workers at begin, middle and end, the workers after another page had a run analysed and a
plan tried. JSON on stdout."""

import argparse
import asyncio
import itertools
import json
import math
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import websockets

from sinew.bench.record.journal import Journal, JournalReader
from sinew.bench.record.sample import Sample
from sinew.measure.events import Health
from sinew.measure.recording import Segment
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig

VIEWERS = 4
RATE_HZ = 200.0
WARM_SHARE = 0.2
MOST_AT_ONCE = 20_000  # samples
LEAD_S = 8.0
SHARES = {"median": 50, "p99": 99, "p999": 99.9}
ROLES = {
    "sinew.apps.dashboard": "pages",
    "spawn_main": "workers",
    " emulate ": "emulated bench",
    " serve ": "steward",
    "sinew run ": "run",
    "--type=renderer": "renderer",
    "--type=gpu-process": "drawing by software",
    "chromium": "browser",
}
SINEW = Path(sys.executable).with_name("sinew")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
BY_SOFTWARE = ["--no-sandbox", "--disable-gpu", "--enable-precise-memory-info"]
BY_ITSELF = ["--no-sandbox"]  # without a graphics card it draws by software, the joint by SwiftShader
COUNTED = """scene => {
  const draw = SinewScope.render.bind(SinewScope), { renderer } = window.getElement(scene) ?? {};
  window.drawn = [];
  window.jointFrames = () => renderer?.info.render.frame ?? 0;
  SinewScope.render = () => { const is = draw(); if (is) window.drawn.push(performance.now()); return is; };
}"""
SCENE = "JSON.parse(document.getElementById('sinew-live').textContent).scene"
DRAWN = """() => Array.from({ length: 100 }, () => {
  const began = performance.now();
  SinewScope.isFresh = true;
  SinewScope.render();
  SinewScope.scope.canvas.getContext("2d").getImageData(0, 0, 1, 1); // until it is drawn
  return performance.now() - began;
})"""
TO_THE_BEGIN = """async () => {
  const began = performance.now();
  SinewScope.go(0, 5);
  SinewScope.render();
  while (SinewScope.bins.time[0] !== 0 || SinewScope.missing.length) await new Promise((go) => setTimeout(go, 20));
  return performance.now() - began;
}"""
PLAN = """
name = "viewers"
[pretension]
pretension_mm = [4]
rest_s = 1
[sweep]
frequency_hz = [3]
settle_s = 1
periods = {periods}
repeats = 1
"""


@contextmanager
def saying(status: dict[str, Any]) -> Iterator[int]:
    """Give the port of a steward that says the same to everybody."""

    class Steward(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            body = json.dumps(status).encode()
            self.send_response(200)
            self.send_header("content-type", "application/json")
            self.send_header("content-length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Steward)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()


def free_port() -> int:
    import socket

    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def pages(runs: Path, steering_port: int) -> Iterator[tuple[int, int]]:
    """Give (port, process) of a server of pages that is up."""
    port = free_port()
    config = {"token": "t" * 20, "http_host": "127.0.0.1", "http_port": port, "steering_port": steering_port}
    config |= {"runs": str(runs), "rig": "paper", "bench": {"kind": "emulator"}, "version": "campaign"}
    command = [sys.executable, "-m", "sinew.apps.dashboard"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdin is not None
            process.stdin.write(json.dumps(config) + "\n")
            process.stdin.flush()
            await_port(port)
            yield port, process.pid
        finally:
            process.kill()


def await_port(port: int, seconds: float = 60.0) -> None:
    import socket

    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
            return
        except OSError:
            time.sleep(0.1)
    raise TimeoutError(f"nothing listens at port {port}")


def memory_mb(process: int) -> float:
    """Return the memory of a process that is in use [MB]: its resident pages that are its own."""
    for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss_Anon:"):
            return float(line.split()[1]) / 1024
    raise OSError("no Pss_Anon in smaps_rollup")


async def view(port: int, seconds: float, counts: list[int]) -> None:
    """Watch for a time; count the frames with samples."""
    uri = f"ws://127.0.0.1:{port}/stream"
    end = time.monotonic() + seconds
    async with websockets.connect(uri, origin=f"http://127.0.0.1:{port}", max_size=4_000_000) as socket:  # type: ignore[arg-type]
        await socket.send(json.dumps({"base_s": 10, "pixels": 800}))
        counts.append(0)
        mine = len(counts) - 1
        while (left := end - time.monotonic()) > 0:
            try:
                frame = await asyncio.wait_for(socket.recv(), left)
            except TimeoutError:
                return
            counts[mine] += '"kind":"samples"' in str(frame)[:40]


async def watch(port: int, process: int, seconds: float, viewers: int) -> tuple[list[float], list[int]]:
    """Return (memory every second [MB], frames of each viewer)."""
    counts: list[int] = []
    tasks = [asyncio.create_task(view(port, seconds, counts)) for _ in range(viewers)]
    memory: list[float] = []
    for _ in range(int(seconds)):
        await asyncio.sleep(1.0)
        memory.append(memory_mb(process))
    await asyncio.gather(*tasks)
    return memory, counts


def synthetic(index: int, count: int) -> Sample:
    """Return a sample of a swing at 3 Hz."""
    t = index / RATE_HZ
    swing, tilt = math.sin(math.tau * 3 * t), 0.01
    return Sample(
        t, t - 0.005, 0.35 * swing, 0.3 * swing, 0.4 * swing, 0.2, (1.0,) * count, (1.0,) * count,
        (0.1 + 0.05 * swing,) * count, (9 * math.cos(math.tau * 3 * t), 0.0, 0.0), (9.81, 0.0, 0.0), tilt, 1e-4, t,
        (0.1,) * count, 12.0,
    )  # fmt: skip


def write_fast(path: Path, seconds: float, speed: float, ready: threading.Event) -> None:
    """Write a journal of so much time [s], so many times as fast as time."""
    plan, rig = load_plan("short"), load_rig("paper")
    with Journal.create(path, dump_plan(plan), dump_rig(rig), {}) as journal:
        journal.begin_segment(0, 0, Segment("steady", 4.0, 3.0, 20.0, 0))
        ready.set()
        begin, written, total = time.monotonic(), 0, int(seconds * RATE_HZ)
        while written < total:
            due = min(total, int((time.monotonic() - begin) * speed * RATE_HZ), written + MOST_AT_ONCE)
            for index in range(written, due):
                journal.append(synthetic(index, rig.tendons.count))
                if index % int(RATE_HZ) == 0:
                    at = index / RATE_HZ
                    journal.event(
                        Health(
                            state="running",
                            cycles=index,
                            missed=0,
                            incomplete=0,
                            worst_late_ms=0.0,
                            busy_ms=0.0,
                            temperature_c={},
                            supply_v=None,
                            bus={},
                            done_s=at,
                            total_s=seconds,
                            group=0,
                            groups=1,
                        )
                    )
            written = max(written, due)
            journal.flush()  # on a busy computer it falls behind, and does not run ahead of the disk
            time.sleep(0.02)


def stream_hours(hours: float, speed: float, viewers: int = VIEWERS) -> dict[str, Any]:
    """Return memory and frame rates of streaming so many hours, so many times as fast as time, to some viewers."""
    with tempfile.TemporaryDirectory() as folder:
        runs = Path(folder)
        (runs / "long").mkdir()
        ready = threading.Event()
        seconds = 3600 * hours
        arguments = (runs / "long" / "journal.sqlite", seconds, speed, ready)
        writer = threading.Thread(target=write_fast, args=arguments, daemon=True)
        status = {"run": {"name": "long", "state": "running"}, "bench": {"kind": "emulator"}, "operator": None}
        with saying(status) as steering, pages(runs, steering) as (port, process):
            writer.start()
            ready.wait(30.0)
            memory, counts = asyncio.run(watch(port, process, seconds / speed, viewers))
        with JournalReader(runs / "long" / "journal.sqlite") as journal:
            samples = journal.last_sample()
    kept = np.array(memory[int(WARM_SHARE * len(memory)) :])
    fifth = max(1, kept.size // 5)
    return {
        "hours": hours,
        "speed": speed,
        "viewers": viewers,
        "samples": samples,
        "frames_per_s": [round(count / (seconds / speed), 2) for count in counts],
        "memory_mb": {"first_fifth": float(kept[:fifth].mean()), "last_fifth": float(kept[-fifth:].mean())},
        "memory_growth": float(kept[-fifth:].mean() / kept[:fifth].mean() - 1),
        "memory_spread": float((kept.max() - kept.min()) / kept.mean()),
    }


def simulated(folder: Path) -> Path:
    """Return the folder of a run of the twin, in a folder of runs."""
    (folder / "done").mkdir()
    plan = folder / "done" / "plan.toml"
    plan.write_text(PLAN.format(periods=30))
    command = [str(SINEW), "simulate", str(plan), "--out", str(folder / "done" / "recording.nc")]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder / "done"


def go_to(page: Any, address: str) -> None:
    """Open a page; on a busy computer its server may be late, and says so."""
    for _ in range(5):
        answer = page.goto(address)
        if answer is not None and answer.ok:
            return
    raise TimeoutError(f"{address} does not open")


def use_workers(page: Any, base: str, done: Path) -> None:
    """Have a run that has ended analysed anew, and a plan tried; both are done when this returns."""
    for path in (*done.glob("results.nc"), *done.glob("analysis.json"), *done.glob("*/results.json")):
        path.unlink()
    go_to(page, f"{base}/runs/{done.name}")
    while not any(done.glob("*/results.json")):
        page.wait_for_timeout(100)
    go_to(page, f"{base}/plan")
    page.wait_for_function("document.querySelector('#sinew-duration')?.textContent", timeout=120_000)


def look_by_browser(hours: float, seconds: float) -> dict[str, Any]:
    """Return what a browser shows of a run of so many hours that is written within so many seconds, and what it costs.

    `frames_per_s` of the oscilloscope with eight traces, every second in which no worker is asked; `draw_ms`: what one
    of its pictures takes of the page's thread, of 100 the least, the median and 95 %; `memory_mb` of the pages' server,
    of its workers after they were used, and of the page what its scripts hold, after they were swept, at begin, middle
    and end; `to_the_begin_ms`: until the first samples are seen.
    """
    from playwright.sync_api import sync_playwright

    speed, found = 3600 * hours / seconds, {}
    with tempfile.TemporaryDirectory() as folder:
        runs = Path(folder)
        done = simulated(runs)
        (runs / "long").mkdir()
        ready = threading.Event()
        arguments = (runs / "long" / "journal.sqlite", 3600 * hours, speed, ready)
        writer = threading.Thread(target=write_fast, args=arguments, daemon=True)
        status = {"run": {"name": "long", "state": "running"}, "bench": {"kind": "emulator"}, "operator": None}
        with saying(status) as steering, pages(runs, steering) as (port, process), sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=BY_SOFTWARE)
            page, other = browser.new_page(), browser.new_page()
            sweeper = page.context.new_cdp_session(page)
            use_workers(other, f"http://127.0.0.1:{port}", done)  # whatever they compile, they have compiled then
            writer.start()
            ready.wait(30.0)
            page.goto(f"http://127.0.0.1:{port}/")
            page.wait_for_function("Number(document.body.dataset.samples) > 100", timeout=120_000)

            def memory() -> dict[str, float]:
                use_workers(other, f"http://127.0.0.1:{port}", done)
                workers = psutil.Process(process).children(recursive=True)
                page.bring_to_front()
                sweeper.send("HeapProfiler.collectGarbage")
                held = sweeper.send("Runtime.getHeapUsage")["usedSize"] / 2**20
                with JournalReader(runs / "long" / "journal.sqlite") as journal:
                    at = journal.last_sample() / RATE_HZ / 3600
                return {
                    "at_h": round(at, 2),
                    "server": round(memory_mb(process), 1),
                    "page": round(held, 1),
                    "workers": round(sum(memory_mb(one.pid) for one in workers), 1),
                    "processes": len(workers),
                }

            found["traces"] = page.evaluate("SinewScope.scope.lines(SinewScope.bins).length")
            found["memory_mb"], found["frames_per_s"] = [memory()], []
            while writer.is_alive():
                page.wait_for_timeout(2000)  # the page counts every second
                found["frames_per_s"].append(float(page.evaluate("document.body.dataset.fps") or 0))
                with JournalReader(runs / "long" / "journal.sqlite") as journal:
                    share = journal.last_sample() / RATE_HZ / 3600 / hours
                if share > 0.5 * len(found["memory_mb"]):
                    found["memory_mb"].append(memory())
            found["memory_mb"].append(memory())
            times = page.evaluate(DRAWN)
            found["draw_ms"] = {
                "least": min(times),
                "median": float(np.median(times)),
                "p95": float(np.percentile(times, 95)),
            }
            found["to_the_begin_ms"] = page.evaluate(TO_THE_BEGIN)
            browser.close()
    return {"hours": hours, "seconds": seconds, **found}


@contextmanager
def real_bench(folder: Path, seconds: float) -> Iterator[tuple[Path, list[str]]]:
    """Give the port of an emulated bench in real time, and what begins a run of so many seconds [s] on it."""
    plan, port = folder / "plan.toml", folder / "port"
    plan.write_text(PLAN.format(periods=round(3 * seconds)))
    emulate = [str(SINEW), "emulate", "--own-time", "--link", str(port), "--socket"]
    run = [str(SINEW), "run", str(plan), "--port", str(port), "--out", str(folder / "runs" / "run")]
    (folder / "runs").mkdir()
    with subprocess.Popen(emulate, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            emulator.stdout.readline()
            yield port, run
        finally:
            emulator.kill()


def cycles_of(run: Path) -> dict[str, Any]:
    """Return how the cycles of a run kept time: `late_ms`, how many began so much after their deadline [ms]; `latest`:
    when [s] the eight latest did, and how late."""
    with JournalReader(run / "journal.sqlite") as journal:
        rows = journal.samples(1, journal.last_sample() + 1)
        numbers = journal.counts()
        ended = str(journal.events()[-1][1])
    late = 1e3 * rows["late_s"]
    edges = [0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, math.inf]
    worst = sorted(np.argsort(np.nan_to_num(late))[-8:])
    return {
        "cycles": int(numbers.get("cycles", late.size)),
        "missed": int(numbers.get("cycles_missed", -1)),
        "late_ms": {f"below {b:g}": int(((late >= a) & (late < b)).sum()) for a, b in itertools.pairwise(edges)},
        **{f"late_{name}_ms": float(np.nanpercentile(late, at)) for name, at in SHARES.items()},
        "latest": [(round(float(rows["time_s"][k] - rows["time_s"][0]), 2), round(late[k], 2)) for k in worst],
        "ended": ended,
    }


def one_run(seconds: float, viewers: int) -> dict[str, Any]:
    """Return the begins of the cycles of a run on an emulated bench in real time, with so many viewers."""
    with tempfile.TemporaryDirectory() as folder, real_bench(Path(folder), seconds) as (_, run):
        runs = Path(folder) / "runs"
        status = {"run": {"name": "run", "state": "running"}, "bench": {"kind": "emulator"}, "operator": None}
        with saying(status) as steering, pages(runs, steering) as (http, _):
            counts: list[int] = []

            async def watched(process: "subprocess.Popen[bytes]") -> None:
                tasks = [asyncio.create_task(view(http, seconds + 30, counts)) for _ in range(viewers)]
                while process.poll() is None:
                    await asyncio.sleep(0.2)
                for task in tasks:
                    task.cancel()

            with subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
                asyncio.run(watched(process))
        return {"viewers": viewers, **cycles_of(runs / "run"), "frames": counts}


def busy_s(root: psutil.Process) -> dict[str, float]:
    """Return how long a core was busy with each process below one [s], by its number and what it is for."""
    found = {}
    for one in root.children(recursive=True):
        with suppress(psutil.Error):
            words, times = " ".join(one.cmdline()), one.cpu_times()
            name = next((told for mark, told in ROLES.items() if mark in words), one.name())
            found[f"{name} {one.pid}"] = times.user + times.system
    return found


def live_run(seconds: float, *, is_watched: bool) -> dict[str, Any]:
    """Return the cycles of a run on an emulated bench in real time, and what Chromium shows of it on the same computer.

    `frames_per_s` of the oscilloscope with all its traces and of the joint, every second of the run; `of_a_core`: what
    each process takes meanwhile.
    """
    from playwright.sync_api import sync_playwright

    found: dict[str, Any] = {"watched": is_watched}
    with tempfile.TemporaryDirectory() as folder, ExitStack() as ends:
        port, run = ends.enter_context(real_bench(Path(folder), seconds))
        serve = [str(SINEW), "serve", "--no-browser", "--port-bench", str(port), "--runs", str(Path(folder) / "runs")]
        http = free_port()
        serve += ["--http", f"127.0.0.1:{http}"]
        server = ends.enter_context(subprocess.Popen(serve, stdout=subprocess.PIPE, text=True))
        ends.callback(server.terminate)
        assert server.stdout is not None
        link = server.stdout.readline().strip()
        await_port(http)
        page = None
        if is_watched:
            playwright = ends.enter_context(sync_playwright())
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=BY_ITSELF)
            ends.callback(browser.close)
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.goto(link)
            page.wait_for_function(f"window.SinewScope && window.getElement?.({SCENE})?.renderer", timeout=60_000)
            page.evaluate(COUNTED, page.evaluate(SCENE))
        process = ends.enter_context(subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        time.sleep(LEAD_S)  # the bench takes up its tendons; the prediction is computed
        begin, before = time.monotonic(), busy_s(psutil.Process())
        drawn, joint = [], []
        while process.poll() is None and time.monotonic() - begin < seconds:
            if page is None:
                time.sleep(1.0)
                continue
            frames = page.evaluate("window.jointFrames()")
            page.wait_for_timeout(1000)
            drawn.append(page.evaluate("window.drawn.filter((at) => at > performance.now() - 1000).length"))
            joint.append(page.evaluate("window.jointFrames()") - frames)
        passed, after = time.monotonic() - begin, busy_s(psutil.Process())
        shares = {name: round((busy - before.get(name, 0.0)) / passed, 3) for name, busy in after.items()}
        found["of_a_core"] = {name.rpartition(" ")[0]: share for name, share in shares.items() if share > 0.003}
        if page is not None:
            found["traces"] = page.evaluate("SinewScope.scope.lines(SinewScope.bins).length")
            of = {"scope": np.array(drawn), "joint": np.array(joint)}
            found["frames_per_s"] = {
                name: {"least": int(some.min()), "median": float(np.median(some)), "every_second": some.tolist()}
                for name, some in of.items()
            }
        process.wait()
        found |= cycles_of(Path(folder) / "runs" / "run")
    return found


def compare_cycles(seconds: float, repeats: int) -> list[dict[str, Any]]:
    """Return runs without and with viewers in turn."""
    return [one_run(seconds, viewers) for _ in range(repeats) for viewers in (0, VIEWERS)]


def compare_live(seconds: float, repeats: int) -> list[dict[str, Any]]:
    """Return runs that nobody looks at and that a browser on the same computer does, in turn."""
    return [live_run(seconds, is_watched=is_watched) for _ in range(repeats) for is_watched in (False, True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=0.0, help="time that is streamed [h]")
    parser.add_argument("--speed", type=float, default=60.0, help="how many times as fast as time")
    parser.add_argument("--cycles", type=float, default=0.0, help="length of the runs in real time [s]")
    parser.add_argument("--live", type=float, default=0.0, help="length of the runs that a browser watches [s]")
    parser.add_argument("--browser", type=float, default=0.0, help="time in which a browser watches those hours [s]")
    parser.add_argument("--repeats", type=int, default=2)
    asked = parser.parse_args()
    found: dict[str, Any] = {}
    if asked.browser:
        found["browser"] = look_by_browser(asked.hours or 12.0, asked.browser)
    elif asked.hours:
        found["stream"] = stream_hours(asked.hours, asked.speed)
    if asked.cycles:
        found["cycles"] = compare_cycles(asked.cycles, asked.repeats)
    if asked.live:
        found["live"] = compare_live(asked.live, asked.repeats)
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
