"""What a user waits for at the command line: each command in a new process, at first and again, beside what is wanted.

At first, no compiled program is kept (an empty `$SINEW_CACHE`). The peer in the same run is what every tool on tables
in Python pays before it does anything: to import NumPy, pandas and SciPy's signal processing.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

PEER = ("-c", "import numpy, pandas, scipy.signal")
SINEW = ("-c", "import sys; from sinew.apps.cli import main; sys.exit(main())")


class Cost(NamedTuple):
    """What a process took: time until it ended, of the processors [s], and the most memory [MiB]."""

    wall_s: float
    processor_s: float
    memory_mib: float

    def __str__(self) -> str:
        return f"{self.wall_s:8.2f} {self.processor_s:10.2f} {self.memory_mib:9.0f}"


def cost_of(arguments: Sequence[str], cache: Path, times: int = 1) -> Cost:
    """Return the cheapest of so many new interpreters with these arguments, by processor time.

    cache: the folder of compiled programs. Raises RuntimeError where one fails.
    """
    found = []
    for _ in range(times):
        begun = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "SINEW_CACHE": str(cache)},
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(f"{' '.join(arguments)} ended with status {process.returncode}")
        processor = used.ru_utime + used.ru_stime
        found.append(Cost(time.perf_counter() - begun, processor, used.ru_maxrss / 1024))
    return min(found, key=lambda one: one.processor_s)


def _write_decay(path: Path) -> None:
    t = np.arange(0.0, 10.0, 0.005)
    noise = np.random.default_rng(1).normal(0.0, 0.05, t.size)
    rows = np.stack([t, 25 * np.exp(-0.3 * t) * np.cos(2 * np.pi * 2.8 * t) + noise], axis=1)
    np.savetxt(path, rows, delimiter=",", header="t_s,angle_deg", comments="")


def main() -> None:
    """Print wall time, processor time and memory of each command, and what is wanted of it."""
    with tempfile.TemporaryDirectory() as folder:
        here, cache = Path(folder), Path(folder) / "cache"
        _write_decay(here / "decay.csv")
        made = here / "reproduce"
        rows: list[tuple[str, Sequence[str], int, str, str]] = [
            ("import numpy, pandas, scipy.signal", PEER, 3, "", ""),
            ("sinew --help", (*SINEW, "--help"), 3, "0.25 s", "0.25 s"),
            (
                "sinew analyse decay.csv",
                (*SINEW, "analyse", str(here / "decay.csv"), "--time", "t_s", "--response", "angle_deg"),
                3,
                "0.8 s",
                "0.8 s",
            ),
            ("sinew reproduce", (*SINEW, "reproduce", "--out", str(made)), 1, "20 s, 1200 MiB", "9 s, 1200 MiB"),
            ("sinew analyse recording.nc", (*SINEW, "analyse", str(made / "recording.nc")), 3, "", ""),
            ("sinew answer recording.nc", (*SINEW, "answer", str(made / "recording.nc")), 1, "", "20 s"),
        ]
        print(f"{'':36}{'wall/s':>8}{'processor/s':>12}{'MiB':>9}  wanted: at most")
        for name, arguments, times, at_first, again in rows:
            shutil.rmtree(cache, ignore_errors=True)
            if arguments is PEER:
                print(f"{name:36}{cost_of(arguments, cache, times)}")
                continue
            print(f"{name + ', at first':36}{cost_of(arguments, cache)}   {at_first}")
            print(f"{name + ', again':36}{cost_of(arguments, cache, times)}   {again}")


if __name__ == "__main__":
    main()
