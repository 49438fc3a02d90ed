"""What a bent pose costs, 28 frequencies and ring-downs at one pretension: `python -m benchmarks bent`.

Each `sinew simulate` is a process of its own, the first with an empty cache of compiled programs, two more with what it
left. Printed are its seconds and those of the processor, the largest memory, how long its programs took to compile, and
whether the recordings are the same bit for bit.
"""

import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr

from sinew.plan.toml import dump_plan, load_plan

PRETENSION_MM = 6.0
_COMPILED = re.compile(r"Finished XLA compilation of (\S+) in ([\d.]+) sec")
_LIMIT_S = 600.0


def _simulate(plan: Path, out: Path, cache: Path) -> tuple[float, float, float, dict[str, float]]:
    """Return seconds, those of the processor, the largest memory so far [GB], and seconds of each compiled program."""
    environment = os.environ | {"SINEW_CACHE": str(cache), "JAX_LOG_COMPILES": "1"}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [str(Path(sys.executable).with_name("sinew")), "simulate", str(plan), "--out", str(out)],
        env=environment, capture_output=True, text=True, timeout=_LIMIT_S, check=False,
    )  # fmt: skip
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    busy = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    programs: dict[str, float] = {}
    for name, spent in _COMPILED.findall(done.stderr):
        programs[name] = max(programs.get(name, 0.0), float(spent))
    return seconds, busy, after.ru_maxrss / 1e6, programs


def main() -> None:
    """Print what the pose costs at first and again."""
    plan = load_plan("bent")
    one = plan.model_copy(update={"pretension": plan.pretension.model_copy(update={"pretension_mm": (PRETENSION_MM,)})})
    assert plan.pose is not None
    print(f"a pose bent by {plan.pose.bend_deg:g}° at {PRETENSION_MM:g} mm, {len(one.groups())} groups")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "one.toml"
        file.write_text(dump_plan(one), encoding="utf-8")
        outs = [Path(folder) / f"{i}.nc" for i in range(3)]
        for i, out in enumerate(outs):
            seconds, busy, memory, programs = _simulate(file, out, Path(folder) / "cache")
            longest = max(programs.items(), key=lambda each: each[1], default=("nothing", 0.0))
            state = "warm" if i else "cold"
            print(
                f"  {state}  {seconds:5.1f} s, {busy:5.1f} s of a core, at most {memory:.2f} GB; "
                f"compiled {sum(programs.values()):.1f} s, {longest[0]} the longest with {longest[1]:.1f} s",
                flush=True,
            )
        same = [_is_same(outs[0], out) for out in outs[1:]]
    print(f"  the same recording bit for bit: {sum(same)} of {len(same)}")


def _is_same(one: Path, other: Path) -> bool:
    with xr.open_dataset(one) as a, xr.open_dataset(other) as b:
        return all(np.array_equal(a[name].values, b[name].values, equal_nan=a[name].dtype.kind == "f") for name in a)


if __name__ == "__main__":
    main()
