"""Rest poses against an independent minimiser: `python -m campaigns.rests --seeds 60`.

Each seed draws a rig (the paper's, or with a flat oval section, or cast curved; chords or channels; another head), a
pretension, a mode of the motors and a pose or what tendons do, and asks `sinew.predict.pose` for the rest. It is
held against an energy written down apart, in plain NumPy from the rig's own numbers: a rod of 48 straight steps, each
turned by the strain in its middle, and tendons from its end to its foot; `scipy.optimize.minimize` knows nothing of it
but its value. A found pose must be where the minimiser comes to from the straight joint, with its tensions; one that is
said to buckle must have a lower energy beside it. One that is refused since a tendon would have to push must be where
the minimiser comes to with just that push; no other refusal counts as agreed.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import OptimizeResult, minimize
from scipy.spatial.transform import Rotation

from sinew.measure.arrays import Array
from sinew.measure.units import STANDARD_GRAVITY
from sinew.plan.pose import Pose
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.joints.design import Design, design_rig
from sinew.predict.joints.section import ellipse_section
from sinew.predict.pose import Asked, Posed, find_pose

STEPS = 48
TILT_DEG, TENSION_N = 0.1, 0.5
"""How far both may lie apart: head and tendons."""

_BESIDE = 0.02
_BASIS = legendre.legvander(2 * (np.arange(STEPS) + 0.5) / STEPS - 1, 2)
_SHARE = (np.arange(STEPS) + 0.5) / STEPS


class PlainJoint:
    """The energy of a rig's joint, in plain NumPy from the rig's numbers. x: 18 strains, the curvatures times L."""

    def __init__(self, rig: RigSpec) -> None:
        assert rig.space is not None
        silicone, tendons, space = rig.silicone, rig.tendons, rig.space
        self.length = silicone.length.value
        diameter = silicone.diameter.value
        if rig.section is None:
            torsion, area = np.pi * diameter**4 / 32, np.pi * diameter**2 / 4
            self.moments = np.array([torsion / 2, torsion / 2])
        else:
            torsion, area = rig.section.torsion_constant.value, rig.section.area.value
            self.moments = np.array([rig.section.least_moment.value, rig.section.greatest_moment.value])
        self.g, self.torsion, self.area = silicone.torsional_rigidity.value / torsion, torsion, area
        azimuth, cast = np.radians(space.rest_azimuth_deg), np.radians(space.rest_bend_deg)
        self.cast = np.array([0.0, -cast * np.sin(azimuth), cast * np.cos(azimuth)])
        angle = 2 * np.pi * np.arange(tendons.count) / tendons.count
        around = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=1)
        self.feet, self.guides = tendons.base_radius.value * around, tendons.head_radius.value * around
        self.beyond = tendons.free_span.value - self.length
        self.stiffness = 1 / (1 / tendons.cable_stiffness.value + 1 / tendons.servo_stiffness.value)
        self.channel = space.routing == "channel"
        lever = space.lever_mass.value
        head = rig.inertia.head_mass.value - lever
        self.mass, self.line = head + lever, space.density.value * area
        self.above = head * space.head_height.value + lever * space.lever_height.value

    def shape(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return strains (step, 6), middles of the steps [m], rotation and place of the end."""
        strains = _BASIS @ x.reshape(6, 3).T
        bent = strains[:, :3] + self.cast
        along = strains[:, 3:] + np.array([1.0, 0.0, 0.0])
        halves = Rotation.from_rotvec(bent / (2 * STEPS)).as_matrix()
        turned, place, middles = np.eye(3), np.zeros(3), np.empty((STEPS, 3))
        for i in range(STEPS):
            middle = turned @ halves[i]
            step = middle @ along[i] * (self.length / STEPS)
            middles[i], place = place + step / 2, place + step
            turned = middle @ halves[i]
        return strains, middles, turned, place

    def spans(self, x: Array) -> Array:
        """Return the length of every tendon [m]."""
        strains, _, turned, place = self.shape(x)
        if self.channel:
            arms = 0.5 * (self.feet + self.guides)
            bent = (strains[:, :3] + self.cast) / self.length
            along = strains[:, 3:] + np.array([1.0, 0.0, 0.0])
            tangents = along[:, None] + np.cross(bent[:, None], arms[None])
            return np.asarray(np.linalg.norm(tangents, axis=2).mean(axis=0) * self.length + self.beyond)
        heads = place + (self.guides + np.array([self.beyond, 0, 0])) @ turned.T
        return np.asarray(np.linalg.norm(heads - self.feet, axis=1))

    def body(self, x: Array) -> float:
        """Return the energy of silicone and weight [J]."""
        strains, middles, turned, place = self.shape(x)
        stretch = 1 + strains[:, 3]
        if np.any(stretch < 0.2):
            return float("inf")
        polar = self.moments.sum()
        twist = self.g * (polar / stretch - (polar - self.torsion) / stretch**4)
        bend = self.g * np.outer((1 + 2 * stretch**-3) / stretch, self.moments)
        dense = self.g * self.area * (stretch**2 + 2 / stretch - 3)
        dense = (
            dense + twist * (strains[:, 0] / self.length) ** 2 + 0.9 * self.g * self.area * (strains[:, 4:] ** 2).sum(1)
        )
        dense = dense + (bend * (strains[:, 1:3] / self.length) ** 2).sum(axis=1)
        high = self.mass * place[0] + self.above * turned[0, 0] + self.line * self.length * middles[:, 0].mean()
        return float(0.5 * self.length * dense.mean() + STANDARD_GRAVITY * high)

    def scale(self) -> Array:
        """Return a size of each unknown, so that the minimiser sees all of them alike."""
        length = self.length
        rows = [self.g * self.torsion / length, *(3 * self.g * self.moments / length)]
        rows += [3 * self.g * self.area * length] + [0.9 * self.g * self.area * length] * 2
        return np.asarray(1 / np.sqrt(np.array(rows)[:, None] / (2 * np.arange(3) + 1))).ravel()


