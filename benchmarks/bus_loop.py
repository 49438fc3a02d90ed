"""Time of the bench's cycle on an emulated bus, beside ROBOTIS's SDK doing the same, in one run.

`sinew emulate` plays the paper's rig in a process of its own: five motors and the sensor, with every byte's time on the
wire, and the joint behind. First the bench's own loop swings the pretensioned joint (`--hz`, `--baud`, `--reads`):
goals of all motors, present values of all devices, guard, tilt, journal. Then, in turns so that both see the same
computer, at each of `--bauds` a loop that does nothing keeps time, and the bare bus with plain and fast reads and
dynamixel-sdk tell the same goals and ask for the same registers at the same rate.

The emulator is a Python program and thinks for longer than any motor, which at 400 Hz is what would be measured. With
`--devices compiled` a small program answers in its place (bus_player.cpp; needs g++): registers in memory, springs for
tendons, each byte's time on the wire, no joint.
"""

import argparse
import gc
import math
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from tools.build_firmware import BuildError, build_program

from benchmarks.sdk_bus import SdkMaster
from sinew.apps.bench.bench_run import open_rig
from sinew.apps.bench.run_control import keeping_time
from sinew.bench.group import Swing
from sinew.bench.guard import Guard, Watch
from sinew.bench.loop import WATCHDOG_S, Loop, LoopStatistics
from sinew.bench.pretension import Held, MotorMap, pull_to_contact, set_pretension
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import Sample
from sinew.bench.stops import stop
from sinew.bench.tilt import TiltEstimator
from sinew.emulator.plant import Unloaded
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.bus import MonotonicClock
from sinew.hardware.rig import ReadKind, Rig, wire_s
from sinew.measure.arrays import Array
from sinew.measure.errors import BenchError, HardwareError
from sinew.measure.recording import Segment
from sinew.plan.plan import Plan, Pretension, Sweep, TendonMode
from sinew.plan.rig import LIMIT_RESERVE_N, RigSpec
from sinew.plan.servo import PULSE
from sinew.plan.toml import dump_plan, dump_rig, load_rig, save_rig
from sinew.twin.simulate import rest_tension

SAMPLE_HZ = 200.0
BAUDS = (1_000_000, 4_500_000)
KINDS: tuple[ReadKind, ...] = ("plain", "fast")
PRETENSION_MM, FREQUENCY_HZ, AMPLITUDE_DEG = 6.0, 3.6, 20.0
MODE: TendonMode = "position-with-current-limit"
SLACK_COUNTS = 100  # of a compiled motor's turn, before its tendon pulls
TURNS = 4  # of bare bus and SDK, one after the other
WANTED_MISSED = 0.1  # percent
PATIENCE_S = 60.0


class _TimedClock(MonotonicClock):
    """The computer's clock, which notes for how long nobody waits: the cycles' busy times [s]."""

    def __init__(self) -> None:
        self.busy: list[float] = []
        self._began = math.nan

    def wait_until(self, time: float) -> None:
        self.busy.append(self.now() - self._began)
        super().wait_until(time)
        self._began = self.now()


def _rig(baud: int, reads: ReadKind) -> RigSpec:
    """Return the paper's rig on a bus of another speed, asked another way."""
    spec = load_rig("paper")
    return spec.model_copy(update={"wiring": spec.wiring.model_copy(update={"baud": baud, "reads": reads})})


@contextmanager
def _emulated(spec: RigSpec, folder: Path) -> Iterator[tuple[str, int]]:
    """Give the port of an emulated bench, and the emulator's process id."""
    link, rig = str(folder / "bench"), folder / "rig.toml"
    save_rig(spec, rig)
    command = [str(Path(sys.executable).with_name("sinew")), "emulate", "--own-time", "--rig", str(rig), "--link", link]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            if not select.select([process.stdout], [], [], PATIENCE_S)[0] or not process.stdout.readline():
                raise SystemExit(f"`sinew emulate` was not ready within {PATIENCE_S:g} s")
            yield link, process.pid
        finally:
            process.terminate()


