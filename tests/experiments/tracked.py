"""One tracked motion on the emulated bench, run through bytes and held against the true motion.

The truth is read from the mechanics behind the emulator at every cycle: torsion and lever as they are, without
sensor, bus or encoder. What is said of lock and phase error here is that truth's; the loop knows only what its
sensors say.
"""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from tests.unit.bench_virtual import virtual_bench

from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.run import RunReport
from sinew.emulator.bench import EmulatedRig
from sinew.emulator.faults import Faults, FaultSpec
from sinew.emulator.plant import JointPlant
from sinew.measure.arrays import Array
from sinew.plan.plan import Group, Plan, Pretension, Track
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.tune.track import ExpectedBackbone, Tracker, planned_tracker
from sinew.twin.simulate import rest_tension

HELD_DEG = 6.0
_BOUNDS_HZ = (1.5, 7.0)
_ORDERS = (1, 3)


@dataclass
class Tracked:
    """What one motion gave.

    report: of the run. is_safe: whether all motors truly were in a safe state after its end. begin: of the
    tracking [s]. Truth, turn by turn of the true lever, since then: time_s, frequency_hz, error_deg (lag less 90°),
    torsion_deg, pretension_mm (at the turn's end). tracker: the law at its end. recording: None where none was made.
    """

    report: RunReport
    is_safe: bool
    begin: float
    time_s: Array
    frequency_hz: Array
    error_deg: Array
    torsion_deg: Array
    pretension_mm: Array
    tracker: Tracker | None
    recording: xr.Dataset | None

    @property
    def turns_to_lock(self) -> float:
        """After how many turns the true phase error stays below 6° for three turns in a row; NaN for never."""
        held = np.abs(self.error_deg) < HELD_DEG
        runs = np.flatnonzero(held[:-2] & held[1:-1] & held[2:])
        return float(runs[0] + 1) if runs.size else math.nan

    def after(self, time: float) -> NDArray[np.bool_]:
        """Return which turns began this long after the tracking [s]."""
        return np.asarray(self.time_s >= time)

    def rms_deg(self, since: float, until: float = math.inf) -> float:
        """Return the root mean square of the true phase error between two times of the tracking [s]."""
        mine = (self.time_s >= since) & (self.time_s < until)
        return float(np.sqrt(np.mean(self.error_deg[mine] ** 2)))


@dataclass
class _Witness:
    """Notes the truth at every cycle."""

    emulated: EmulatedRig
    plant: JointPlant
    rows: list[tuple[float, float, float, float]] = field(default_factory=list)

    def on_sample(self, sample: object) -> None:
        """Note time, lever, torsion and pretension."""
        motion = self.emulated.motion()
        self.rows.append((motion.time, motion.drive.angle, motion.torsion, 1e3 * self.plant.pretension))

    def on_event(self, event: object) -> None:
        """Do nothing."""


def track_plan(pretension_mm: float, start_hz: float | None, duration_s: float, **more: object) -> Plan:
    """Return a plan of one motion. more: of `sinew.plan.plan.Track`; the command has 20° unless it says otherwise."""
    settings: dict[str, object] = {"amplitude_deg": (20.0,), "low_hz": _BOUNDS_HZ[0], "high_hz": _BOUNDS_HZ[1]}
    settings |= {"start_hz": start_hz, "duration_s": duration_s, **more}
    track = Track.model_validate(settings)
    return Plan(name="tracking", pretension=Pretension(pretension_mm=(pretension_mm,), rest_s=0.5), track=track)


