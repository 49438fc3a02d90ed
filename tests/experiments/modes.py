"""What the three motor modes reach (the paper's supplement S1).

Every trial starts anew: slack cables of unequal length, a head plate that leans 3° in a random direction, another
draw of the sensor's noise. The bench pulls, levels, sets each pretension and drives; what it reached is read from the
mechanics. Virtual time, seeded.
"""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from tests.unit.bench_virtual import virtual_bench

from sinew.emulator.bench import EmulatedRig
from sinew.emulator.plant import JointPlant
from sinew.measure.events import Event, Pretensioned
from sinew.plan.plan import Plan, Pretension, Sweep, TendonMode
from sinew.plan.toml import load_rig
from sinew.twin.simulate import rest_tension

MODES: tuple[TendonMode, ...] = get_args(TendonMode)
PRETENSIONS_MM = (2.0, 8.0)
TILT = math.radians(3.0)


@dataclass(frozen=True)
class Row:
    """What one trial gave at one pretension.

    reached_mm: true common shortening of the cables, after levelling. current_a: true mean current; asked_current_a:
    NaN where none was asked for. tilt_deg: true tilt of the head plate.
    """

    mode: str
    pretension_mm: float
    reached_mm: float
    asked_current_a: float
    current_a: float
    tilt_deg: float


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
            self.truth.append(
                (1e3 * self._plant.pretension, float(np.mean(currents)), math.hypot(*self._plant.motion().tilt))
            )


def run_trial(mode: TendonMode, seed: int) -> list[Row]:
    """Return one trial's rows, one for each pretension."""
    spec = load_rig("paper")
    chance = np.random.default_rng([seed, MODES.index(mode)])
    towards = chance.uniform(0, math.tau)
    plant = JointPlant(
        spec,
        slack_m=chance.uniform(0.2e-3, 4e-3, spec.tendons.count).tolist(),
        rest_tilt=(TILT * math.cos(towards), TILT * math.sin(towards)),
    )
    bench = virtual_bench(spec, plant=plant, seed=seed)
    witness = _Witness(plant, bench.emulated)
    plan = Plan(
        name="modes",
        pretension=Pretension(pretension_mm=PRETENSIONS_MM, mode=mode, rest_s=0.5),
        sweep=Sweep(frequency_hz=(3.0,), settle_s=0.5, periods=5, repeats=1),
    )
    tension = dict(zip(PRETENSIONS_MM, rest_tension(PRETENSIONS_MM, spec).tolist(), strict=True))
    with tempfile.TemporaryDirectory() as folder:
        report = bench.run(plan, Path(folder), tension, listener=witness)
        if not report.is_complete:
            raise RuntimeError(f"mode {mode}, seed {seed}: {report.sentence}")
    return [
        Row(mode, asked, reached, said.asked_current_a, current, math.degrees(tilt))
        for asked, said, (reached, current, tilt) in zip(PRETENSIONS_MM, report.pretensions, witness.truth, strict=True)
    ]
