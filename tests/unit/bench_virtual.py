"""A bench in virtual time: the bench's own code on one side, emulated devices and mechanics on the other."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner, RunReport
from sinew.emulator.bench import EmulatedRig, VirtualPort
from sinew.emulator.plant import JointPlant
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.plan.plan import Plan, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig

SLACK_M = (1.0e-3, 2.5e-3, 1.8e-3, 0.6e-3)


@dataclass
class VirtualBench:
    spec: RigSpec
    emulated: EmulatedRig
    port: VirtualPort
    rig: Rig

    def run(
        self, plan: Plan, folder: Path, tension_n: dict[float, float], *, resume: bool = False, **more: Any
    ) -> RunReport:
        """Run a plan, its journal in a folder. more: of the `Runner`, as listener, law or held."""
        texts = (dump_plan(plan), dump_rig(self.spec))
        path = folder / "journal.sqlite"
        with Journal.open(path, *texts) if resume else Journal.create(path, *texts) as journal:
            return Runner(self.rig, self.port, plan, journal, tension_n, **more).run(resume=resume)


def virtual_bench(
    spec: RigSpec,
    *,
    plant: JointPlant | None = None,
    slack_m: Sequence[float] = SLACK_M,
    rest_tilt: tuple[float, float] = (0.0, 0.0),
    seed: int = 0,
    tells_supply: bool = False,
    told: RigSpec | None = None,
) -> VirtualBench:
    """Return a bench as `spec` says; the run goes by `told`, else by the same."""
    plant = plant or JointPlant(spec, slack_m=slack_m, rest_tilt=rest_tilt)
    emulated = EmulatedRig(spec, plant, seed=seed, tells_supply=tells_supply)
    port = VirtualPort(emulated)
    bus = Bus(port, port, BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms), retries=2)
    return VirtualBench(told or spec, emulated, port, Rig(bus, port, told or spec))


def set_going(
    rig: Rig,
    clock: VirtualPort,
    mode: TendonMode,
    *,
    cycles: int,
    drive_step: float,
    tendon_step: float = 0.0,
    current: float = 0.05,
) -> None:
    """Leave a bench as a run does that dies: motors under way by a step [rad] a cycle of 5 ms, or tendon motors under a
    current [A], and bus watchdogs armed."""
    rig.configure()
    rig.set_tendon_mode(mode)
    for motor in rig.motors:
        if mode == "current" and motor in rig.tendons:
            motor.set("goal_current", current)
        motor.torque_on()
        motor.arm_watchdog(0.08)
    start = [motor.angle() for motor in rig.tendons]
    for cycle in range(cycles):
        goals = [current if mode == "current" else angle + tendon_step * cycle for angle in start]
        rig.write_goals(drive_step * cycle, goals)
        rig.read()
        clock.wait_until(clock.now() + 0.005)
