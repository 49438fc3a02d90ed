"""Sliders of the design page: from a slider's move to its curve, in a worker's process as the pages have it.

A hundred moves drawn with a seed, each of one slider by one or a few steps, as a hand makes them. Measured is what the
pages' server waits for: the question to the worker, the sketch, and the way back. What the browser adds is measured
by `tests/browser/test_pages.py`. A busy computer lengthens them; its load is told.
"""

import argparse
import asyncio
import os
import time
from collections.abc import Sequence

import numpy as np
import psutil

from sinew.apps.dashboard.worker import Worker

LIMITS = {  # of the page's sliders: low, high, step
    "length_mm": (60.0, 150.0, 1.0),
    "outer_mm": (40.0, 80.0, 0.5),
    "tendon_circle_mm": (15.0, 60.0, 0.5),
    "lever_inertia_kg_m2": (0.004, 0.02, 0.0001),
    "pretension_mm": (0.0, 12.0, 0.25),
    "amplitude_deg": (2.0, 30.0, 0.5),
}
BUILT = {"length_mm": 95.0, "outer_mm": 65.0, "tendon_circle_mm": 28.0, "lever_inertia_kg_m2": 0.0083}
BUILT |= {"pretension_mm": 4.0, "amplitude_deg": 20.0}
BAND_HZ = (1.0, 6.0)
MOST_STEPS = 5


def moves(count: int, seed: int) -> list[dict[str, float]]:
    """Return what the sliders say after each of so many moves."""
    random, now, made = np.random.default_rng(seed), dict(BUILT), []
    for _ in range(count):
        name = str(random.choice(list(LIMITS)))
        low, high, step = LIMITS[name]
        way = step * random.integers(1, MOST_STEPS + 1) * random.choice([-1, 1])
        now = now | {name: float(np.clip(now[name] + way, low, high))}
        made.append(now)
    return made


def spent() -> float:
    """Return what the workers' processes have spent of the processor [s]."""
    return sum(sum(child.cpu_times()[:2]) for child in psutil.Process().children(recursive=True))


async def measure(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, list[float], float]:
    """Return (times [s] on the wall of each move, of its solver alone, of suggestions; processor's time of a move)."""
    worker, times, solver, suggestions = Worker(), [], [], []
    rig = ("length_mm", "outer_mm", "tendon_circle_mm", "lever_inertia_kg_m2")
    try:
        await worker.call("warm_up")
        before = spent()
        for values in moves(count, seed):
            begin = time.perf_counter()
            changes = {name: values[name] for name in rig}
            asked = "paper", changes, values["pretension_mm"], values["amplitude_deg"], BAND_HZ
            found = await worker.call("sketch_curves", *asked, key="sliders")
            times.append(time.perf_counter() - begin)
            solver.append(found["wall_s"])
        each = (spent() - before) / count
        for hertz in (3.2, 3.6, 4.0):
            begin = time.perf_counter()
            await worker.call("suggest_pretension", "paper", {}, hertz, 20.0)
            suggestions.append(time.perf_counter() - begin)
    finally:
        worker.close()
    return np.array(times), np.array(solver), suggestions, each


def main(arguments: Sequence[str] = ()) -> None:
    """Print median and 95th percentile of the moves, and the longest suggestion."""
    parser = argparse.ArgumentParser("sliders", description=__doc__)
    parser.add_argument("--moves", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    before = os.getloadavg()[0]
    times, solver, suggestions, each = asyncio.run(measure(asked.moves, asked.seed))
    print(f"{'':32}{'median':>10}{'95 %':>10}{'longest':>10}")
    for name, row in (("from move to curve / ms", times), ("of that in the solver / ms", solver)):
        print(f"{name:32}" + "".join(f"{1e3 * q:10.0f}" for q in (*np.percentile(row, (50, 95)), row.max())))
    print(f"processor's time of the worker for a move, mean: {1e3 * each:.0f} ms")
    print(f"suggestions of a pretension: at most {max(suggestions):.1f} s")
    print(f"load of the computer: {before:.1f} before, {os.getloadavg()[0]:.1f} after, {os.cpu_count()} cores")