def _stretched(spans: Array, ends: Array | None) -> Array:
    """Return how far tendons are stretched [m] whose motors hold positions; raises ValueError without their ends."""
    if ends is None:
        raise ValueError("found neither cable ends nor tensions, expected one of them; name what the motors hold")
    return np.maximum(spans - ends, 0.0)


def held_energy(joint: PlainJoint, x: Array, ends: Array | None, tension: Array | None) -> float:
    """Return the energy [J] with motors that hold positions (ends [m]) or currents (tension [N])."""
    if tension is not None:
        return joint.body(x) + float(tension @ joint.spans(x))
    taut = _stretched(joint.spans(x), ends)
    return joint.body(x) + 0.5 * joint.stiffness * float(taut @ taut)


def least(joint: PlainJoint, start: Array, ends: Array | None, tension: Array | None) -> OptimizeResult:
    """Return where the energy is least, from a start."""
    scale = joint.scale()
    base = held_energy(joint, start, ends, tension)

    def value(y: Array) -> float:
        return held_energy(joint, scale * y, ends, tension) - base

    y = start / scale
    for _ in range(2):  # the second run begins with a fresh estimate of the curvature
        found = minimize(value, y, jac="3-point", method="BFGS", options={"gtol": 1e-7, "maxiter": 400})
        y = found.x
    found.x = scale * y
    return found


@dataclass(frozen=True)
class Trial:
    """One pose. outcome: "found", "buckles" or "refused"; why: the reason, or what is wrong; ok: both agree."""

    seed: int
    asked: str
    outcome: str
    ok: bool
    why: str
    apart_deg: float = 0.0
    apart_n: float = 0.0


def draw(seed: int) -> tuple[RigSpec, Asked]:
    """Return a rig and what is asked of it, by chance."""
    rng = np.random.default_rng(seed)
    rig = load_rig("paper")
    if rng.random() < 0.3:
        rig = design_rig(rig, Design(section=ellipse_section(0.065, 0.040), name="oval"))
    assert rig.space is not None
    change: dict[str, object] = {"routing": rng.choice(["chord", "chord", "channel"])}
    if rng.random() < 0.4:
        change |= {"rest_bend_deg": float(rng.uniform(10, 40)), "rest_azimuth_deg": float(rng.uniform(0, 360))}
    rig = rig.model_copy(update={"space": rig.space.model_copy(update=change)})
    rig = rig.with_values({"inertia.head_mass": float(rng.uniform(0.5, 1.8))})
    pretension, bend = float(rng.uniform(0, 24)), float(rng.uniform(0, 45))
    mode = str(rng.choice(["position", "position-with-current-limit", "current"]))
    count, way = rig.tendons.count, rng.random()
    if way < 0.2 and mode != "current":
        take_up = tuple(float(v) for v in np.maximum(0.0, pretension + rng.uniform(-6, 6, count)))
        return rig, Asked(mode=mode, take_up_mm=take_up)
    if way < 0.4 and mode == "current":
        return rig, Asked(mode=mode, tension_n=tuple(float(v) for v in rng.uniform(5, 90, count)))
    return rig, Asked(pretension, Pose(bend_deg=bend, azimuth_deg=float(rng.uniform(0, 360))), mode)