def _described(spec: RigSpec) -> str:
    """Return a rig's devices as bus_player.cpp reads them: tendons slack, the lever at its zero, the head upright."""
    tendons, wiring = spec.tendons, spec.wiring
    emulated = EmulatedRig(spec, Unloaded(tendons.count, spec), imu_ppm=0.0)
    emulated.advance(1.0)
    contact = tendons.first_contact_tension.value
    stiffness = (float(rest_tension([PRETENSION_MM], spec)[0]) - contact) / (1e-3 * PRETENSION_MM)
    per_count = tendons.current(stiffness * PULSE * tendons.pulley_radius.value) / tendons.current_lsb.value
    lines = [f"baud {wiring.baud}"]
    for index, (device, motor) in enumerate(emulated.motors.items()):
        registers = motor.registers
        motor.refresh(0, registers.rows.size, 1.0)
        start = registers["goal_position"] = registers["present_position"]
        at = {row.name: row.address for row in registers.rows}
        lines += [f"device {device} {registers.memory.hex()}", f"tick {at['realtime_tick']}"]
        lines.append(f"follows {at['goal_position']} {at['present_position']}")
        if index < tendons.count:
            sign = wiring.tendon_pull[index]
            spring = f"{start + sign * SLACK_COUNTS} {sign * per_count:.6g}"
            lines.append(f"pulls {at['present_current']} {at['goal_current']} {spring}")
    imu = emulated.imu.registers
    at = {row.name: row.address for row in imu.rows}
    lines += [f"device {wiring.imu_id} {imu.memory.hex()}", f"clock {at['clock']}"]
    lines += [f"samples {at['sample_time']} {at['samples']} {imu['sample_period']}", "run"]
    return "\n".join(lines) + "\n"


