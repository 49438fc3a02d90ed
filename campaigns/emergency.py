"""Emergency stops of runs at random moments: `python -m campaigns.emergency --runs 90`.

Each run is a short plan on the emulated bench in virtual time; the request comes at a drawn moment of a drawn phase, at
a drawn pretension, motor mode and safe state. In half of the runs packets are lost from then on, or a motor falls
silent for good, whose bus watchdog has to stop it. What the motors do is read from the mechanics: frozen means without
torque, or told to stay with limited output (`EmulatedRig.frozen`); at rest means that nothing turns any more either
(`EmulatedRig.in_safe_state`). Exit status 1 if something happened that may not.
"""

import math
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd

from campaigns.options import TWO, campaign_parser, conclude, spread_of, spread_trials
from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner
from sinew.emulator.bench import EmulatedRig, VirtualPort
from sinew.emulator.faults import Faults, parse_fault
from sinew.emulator.plant import JointPlant
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.measure.errors import StartError
from sinew.plan.plan import Plan, TendonMode
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan
from sinew.twin.simulate import rest_tension

FROZEN_MOST_MS = 200.0
"""From the request until every motor is frozen."""

PHASES = {
    "set-up": 0.5, "pull": 3.0, "mode change": 0.1, "pretension": 3.0, "steady": 2.0, "ring-down": 1.4, "pause": 0.4
}  # fmt: skip
"""Phases at which a request is aimed, and for how long of each it may come [s]."""

PRETENSIONS_MM = (0.0, 4.0, 12.0)
DROPPED, SILENT = "drop:p=0.05", "a motor falls silent"

_TENSION_RISE_N = 8.0
_AFTER_S = 4.0
_LOOK_S = 0.01


