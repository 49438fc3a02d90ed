"""The three motor modes compared: `python -m campaigns.modes` (the paper's supplement S1).

Every trial starts anew: slack cables of unequal length, a head plate that leans 3° in a random direction, another draw
of the sensor's noise. The bench pulls, levels, sets each pretension and sweeps; what it reached is read from the
mechanics. Printed by mode and pretension: pretension or current reached against asked, tilt, and the resonance, with
the standard deviation over the trials. Virtual time, seeded.
"""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from campaigns.options import TWO, spread_of, spread_trials, trial_parser
from sinew.analysis.analysed import analyse_recording
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner
from sinew.emulator.found import VirtualPort
from sinew.emulator.joint_plant import JointPlant
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.measure.events import Event, Pretensioned
from sinew.plan.plan import Plan, Pretension, Sweep, TendonMode
from sinew.plan.toml import dump_plan, dump_rig, load_rig
from sinew.twin.simulate import rest_tension

MODES: tuple[TendonMode, ...] = get_args(TendonMode)
PRETENSIONS_MM = (2.0, 8.0)
TILT = math.radians(3.0)
_OFFSETS_HZ = (-0.6, -0.35, -0.2, -0.1, 0.0, 0.1, 0.2, 0.4)
_MIDDLES_HZ = (2.95, 3.7)


@dataclass(frozen=True)
class Row:
    """What one trial gave at one pretension.

    reached_mm: true common shortening of the cables, after levelling. current_a: true mean current; asked_current_a:
    NaN where none was asked for. tilt_deg: true tilt of the head plate. resonance_hz, gain: of the sweep, or NaN.
    """

    mode: str
    pretension_mm: float
    reached_mm: float
    asked_current_a: float
    current_a: float
    tilt_deg: float
    resonance_hz: float
    gain: float


class _Witness:
    """Notes the truth when a pretension has been set."""

    def __init__(self, plant: JointPlant, emulated: EmulatedRig) -> None:
        self._plant, self._emulated = plant, emulated
        self.truth: list[tuple[float, float, float]] = []

    def on_sample(self, sample: object) -> None:
        """Do nothing."""

    def on_event(self, event: Event) -> None:
        """Note the mechanics behind an event `pretension`."""
        if isinstance(event, Pretensioned):
            currents = [horn.current for horn in self._emulated.motion().tendons]
            self.truth.append((1e3 * self._plant.pretension, float(np.mean(currents)), self._plant.tilt_angle))


def run_trial(mode: TendonMode, seed: int, *, sweep: bool = True) -> list[Row]:
    """Return one trial's rows, one for each pretension. sweep: measure the resonance, too; else one frequency."""
    spec = load_rig("paper")
    chance = np.random.default_rng([seed, MODES.index(mode)])
    towards = chance.uniform(0, math.tau)
    plant = JointPlant(
        spec,
        slack_m=chance.uniform(0.2e-3, 4e-3, spec.tendons.count).tolist(),
        rest_tilt=(TILT * math.cos(towards), TILT * math.sin(towards)),
    )
    emulated = EmulatedRig(spec, plant, seed=seed)
    port = VirtualPort(emulated)
    bus = Bus(port, port, BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms), retries=2)
    witness = _Witness(plant, emulated)
    frequencies = sorted({middle + offset for middle in _MIDDLES_HZ for offset in _OFFSETS_HZ}) if sweep else [3.0]
    plan = Plan(
        name="modes",
        pretension=Pretension(pretension_mm=PRETENSIONS_MM, mode=mode, rest_s=0.5),
        sweep=Sweep(frequency_hz=tuple(frequencies), settle_s=3.0 if sweep else 0.5, periods=5, repeats=1),
    )
    tension = dict(zip(PRETENSIONS_MM, rest_tension(PRETENSIONS_MM, spec).tolist(), strict=True))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "journal.sqlite"
        with Journal.create(path, dump_plan(plan), dump_rig(spec)) as journal:
            report = Runner(Rig(bus, port, spec), port, plan, journal, tension, listener=witness).run()
        if not report.is_complete:
            raise RuntimeError(f"mode {mode}, seed {seed}: {report.sentence}")
        results = analyse_recording(recording_from_journal(path), spec)
    nothing = [math.nan] * len(PRETENSIONS_MM)
    peaks = results["resonance_hz"].values.tolist() if sweep else nothing
    gains = results["gain_peak"].values.tolist() if sweep else nothing
    return [
        Row(mode, asked, reached, said.asked_current_a, current, math.degrees(tilt), peak, gain)
        for asked, said, (reached, current, tilt), peak, gain in zip(
            PRETENSIONS_MM, report.pretensions, witness.truth, peaks, gains, strict=True
        )
    ]


def table(rows: Sequence[Row]) -> str:
    """Return the comparison as a Markdown table: mean ± standard deviation over the trials."""
    lines = [
        "| mode | asked | true pretension/mm | true current/mA | largest tilt/° | resonance/Hz | gain |",
        "|---|---|---|---|---|---|---|",
    ]
    for mode in MODES:
        for asked in PRETENSIONS_MM:
            mine = [row for row in rows if row.mode == mode and row.pretension_mm == asked]
            if not mine:
                continue
            want = mine[0].asked_current_a
            goal = f"{asked:g} mm" if math.isnan(want) else f"{asked:g} mm: {1e3 * want:.1f} mA"
            cells = [
                mode,
                goal,
                _spread([row.reached_mm for row in mine], 3),
                _spread([1e3 * row.current_a for row in mine], 1),
                f"{max(row.tilt_deg for row in mine):.2f}",
                _spread([row.resonance_hz for row in mine], 3),
                _spread([row.gain for row in mine], 3),
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _spread(values: Sequence[float], digits: int) -> str:
    std = float(np.std(values, ddof=1)) if len(values) > 1 else math.nan
    return f"{np.mean(values):.{digits}f} ± {std:.{digits}f}"


def main() -> None:
    """Run the trials and print the table."""
    about = "The three motor modes, compared."
    parser = trial_parser(
        "modes", about, count=5, of="trials for each mode", trials="trials", first="seed", workers=TWO
    )
    chosen = parser.parse_args()
    jobs = [(mode, chosen.seed + trial) for trial in range(chosen.trials) for mode in MODES]
    parts = spread_trials(run_trial, *zip(*jobs, strict=True), spread=spread_of(chosen))
    rows = [row for part in parts for row in part]
    print(table(rows))


if __name__ == "__main__":
    main()
