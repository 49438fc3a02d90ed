"""Runs one after the other on a bench that stays powered, and how far each is from the twin's own answer.

A run ends by itself, by hold, release or emergency, is killed, or loses its line; other software may write to the
motors before the next, which is by a program that knows nothing of the one before. What it measures may be off by 2 %
in gain, 2° in phase and 5 % in the damping ratio.
"""

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr

from sinew.analysis.analysed import analyse_recording
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner, RunReport
from sinew.emulator.bench import EmulatedRig, VirtualPort
from sinew.emulator.plant import JointPlant
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.registers import XH430_W350, Register
from sinew.hardware.rig import Rig
from sinew.measure.errors import SinewError
from sinew.plan.plan import Plan, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan

End = Literal["normal", "hold", "release", "emergency", "killed", "lost line", "other software"]
"""How the first run ends; at the last, registers change at its normal end."""

GAIN, PHASE_DEG, DAMPING = 0.02, 2.0, 0.05
"""How far the second run may be from the twin: relative, degrees, relative."""

PLAN = """
name = "second runs"
sample_hz = 200
[pretension]
pretension_mm = [6]
rest_s = 0.3
[sweep]
frequency_hz = [3.4]
amplitude_deg = 20
settle_s = 2
periods = 4
repeats = 1
[ring_down]
frequency_hz = [3.7, 3.7]
amplitude_deg = 20
drive_s = 1.5
record_s = 2
repeats = 1
"""

_LONGEST_S = 60.0
_SLACK_M = (1.0e-3, 2.5e-3, 1.8e-3, 0.6e-3)
_HARMLESS = (
    "drive_mode", "operating_mode", "moving_threshold", "pwm_limit", "velocity_limit", "startup_configuration",
    "return_delay_time", "goal_pwm", "goal_current", "goal_velocity", "profile_acceleration", "profile_velocity",
    "position_p_gain", "position_i_gain", "position_d_gain", "velocity_p_gain", "velocity_i_gain",
    "feedforward_1st_gain", "feedforward_2nd_gain", "bus_watchdog", "goal_position", "led",
)  # fmt: skip
# What makes no motor deaf, and no run refuse to begin.


class Write(NamedTuple):
    """What other software writes: counts to a register of a motor, by id."""

    device: int
    register: str
    counts: int


class KilledError(BaseException):
    """The process of the first run is gone; nothing of it may act any more."""


class _MortalPort(VirtualPort):
    """A port whose master dies at a time [s], so that nothing of it speaks any more."""

    dies_at = math.inf
    ends_at = math.inf

    def write(self, data: bytes) -> None:
        if self.now() >= self.dies_at:
            raise KilledError
        if self.now() >= self.ends_at:
            raise RuntimeError(f"no end of the run after {_LONGEST_S:g} s")
        super().write(data)


class _Watcher:
    """Sees a run, and does something once, so long after its begin [s]; a Listener."""

    def __init__(self, port: VirtualPort, at_s: float, act: object) -> None:
        self._port, self._at, self._act = port, port.now() + at_s, act
        self._done = False

    def on_sample(self, _sample: object) -> None:
        if not self._done and self._port.now() >= self._at:
            self._done = True
            assert callable(self._act)
            self._act()

    def on_event(self, event: object) -> None:
        pass


def plan_of(mode: TendonMode, text: str = PLAN) -> Plan:
    """Return a plan, of the second run and of a first that is cut short, in a tendon mode."""
    plan = parse_plan(text)
    return plan.model_copy(update={"pretension": plan.pretension.model_copy(update={"mode": mode})})


def draw_writes(rng: np.random.Generator, count: int) -> tuple[Write, ...]:
    """Return what other software writes: so many registers of random motors, each to anything that it can hold."""
    spec = load_rig("paper")
    devices = (*spec.wiring.tendon_ids, spec.wiring.drive_id)
    drawn = [(int(rng.choice(devices)), XH430_W350[str(rng.choice(_HARMLESS))]) for _ in range(count)]
    return tuple(Write(device, row.name, _any_count(rng, row)) for device, row in drawn)


def _any_count(rng: np.random.Generator, row: Register) -> int:
    count = int(rng.integers(row.lowest, row.highest, endpoint=True))
    # With torque by goal another program would swing the joint at once; that is no run's fault.
    return count & ~0x08 if row.name == "drive_mode" else count