@dataclass(frozen=True, slots=True)
class Case:
    """One run.

    phase, after_s: when the request comes, so long [s] after the phase's begin. fault: what goes wrong then.
    """

    number: int
    phase: str
    after_s: float
    mode: TendonMode
    safe_state: str
    pretension_mm: float
    amplitude_deg: float
    fault: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a case, by the truth of the mechanics.

    frozen_ms: from the request until the last motor was frozen; NaN if one was not after 200 ms. said_ms: by the run.
    rest_ms: until nothing turned any more, of rigs that hold. lever_deg: how far the lever went on.
    rise_n: of the largest tension over that of the last half second before. wrong: what happened that may not.
    """

    case: Case
    frozen_ms: float
    said_ms: float
    rest_ms: float
    done_ms: float
    lever_deg: float
    rise_n: float
    wrong: tuple[str, ...]


def draw_case(seed: int, number: int) -> Case:
    """Return case `number` of a campaign: phases, modes and safe states in turn, the rest by chance."""
    rng = np.random.default_rng([seed, number])
    modes: tuple[TendonMode, ...] = get_args(TendonMode)
    names = list(PHASES)
    phase = names[number % len(names)]
    mode = modes[number // len(names) % len(modes)]
    if phase == "mode change" and mode == "position-with-current-limit":
        mode = "current"  # a run by the other has none
    return Case(
        number=number,
        phase=phase,
        after_s=float(rng.uniform(0, PHASES[phase])),
        mode=mode,
        safe_state=("hold", "release")[int(rng.integers(2))],
        pretension_mm=float(rng.choice(PRETENSIONS_MM[1:] if mode == "current" else PRETENSIONS_MM)),
        amplitude_deg=float(rng.uniform(10, 40)),
        fault=str(rng.choice(["", DROPPED, SILENT], p=[0.5, 0.3, 0.2])),
    )


def tensions() -> dict[float, float]:
    """Return the tension of each tendon at rest [N] at every pretension of the campaign [mm]."""
    return dict(zip(PRETENSIONS_MM, rest_tension(PRETENSIONS_MM, load_rig("paper")).tolist(), strict=True))


class _Port(VirtualPort):
    """A port that makes the request when it is due, and looks at the truth afterwards."""

    def __init__(self, emulated: EmulatedRig, case: Case) -> None:
        super().__init__(emulated)
        self.emulated, self.case = emulated, case
        self.runner: Runner | None = None
        self.due = math.inf if case.phase != "set-up" else case.after_s
        self.asked = self.looked = self.frozen = self.unrest = math.nan
        self.before = self.after = self.lever = 0.0
        self._start_lever = 0.0
        self._recent: list[tuple[float, float]] = []

    def write(self, data: bytes) -> None:
        self._look()
        super().write(data)

    def wait_until(self, time: float) -> None:
        # Nobody speaks while the motors stand; the truth is looked at all the same.
        while math.isfinite(self.asked) and time - self.now() > _LOOK_S:
            super().wait_until(self.now() + _LOOK_S)
            self._look()
        super().wait_until(time)

    def _look(self) -> None:
        now, runner = self.now(), self.runner
        if runner is None or now - self.looked < _LOOK_S:
            return
        if self.case.phase == "pause" and runner.at.group is not None:
            runner.steering.request_pause()
        if math.isinf(self.due) and _phase(runner) == self.case.phase:
            self.due = now + self.case.after_s
        motion = self.emulated.motion()
        if math.isnan(self.asked):
            self._recent = [*(pair for pair in self._recent if pair[0] > now - 0.5), (now, max(motion.tension))]
            if now >= self.due:
                self.asked, self._start_lever = now, motion.drive.angle
                self.before = max(tension for _, tension in self._recent)
                self._go_wrong()
                runner.steering.request_emergency("emergency stop of the campaign")
            return
        self.looked = now
        self.lever = max(self.lever, abs(motion.drive.angle - self._start_lever))
        self.after = max(self.after, *motion.tension)
        if not self.emulated.in_safe_state():
            self.unrest = now
        if math.isnan(self.frozen) and now - self.asked >= 1e-3 * FROZEN_MOST_MS:
            states = self.emulated.states().values()
            since = max(now - state.law_s if state.torque else self.asked for state in states)
            self.frozen = max(0.0, since - self.asked) if self.emulated.frozen_since() is not None else math.inf

    def _go_wrong(self) -> None:
        case, emulated = self.case, self.emulated
        if case.fault == DROPPED:
            Faults(emulated, [parse_fault(DROPPED)], case.number)
        elif case.fault == SILENT:
            silent = list(emulated.motors)[case.number % len(emulated.motors)]
            emulated.line.devices = [device for device in emulated.line.devices if device.id != silent]


def _phase(runner: Runner) -> str:
    state = runner.at.state
    if state == "running" and runner.at.group is not None:
        return runner.group_kind
    return {
        "starting": "set-up",
        "pulling the tendons": "pull",
        "changing the mode": "mode change",
        "setting pretension": "pretension",
        "paused": "pause",
    }.get(state, state)


def plan_of(case: Case) -> Plan:
    """Return the plan of a case."""
    return parse_plan(f"""
        name = "emergency"
        sample_hz = 200
        [pretension]
        pretension_mm = [{case.pretension_mm}]
        mode = "{case.mode}"
        rest_s = 0.3
        [sweep]
        frequency_hz = [{3.2 + 0.1 * case.pretension_mm}]
        amplitude_deg = {case.amplitude_deg}
        settle_s = 1.2
        periods = 4
        repeats = 1
        [ring_down]
        frequency_hz = [{3.2 + 0.1 * case.pretension_mm}, {3.2 + 0.1 * case.pretension_mm}]
        amplitude_deg = {case.amplitude_deg}
        drive_s = 1.0
        record_s = 0.6
        repeats = 1
    """)


def play(case: Case, tension_n: Mapping[float, float]) -> Outcome:
    """Run a case and return what became of it. tension_n: of each tendon at rest [N], by pretension [mm]."""
    paper, plan = load_rig("paper"), plan_of(case)
    spec = paper.model_copy(update={"limits": paper.limits.model_copy(update={"safe_state": case.safe_state})})
    rng = np.random.default_rng(case.number)
    plant = JointPlant(spec, slack_m=rng.uniform(2e-4, 3e-3, spec.tendons.count).tolist(), rest_tilt=(0.01, -0.01))
    emulated = EmulatedRig(spec, plant, seed=case.number)
    port = _Port(emulated, case)
    timing = BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms)
    rig = Rig(Bus(port, port, timing, retries=2), port, spec)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "journal.sqlite"
        with Journal.create(path, dump_plan(plan), dump_rig(spec)) as journal:
            port.runner = runner = Runner(rig, port, plan, journal, tension_n)
            report = runner.report
            with suppress(StartError):  # asked before anything moved
                runner.run()
    done = port.now()
    port.wait_until(done + _AFTER_S)
    wrong = []
    if math.isnan(port.asked):
        wrong.append(f"the request never came: {report.sentence}")
    if not port.frozen * 1e3 <= FROZEN_MOST_MS:
        wrong.append("not frozen after 200 ms")
    if report.stop is not None and report.stop.is_safe is (case.fault == SILENT):
        wrong.append(f"left with: {report.stop.sentence()}")
    if report.stop is None and any(state.torque for state in emulated.states().values()):
        wrong.append("refused, and a torque is on")
    # The others' release loads a tendon whose motor hears nothing, and is held by its watchdog.
    if port.after > port.before + _TENSION_RISE_N and (case.fault != SILENT or case.safe_state == "hold"):
        wrong.append(f"the tension rose from {port.before:.0f} to {port.after:.0f} N")
    if not emulated.in_safe_state():
        wrong.append("not at rest in the end")
    return Outcome(
        case=case,
        frozen_ms=1e3 * port.frozen,
        said_ms=math.nan if report.halted_s is None else 1e3 * report.halted_s,
        rest_ms=0.0 if math.isnan(port.unrest) else 1e3 * (port.unrest - port.asked),
        done_ms=1e3 * (done - port.asked),
        lever_deg=math.degrees(port.lever),
        rise_n=port.after - port.before,
        wrong=tuple(wrong),
    )


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the outcomes by phase, mode, pretension, safe state, and with or without lost packets."""
    rows = pd.DataFrame([asdict(one.case) | asdict(one) for one in outcomes])
    rows["fault"] = rows["fault"].replace({"": "nothing goes wrong", DROPPED: "1 packet in 20 is lost"})
    rows["at rest (hold)"] = rows["rest_ms"].where(rows["safe_state"] == "hold")
    rows["released"] = rows["done_ms"].where(rows["safe_state"] == "release")
    names = ["frozen_ms", "said_ms", "at rest (hold)", "released", "lever_deg"]
    by = [rows.groupby(what) for what in ("phase", "mode", "pretension_mm", "safe_state", "fault", lambda _: "all")]
    parts = [
        pd.concat([one.size().rename("runs"), one["frozen_ms"].median().rename("median"), one[names].max()], axis=1)
        for one in by
    ]
    return str(pd.concat(parts).round().to_string(na_rep=""))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its table, and return the exit status."""
    parser = campaign_parser("emergency", __doc__, count=90, workers=TWO)
    given = parser.parse_args(arguments)
    cases = [draw_case(given.seed, number) for number in range(given.runs)]
    outcomes = list(spread_trials(partial(play, tension_n=tensions()), cases, spread=spread_of(given)))
    wrong = [f"{one.case}: {sentence}" for one in outcomes for sentence in one.wrong]
    return conclude(given.out, table(outcomes), list(map(asdict, outcomes)), wrong)


if __name__ == "__main__":
    sys.exit(main())
