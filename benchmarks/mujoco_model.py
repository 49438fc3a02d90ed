"""The exported joint in MuJoCo beside the twin: resonance, ring-down, modes, and where it rests, straight and bent.

`sinew model` writes the joint as MJCF from its mechanics alone; here MuJoCo does with it what a bench does. The drive's
command is swept and the torsion's amplitude read; the drive stops and the torsion dies away; the motors take up cable
and the head goes where it rests. The twin does the same with its own equations.
"""

import importlib.util
import math
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from scipy.optimize import curve_fit
from scipy.spatial.transform import Rotation

from sinew.measure.arrays import Array
from sinew.mechanics.space import twist_and_tilt
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.multibody import PIECES, Bodies, joint_bodies, write_mjcf
from sinew.predict.pose import Asked, find_pose
from sinew.twin.simulate import lane_parameters, simulate_tracks

SAMPLE_HZ = 200.0
COMMAND_DEG = 20.0
SETTLE_S, KEPT_S = 5.0, 2.0
GRID_HZ = 0.08
REST_S = 6.0


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
    kind = "ring-down" if ring_down else "steady"
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
    tops = np.flatnonzero((np.abs(torsion[1:-1]) >= np.abs(torsion[:-2])) & (np.abs(torsion[1:-1]) > np.abs(torsion[2:]))) + 1
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
    """What the twin says and what MuJoCo does with the exported model."""

    pretension_mm: float
    resonance: tuple[Peak, Peak]
    decay: tuple[Decay, Decay]

    @property
    def off(self) -> float:
        """Return how far MuJoCo's resonance is from the twin's, as a share."""
        return self.resonance[1].frequency_hz / self.resonance[0].frequency_hz - 1


def resonance_beside(rig: RigSpec, pretension_mm: float, *, sway: bool = True, pieces: int = PIECES) -> Beside:
    """Return resonance and decay of the twin and of MuJoCo. The exported guides are those of the twin's swing at its
    resonance, and for the decay of a quarter of it."""
    first = joint_bodies(rig, pretension_mm, sway=False)
    grid = first.torsion_hz + GRID_HZ * np.arange(-6, 4)
    ours = peak(grid, np.array([amplitude(one) for one in twins(rig, pretension_mm, list(grid))]))
    made = [
        joint_bodies(rig, pretension_mm, swing_deg=math.degrees(share * ours.amplitude), sway=sway, pieces=pieces)
        for share in (1.0, 0.25)
    ]
    theirs = peak(grid, np.array([amplitude(swung(made[0], f, SETTLE_S + KEPT_S)) for f in grid]))
    hz, stop = ours.frequency_hz, stop_time(ours.frequency_hz)
    records = twins(rig, pretension_mm, [hz], True)[0], swung(made[1], hz, stop + KEPT_S, stop)
    decays = [decay(one[math.ceil(stop * SAMPLE_HZ) :], 0.25 * ours.amplitude) for one in records]
    return Beside(pretension_mm, (ours, theirs), (decays[0], decays[1]))
