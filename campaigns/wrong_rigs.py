"""Benches that are wired otherwise than their rig says: `python -m campaigns.wrong_rigs --seeds 5`.

A bench with slack cables and a head that leans, in virtual time, is run with a rig in which one thing is wrong. Each
must be named before the lever moves; a wrong sign of the drive by a move of 3°. Tension and the lever's way are read
from the mechanics. Exit status 1 where a rig is not named, or a tendon carries over 1.3 times what the twin expects.
"""

import json
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from campaigns.options import campaign_parser
from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner
from sinew.emulator.found import VirtualPort
from sinew.emulator.joint_plant import JointPlant
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.measure.errors import StartError
from sinew.plan.rig import RigSpec
from sinew.plan.servo import COUNTS_PER_TURN
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan
from sinew.twin.simulate import rest_tension

PRETENSION_MM = 4.0
MODES = ("position", "position-with-current-limit", "current")
_ZERO_OFF = round(61 / 360 * COUNTS_PER_TURN)

WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "neighbouring ids swapped": ({"tendon_ids": (2, 1, 3, 4)}, "tendons 1 and 2 answer to each other's commands"),
    "opposite ids swapped": ({"tendon_ids": (3, 2, 1, 4)}, "tendons 1 and 3 answer to each other's commands"),
    "pull sign": ({"tendon_pull": (1, 1, -1, 1)}, "tendon 3 has travelled"),
    "drive sign": ({"drive_sign": -1}, "wiring.drive_sign is wrong"),
    "drive zero off by 61°": ({"drive_zero_counts": 2048 + _ZERO_OFF}, "correct wiring.drive_zero_counts"),
    "board turned by 90°": ({"imu_axes": ("+x", "+z", "-y")}, "the board is turned about x"),
    "board turned by 180°": ({"imu_axes": ("+x", "-y", "-z")}, "the board is turned about x"),
}
"""What is wrong in the rig's wiring, and how it is named."""


class Outcome(NamedTuple):
    """sentence: how the run ended. tension_n: largest of all tendons. lever_deg: how far the lever went."""

    sentence: str
    tension_n: float
    lever_deg: float


class _Watcher:
    def __init__(self, emulated: EmulatedRig) -> None:
        self._emulated = emulated
        self.tension, self.lever = 0.0, 0.0

    def on_sample(self, _: object) -> None:
        motion = self._emulated.motion()
        self.tension = max(self.tension, *motion.tension)
        self.lever = max(self.lever, abs(motion.drive.angle))

    def on_event(self, _: object) -> None:
        pass


def play(spec: RigSpec, wiring: dict[str, Any], mode: str, seed: int, tension_n: float) -> Outcome:
    """Run a bench that is wired as `spec` says with a rig whose wiring is another, and return how that ended."""
    rng = np.random.default_rng(seed)
    slack, lean = rng.uniform(2e-4, 3e-3, spec.tendons.count).tolist(), rng.normal(0.0, 0.015, 2)
    plant = JointPlant(spec, slack_m=slack, rest_tilt=(float(lean[0]), float(lean[1])))
    emulated = EmulatedRig(spec, plant, seed=seed)
    port, watcher = VirtualPort(emulated), _Watcher(emulated)
    told = spec.model_copy(update={"wiring": spec.wiring.model_copy(update=wiring)})
    rig = Rig(
        Bus(port, port, BusTiming(told.wiring.baud, latency=1e-3 * told.wiring.latency_ms), retries=2), port, told
    )
    plan = parse_plan(
        f'name = "wrong"\n[pretension]\npretension_mm = [{PRETENSION_MM}]\nmode = "{mode}"\nrest_s = 0.3\n'
        "[sweep]\nfrequency_hz = [3.5]\nsettle_s = 0.3\nperiods = 2\nrepeats = 1"
    )
    with tempfile.TemporaryDirectory() as folder:  # noqa: SIM117
        with Journal.create(Path(folder) / "journal.sqlite", dump_plan(plan), dump_rig(told)) as journal:
            runner = Runner(rig, port, plan, journal, {PRETENSION_MM: tension_n}, listener=watcher)
            try:
                sentence = runner.run().sentence
            except StartError as refusal:
                sentence = str(refusal)
    return Outcome(sentence, watcher.tension, math.degrees(watcher.lever))


def faults_of(name: str, outcome: Outcome, tension_n: float) -> list[str]:
    """Return what speaks against the end of a wrong rig."""
    wrong = [] if WRONG[name][1] in outcome.sentence else [f"not named: {outcome.sentence}"]
    if outcome.tension_n > 1.3 * tension_n:
        wrong.append(f"{outcome.tension_n:.1f} N, {tension_n:.1f} expected")
    most = 3.5 if name == "drive sign" else 0.5
    return wrong + ([f"the lever moved by {outcome.lever_deg:.1f}°"] if outcome.lever_deg > most else [])


def main(arguments: Sequence[str] | None = None) -> int:
    parser = campaign_parser("wrong_rigs", __doc__, count=5, of="seeds")
    asked = parser.parse_args(arguments)
    spec = load_rig("paper")
    tension, rows, bad = float(rest_tension((PRETENSION_MM,), spec)[0]), [], 0
    for name, (wiring, _) in WRONG.items():
        for number in range(asked.seeds):
            mode = MODES[number % len(MODES)]
            outcome = play(spec, wiring, mode, asked.seed + number, tension)
            wrong = faults_of(name, outcome, tension)
            bad += bool(wrong)
            rows.append({"rig": name, "mode": mode, **outcome._asdict(), "wrong": wrong})
            print(
                f"{name}, {mode}: {outcome.tension_n:.1f} N ({outcome.tension_n / tension:.2f} of the twin's), lever "
                f"{outcome.lever_deg:.1f}°; {'; '.join(wrong) or 'named'}",
                flush=True,
            )
    print(f"{len(rows)} runs, {bad} wrong", flush=True)
    if asked.out is not None:
        asked.out.write_text(json.dumps(rows, indent=1) + "\n")
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