@cache
def truth(mode: TendonMode) -> tuple[xr.Dataset, dict[float, float]]:
    """Return what the twin itself gives for the plan, and the tension of each tendon at rest [N]."""
    from sinew.twin.parameters import Effects
    from sinew.twin.simulate import rest_tension, simulate

    rig, plan = load_rig("paper"), plan_of(mode)
    asked = plan.pretension.pretension_mm
    tension = dict(zip(asked, rest_tension(asked, rig).tolist(), strict=True))
    return analyse_recording(simulate(plan, rig, effects=Effects().without("repeatability")), rig), tension


class Bench:
    """A bench that stays while programs come and go on it, its cables slack and its head plate leaning."""

    def __init__(self, spec: RigSpec, seed: int) -> None:
        self.spec = spec
        self.emulated = EmulatedRig(spec, JointPlant(spec, slack_m=_SLACK_M, rest_tilt=(0.012, -0.012)), seed=seed)

    def leave_alone(self, seconds: float = 0.5) -> None:
        """Let time pass in which no program speaks, until the watchdogs have acted and a motor that started anew
        listens."""
        self.emulated.advance(self.emulated.time + seconds)

    def program(self) -> tuple[Rig, _MortalPort]:
        """Return the bench as a new program sees it: it knows nothing of the one before."""
        port = _MortalPort(self.emulated)
        port.ends_at = port.now() + _LONGEST_S
        timing = BusTiming(self.spec.wiring.baud, latency=1e-3 * self.spec.wiring.latency_ms)
        return Rig(Bus(port, port, timing, retries=2), port, self.spec), port

    def run(
        self, plan: Plan, folder: Path, *, resume: bool = False, at_s: float = math.inf, act: str | object = ""
    ) -> RunReport:
        """Run a plan as a new program would. act: at `at_s`, an `End`, or what else is to be called.

        Raises StartError, and KilledError where the program was killed.
        """
        rig, port = self.program()
        texts = (dump_plan(plan), dump_rig(self.spec))
        path = folder / "journal.sqlite"
        _, tension = truth(plan.pretension.mode)
        with Journal.open(path, *texts) if resume else Journal.create(path, *texts) as journal:
            acts = {
                "hold": lambda: runner.steering.request_stop("asked to hold", "hold"),
                "release": lambda: runner.steering.request_stop("asked to release", "release"),
                "emergency": lambda: runner.steering.request_emergency("emergency"),
                "killed": lambda: setattr(port, "dies_at", port.now()),
                "lost line": lambda: setattr(self.emulated, "unplugged", True),
            }
            watcher = _Watcher(port, at_s, acts.get(act, act) if isinstance(act, str) else act)
            runner: Runner = Runner(rig, port, plan, journal, tension, listener=watcher)
            return runner.run(resume=resume)

    def write(self, writes: Sequence[Write]) -> None:
        """Write to the motors as other software does; what a motor refuses it refuses."""
        rig, port = self.program()
        tables = {motor.id: motor.table for motor in rig.motors}
        for one in writes:
            row = tables[one.device][one.register]
            data = one.counts.to_bytes(row.size, "little", signed=row.signed)
            rig.bus.write(one.device, row.address, data, retries=0)
        port.wait_until(port.now() + 0.05)


def compare(journal: Path, mode: TendonMode) -> dict[str, float]:
    """Return how far what a journal measured is from the twin, in parts of what is allowed.

    Groups that are not in the recording are not compared; NaN where one has no value.
    """
    try:
        found = analyse_recording(recording_from_journal(journal), load_rig("paper"))
    except SinewError:
        return {}  # no whole group: nothing was measured
    twin, _ = truth(mode)
    measures = {
        "gain": ("gain", lambda a, b: np.abs(a / b - 1) / GAIN),
        "phase": ("phase_lag_rad", lambda a, b: np.abs(np.degrees(a - b)) / PHASE_DEG),
        "D": ("damping_ratio", lambda a, b: np.abs(a / b - 1) / DAMPING),
    }
    off = {name: share(found[key].values, twin[key].values) for name, (key, share) in measures.items() if key in found}
    return {name: round(float(np.max(share)), 3) for name, share in off.items() if share.size}
