"""The exported joint in MuJoCo beside the twin: resonance, ring-down, modes, and where it rests, straight and bent.

`sinew model` writes the joint as MJCF from its mechanics alone; here MuJoCo does with it what a bench does. The drive's
command is swept and the torsion's amplitude read; the drive stops and the torsion dies away; the motors take up cable
and the head goes where it rests. The twin does the same with its own equations.
"""

import importlib.util
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.optimize import curve_fit

from sinew.measure.arrays import Array
from sinew.measure.schema import SegmentKind
from sinew.mechanics.space import twist_and_tilt
from sinew.plan.plan import Group
from sinew.plan.pose import STRAIGHT, Pose, bend_of_swing
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict import modes
from sinew.predict.multibody import PIECES, Bodies, joint_bodies, write_mjcf
from sinew.predict.pose import Asked, find_pose
from sinew.twin.simulate import lane_parameters, simulate_tracks

SAMPLE_HZ = 200.0
COMMAND_DEG = 20.0
SETTLE_S, KEPT_S = 5.0, 2.0
GRID_HZ = 0.08
REST_S, SETTLING_S = 1.5, 0.03


def loaded(bodies: Bodies) -> tuple[Any, Any]:
    """Return MuJoCo's (model, data) of a joint, at its rest."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(write_mjcf(bodies, []))
    return model, mujoco.MjData(model)


def commanded(time_s: Array, frequency_hz: float, stop_s: float = math.inf) -> Array:
    """Return the lever's command [rad], a sine from zero that stops."""
    driven = np.radians(COMMAND_DEG) * np.sin(2 * np.pi * frequency_hz * time_s)
    return np.where(time_s < stop_s, driven, 0.0)


