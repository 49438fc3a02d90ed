"""How the head plate is levelled, upright and in a pose: `python -m campaigns.levelling`.

First the law against the linear joint in space, for every motor mode, pretension and pose: with the correction of tilt
as input and the tilt that the accelerometer tells as output, the static gain, the largest gain of the open loop
beyond its crossover (the inverse of the gain margin) and the phase margin. With --bounds the same with each assumed
mass of the rig at either of its bounds. Then trials through the emulator's bytes in virtual time: a bench with slack
cables and a head that leans is pulled and levelled; what is left is read from the mechanics. Every trial is seeded.
"""

import json
import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from campaigns.bent import run_bent, shortened
from campaigns.options import campaign_parser
from campaigns.space import ASSUMED
from sinew.bench.pretension import LEVEL_MEMORY_S, LEVEL_RATE, Contact, Held, MotorMap
from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import SpecError
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.rod import rod_poses
from sinew.mechanics.space import Space
from sinew.plan.plan import TendonMode
from sinew.plan.pose import Pose
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_plan, load_rig
from sinew.predict.modes import Asked, Finder
from sinew.solve.spatial import patterns

MODES: tuple[TendonMode, ...] = ("position", "position-with-current-limit", "current")
PRETENSIONS_MM = (0.0, 2.0, 6.0, 12.0)
BENDS_DEG = (0.0, 10.0, 20.0, 30.0)

_HZ = np.concatenate([np.geomspace(0.02, 1.0, 60), np.geomspace(1.0, 40.0, 1500)])
_SWAYS_HZ = 1.0  # beyond it lies no crossover, but every sway


class Margin(NamedTuple):
    """Of the levelling loop at a pose. gain: static, of tilt by correction. beyond: largest gain of the open loop
    beyond its crossover, at sway_hz. phase_deg: margin at the crossover."""

    gain: float
    beyond: float
    sway_hz: float
    phase_deg: float


@cache
def _place() -> Any:
    """Return the compiled slope of the plate's place by the coordinates, (3, 18)."""

    def of(q: jax.Array, space: Space) -> jax.Array:
        return jnp.asarray(jax.jacfwd(lambda flat: rod_poses(flat.reshape(q.shape), space.rod)[1][-1])(q.ravel()))

    return jax.jit(of)


def told_tilt(finder: Finder, rig: RigSpec, pretension_mm: float, bend_deg: float) -> Complexes:
    """Return the tilt about y and z that the accelerometer tells by the correction about y and z at `_HZ`, (f, 2, 2).

    Upright, a plate that is accelerated by a looks tilted by a/g more; in a pose that is right for small swings about
    it as far as the cosine of the bend.
    """
    linear, space = finder.linear(pretension_mm, bend_deg)
    q, at, radius = finder.at(pretension_mm, bend_deg).coordinates, linear.around, rig.tendons.head_radius.value
    place, rises = np.asarray(_place()(q, space)), radius * patterns(space)[1:]
    if finder.asked.mode == "current":
        tensions = tuple(at.tension.tolist())
        held = {pretension_mm: Held((pretension_mm,) * len(tensions), tensions)}
        stiffness = MotorMap(rig, "current", Contact((0.0,) * len(tensions), 0.0), held).tilt_stiffness(pretension_mm)
        pulled = -at.by_span.T @ (stiffness * rises / (0.5 * len(tensions) * radius**2)).T
    else:
        pulled = at.by_end @ rises.T
    found = []
    for hz in _HZ:
        omega = math.tau * hz
        storage, loss = linear.stiffness(omega, space)
        moved = np.linalg.solve(storage + 1j * loss - omega**2 * linear.mass, pulled)
        across = place @ moved * (omega**2 / STANDARD_GRAVITY)
        found.append(at.by_tilt @ moved + np.array([-across[2], across[1]]))
    return np.array(found)


def law(omega: Array) -> Complexes:
    """Return the controller's correction by the tilt that is told, at angular frequencies [rad/s]."""
    return np.asarray(LEVEL_RATE / (1j * omega) / (1 + 1j * omega * LEVEL_MEMORY_S) ** 2)


def margin_of(finder: Finder, rig: RigSpec, pretension_mm: float, bend_deg: float) -> Margin:
    """Return the margin of the loop at a pose, of the worse of its two characteristic loci."""
    told = told_tilt(finder, rig, pretension_mm, bend_deg)
    omega = math.tau * _HZ
    sensor = 1 / (1 + math.sqrt(2) * (s := 1j * _HZ / rig.imu.low_pass.value) + s**2)
    loci = np.linalg.eigvals(told) * (law(omega) * sensor)[:, None]
    sizes = np.abs(loci)
    beyond = np.where(_HZ[:, None] > _SWAYS_HZ, sizes, 0.0)
    at = int(np.argmax(beyond.max(axis=1)))
    phases = []
    for locus, size in zip(loci.T, sizes.T, strict=True):
        crossing = int(np.argmax(size < 1))
        phases.append(180 + math.degrees(float(np.angle(locus[crossing]))))
    return Margin(float(np.abs(np.linalg.eigvals(told[0])).max()), float(beyond.max()), float(_HZ[at]), min(phases))


