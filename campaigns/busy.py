"""Runs on an emulated bench on a busy computer: `python -m campaigns.busy --minutes 10 --runs 10`.

Two loops of ordinary priority for every core compute for so many minutes, and until the last run has ended. Meanwhile
runs, by turns through a terminal and through a socket, are played, each on an emulator of its own; run and emulator are
stopped (SIGSTOP) at drawn moments for 100 to 300 ms, alone or both. Each run must end complete by itself, its recording
have every sample of the plan and no hole, and its gain, phase and damping be those that the twin's own simulation of
the plan gives. Exit status 1 where one does not.
"""

import contextlib
import json
import os
import random
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from campaigns.options import campaign_parser
from sinew.analysis.analysed import analyse_recording
from sinew.measure.files.netcdf import load_recording
from sinew.measure.recording import segment_slices
from sinew.plan.toml import load_rig, parse_plan
from sinew.twin.parameters import Effects
from sinew.twin.simulate import simulate

PLAN = """
name = "busy"
pretension = { pretension_mm = [6], rest_s = 0.5 }
sweep = { frequency_hz = [3.0, 3.7], settle_s = 2.5, periods = 4, repeats = 1 }
ring_down = { frequency_hz = [3.7, 3.7], drive_s = 2, record_s = 2.5, repeats = 1 }
"""
"""Every kind of group, as short as settles."""

MOST_GAIN, MOST_PHASE_DEG, MOST_DAMPING = 0.02, 2.0, 0.05
"""By how much a recording may differ from the twin: shares of gain and of damping, degrees of phase."""

_PATIENCE_S = 1800.0  # of everything that a busy computer may take
_BUSY = "while True: pass"
_SINEW = str(Path(sys.executable).with_name("sinew"))


@dataclass
class Run:
    """One run, and what was found.

    port: terminal or socket. status: of its process. ended: its sentence. wall_s: it took; bench_s: of the bench's
    time. held_s: for how long that stood, while the run got ready among it. pauses, paused_s: by SIGSTOP.
    gain, phase_deg, damping: largest difference from the twin. wrong: what may not happen.
    """

    number: int
    port: str
    status: int = -1
    ended: str = ""
    wall_s: float = 0.0
    bench_s: float = 0.0
    held_s: float = 0.0
    pauses: int = 0
    paused_s: float = 0.0
    samples: int = 0
    missed: int = 0
    incomplete: int = 0
    gain: float = float("nan")
    phase_deg: float = float("nan")
    damping: float = float("nan")
    wrong: list[str] = field(default_factory=list)


