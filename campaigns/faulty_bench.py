"""An emulated bench, ready for one run of the campaign: faults, witness, operator, virtual time."""

import math
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from campaigns.lies import HostileLine
from campaigns.scenario import Scenario, Timeline, plan_of, rig_of
from campaigns.witness import TENDON_COUNTS, Witness
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import Sample
from sinew.bench.run import Runner, RunReport
from sinew.emulator.faults import Faults
from sinew.emulator.found import VirtualPort
from sinew.emulator.joint_plant import JointPlant
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.measure.events import Event
from sinew.plan.plan import Group
from sinew.plan.toml import dump_plan, dump_rig
from sinew.tune.track import ExpectedBackbone, Tracker, planned_tracker

JOURNAL = "journal.sqlite"
"""Name of a run's journal in its folder."""

LONGEST_S = 90.0
"""A run that has not ended after so long has no end [s, virtual time]."""

_WATCHDOG_S = 0.3  # without a host, so that the bus watchdogs can act
_REST_MOST_S = 4.0  # until a joint that swings in held tendons is at rest
_BUS_RETRIES = 2

_BACKBONE_HZ = {0.0: 3.030, 2.0: 3.176, 4.0: 3.351}
"""Where the paper's joint resonates at a command of 20°, by pretension [mm] (docs/explanation/tracking.md)."""

_AT_20_DEG = (20.0, 9.0, 40.0)  # command, lever and torsion, about

# Straight lines in the place of a prediction, which takes longer than a run: the law needs only about where, and how
# damped.
_EXPECTED = tuple(
    ExpectedBackbone(mm, np.full(2, hz), np.full(2, 0.07), *(np.radians([0.0, deg]) for deg in _AT_20_DEG))
    for mm, hz in _BACKBONE_HZ.items()
)


class EndlessError(Exception):
    """A run that does not end."""


class _BoundedPort(VirtualPort):
    """A port whose time comes to an end."""

    def write(self, data: bytes) -> None:
        if self.now() > LONGEST_S:
            raise EndlessError(f"no end after {LONGEST_S:g} s")
        super().write(data)


class _Operator:
    """Sees the run, notes its phases, and ends it when the scenario says so; a Listener."""

    def __init__(self, port: VirtualPort, interrupt_s: float) -> None:
        self._port, self._interrupt_s = port, interrupt_s
        self.runner: Runner | None = None
        self.said: dict[str, float] = {}
        self.first, self.newest = math.nan, math.nan
        self.after_contact = math.nan

    def on_sample(self, sample: Sample) -> None:
        now = sample.time_s
        if math.isnan(self.first):
            self.first = now
        if "contact" in self.said and math.isnan(self.after_contact):
            self.after_contact = now
        self.newest = now
        if now >= self._interrupt_s and self.runner is not None:
            self.runner.steering.request_stop("interrupted by the operator")

    def on_event(self, event: Event) -> None:
        self.said.setdefault(event.kind, self._port.now())

    def timeline(self) -> Timeline:
        """Return the phases that there were."""
        said, nothing = self.said, math.nan
        phases: Timeline = {
            "set-up": (0.0, self.first),
            "mode change": (said.get("contact", nothing), self.after_contact),
            "levelling": (self.after_contact, said.get("pretension", nothing)),
            "stop": (self.newest, said.get("end", nothing)),
        }
        return {phase: times for phase, times in phases.items() if not any(map(math.isnan, times))}


class FaultyBench:
    """An emulated bench with a scenario's joint and faults, and all that a run on it needs.

    witness: of how the joint moved. hostile: the line, if it is. emulated: the devices. rig: the same as the bench sees
    them, through port.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.plan, self.spec = scenario, plan_of(scenario), rig_of(scenario)
        spec = self.spec
        plant = JointPlant(spec, slack_m=scenario.slack_m, rest_tilt=scenario.rest_tilt)
        self.witness = Witness(plant, spec.tendons.count)
        self.emulated = EmulatedRig(spec, self.witness, seed=scenario.fault_seed, tendon_counts=TENDON_COUNTS)
        self.faults = Faults(scenario.faults, seed=scenario.fault_seed)
        self.port = _BoundedPort(self.faults.attach(self.emulated))
        self.hostile = HostileLine(scenario.lies, self.emulated.line) if scenario.lies is not None else None
        timing = BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms)
        self.rig = Rig(Bus(self.port, self.port, timing, retries=_BUS_RETRIES), self.port, spec)
        self.operator = _Operator(self.port, scenario.interrupt_s)

    def run(self, folder: Path, tension_n: Mapping[float, float]) -> RunReport:
        """Run the plan with a journal in a folder; raises what the run does not catch, StartError among it."""
        with Journal.create(folder / JOURNAL, dump_plan(self.plan), dump_rig(self.spec)) as journal:
            runner = Runner(self.rig, self.port, self.plan, journal, tension_n, listener=self.operator, law=self._law)
            self.operator.runner = runner
            return runner.run()

    def _law(self, group: Group, time: float) -> Tracker:
        return planned_tracker(group, self.plan, self.spec, _EXPECTED, time)

    def settle(self) -> None:
        """Let the bench be without its host until the watchdogs have acted and nothing swings."""
        start = end = self.port.rig.time
        while end < start + _WATCHDOG_S or (end < start + _REST_MOST_S and not self.emulated.in_safe_state()):
            end += 0.1
            self.port.rig.advance(end)


def timeline_of(scenario: Scenario, tension_n: Mapping[float, float]) -> Timeline:
    """Return when the phases of a run without its faults begin and end [s]."""
    bench = FaultyBench(scenario.without_faults())
    with TemporaryDirectory() as folder:
        bench.run(Path(folder), tension_n)
    return bench.operator.timeline()