def tracked(
    plan: Plan,
    expected: Sequence[ExpectedBackbone],
    faults: Sequence[tuple[FaultSpec, float]] = (),
    *,
    seed: int = 0,
    spec: RigSpec | None = None,
) -> Tracked:
    """Run a plan of one motion on the paper's rig and return what it gave.

    expected: of the pretensions that it visits. faults: what happens, and how long after the tracking began [s].
    seed: of slack, lean of the plate, and the sensor's noise.
    """
    spec = spec or load_rig("paper")
    chance = np.random.default_rng([seed, 7])
    towards, lean = chance.uniform(0, math.tau), math.radians(chance.uniform(0.5, 1.5))
    slack = chance.uniform(0.5e-3, 3e-3, spec.tendons.count).tolist()
    plant = JointPlant(spec, slack_m=slack, rest_tilt=(lean * math.cos(towards), lean * math.sin(towards)))
    bench = virtual_bench(spec, plant=plant, seed=seed)
    emulated = bench.emulated
    witness, laws = _Witness(emulated, plant), []

    def law(group: Group, time: float) -> Tracker:
        laws.append((time, planned_tracker(group, plan, spec, expected, time)))
        late = [FaultSpec(f.kind, f.values, time + after, time + after + f.stop - f.start) for f, after in faults]
        Faults(emulated, late, seed)
        return laws[-1][1]

    with tempfile.TemporaryDirectory() as folder:
        report = bench.run(plan, Path(folder), _tensions(plan, spec), listener=witness, law=law)
        recording = recording_from_journal(Path(folder) / "journal.sqlite") if report.is_complete else None
    is_safe = _ends_safely(emulated)
    begin = laws[0][0] if laws else math.nan
    turns = _turns(np.array(witness.rows), begin, plan.track.motion_s if plan.track is not None else 0.0)
    return Tracked(report, is_safe, begin, *turns, laws[0][1] if laws else None, recording)


def _ends_safely(emulated: EmulatedRig) -> bool:
    """Return whether 0.1 s after a run every motor is without torque, limited or stopped by its watchdog, and stands
    still when the swing has died down: a joint that swings turns a held lever a little."""
    emulated.advance(emulated.time + 0.1)
    let_go = all(state.is_limited or state.is_tripped for state in emulated.states().values())
    emulated.advance(emulated.time + 5.0)
    return let_go and emulated.in_safe_state()


def _tensions(plan: Plan, spec: RigSpec) -> dict[float, float]:
    visited = list(plan.pretension.pretension_mm)
    if plan.track is not None and plan.track.pretension_to_mm is not None:
        visited.append(plan.track.pretension_to_mm)
    return dict(zip(visited, rest_tension(visited, spec).tolist(), strict=True))


def _turns(rows: Array, begin: float, length: float) -> tuple[Array, Array, Array, Array, Array]:
    """Return time, frequency, phase error, torsion and pretension by turn of the true lever."""
    mine = rows[(rows[:, 0] >= begin) & (rows[:, 0] < begin + length)]
    time, lever = mine[:, 0] - begin, mine[:, 1]
    up = np.flatnonzero((lever[:-1] < 0) & (lever[1:] >= 0))
    zeros = time[up] - lever[up] / (lever[up + 1] - lever[up]) * (time[up + 1] - time[up])
    found = []
    for start, end in pairwise(zeros.tolist()):
        if end - start < 0.05:
            continue  # the lever trembles about zero before it swings
        now = slice(*np.searchsorted(time, (start, end)))
        phase = math.tau * (time[now] - start) / (end - start)
        waves = [wave(order * phase) for order in _ORDERS for wave in (np.cos, np.sin)]
        design = np.stack([np.ones_like(phase), *waves], axis=1)
        fit = np.linalg.lstsq(design, mine[now, 1:3], rcond=None)[0]
        drive, torsion = fit[1] - 1j * fit[2]
        lag = math.degrees(np.angle(drive * np.conj(torsion)))
        error = math.remainder(lag - 90.0, 360.0)
        found.append((start, 1 / (end - start), error, math.degrees(abs(torsion)), float(mine[now, 3][-1])))
    columns = np.array(found).reshape(-1, 5).T
    return columns[0], columns[1], columns[2], columns[3], columns[4]