@contextmanager
def every_core_busy(loops: int) -> Iterator[None]:
    """Have so many loops compute, each a process of its own; they end with us."""
    busy = [subprocess.Popen([sys.executable, "-c", _BUSY]) for _ in range(loops)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def play(number: int, port: str, folder: Path, seed: int, *, pauses: bool) -> Run:
    """Play a run on an emulator of its own and return how it ended; its recording is in the folder.

    Raises TimeoutError where the emulator does not get ready, or the run does not end, within half an hour.
    """
    run = Run(number, port)
    chance = random.Random(f"{seed} {number}")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    link, truth = folder / "bench", folder / "truth.json"
    emulate = [_SINEW, "emulate", "--link", str(link), "--truth", str(truth), "--seed", str(seed + number)]
    emulate += ["--socket"] * (port == "socket")
    command = [_SINEW, "run", str(folder / "plan.toml"), "--port", str(link), "--out", str(folder / "run"), "--json"]
    with subprocess.Popen(emulate, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            if not select.select([emulator.stdout], [], [], _PATIENCE_S)[0]:
                raise TimeoutError("the emulator does not get ready")
            emulator.stdout.readline()
            began = time.monotonic()
            with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
                over = threading.Event()
                stopping = threading.Thread(target=_stop_at_random, args=(run, [emulator, process], chance, over))
                if pauses:
                    stopping.start()
                try:
                    out, err = process.communicate(timeout=_PATIENCE_S)
                finally:
                    over.set()
                    if pauses:
                        stopping.join()
                    process.kill()
            run.status, run.wall_s = process.returncode, time.monotonic() - began
        finally:
            emulator.send_signal(signal.SIGCONT)
            emulator.send_signal(signal.SIGINT)
            emulator.wait(_PATIENCE_S)
    told = json.loads(truth.read_text(encoding="utf-8"))
    run.bench_s, run.held_s = told["time_s"], told["slipped_s"]
    said: dict[str, Any] = json.loads(out) if out else {"ended": err.strip(), "complete": False, "cycles": {}}
    run.ended = said["ended"]
    run.missed, run.incomplete = said["cycles"].get("missed", -1), said["cycles"].get("incomplete", -1)
    if run.status != 0 or not said["complete"]:
        run.wrong.append(f"it ended with status {run.status}: {run.ended}")
    if not told["in_safe_state"]:
        run.wrong.append("the bench was not left in a safe state")
    return run


def _stop_at_random(
    run: Run, processes: "list[subprocess.Popen[str]]", chance: random.Random, over: threading.Event
) -> None:
    while not over.wait(chance.uniform(0.5, 3.0)):
        stopped = chance.choice([processes[:1], processes[1:], processes])
        seconds = chance.uniform(0.1, 0.3)
        for process in stopped:
            process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        for process in stopped:
            process.send_signal(signal.SIGCONT)
        run.pauses, run.paused_s = run.pauses + 1, run.paused_s + seconds


def judge(run: Run, recording: xr.Dataset, twin: xr.Dataset) -> None:
    """Hold a run's recording against the twin's own."""
    plan = parse_plan(PLAN)
    wanted = [count for group in plan.groups() for count in group.sample_counts(plan.sample_hz) if count]
    slices = segment_slices(recording)
    counts = [where.stop - where.start for where in slices]
    run.samples = sum(counts)
    if len(counts) != len(wanted):
        run.wrong.append(f"the recording has {len(counts)} segments, expected {len(wanted)}")
    times = recording["time_s"].values
    gap = max(float(np.diff(times[where]).max()) for where in slices)
    if gap > 1.5 / plan.sample_hz:
        run.wrong.append(f"the recording has a hole of {1e3 * gap:.1f} ms")
    kinds = [str(kind) for kind in recording["kind"].values]
    for kind, count, asked in zip(kinds, counts, wanted, strict=False):
        if kind != "settle" and abs(count - asked) > 1:
            run.wrong.append(f"a {kind} segment has {count} samples, expected {asked}")
    bench, own = analyse_recording(recording, load_rig("paper")), analyse_recording(twin, load_rig("paper"))
    run.gain = float(np.abs(bench["gain"].values / own["gain"].values - 1).max())
    run.phase_deg = float(np.degrees(np.abs(bench["phase_lag_rad"].values - own["phase_lag_rad"].values)).max())
    run.damping = float(np.abs(bench["damping_ratio"].values / own["damping_ratio"].values - 1).max())
    for name, most in (("gain", MOST_GAIN), ("phase_deg", MOST_PHASE_DEG), ("damping", MOST_DAMPING)):
        if not getattr(run, name) <= most:
            run.wrong.append(f"{name} differs by {getattr(run, name):.4f} from the twin's, expected {most:g} at most")


def table(runs: Sequence[Run]) -> str:
    """Return what became of the runs, as text."""
    lines = [
        "run  port      status  wall/s  bench/s  held/s  pauses  samples  missed  lacking    gain  phase/°  damping"
    ]
    for run in runs:
        lines.append(
            f"{run.number:3d}  {run.port:8s}  {run.status:6d}  {run.wall_s:6.1f}  {run.bench_s:7.1f}  "
            f"{run.held_s:6.1f}  {run.pauses:6d}  {run.samples:7d}  {run.missed:6d}  {run.incomplete:7d}  "
            f"{run.gain:6.2%}  {run.phase_deg:7.2f}  {run.damping:7.2%}"
        )
    right = sum(not run.wrong for run in runs)
    lines.append(f"{right} of {len(runs)} runs complete by themselves with a right recording")
    lines += [f"!! run {run.number}: {wrong}" for run in runs for wrong in run.wrong]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its table, and return the exit status."""
    parser = campaign_parser("busy", __doc__, count=10)
    parser.add_argument("--minutes", type=float, default=10.0, help="how long every core is busy, at least [10]")
    parser.add_argument("--together", type=int, default=1, help="how many runs at once [1]")
    parser.add_argument("--no-pauses", action="store_true", help="stop no process by SIGSTOP")
    given = parser.parse_args(arguments)
    loops = 2 * (os.cpu_count() or 1)
    with contextlib.ExitStack() as stack:
        folders = [Path(stack.enter_context(tempfile.TemporaryDirectory())) for _ in range(given.runs)]
        began = time.monotonic()
        with every_core_busy(loops):
            with ThreadPoolExecutor(given.together) as pool:
                kinds = [("terminal", "socket")[number % 2] for number in range(given.runs)]

                def one(number: int) -> Run:
                    run = play(number, kinds[number], folders[number], given.seed, pauses=not given.no_pauses)
                    print(f"run {number}: {run.ended}", file=sys.stderr, flush=True)
                    return run

                runs = list(pool.map(one, range(given.runs)))
            all_s = time.monotonic() - began
            time.sleep(max(0.0, 60 * given.minutes - all_s))
            load = os.getloadavg()[0]
        twin = simulate(parse_plan(PLAN), load_rig("paper"), effects=Effects().without("repeatability"))
        for run, folder in zip(runs, folders, strict=True):
            if (path := folder / "run" / "recording.nc").exists():
                judge(run, load_recording(path), twin)
            else:
                run.wrong.append("there is no recording")
    if given.out is not None:
        given.out.write_text(json.dumps([asdict(run) for run in runs], indent=1) + "\n", encoding="utf-8")
    print(f"{loops} busy loops on {os.cpu_count()} cores; {len(runs)} runs in {all_s:.0f} s; load average {load:.1f}")
    print(table(runs))
    return 1 if any(run.wrong for run in runs) else 0


if __name__ == "__main__":
    sys.exit(main())