def margins(rig: RigSpec) -> Iterator[tuple[TendonMode, float, float, Margin]]:
    """Yield (mode, pretension [mm], bend [deg], margin) of all poses in which every tendon is taut."""
    for mode in ("position", "current"):
        for bend in BENDS_DEG:
            for pretension in PRETENSIONS_MM:
                finder = Finder(rig, Asked((pretension,), (bend,), 90.0, mode))
                try:
                    if not finder.at(pretension, bend).taut:
                        continue
                    yield mode, pretension, bend, margin_of(finder, rig, pretension, bend)
                except SpecError:  # no such pose
                    continue


class Trial(NamedTuple):
    """One trial: true tilt from what was asked for, and what the bench said [deg]; largest tension while it was
    levelled [N]; how long that took [s]; how the run ended."""

    left_deg: float
    said_deg: float
    tension_n: float
    levelling_s: float
    ended: str


def run_trial(rig: RigSpec, mode: TendonMode, pretension_mm: float, bend_deg: float, seed: int) -> Trial:
    """Pull and level a bench in space and return what came of it. Raises SpecError for a pose that cannot be held."""
    plan = shortened(load_plan("bent"), (3.0,), pretension_mm)
    azimuth = float(np.random.default_rng([seed, 2]).uniform(0, 360))
    assert plan.sweep is not None
    sweep = plan.sweep.model_copy(update={"amplitude_deg": 1.0, "settle_s": 0.5, "periods": 1})
    pretension = plan.pretension.model_copy(update={"mode": mode, "rest_s": 0.3})
    pose = Pose(bend_deg=bend_deg, azimuth_deg=round(azimuth) if bend_deg else 0.0)
    run = run_bent(plan.model_copy(update={"sweep": sweep, "pretension": pretension, "pose": pose}), rig, seed)
    if not run.report.pretensions:
        return Trial(math.nan, math.nan, float(run.truth.tension.max()), math.nan, run.report.sentence)
    said, truth = run.report.pretensions[0], run.truth
    left = truth.tilt[:, run.levelled] - np.array(pose.swing_rad)
    largest = float(truth.tension[:, : run.levelled + 1].max())
    return Trial(math.degrees(float(np.hypot(*left))), said.tilt_deg, largest, said.levelling_s, run.report.sentence)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = campaign_parser("levelling", __doc__, count=1, of="trials")
    parser.add_argument("--bounds", action="store_true", help="margins with assumed masses at their bounds, too")
    asked = parser.parse_args(arguments)
    rig, rows = load_rig("paper"), []
    rigs = [("as it is", rig)]
    if asked.bounds:
        ends = [(name, end) for name, bounds in ASSUMED.items() for end in bounds]
        rigs += [(f"{name} {end:g}", rig.with_values({name: end})) for name, end in ends]
    for said, one in rigs:
        found = list(margins(one))
        for mode, pretension, bend, margin in found if said == "as it is" else []:
            print(
                f"{mode} {pretension:g} mm {bend:g}°: gain {margin.gain:.2f}, {margin.beyond:.2f} beyond at "
                f"{margin.sway_hz:.1f} Hz, phase margin {margin.phase_deg:.0f}°",
                flush=True,
            )
        beyond, phase = max(row[3].beyond for row in found), min(row[3].phase_deg for row in found)
        print(f"rig {said}: gain margin {1 / beyond:.1f}, phase margin {phase:.0f}° in {len(found)} poses", flush=True)
        rows.append({"rig": said, "gain_margin": 1 / beyond, "phase_margin_deg": phase})
    for number in range(asked.trials):
        for mode in MODES:
            for pretension, bend in ((2.0, 0.0), (6.0, 0.0), (12.0, 0.0), (6.0, 10.0), (6.0, 20.0), (12.0, 30.0)):
                trial = run_trial(rig, mode, pretension, bend, asked.seed + number)
                print(
                    f"{mode} {pretension:g} mm {bend:g}°: {trial.left_deg:.3f}° left, said {trial.said_deg:.3f}°, at "
                    f"most {trial.tension_n:.0f} N, {trial.levelling_s:.1f} s; {trial.ended}",
                    flush=True,
                )
                rows.append({"mode": mode, "pretension_mm": pretension, "bend_deg": bend, **trial._asdict()})
    if asked.out is not None:
        asked.out.write_text(json.dumps(rows, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
