"""Twins with one damping law each, for `sinew identify RECORDING.nc` to find.

`python -m campaigns.law_twin --seeds 5`. Of the twin's losses only one acts: the silicone's loss factor; a viscous
damper; or the damper and guide friction whose presliding is the shortest that a rig may have, nearly Coulomb's.
Sensors, servo and delays are those of the rig; the lever is measured. Numbers are drawn anew for every seed.
"""

import argparse
import contextlib
import io
import json
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.law_signals import LAWS, DampingLaw
from sinew.apps.cli import main as command
from sinew.measure.files.netcdf import save_recording
from sinew.plan.plan import Plan, Pretension, Sweep
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.twin.parameters import Effects
from sinew.twin.simulate import simulate

_FREQUENCIES_HZ = (1.8, 2.4, 2.8, 3.1, 3.5, 4.4)
_PRESLIDING_RAD = 0.02


@dataclass(frozen=True)
class Heard:
    """What `sinew identify` said of one recording."""

    law: DampingLaw
    seed: int
    model: str
    message: str
    damping_ratio: float

    @property
    def verdict(self) -> str:
        """Return picked, cannot tell, or wrong."""
        if self.message.startswith("cannot tell"):
            return "cannot tell"
        found = next((law for law in LAWS if self.model.startswith(law)), "viscous")
        return "picked" if found == self.law else "wrong"


def draw_rig(law: DampingLaw, seed: int) -> tuple[RigSpec, Effects]:
    """Return the paper's rig with one damping law of hidden size, and the effects that act."""
    rng = np.random.default_rng([seed, LAWS.index(law), 11])

    def between(low: float, high: float) -> float:
        return math.exp(rng.uniform(math.log(low), math.log(high)))

    values = {
        "silicone.torsional_rigidity": between(0.25, 0.35),
        "silicone.loss_factor": between(0.08, 0.3),
        "silicone.viscous": between(0.02, 0.08),
        "tendons.guide_friction": between(0.2e-3, 0.6e-3),
        "tendons.presliding_angle": _PRESLIDING_RAD,
    }
    off = {
        "loss-factor": ("guide_friction",),
        "viscous": ("guide_friction", "silicone_loss"),
        "coulomb": ("silicone_loss",),
    }[law]
    if law == "loss-factor":
        values["silicone.viscous"] = 0.0
    return load_rig("paper").with_values(values), Effects().without(*off)


def run_twin(law: DampingLaw, seed: int) -> Heard:
    """Return what the command says of a recording of the twin."""
    rig, effects = draw_rig(law, seed)
    plan = Plan(
        name="laws",
        pretension=Pretension(pretension_mm=(4.0,)),
        sweep=Sweep(frequency_hz=_FREQUENCIES_HZ, settle_s=3.0, periods=6, repeats=1),
    )
    said = io.StringIO()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(said):
        path = Path(folder) / "twin.nc"
        save_recording(simulate(plan, rig, seed=seed, effects=effects), path)
        if code := command(["identify", str(path), "--json"]):
            raise RuntimeError(f"{law}, seed {seed}: sinew identify ended with status {code}")
    found = json.loads(said.getvalue())
    return Heard(law, seed, found["model"], found["message"], found["damping_ratio"]["value"])


def main() -> None:
    """Run the recordings and print what was heard."""
    parser = argparse.ArgumentParser(prog="python -m campaigns.law_twin", description="Is the law of the twin found?")
    parser.add_argument("--seeds", type=int, default=5, help="recordings for each law")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--law", choices=LAWS, action="append", help="only this law")
    chosen = parser.parse_args()
    for law in chosen.law or LAWS:
        heard = [run_twin(law, seed) for seed in range(chosen.first, chosen.first + chosen.seeds)]
        for one in heard:
            print(f"{one.seed:4d} {law:11s} D {one.damping_ratio:.3f} -> {one.verdict}, {one.model}: {one.message}")
        counts = {word: sum(one.verdict == word for one in heard) for word in ("picked", "cannot tell", "wrong")}
        print(law, counts, flush=True)


if __name__ == "__main__":
    main()
