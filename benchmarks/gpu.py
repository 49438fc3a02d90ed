"""Batches on a GPU beside the CPU, the same ones in one run: `python -m benchmarks gpu`, `make bench-gpu`.

Each device has a process of its own, for JAX begins on one. Everything is compiled before it is timed. Where JAX finds
no GPU, the CPU's time stands alone, and it is said that the figure is missing.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.table import Row
from sinew.measure.errors import SpecError
from sinew.measure.tasks import DEVICE, DEVICES
from sinew.paper.numbers import observe
from sinew.plan.toml import dump_rig, load_rig
from sinew.predict.design import shear_modulus_of
from sinew.solve.programs import configure
from sinew.tune.candidate import DesignTarget
from sinew.tune.design import blocks_of, search_block

COUNTS = (64, 512)
NO_GPU = 3
_ALIKE = 1e-6  # a search that comes by an edge of a limit can leave it on the other side for a difference of rounding


def batches(count: int) -> dict[str, Callable[[], Any]]:
    """Return what is computed by name, so many of each at once: what gives their numbers as one array."""
    rig = load_rig("paper")
    target, base = DesignTarget((0.7, 1.1), 7.0, 0.25), {"base": shear_modulus_of(rig)}
    (block,) = blocks_of(dump_rig(rig), target, base, ["circle"], count, 0)
    return {
        "designs, searched": lambda: search_block(block).objectives,
        "rigs of the posterior": lambda: observe([rig] * count),
    }


def measure(counts: Sequence[int]) -> dict[str, Any]:
    """Return time [s], processor time [s] and numbers of every batch on the device of this process, by name."""
    configure()
    found: dict[str, Any] = {}
    for count in counts:
        for name, batch in batches(count).items():
            values = np.asarray(batch())
            begin, cpu = time.perf_counter(), time.process_time()
            batch()
            took = {"seconds": time.perf_counter() - begin, "cpu_s": time.process_time() - cpu}
            found[f"{count:4d} {name}"] = took | {"kind": str(values.dtype), "values": values.tolist()}
    return found


def rows(arguments: Sequence[str] = ()) -> list[Row]:
    """Return the time of each batch on the CPU and, where there is one, on the GPU, and how far numbers are apart."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks gpu", description=__doc__)
    parser.add_argument("--alone", action="store_true", help=f"the device of ${DEVICE} alone, as JSON")
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="sizes of a batch (default: 64 512)")
    given = parser.parse_args([*arguments])
    if given.alone:
        try:
            print(json.dumps(measure(given.counts)))
        except SpecError as error:
            print(error, file=sys.stderr)
            sys.exit(NO_GPU)
        return []
    cpu, gpu = (asked(device, given.counts) for device in DEVICES)
    assert isinstance(cpu, dict)
    found = []
    for name, one in cpu.items():
        if not isinstance(gpu, dict):
            found.append(Row(f"{name}, CPU", one["seconds"], "GPU", None, "s", f"the GPU's figure is missing: {gpu}"))
            continue
        other = gpu[name]
        apart = np.abs(np.array(other["values"]) / np.where(one["values"], one["values"], 1.0) - 1)
        far = apart[np.isfinite(apart).all(axis=1)].max(axis=1, initial=0.0)
        close = f"{np.mean(far < _ALIKE):.1%} within {_ALIKE:g}, the farthest {far.max(initial=0.0):.1e} apart"
        found.append(Row(f"{name}, GPU", other["seconds"], "CPU", one["seconds"], "s", close))
    return found


def asked(device: str, counts: Sequence[int]) -> dict[str, Any] | str:
    """Return what a process of its own measures on a device; where there is none, why."""
    command = [sys.executable, "-m", "benchmarks.gpu", "--alone", "--counts", *map(str, counts)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {DEVICE: device})
    if done.returncode == NO_GPU:
        return done.stderr.strip().splitlines()[-1]
    if done.returncode:
        raise RuntimeError(done.stderr)
    return dict(json.loads(done.stdout))


if __name__ == "__main__":
    rows(sys.argv[1:])