def judge(seed: int, rig: RigSpec, asked: Asked, posed: Posed) -> Trial:
    """Return whether the minimiser says the same."""
    words = f"{rig.name}, {asked.mode}, {asked.words()}"
    if posed.rest is None and "does not stay" not in posed.why:
        return judge_refusal(Trial(seed, words, "refused", False, posed.why), rig, asked, posed)
    joint, space = PlainJoint(rig), posed.space
    by_current = asked.mode == "current"
    ends, tension = (None, np.asarray(space.held_tension)) if by_current else (np.asarray(space.cable_end), None)
    q = posed.coordinates
    assert q is not None
    start = np.zeros(q.size)
    if posed.rest is None:
        start = q.ravel() + _BESIDE * joint.scale() * np.random.default_rng([seed, 1]).standard_normal(q.size)
    found = least(joint, start, ends, tension)
    here = held_energy(joint, q.ravel(), ends, tension)
    if posed.rest is None:
        lower = here - held_energy(joint, found.x, ends, tension)
        return Trial(seed, words, "buckles", lower > 1e-9, f"{posed.why}; beside it {lower:.2g} J less")
    turned = joint.shape(found.x)[2]
    ours = joint.shape(q.ravel())[2]
    apart = float(np.degrees(np.linalg.norm(Rotation.from_matrix(turned @ ours.T).as_rotvec())))
    spans = joint.spans(found.x)
    pulls = tension if tension is not None else joint.stiffness * _stretched(spans, ends)
    apart_n = float(np.max(np.abs(pulls - posed.rest.at.tension)))
    ok = apart < TILT_DEG and apart_n < TENSION_N
    return Trial(seed, words, "found", ok, "" if ok else "the minimiser came to another pose", apart, apart_n)


def judge_refusal(trial: Trial, rig: RigSpec, asked: Asked, posed: Posed) -> Trial:
    """Return whether the tensions that would hold the pose, of which one pushes, lead the minimiser to it."""
    tension = np.asarray(posed.space.held_tension)
    if "would have to push" not in posed.why or tension.min() >= 0:
        return trial
    joint = PlainJoint(rig)
    axis = joint.shape(least(joint, np.zeros(18), None, tension).x)[2][:, 0]
    bend, azimuth = asked.pose.bend_rad, asked.pose.azimuth_rad
    wanted = np.array([np.cos(bend), np.sin(bend) * np.cos(azimuth), np.sin(bend) * np.sin(azimuth)])
    apart = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, wanted)), axis @ wanted)))
    return replace(trial, ok=apart < TILT_DEG, apart_deg=apart)


def run(seed: int) -> Trial:
    """Return one trial."""
    rig, asked = draw(seed)
    return judge(seed, rig, asked, find_pose(rig, asked, outlook=False))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials and print what came of them; 1 where one is wrong."""
    parser = argparse.ArgumentParser(prog="python -m campaigns.rests", description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=60, help="how many")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    asked = parser.parse_args(arguments)
    trials = []
    for seed in range(asked.first, asked.first + asked.seeds):
        trials.append(run(seed))
        one = trials[-1]
        verdict = f"{one.outcome:8s} {'ok ' if one.ok else 'WRONG'} {one.apart_deg:.4f}° {one.apart_n:.3f} N"
        print(f"{seed:3d} {verdict}  {one.asked}")
        if one.why:
            print(f"      {one.why}", flush=True)
    counts = Counter((one.outcome, one.ok) for one in trials)
    for (outcome, ok), count in sorted(counts.items()):
        print(f"{outcome}: {count} {'as the minimiser says' if ok else 'WRONG'}")
    found = [one for one in trials if one.outcome != "buckles"]
    if found:
        print(f"largest difference: {max(t.apart_deg for t in found):.4f}°, {max(t.apart_n for t in found):.3f} N")
    return 0 if all(one.ok for one in trials) else 1


if __name__ == "__main__":
    raise SystemExit(main())
