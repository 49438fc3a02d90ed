"""Time of the bus's cycle on an emulated bench, beside ROBOTIS's SDK doing the same.

`sinew emulate` plays the paper's rig in a process of its own: five motors and the sensor, with every byte's time on the
wire. In turns, so that both see the same computer, Sinew's bus and dynamixel-sdk tell the
same goals and ask for the same registers at the same rate.
"""

import argparse
import gc
import math
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.sdk_bus import SdkMaster
from benchmarks.table import Row
from sinew.apps.bench.bench_run import open_rig
from sinew.apps.bench.run_control import keeping_time
from sinew.bench.group import Swing
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig, save_rig

SAMPLE_HZ = 200.0
BAUDS = (1_000_000, 4_500_000)
FREQUENCY_HZ, AMPLITUDE_DEG = 3.6, 20.0
MODE: TendonMode = "position-with-current-limit"
TURNS = 4  # of bare bus and SDK, one after the other
PATIENCE_S = 60.0


def _rig(baud: int) -> RigSpec:
    """Return the paper's rig on a bus of another speed."""
    spec = load_rig("paper")
    return spec.model_copy(update={"wiring": spec.wiring.model_copy(update={"baud": baud})})


@contextmanager
def _emulated(spec: RigSpec, folder: Path) -> Iterator[str]:
    """Give the port of an emulated bench."""
    link, rig = str(folder / "bench"), folder / "rig.toml"
    save_rig(spec, rig)
    command = [str(Path(sys.executable).with_name("sinew")), "emulate", "--own-time", "--rig", str(rig), "--link", link]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            if not select.select([process.stdout], [], [], PATIENCE_S)[0] or not process.stdout.readline():
                raise SystemExit(f"`sinew emulate` was not ready within {PATIENCE_S:g} s")
            yield link
        finally:
            process.terminate()


def _paced(cycle: Callable[[float], bool], count: int, period: float) -> tuple[list[float], int, int]:
    """Run cycles at the rate; return (how long each took [s], missed deadlines, failed cycles)."""
    took: list[float] = []
    missed = failed = 0
    due = time.monotonic()
    for _ in range(count):
        time.sleep(max(0.0, due - time.monotonic()))
        began = time.monotonic()
        skipped = int((began - due) // period)
        missed += skipped
        due += (1 + skipped) * period
        failed += not cycle(began)
        took.append(time.monotonic() - began)
    return took, missed, failed


def _bare_clock(count: int, period: float) -> tuple[list[float], int, int]:
    """Time nothing at all, by the bench's own priority: what the computer itself does not keep."""
    with keeping_time():
        return _paced(lambda _: True, count, period)


def _bare_bus(port: str, spec: RigSpec, count: int, period: float) -> tuple[list[float], int, int]:
    """Time Sinew's bus alone: goals in one packet, present values of all devices in one transaction, decoded."""
    with open_rig(port, spec) as (rig, clock), keeping_time():
        rig.set_tendon_mode(MODE)
        angles = tuple(motor.angle() for motor in rig.tendons)
        swing = Swing(math.radians(AMPLITUDE_DEG), FREQUENCY_HZ, clock.now())
        for motor in rig.motors:
            motor.torque_on()

        def cycle(now: float) -> bool:
            rig.write_goals(swing(now), angles)
            return not rig.read().faults

        try:
            return _paced(cycle, count, period)
        finally:
            for motor in rig.motors:
                motor.torque_off()


def _sdk(port: str, spec: RigSpec, count: int, period: float, kind: str) -> tuple[list[float], int, int]:
    """Time dynamixel-sdk with its groups of one kind: sync, bulk or fast bulk.

    Without real-time priority: the SDK asks the port again and again until all is there, and with it would keep the
    system from handing over the bytes that it waits for.
    """
    master = SdkMaster(port, spec)
    cycle = {"sync": master.sync_cycle, "bulk": master.bulk_cycle, "fast": master.fast_bulk_cycle}[kind]
    swing = Swing(math.radians(AMPLITUDE_DEG), FREQUENCY_HZ, time.monotonic())
    gc.collect()
    gc.disable()
    try:
        return _paced(lambda now: cycle(swing(now)), count, period)
    finally:
        gc.enable()
        master.close()


def rows(arguments: Sequence[str] = ()) -> Iterator[Row]:
    """Return the median time of a cycle at each speed of the bus, Sinew's and the SDK's in turns."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks bus", description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each master (20)")
    parser.add_argument("--hz", type=float, default=SAMPLE_HZ, help="rate of the cycles (200)")
    parser.add_argument("--bauds", type=int, nargs="+", default=BAUDS, help="speeds of the bus (1000000 4500000)")
    options = parser.parse_args(arguments)
    return (row for baud in options.bauds for row in _at(baud, options.seconds, options.hz))


def _at(baud: int, seconds: float, hz: float) -> Iterator[Row]:
    count, period = max(1, round(seconds / TURNS * hz)), 1 / hz
    spec = _rig(baud)
    with tempfile.TemporaryDirectory() as folder, _emulated(spec, Path(folder)) as port:
        runs: dict[str, Callable[[], tuple[list[float], int, int]]] = {
            "sinew": lambda: _bare_bus(port, spec, count, period),
            "GroupSyncRead": lambda: _sdk(port, spec, count, period, "sync"),
            "GroupBulkRead": lambda: _sdk(port, spec, count, period, "bulk"),
            "fastBulkRead": lambda: _sdk(port, spec, count, period, "fast"),
        }
        took: dict[str, list[float]] = {name: [] for name in runs}
        missed, failed = Counter[str](), Counter[str]()
        for _ in range(TURNS):
            for name, run in runs.items():
                times, late, bad = run()
                took[name] += times
                missed[name] += late
                failed[name] += bad
    for name in ("GroupSyncRead", "GroupBulkRead", "fastBulkRead"):
        ours, theirs = (1e3 * float(np.median(took[one])) for one in ("sinew", name))
        note = f"missed {missed['sinew']}, {missed[name]}; failed {failed['sinew']}, {failed[name]} "
        note += f"of {len(took[name])}"
        yield Row(f"a cycle of six devices, {baud} baud", ours, f"dynamixel-sdk, {name}", theirs, "ms", note)
