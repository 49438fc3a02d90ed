"""One run of the campaign in virtual time, and the verdict on it.

What may not happen, whatever the fault (`Verdict.violations`): a reading in the recording, or in the journal, that was
not true; an end outside the safe state, as the motors are and not as their registers say; an end that the report calls
safe and that is not the declared one; an end without a sentence; an error that has no name; a run without end; a
recording that lacks a group that was reported as done; an early end where nothing was wrong.
"""

import gc
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from campaigns.comparison import Comparison, compare
from campaigns.faulty_bench import JOURNAL, FaultyBench, timeline_of
from campaigns.scenario import Scenario
from sinew.bench.run import RunReport
from sinew.emulator.rig import MotorState
from sinew.measure.errors import StartError


@dataclass(slots=True)
class Verdict:
    """What became of a run.

    kind: of its fault. struck: whether it came before the run had ended. happened: what its faults did, and how often.
    outcome: complete, stopped, refused or raised. sentence: what ended it. stop: how it was left, as the bench says.
    readings: of the recording and the journal, held against the truth. end: the motors' true state. tension_n: of every
    tendon in the end. virtual_s, wall_s: how long it took. violations: of what may not happen, those of the readings
    among them.
    """

    number: int
    kind: str
    faults: list[str]
    plan: str
    mode: str
    safe_state: str
    interrupt_s: float | None
    struck: bool = False
    happened: dict[str, int] = field(default_factory=dict)
    outcome: str = "refused"
    sentence: str = ""
    stop: str = ""
    groups: int = 0
    groups_done: int = 0
    readings: Comparison = field(default_factory=Comparison)
    end: list[str] = field(default_factory=list)
    tension_n: list[float] = field(default_factory=list)
    virtual_s: float = 0.0
    wall_s: float = 0.0
    violations: list[str] = field(default_factory=list)

    def document(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return asdict(self)


def judge(scenario: Scenario, tension_n: Mapping[float, float]) -> Verdict:
    """Run a scenario and return what became of it; raises nothing that a run may do wrong.

    tension_n: of each tendon at rest, by pretension [mm].
    """
    began = time.perf_counter()
    if scenario.phase is not None:
        scenario = scenario.aimed(timeline_of(scenario, tension_n))
    bench = FaultyBench(scenario)
    verdict = Verdict(
        scenario.number,
        scenario.kind,
        [str(fault) for fault in (*scenario.faults, *([scenario.lies] if scenario.lies else []))],
        scenario.plan,
        scenario.mode,
        scenario.safe_state,
        None if math.isinf(scenario.interrupt_s) else scenario.interrupt_s,
    )
    collecting = gc.isenabled()
    gc.disable()
    try:
        with TemporaryDirectory() as folder:
            report = _run(bench, Path(folder), tension_n, verdict)
            _look_at_end(bench, report, verdict)
            verdict.readings = compare(bench, Path(folder) / JOURNAL, report.groups_done if report else 0)
            verdict.violations += verdict.readings.violations
    finally:
        if collecting:
            gc.enable()
            gc.collect(1)
    for happening in bench.faults.log:
        what = f"{happening.kind} {happening.what}"
        verdict.happened[what] = verdict.happened.get(what, 0) + 1
        verdict.struck = verdict.struck or happening.time <= verdict.virtual_s
    if bench.hostile is not None:
        marked = {"stale": bench.rig.stale.total(), "impossible": bench.rig.impossible.total()}
        verdict.happened = {"struck": bench.hostile.struck} | {f"marked {why}": n for why, n in marked.items()}
        verdict.struck = bench.hostile.struck > 0
    verdict.wall_s = time.perf_counter() - began
    return verdict


def _run(bench: FaultyBench, folder: Path, tension_n: Mapping[float, float], verdict: Verdict) -> RunReport | None:
    """Run, note how it ended, and return its report; None where it did not start."""
    report = None
    try:
        report = bench.run(folder, tension_n)
    except StartError as refusal:
        verdict.sentence = str(refusal)
    except Exception as fault:
        verdict.outcome, verdict.sentence = "raised", str(fault)
        verdict.violations.append(f"raised {type(fault).__name__}: {fault}")
    verdict.virtual_s = round(bench.port.rig.time, 3)
    if report is not None:
        verdict.outcome = "complete" if report.is_complete else "stopped"
        verdict.sentence, verdict.stop = report.sentence, report.stop.sentence() if report.stop else ""
        verdict.groups, verdict.groups_done = report.groups, report.groups_done
        if not verdict.stop.strip():
            verdict.violations.append("no sentence on how the rig was left")
    if verdict.kind == "none" and math.isinf(bench.scenario.interrupt_s) and verdict.outcome != "complete":
        verdict.violations.append(f"{verdict.outcome} without a fault: {verdict.sentence}")
    if not verdict.sentence.strip() or "\n" in verdict.sentence:
        verdict.violations.append("no sentence on what ended it")
    return report


def _look_at_end(bench: FaultyBench, report: RunReport | None, verdict: Verdict) -> None:
    bench.settle()
    states = bench.emulated.states()
    verdict.end = [_words(device, state) for device, state in states.items()]
    verdict.tension_n = [round(tension, 2) for tension in bench.emulated.motion().tension]
    if not bench.emulated.in_safe_state():
        verdict.violations.append("outside the safe state: " + "; ".join(verdict.end))
    if verdict.outcome == "refused" and any(state.torque for state in states.values()):
        verdict.violations.append("refused, and a torque is on: " + "; ".join(verdict.end))
    if report is not None and report.stop is not None and report.stop.is_safe:
        for motor in bench.rig.motors:
            state = states[motor.id]
            if not _is_as_declared(bench.scenario, state):
                declared = report.stop.declared
                verdict.violations.append(f"the report says {declared}, but {motor.name} is {_words(motor.id, state)}")


def _is_as_declared(scenario: Scenario, state: MotorState) -> bool:
    """Return whether a motor is as a report without reservations says."""
    if scenario.safe_state == "release":
        return not state.torque
    # The supply, or a motor's own protection, may have taken its torque after it was asked.
    may_be_off = any(fault.kind in ("brown-out", "overload", "overheat") for fault in scenario.faults)
    return state.torque or may_be_off


def _words(device: int, state: MotorState) -> str:
    torque = "torque" if state.torque else "no torque"
    tripped = ", tripped" if state.is_tripped else ""
    law = state.law
    limits = "" if law.kind == "off" else f" {law.goal:.3f} duty<{law.duty_limit:.2f} current<{law.current_limit:.2f}"
    return f"{device}: {torque}{tripped}, {law.kind}{limits}, {state.speed:+.3f} rad/s"