@contextmanager
def _compiled(spec: RigSpec, folder: Path) -> Iterator[tuple[str, int]]:
    """Give the port of a bench that bus_player.cpp plays, and its process id."""
    player = folder / "bus-player"
    if not player.exists():
        try:
            build_program([Path(__file__).with_name("bus_player.cpp")], player)
        except BuildError as trouble:
            raise SystemExit(str(trouble)) from trouble
    with subprocess.Popen([player], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(_described(spec))
            process.stdin.flush()
            if not select.select([process.stdout], [], [], PATIENCE_S)[0]:
                raise SystemExit(f"bus_player was not ready within {PATIENCE_S:g} s")
            yield process.stdout.readline().strip(), process.pid
        finally:
            process.terminate()


DEVICES = {"emulated": _emulated, "compiled": _compiled}


def _cpu_seconds(process: int) -> float:
    """Return how long a process has computed [s]; NaN where the system does not tell."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return math.nan
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _plan(seconds: float, hz: float) -> Plan:
    """Return what a plan would call it."""
    periods = max(1, round(seconds * FREQUENCY_HZ))
    sweep = Sweep(frequency_hz=(FREQUENCY_HZ,), amplitude_deg=AMPLITUDE_DEG, periods=periods)
    pretension = Pretension(pretension_mm=(PRETENSION_MM,), mode=MODE)
    return Plan(name="bus loop", sample_hz=hz, pretension=pretension, sweep=sweep)


def _put_under_power(loop: Loop, rig: Rig, tension_n: float) -> None:
    """Set the motors up, pull the tendons to first contact and set the pretension, as a run does."""
    rig.configure()
    rig.set_tendon_mode(MODE)
    for motor in rig.motors:
        motor.torque_on()
        motor.arm_watchdog(WATCHDOG_S)
    angles = tuple(motor.angle() for motor in rig.tendons)
    loop.watch = Watch(origin=angles, goals=angles)
    loop.restart()
    contact = pull_to_contact(loop, rig)
    held = Held.upright(PRETENSION_MM, tension_n, len(rig.tendons))
    motors = MotorMap(rig.spec, MODE, contact, {PRETENSION_MM: held})
    limit = (tension_n + LIMIT_RESERVE_N) * motors.newton
    loop.watch.limit = (limit,) * len(rig.tendons)
    for tendon in rig.tendons:
        tendon.limit_output(limit)
    set_pretension(loop, motors, PRETENSION_MM, 0.0, (0.0, 0.0))


def _time_loop(
    port: str, spec: RigSpec, seconds: float, hz: float, folder: Path
) -> tuple[Array, Array, LoopStatistics, str]:
    """Return (busy times, latenesses of the cycles [s], statistics, words on the wire) of the bench's loop."""
    tension = float(rest_tension([PRETENSION_MM], spec)[0])
    clock = _TimedClock()
    late: list[float] = []

    def take(sample: Sample) -> None:
        journal.append(sample)
        late.append(sample.late_s)

    with (
        open_rig(port, spec) as (rig, _),
        keeping_time(),
        Journal.create(folder / "journal.sqlite", dump_plan(_plan(seconds, hz)), dump_rig(spec)) as journal,
    ):
        loop = Loop(rig, clock, Guard(spec), TiltEstimator(spec, hz), 1 / hz, take)
        try:
            rig.choose_reads(1 / hz)
            _put_under_power(loop, rig, tension)
            journal.begin_segment(1, 0, Segment("steady", PRETENSION_MM, FREQUENCY_HZ, AMPLITUDE_DEG, 0))
            loop.statistics = LoopStatistics()
            late.clear()
            clock.busy.clear()
            loop.run(seconds, Swing(math.radians(AMPLITUDE_DEG), FREQUENCY_HZ, loop.due))
            clock.wait_until(clock.now())  # ends the last cycle
            journal.end_segment("complete")
        finally:
            stop(rig, MonotonicClock(), "release")
        wire = f"{1e3 * rig.wire_s():.2f} ms of a cycle are bytes on the wire, {rig.reads.kind} reads {rig.reads.why}"
    return np.array(clock.busy[1:]), np.array(late), loop.statistics, wire


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
        if rig.choose_reads(period).kind != spec.wiring.reads:
            raise SystemExit(rig.reads.why)
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


def _quantiles(seconds: Sequence[float] | Array) -> str:
    median, most, worst = 1e3 * np.quantile(seconds, (0.5, 0.99, 1.0))
    return f"median {median:5.2f}  p99 {most:5.2f}  longest {worst:5.2f} ms"


def _print_histogram(title: str, seconds: Array, edges_ms: Sequence[float]) -> None:
    """Print how many times lie between edges; what lies beyond the last, too."""
    counts, _ = np.histogram(1e3 * seconds, [*edges_ms, math.inf])
    print(f"  {title}")
    for low, high, count in zip(edges_ms, [*edges_ms[1:], math.inf], counts, strict=True):
        bar = "#" * math.ceil(50 * count / seconds.size)
        span = f"{low:5.2f} to {high:5.2f} ms" if math.isfinite(high) else f"{low:5.2f} ms and more"
        print(f"    {span:18} {count:7d}  {bar}")


def _load() -> str:
    return " ".join(f"{load:.1f}" for load in os.getloadavg())


def _report_loop(port: str, player: int, spec: RigSpec, seconds: float, hz: float, folder: Path) -> None:
    """Print how the bench's loop fared."""
    load, began, computed = _load(), time.monotonic(), _cpu_seconds(player)
    busy, late, statistics, wire = _time_loop(port, spec, seconds, hz, folder)
    share = (_cpu_seconds(player) - computed) / (time.monotonic() - began)
    missed = 100 * statistics.missed / (statistics.cycles + statistics.missed)
    print(
        f"bench loop: {statistics.cycles} cycles at {hz:g} Hz and {spec.wiring.baud} baud, load average before {load}, "
        f"after {_load()}"
    )
    print(f"  {wire}; those who answer took {100 * share:.0f} % of a core")
    _print_histogram("time a cycle took", busy, [0, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 7.5, 10])
    _print_histogram("begin after its deadline", late, [0, 0.05, 0.1, 0.2, 0.5, 1, 2, 5])
    print(f"  cycle      {_quantiles(busy)}")
    print(f"  lateness   {_quantiles(late)}")
    print(f"  missed deadlines {statistics.missed} = {missed:.3f} % (wanted: under {WANTED_MISSED:g} %)")
    print(
        f"  cycles with a missing answer {statistics.incomplete}, readings left out: {statistics.stale} stale, "
        f"{statistics.impossible} impossible"
    )


def _report_peer(baud: int, seconds: float, hz: float, folder: Path, devices: str) -> None:
    """Print bare bus and SDK beside each other at one speed of the bus."""
    count, period = max(1, round(seconds / TURNS * hz)), 1 / hz
    plain, fast = _rig(baud, "plain"), _rig(baud, "fast")
    with DEVICES[devices](plain, folder) as (port, _):
        runs: dict[str, Callable[[], tuple[list[float], int, int]]] = {
            "nothing at all": lambda: _bare_clock(count, period),
            "sinew's bus, plain": lambda: _bare_bus(port, plain, count, period),
            "sinew's bus, fast": lambda: _bare_bus(port, fast, count, period),
            "dynamixel-sdk, GroupSyncRead": lambda: _sdk(port, plain, count, period, "sync"),
            "dynamixel-sdk, GroupBulkRead": lambda: _sdk(port, plain, count, period, "bulk"),
            "dynamixel-sdk, fastBulkRead": lambda: _sdk(port, plain, count, period, "fast"),
        }
        took: dict[str, list[float]] = {name: [] for name in runs}
        missed, failed = dict.fromkeys(runs, 0), dict.fromkeys(runs, 0)
        for _ in range(TURNS):
            for name, run in runs.items():
                times, late, bad = run()
                took[name] += times
                missed[name] += late
                failed[name] += bad
    wire = ", ".join(f"{kind} {1e3 * wire_s(plain, MODE, kind):.2f} ms" for kind in KINDS)
    print(
        f"goals and present values of all six at {baud} baud and {hz:g} Hz, {TURNS} turns of {count} cycles each, load "
        f"average after {_load()}; on the wire {wire}"
    )
    ours = float(np.median(took["sinew's bus, plain"]))
    for name, times in took.items():
        ratio = f"; {np.median(times) / ours:.2f} times sinew's plain"
        print(f"  {name:28} {_quantiles(times)}, missed {missed[name]}, failed {failed[name]} of {len(times)}{ratio}")


def main(arguments: Sequence[str] = ()) -> None:
    """Print how the bench's loop keeps time, and how long dynamixel-sdk takes for the same."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks bus", description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0, help="of the bench's loop (120); 0: leave it out")
    parser.add_argument("--hz", type=float, default=SAMPLE_HZ, help="rate of the cycles (200)")
    parser.add_argument("--baud", type=int, default=BAUDS[0], help="of the bench's loop (1000000)")
    parser.add_argument("--reads", choices=("plain", "fast"), default="plain", help="of the bench's loop (plain)")
    parser.add_argument("--peer-seconds", type=float, help="of bare bus and SDK each (as --seconds); 0: leave them out")
    parser.add_argument("--bauds", type=int, nargs="+", default=BAUDS, help="of bare bus and SDK (1000000 4500000)")
    parser.add_argument("--devices", choices=list(DEVICES), default="emulated", help="who answers (emulated)")
    options = parser.parse_args(arguments)
    spec = _rig(options.baud, options.reads)
    said = "`sinew emulate`" if options.devices == "emulated" else "bus_player.cpp, which has no joint,"
    print(f"six devices on a bus of {said} in a process of its own")
    with tempfile.TemporaryDirectory() as name:
        if options.seconds:
            with DEVICES[options.devices](spec, Path(name)) as (port, player):
                try:
                    _report_loop(port, player, spec, options.seconds, options.hz, Path(name))
                except (BenchError, HardwareError) as trouble:
                    told = f"the bench's loop was stopped at a load average of {_load()}: {trouble}"
                    raise SystemExit(told) from trouble
        seconds = options.seconds if options.peer_seconds is None else options.peer_seconds
        for baud in options.bauds if seconds else ():
            _report_peer(baud, seconds, options.hz, Path(name), options.devices)


if __name__ == "__main__":
    main(sys.argv[1:])
