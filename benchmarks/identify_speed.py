"""Time of `sinew identify` on long tables, each in a new process, with and without compiled code of an earlier one.

A joint of 3 Hz under a torque that sweeps, integrated by fixed steps, its angle with 0.2° of noise. The
law decides how long the choice of a model takes: dry friction has its limit, hysteresis that yields, tried beside it,
in steps a quarter as long as the samples, and what yields indeed leaves misfit in every other law.
"""

import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinew.measure.arrays import Array

INERTIA, HZ, DAMPING = 12.74e-3, 3.0, 0.05  # kg m²; Lehr's ratio
OMEGA = 2 * np.pi * HZ
SWING, NOISE = 0.5, float(np.deg2rad(0.2))  # rad
_STEPS_HZ, _DRY_STEPS_HZ = 2000.0, 8000.0  # of the integration
_SLIDING = 1e-3 * SWING * OMEGA  # rad/s: below it friction is a damper

Rate = Callable[[Array, float], Array]


@dataclass(frozen=True)
class Case:
    """One table. dry: friction's torque; cubic, hysteresis: likewise, at the largest swing, all over the spring's."""

    name: str
    model: str
    samples: int
    rate_hz: float
    dry: float = 0.0
    cubic: float = 0.0
    hysteresis: float = 0.0
    free: bool = False


CASES = (
    Case("linear, driven", "linear", 65_000, 200.0),
    Case("linear, driven", "auto", 12_000, 100.0),
    Case("hardening, driven", "auto", 12_000, 100.0, cubic=0.3),
    Case("dry friction, driven", "auto", 12_000, 160.0, dry=0.05),
    Case("dry friction and hardening, driven", "auto", 12_000, 160.0, dry=0.05, cubic=0.3),
    Case("hysteresis, driven", "auto", 12_000, 160.0, hysteresis=0.1),
    Case("hysteresis and hardening, driven", "auto", 12_000, 160.0, hysteresis=0.1, cubic=0.3),
    Case("dry friction, free", "auto", 12_000, 1000.0, dry=0.02, free=True),
)


def table_of(case: Case, seed: int = 0) -> Array:
    """Return time [s], torque [N m] and angle [rad] of a case, shape (n, 3)."""
    parts = round((_DRY_STEPS_HZ if case.dry else _STEPS_HZ) / case.rate_hz)
    step = 1.0 / case.rate_hz / parts
    lasts = case.samples / case.rate_hz
    slope = 1.6 * HZ / lasts
    size = 0.0 if case.free else SWING * 2 * DAMPING * OMEGA**2
    cubic = case.cubic / max(1 - case.cubic, 0.1) * OMEGA**2 / SWING**2
    dry, hysteresis = (share * OMEGA**2 * SWING for share in (case.dry, case.hysteresis))
    yields = 0.1 * SWING

    def push(t: float) -> float:
        return size * math.sin(2 * math.pi * (0.4 * HZ * t + 0.5 * slope * t**2))

    def rate(t: float, r: float, v: float, w: float) -> tuple[float, float, float]:
        lost = 2 * DAMPING * OMEGA * v + dry * math.tanh(v / _SLIDING) + hysteresis * w
        return v, push(t) - lost - OMEGA**2 * r - cubic * r**3, v / yields * (1 - (w * w if v * w > 0 else 0.0))

    state: tuple[float, ...] = (SWING if case.free else 0.0, 0.0, 0.0)
    rows = np.empty((case.samples, 3))
    for n in range(case.samples):
        t = n / case.rate_hz
        rows[n] = t, INERTIA * push(t), state[0]
        for _ in range(parts):
            middle = tuple(y + 0.5 * step * k for y, k in zip(state, rate(t, *state), strict=True))
            state = tuple(y + step * k for y, k in zip(state, rate(t + 0.5 * step, *middle), strict=True))
            t += step
    rows[:, 2] += np.random.default_rng(seed).normal(0, NOISE, case.samples)
    return rows


def _timed(command: Sequence[str], cache: Path) -> tuple[float, float, str]:
    """Return wall and CPU seconds of a command in a new process, and what it printed."""
    started, before = time.perf_counter(), os.times()
    told = subprocess.run(
        command, check=True, capture_output=True, text=True, env=os.environ | {"SINEW_CACHE": str(cache)}
    ).stdout
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - started, used, told


def main(asked: Sequence[str] = ()) -> None:
    """Print wall and CPU seconds of every case, or of those with the numbers that are asked for."""
    print(f"sinew identify FILE in a new process, {os.cpu_count()} cores (wanted: at most 20 s)")
    print(f"  {'':36} {'model':8} {'samples':>8}   {'nothing compiled':>16}   {'compiled before':>16}   found")
    with tempfile.TemporaryDirectory() as folder:
        for number, case in enumerate(CASES):
            if asked and str(number) not in asked:
                continue
            path = Path(folder) / f"{number}.csv"
            np.savetxt(path, table_of(case), delimiter=",", header="t,u,x", comments="", fmt="%.9g")
            inputs = ["--excitation", "none"] if case.free else ["--input", "u:N*m", "--excitation", "torque"]
            command = [str(Path(sys.executable).with_name("sinew")), "identify", str(path)]
            command += ["--time", "t", "--output", "x:rad"]
            command += [*inputs, "--model", case.model]
            runs = [_timed(command, Path(folder) / f"cache{number}") for _ in range(2)]
            spent = "   ".join(f"{wall:5.1f} s, {cpu:4.1f} CPU" for wall, cpu, _ in runs)
            found = next(line for line in runs[1][2].splitlines() if "model" in line).split()[1]
            print(f"  {case.name:36} {case.model:8} {case.samples:8d}   {spent}   {found}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
