"""The joint in space against what is known of it: the torsional twin, energy, its own linear equations.

`python -m campaigns.space` prints each number beside the one it should meet and takes some minutes.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from campaigns.options import conclude
from sinew.measure.arrays import Array
from sinew.measure.attitude import tilt_from, torsion_of
from sinew.mechanics.space import (
    Space,
    SpaceState,
    space_at_rest,
    space_derivative,
    space_dissipation,
    space_energy,
)
from sinew.plan.plan import STRAIGHT, Group, Pose
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.solve.march import Swing, runge_kutta_samples, swing, swing_steps
from sinew.solve.spatial import Mode, linear_equations, modes
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, simulate_tracks
from sinew.twin.space import SpaceLanes, space_lanes, swing_lanes

RIG = load_rig("paper")

STIFFNESS = 1 / (1 / RIG.tendons.cable_stiffness.value + 1 / RIG.tendons.servo_stiffness.value)
"""Of a tendon, cable and servo [N/m]."""

SAMPLE_HZ = 200.0
ELASTIC = Effects().without("silicone_loss", "guide_friction", "drive_dynamics")
"""Nothing is lost and the lever follows its command: what linear equations know."""


def steady(
    frequency_hz: float,
    pretension_mm: float = 6.0,
    amplitude_deg: float = 20.0,
    pose: Pose = STRAIGHT,
    settle_s: float = 4.0,
) -> Group:
    """Return a group of a drive that runs for a while, and then for six periods."""
    return Group("steady", pretension_mm, frequency_hz, amplitude_deg, 0, settle_s, 6 / frequency_hz, pose=pose)


def bent(bend_deg: float, azimuth_deg: float = 90.0) -> Pose:
    """Return a pose."""
    return Pose(bend_deg=bend_deg, azimuth_deg=azimuth_deg)


class Head(NamedTuple):
    """What a head does, (sample,): torsion, tilt in the plane of its bend and out of it, gyroscope about x; SI."""

    torsion: Array
    inside: Array
    outside: Array
    gyro: Array


def head_of(one: Swing, pose: Pose, begin: int = 0) -> Head:
    """Return the motion of a head about its pose, from a sample on."""
    orientation = Rotation.from_matrix(one.rotations).as_quat(scalar_first=True)
    tilt = tilt_from(orientation, pose.bend_rad, pose.azimuth_rad)
    return Head(*(x[begin:] for x in (torsion_of(orientation), tilt[:, 0], tilt[:, 1], one.spin[0])))


def harmonics(values: Array, frequency_hz: float, count: int = 3) -> Array:
    """Return the complex amplitudes of the first harmonics of a steady motion, (count + 1,): the mean first."""
    time = np.arange(values.shape[-1]) / SAMPLE_HZ
    turning = np.exp(2j * np.pi * frequency_hz * np.outer(time, np.arange(1, count + 1)))
    table = np.concatenate([np.ones((time.size, 1)), turning.real, -turning.imag], axis=1)
    found = np.linalg.lstsq(table, values, rcond=None)[0]
    return np.concatenate([found[:1], found[1 : count + 1] + 1j * found[count + 1 :]])


def peak(frequency_hz: Array, gain: Array) -> tuple[float, float]:
    """Return (frequency, gain) of the top of a curve, by a parabola through its three highest points."""
    top = int(np.clip(np.argmax(gain), 1, gain.size - 2))
    f, g = frequency_hz[top - 1 : top + 2], gain[top - 1 : top + 2]
    a, b, c = np.polyfit(f - f[1], g, 2)
    return float(f[1] - b / (2 * a)), float(c - b * b / (4 * a))


# Energy.


@partial(jax.jit, static_argnames=("room",))
def _energies(
    space: Space, state: SpaceState, sample_s: jax.Array, samples: jax.Array, steps: jax.Array, room: int
) -> jax.Array:
    """Return (sample, [energy, lost, given]) [J]."""

    def slope(time_s: jax.Array, now: tuple[SpaceState, jax.Array]) -> tuple[tuple[SpaceState, jax.Array], jax.Array]:
        one, sums = now
        after = space_derivative(time_s, one, space)[0]
        powers = jnp.stack(space_dissipation(time_s, one, space))
        energy = space_energy(time_s, one, space)
        return (after, powers), jnp.concatenate([energy[None], sums])

    zero = jnp.zeros(())
    return runge_kutta_samples(slope, zero, (state, jnp.zeros(2)), sample_s, samples, steps, room)[1]


def energy_residual(lanes: SpaceLanes, lane: int = 0, seconds: float = 5.0, steps: int | None = None) -> float:
    """Return the largest (energy change + lost - given) over the energy put in up to the end of a run.

    What the drive and the tendons put in is their power where it is positive; energies are summed up with the motion
    by the same RK4. steps: between samples, else as many as the twin takes.
    """
    steps = steps or swing_steps(lanes.space, 1 / SAMPLE_HZ)
    one = jax.tree.map(lambda leaf: jnp.asarray(leaf[lane]), lanes.space)
    state = space_at_rest(jnp.asarray(lanes.q[lane]), one)
    samples = int(seconds * SAMPLE_HZ)
    rows = _energies(
        one, state, np.float64(1 / SAMPLE_HZ), np.int64(samples), np.int64(steps), int(np.ceil(samples / 1000) * 1000)
    )
    energy, lost, given = np.asarray(rows)[:samples].T
    moved = energy - energy[0] + lost - given
    put_in = np.sum(np.maximum(np.diff(given), 0.0))
    return float(np.abs(moved).max() / put_in)


# Linear modes against the motion after a small blow.


def struck_frequencies(lanes: SpaceLanes, found: Sequence[Mode], pose: Pose, seconds: float = 10.0) -> Array:
    """Return the frequency of each mode [Hz] as the motion of a struck head has it: undamped cosines fitted to torsion
    and tilts, all at once."""
    samples = int(seconds * SAMPLE_HZ)
    (one,) = swing(lanes.space, lanes.q, [samples], 1 / SAMPLE_HZ)
    head = head_of(one, pose, 4)
    time = np.arange(head.torsion.size) / SAMPLE_HZ
    channels = np.stack([x - x.mean() for x in head[:3]], axis=1)

    def misfit(frequencies: Array) -> Array:
        phase = 2 * np.pi * np.outer(time, frequencies)
        table = np.concatenate([np.cos(phase), np.sin(phase), np.ones((time.size, 1))], axis=1)
        return np.asarray((channels - table @ np.linalg.lstsq(table, channels, rcond=None)[0]).ravel())

    start = _spectral_peaks(channels, np.array([m.frequency_hz for m in found]))
    return np.asarray(least_squares(misfit, start, x_scale=1e-3).x)


def _spectral_peaks(channels: Array, near: Array) -> Array:
    """Return the frequency of the largest line of a spectrum within 3 % of each of some frequencies [Hz]."""
    window = np.hanning(channels.shape[0])[:, None]
    size = 16 * channels.shape[0]
    lines = np.abs(np.fft.rfft(channels * window, size, axis=0)).max(axis=1)
    at = np.fft.rfftfreq(size, 1 / SAMPLE_HZ)
    return np.array([at[np.argmax(np.where(np.abs(at / f - 1) < 0.03, lines, 0.0))] for f in near])


def struck_lane(pose: Pose, pretension_mm: float, impulse: float = 1e-4, rig: RigSpec = RIG) -> SpaceLanes:
    """Return a lane of an elastic joint, its lever locked, struck about all three axes at once."""
    group = Group("ring-down", pretension_mm, np.nan, np.nan, 0, 0.0, 10.0, "impulse-roll", np.nan, impulse, pose)
    lanes = space_lanes([group], rig, effects=ELASTIC)
    blow = impulse * np.array([[1.0, 1.0, 1.0]])
    return lanes._replace(space=lanes.space._replace(blow=blow))  # type: ignore[arg-type]


def modes_of(lanes: SpaceLanes, lane: int = 0, below_hz: float = 14.0) -> list[Mode]:
    """Return the linear modes of a lane at rest."""
    one = jax.tree.map(lambda leaf: leaf[lane], lanes.space)
    return modes(linear_equations(lanes.q[lane], one), one, below_hz)


# Rows of the table.


@dataclass(frozen=True)
class Row:
    """One number of the campaign. met: whether it is what it should be."""

    what: str
    ours: str
    fact: str
    met: bool


def straight_rows() -> Iterator[Row]:
    """Yield the straight joint in space against the torsional twin: the top of its response."""
    frequencies = {0.0: np.linspace(2.8, 3.1, 7), 6.0: np.linspace(3.45, 3.75, 7), 12.0: np.linspace(4.15, 4.45, 7)}
    for pretension, hz in frequencies.items():
        groups = [steady(f, pretension) for f in hz]
        flat = peak(
            hz, gains([t.torsion for t in simulate_tracks(lane_parameters(groups, RIG), groups, SAMPLE_HZ)], groups)
        )
        swings = swing_lanes(space_lanes(groups, RIG), groups, SAMPLE_HZ)
        top = peak(hz, gains([head_of(one, STRAIGHT).torsion for one in swings], groups))
        off = [100 * (a / b - 1) for a, b in zip(top, flat, strict=True)]
        yield Row(
            f"straight, {pretension:g} mm: f, gain against the torsional twin",
            f"{off[0]:+.4f} %, {off[1]:+.4f} % ({top[0]:.4f} Hz, {top[1]:.4f})",
            "within 0.2 %, 0.5 %",
            abs(off[0]) < 0.2 and abs(off[1]) < 0.5,
        )


def gains(torsions: Sequence[Array], groups: Sequence[Group]) -> Array:
    """Return the amplitude of the torsion's fundamental over the lever's command, (group,)."""
    begins = [g.sample_counts(SAMPLE_HZ)[0] for g in groups]
    found = [abs(harmonics(t[b:], g.frequency_hz)[1]) for t, b, g in zip(torsions, begins, groups, strict=True)]
    return np.array(found) / np.radians([g.amplitude_deg for g in groups])


def energy_rows() -> Iterator[Row]:
    """Yield the energy balance of bent runs of five seconds."""
    for hz, where in ((3.7, "at resonance"), (2.0, "below"), (5.5, "above")):
        found = energy_residual(space_lanes([steady(hz, 6.0, pose=bent(20))], RIG))
        yield Row(f"energy balance of 5 s, 20°, 6 mm, {where}", f"{found:.2g}", "1e-6", found < 1e-6)


def mode_rows() -> Iterator[Row]:
    """Yield linear modes against the motion after a small blow."""
    for pretension, pose in ((6.0, STRAIGHT), (6.0, bent(20)), (12.0, bent(30, 45))):
        lanes = struck_lane(pose, pretension)
        found = modes_of(lanes)
        seen = struck_frequencies(lanes, found, pose)
        off = 100 * (seen / [m.frequency_hz for m in found] - 1)
        text = ", ".join(f"{m.frequency_hz:.3f} Hz {o:+.3f} %" for m, o in zip(found, off, strict=True))
        yield Row(
            f"modes, {pretension:g} mm, {pose.words()}: spectrum against them", text, "0.5 %", np.abs(off).max() < 0.5
        )


ROWS = {"straight": straight_rows, "energy": energy_rows, "modes": mode_rows}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=list(ROWS), nargs="+", default=list(ROWS))
    parser.add_argument("--out", type=Path, help="also write the rows as JSON")
    asked = parser.parse_args(arguments)
    kept = [row for name in asked.only for row in ROWS[name]()]
    verdicts = [f"{row.what:75} {row.ours:60} {row.fact:28} {'met' if row.met else 'NOT MET'}" for row in kept]
    conclude(asked.out, "\n".join(verdicts), [asdict(row) for row in kept])


if __name__ == "__main__":
    main()