def swung(bodies: Bodies, frequency_hz: float, seconds: float, stop_s: float = math.inf) -> Array:
    """Return MuJoCo's torsion of the head [rad] at `SAMPLE_HZ`, the drive commanded."""
    import mujoco

    model, data = loaded(bodies)
    each = round(1 / SAMPLE_HZ / model.opt.timestep)
    torsion = np.empty(round(seconds * SAMPLE_HZ))
    for i, command in enumerate(commanded((np.arange(torsion.size * each)) * model.opt.timestep, frequency_hz, stop_s)):
        if i % each == 0:
            mujoco.mj_forward(model, data)
            torsion[i // each] = data.sensor("torsion").data[0]
        data.ctrl[-1] = command
        mujoco.mj_step(model, data)
    return torsion


def twins(rig: RigSpec, pretension_mm: float, frequencies: Sequence[float], ring_down: bool = False) -> list[Array]:
    """Return the twin's torsion [rad] at `SAMPLE_HZ` at each frequency of the drive [Hz]."""
    kind: SegmentKind = "ring-down" if ring_down else "steady"
    groups = [
        Group(kind, pretension_mm, f, COMMAND_DEG, 0, stop_time(f) if ring_down else SETTLE_S, KEPT_S)
        for f in frequencies
    ]
    return [track.torsion for track in simulate_tracks(lane_parameters(groups, rig), groups, SAMPLE_HZ)]


def stop_time(frequency_hz: float) -> float:
    """Return when a drive stops [s]: at a zero of its command."""
    return round(SETTLE_S * frequency_hz) / frequency_hz


class Peak(NamedTuple):
    """Resonance: frequency [Hz] with its standard uncertainty from the grid, amplitude of the torsion [rad]."""

    frequency_hz: float
    std_hz: float
    amplitude: float


def amplitude(torsion: Array) -> float:
    """Return the half range over the last second [rad]."""
    return float(np.ptp(torsion[-round(SAMPLE_HZ) :]) / 2)


def peak(frequency_hz: Array, amplitudes: Array) -> Peak:
    """Return the top of a parabola through the largest amplitude and two on each side.

    Its uncertainty: how far the top through one on each side is from it, or a twentieth of the grid.
    """
    i = int(np.clip(np.argmax(amplitudes), 2, len(amplitudes) - 3))
    tops = []
    for reach in (2, 1):
        near = slice(i - reach, i + reach + 1)
        a, b, _ = np.polyfit(frequency_hz[near] - frequency_hz[i], amplitudes[near], 2)
        tops.append(frequency_hz[i] - b / (2 * a))
    return Peak(float(tops[0]), max(abs(tops[0] - tops[1]), GRID_HZ / 20), float(np.max(amplitudes)))


class Decay(NamedTuple):
    """A ring-down between two amplitudes: frequency [Hz] and Lehr's damping, each with its standard deviation."""

    frequency_hz: float
    std_hz: float
    damping: float
    damping_std: float


def decay(torsion: Array, around: float) -> Decay:
    """Return frequency and damping of a decay where its peaks are within a factor of two of an amplitude [rad].

    A damped sine by least squares; what it leaves, taken as noise of one sample in five, gives the deviations.
    """
    tops = (
        np.flatnonzero((np.abs(torsion[1:-1]) >= np.abs(torsion[:-2])) & (np.abs(torsion[1:-1]) > np.abs(torsion[2:])))
        + 1
    )
    inside = tops[(np.abs(torsion[tops]) < 2 * around) & (np.abs(torsion[tops]) > around / 2)]
    kept = torsion[inside[0] : inside[-1] + 1]
    time_s = np.arange(kept.size) / SAMPLE_HZ

    def damped(t: Array, a: float, b: float, rate: float, omega: float, offset: float) -> Array:
        return np.asarray(np.exp(-rate * t) * (a * np.cos(omega * t) + b * np.sin(omega * t)) + offset)

    omega = np.pi * (len(inside) - 1) / time_s[-1]
    rate = np.log(abs(kept[0] / kept[-1])) / time_s[-1]
    found, covariance = curve_fit(damped, time_s, kept, [kept[0], 0.0, rate, omega, 0.0])
    std = np.sqrt(5 * np.diag(covariance))
    natural = math.hypot(found[2], found[3])
    return Decay(natural / (2 * np.pi), float(std[3] / (2 * np.pi)), found[2] / natural, float(std[2] / natural))


class Beside(NamedTuple):
    """Resonance and decay: (of the twin, of MuJoCo with the exported model)."""

    resonance: tuple[Peak, Peak]
    decay: tuple[Decay, Decay]

    @property
    def off(self) -> float:
        """Return how far MuJoCo's resonance is from the twin's, as a share."""
        return self.resonance[1].frequency_hz / self.resonance[0].frequency_hz - 1

    @property
    def damping_off(self) -> float:
        """Return the same of the decay's damping."""
        return self.decay[1].damping / self.decay[0].damping - 1


def resonance_beside(rig: RigSpec, pretension_mm: float, *, sway: bool = True, pieces: int = PIECES) -> Beside:
    """Return resonance and decay of the twin and of MuJoCo. The exported guides are those of the twin's swing at its
    resonance, and for the decay of a quarter of it."""
    asked = modes.Asked((pretension_mm,), (0.0,))
    first = joint_bodies(rig, asked, sway=False)
    grid = np.asarray(first.torsion_hz + GRID_HZ * np.arange(-5, 4), dtype=np.float64)
    ours = peak(grid, np.array([amplitude(one) for one in twins(rig, pretension_mm, list(grid))]))
    made = [
        joint_bodies(rig, asked._replace(swing_deg=math.degrees(share * ours.amplitude)), pieces, sway=sway)
        for share in (1.0, 0.25)
    ]
    theirs = peak(grid, np.array([amplitude(swung(made[0], f, SETTLE_S + KEPT_S)) for f in grid]))
    hz, stop = ours.frequency_hz, stop_time(ours.frequency_hz)
    records = twins(rig, pretension_mm, [hz], ring_down=True)[0], swung(made[1], hz, stop + KEPT_S, stop)
    decays = [decay(one[math.ceil(stop * SAMPLE_HZ) :], 0.25 * ours.amplitude) for one in records]
    return Beside((ours, theirs), (decays[0], decays[1]))


class Rested(NamedTuple):
    """Where a head rests: bend and its azimuth [deg], place of the plate in B (3,) [mm], tensions (tendon,) [N]."""

    bend_deg: float
    azimuth_deg: float
    place_mm: Array
    tension_n: Array


def rest_beside(rig: RigSpec, pretension_mm: float, pose: Pose, *, pieces: int = PIECES) -> tuple[Rested, Rested]:
    """Return where the head rests in the twin and in MuJoCo, the model being that of the upright joint and its motors
    told to take up what the twin's do for the pose."""
    upright, posed = (find_pose(rig, Asked(pretension_mm, one), outlook=False) for one in (STRAIGHT, pose))
    assert upright.rest is not None
    assert posed.rest is not None
    assert posed.shape is not None
    model, data = loaded(joint_bodies(rig, modes.Asked((pretension_mm,), (0.0,)), pieces))
    data.ctrl[: rig.tendons.count] = posed.rest.take_up - upright.rest.take_up
    _settle(model, data)
    base = data.body("base").xmat.reshape(3, 3)
    turned = base.T @ data.body("head").xmat.reshape(3, 3)
    tilt = np.asarray(twist_and_tilt(jnp.asarray(turned))[1])
    place = 1e3 * base.T @ data.body("head").xpos
    theirs = Rested(*_bend_of(tilt), place, -data.actuator_force[: rig.tendons.count])
    at = posed.rest.at
    return Rested(*_bend_of(np.asarray(at.tilt)), 1e3 * posed.shape.line[-1], np.asarray(at.tension)), theirs


def _bend_of(tilt: Array) -> tuple[float, float]:
    bend, azimuth = bend_of_swing(float(tilt[0]), float(tilt[1]))
    return math.degrees(bend), math.degrees(azimuth)


def _settle(model: Any, data: Any) -> None:
    """Step until the joint rests: without its memory, which only takes time, and with dampers on its springs."""
    import mujoco

    for i in range(model.ntendon):
        if model.tendon(i).name.startswith("memory"):
            model.tendon_stiffness[i] = 0.0
    model.dof_damping[model.jnt_dofadr] += SETTLING_S * model.jnt_stiffness
    for _ in range(round(REST_S / model.opt.timestep)):
        mujoco.mj_step(model, data)


def changed(rig: RigSpec, **values: float) -> RigSpec:
    """Return a rig with other values, `part__name`, in SI."""
    for name, value in values.items():
        part, field = name.split("__")
        table = getattr(rig, part)
        one = getattr(table, field).model_copy(update={"value": value})
        rig = rig.model_copy(update={part: table.model_copy(update={field: one})})
    return rig


POSES = {
    0.0: (Pose(bend_deg=4.0, azimuth_deg=0.0),),
    6.0: (Pose(bend_deg=10.0, azimuth_deg=0.0), Pose(bend_deg=20.0, azimuth_deg=90.0)),
}
POSES[12.0] = (Pose(bend_deg=10.0, azimuth_deg=45.0), Pose(bend_deg=30.0, azimuth_deg=0.0))


def main(arguments: Sequence[str] = ()) -> None:
    """Print resonance, damping and rest poses of the exported joint in MuJoCo beside the twin's; `resonance` and `rest`
    print one half."""
    if importlib.util.find_spec("mujoco") is None:
        print("MuJoCo is not installed: skipped")
        return
    if "rest" not in arguments:
        _print_resonances()
    if "resonance" not in arguments:
        _print_rests()


def _print_resonances() -> None:
    paper = load_rig("paper")
    rigs = {"paper": paper, "softer, heavier": changed(paper, silicone__torsional_rigidity=0.22, inertia__lever=0.0105)}
    print(f"the exported joint in MuJoCo beside the twin, {PIECES} pieces, {COMMAND_DEG:g} deg; wanted: f_r within 2 %")
    print(
        "  rig               p/mm   f_r/Hz twin     MuJoCo           off   torsion/deg    D of the decay          off"
    )
    for name, rig in rigs.items():
        for p in (0.0, 6.0, 12.0):
            found = resonance_beside(rig, p)
            (a, b), (c, d) = found.resonance, found.decay
            print(
                f"  {name:16} {p:5.0f}   {a.frequency_hz:.3f}±{a.std_hz:.3f}  {b.frequency_hz:.3f}±{b.std_hz:.3f}"
                f"  {100 * found.off:+5.2f} %  {math.degrees(a.amplitude):4.1f} {math.degrees(b.amplitude):4.1f}"
                f"   {c.damping:.4f}±{c.damping_std:.4f} {d.damping:.4f}±{d.damping_std:.4f}"
                f"  {100 * found.damping_off:+5.1f} %"
            )


def _print_rests() -> None:
    print("where the head rests, motors taking up what the twin's do: bend/deg, place/mm, tensions/N")
    for name in ("paper", "curved"):
        for p, poses in POSES.items():
            for pose in (STRAIGHT, *poses):
                ours, theirs = rest_beside(load_rig(name), p, pose)
                apart = np.linalg.norm(ours.place_mm - theirs.place_mm)
                tension = np.max(np.abs(ours.tension_n - theirs.tension_n)) / np.sum(ours.tension_n)
                print(
                    f"  {name:8} {p:3.0f}  {ours.bend_deg:6.2f} at {ours.azimuth_deg:4.0f}: {theirs.bend_deg:6.2f} at "
                    f"{theirs.azimuth_deg:4.0f}, {apart:.2f} mm apart, tensions within {100 * tension:.1f} % of the sum"
                )
