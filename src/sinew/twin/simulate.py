"""A plan run on the twin, and the recording of it."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import signal

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.drive import motor_current
from sinew.mechanics.parameters import CURRENT, TENDON_MODES, Parameters
from sinew.mechanics.tendons import tendon_tension
from sinew.plan.plan import Group, Plan, TendonMode, require_straight
from sinew.plan.rig import LIMIT_RESERVE_N, Bus, Imu, RigSpec
from sinew.plan.servo import SERVOS, VOLTAGE_LSB
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig
from sinew.solve.march import LANES, Progress, Track, integrate
from sinew.solve.rest import set_pretension
from sinew.twin.cache import configure
from sinew.twin.parameters import Effects, from_rig

# The true motion becomes what the registers and stamps of a bench would say.


def _noise(std: float, imu: Imu, size: int, sample_hz: float, rng: np.random.Generator) -> Array:
    """Return noise of a standard deviation, coloured by the sensor's own low-pass."""
    white = rng.standard_normal(size)
    corner = imu.low_pass.value
    if corner >= 0.45 * sample_hz:
        return std * white
    b, a = signal.butter(2, corner, fs=sample_hz)
    _, h = signal.freqz(b, a, worN=512)
    return np.asarray(std / np.sqrt(np.mean(np.abs(h) ** 2)) * signal.lfilter(b, a, white))


def _moving_average(values: Array, starts: NDArray[np.intp], count: int) -> Array:
    """Return the causal mean over `count` samples; before the start of a group the first sample is repeated."""
    index = np.arange(values.size)
    first = np.zeros(values.size, dtype=np.intp)
    first[starts] = starts
    first = np.maximum.accumulate(first)
    total = np.zeros_like(values)
    for back in range(count):
        total += values[np.maximum(index - back, first)]
    return total / count


def read_rounded(values: Array, lsb: float, effects: Effects) -> Array:
    """Return values rounded to a register's unit."""
    return np.round(values / lsb) * lsb if effects.sensor_noise else values


def read_gyro(
    low_passed: Array,
    low_passed_rate: Array,
    true_rate: Array,
    starts: NDArray[np.intp],
    sample_hz: float,
    imu: Imu,
    effects: Effects,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Return the gyroscope's three axes as the stock OpenCR library reports them [rad/s], shape (sample, 3).

    low_passed, low_passed_rate: torsion rate behind the chip's low-pass and its derivative, (sample,).
    true_rate: before it. starts: first sample of every group.
    Range, noise, bias, residual delay (first order in τ: its remainder is (Ωτ)²/2 = 6e-5 at 4.3 Hz), moving
    average, whole LSB, dead band.
    """
    readings = np.zeros((true_rate.size, 3), dtype=np.float32)
    along = low_passed - imu.residual_delay.value * low_passed_rate if effects.sensor_filter else true_rate
    for axis in range(3):
        values = along if axis == 0 else np.zeros_like(along)
        if effects.sensor_noise:
            bias = imu.gyro_bias.value * rng.standard_normal()
            values = values + bias + _noise(imu.gyro_noise.value, imu, values.size, sample_hz, rng)
            values = np.clip(values, -imu.gyro_range.value, imu.gyro_range.value)
        if effects.sensor_filter:
            values = _moving_average(values, starts, imu.average_samples)
        if effects.sensor_noise:
            raw = np.round(values / imu.gyro_lsb.value)
            values = np.where(np.abs(raw) <= imu.dead_band, 0.0, raw) * imu.gyro_lsb.value
        readings[:, axis] = values
    return readings


def read_accelerometer(
    rate: Array, acceleration: Array, imu: Imu, effects: Effects, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return the accelerometer's three axes [m/s²], shape (sample, 3), for a chip at (0, r, 0) in frame H.

    rate, acceleration: of the torsion. Specific force, upright: +g along x, -r φ̇² along y, r φ̈ along z; clipped at the
    range. Its low-pass is not modelled.
    """
    radius = imu.mount_radius.value
    force = np.stack([np.full_like(rate, STANDARD_GRAVITY), -radius * rate**2, radius * acceleration], axis=-1)
    if effects.sensor_noise:
        force += imu.accelerometer_noise.value * rng.standard_normal(force.shape)
        force = np.clip(force, -imu.accelerometer_range.value, imu.accelerometer_range.value)
        force = np.round(force / imu.accelerometer_lsb.value) * imu.accelerometer_lsb.value
    return force.astype(np.float32)


def stamp(counts: NDArray[np.intp], sample_hz: float, bus: Bus, effects: Effects, rng: np.random.Generator) -> Array:
    """Return the host's time stamps [s] of groups that follow one another, shape (sum of counts,).

    Jitter is normal, cut at 0.4 sample intervals so that stamps keep their order.
    """
    index = np.arange(int(counts.sum()))
    ideal = index / sample_hz
    if not effects.stamp_jitter:
        return ideal
    jitter = bus.stamp_jitter.value * rng.standard_normal(index.size)
    return np.asarray(ideal + np.clip(jitter, -0.4 / sample_hz, 0.4 / sample_hz))


_READ = (
    "amplitude", "omega", "stop_s", "duty_torque", "speed_slope", "torque_constant", "stiffness", "held_tension", "mode"
)  # fmt: skip
"""Parameters that the registers' readings depend on."""

Lanes = tuple[Parameters, NDArray[np.float64]]


@cache
def _set_pretension() -> Callable[..., Any]:
    return jax.jit(jax.vmap(set_pretension, in_axes=(0, 0, None, None, None)))


def lane_parameters(
    groups: Sequence[Group],
    rig: RigSpec,
    *,
    mode: TendonMode = "position",
    effects: Effects | None = None,
    rng: np.random.Generator | None = None,
) -> Lanes:
    """Return (parameters with a lane axis, shortening at rest [m]) for groups, one lane each.

    rng: draws the scatter of pretension and friction, one draw for each pair of pretension and repeat.
    """
    configure()
    effects = effects or Effects()
    pairs = {pair: i for i, pair in enumerate(dict.fromkeys((g.pretension_mm, g.repeat) for g in groups))}
    pair = np.array([pairs[g.pretension_mm, g.repeat] for g in groups])
    scatter = np.zeros((2, len(pairs)))
    if rng is not None and effects.repeatability:
        widths = (rig.repeatability.pretension.value, rig.repeatability.guide_friction.value)
        scatter = np.array(widths)[:, None] * rng.standard_normal(scatter.shape)

    lanes = len(groups)
    p = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (lanes, *np.shape(leaf))).copy(), from_rig(rig))
    driven = np.array([g.kind != "idle" for g in groups])
    frequency = np.array([g.frequency_hz if g.kind != "idle" else 1.0 for g in groups])
    amplitude = np.array([np.radians(g.amplitude_deg) if g.kind != "idle" else 0.0 for g in groups])
    p = p._replace(
        amplitude=np.where(driven, amplitude, 0.0),
        omega=2 * np.pi * frequency,
        stop_s=np.array([g.settle_s if g.kind == "ring-down" else np.inf for g in groups]),
        guides=p.guides.scaled(np.maximum(0.0, 1 + scatter[1, pair])),
    )
    p = effects.applied(p)
    if not effects.tendons:
        return p, np.zeros(lanes)
    pretension = np.maximum(0.0, np.array([g.pretension_mm for g in groups]) * 1e-3 + scatter[0, pair])
    held = TENDON_MODES[mode] if effects.length_locking else CURRENT
    return _pretensioned(p, pretension, rig.tendons.first_contact_tension.value, held)


def _pretensioned(p: Parameters, pretension: NDArray[np.float64], contact: float, mode: float) -> Lanes:
    """Return the lanes at their pretensions [m]; solved in blocks of one size, so that it is compiled once."""
    lanes = pretension.size
    blocks = []
    for start in range(0, lanes, LANES):
        index = np.minimum(np.arange(start, start + LANES), lanes - 1)
        block = jax.tree.map(lambda leaf, index=index: np.asarray(leaf)[index], p)
        blocks.append(_set_pretension()(block, pretension[index], contact, mode, LIMIT_RESERVE_N))
    held, shortening = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:lanes], *blocks)
    return held, shortening


def rest_tension(pretension_mm: Sequence[float], rig: RigSpec) -> NDArray[np.float64]:
    """Return the tension of each tendon at rest [N] at every pretension [mm], shape (pretension,)."""
    groups = [Group("idle", p, np.nan, np.nan, 0, 0.0, 1.0) for p in pretension_mm]
    p, _ = lane_parameters(groups, rig, mode="current")
    return np.asarray(p.held_tension)


def peak_torsion(plan: Plan, rig: RigSpec) -> NDArray[np.float64]:
    """Return the largest torsion [rad] that the plan's drive brings about at each of its pretensions, (pretension,).

    One repeat of every group, without scatter or sensors, from rest.
    """
    require_straight(plan, "the twin")
    groups = [group for group in plan.groups() if group.kind not in ("idle", "tracking") and group.repeat == 0]
    lanes = lane_parameters(groups, rig, mode=plan.pretension.mode)
    tracks = simulate_tracks(lanes, groups, plan.sample_hz)
    peaks = [(g.pretension_mm, float(np.abs(t.torsion).max())) for g, t in zip(groups, tracks, strict=True)]
    return np.array([max(peak for p, peak in peaks if p == asked) for asked in plan.pretension.pretension_mm])


def foresee(plan: Plan, rig: RigSpec) -> tuple[NDArray[np.float64], xr.Dataset]:
    """Return what a plan will bring about: the largest torsion [rad] at each pretension, as `peak_torsion`, and the
    recording of one repeat of it without scatter and noise, with the delays and filters of the sensors."""
    require_straight(plan, "the twin")
    parts = {name: part.model_copy(update={"repeats": 1}) for name in _REPEATED if (part := getattr(plan, name))}
    once = plan.model_copy(update=parts)
    groups = once.groups()
    lanes = lane_parameters(groups, rig, mode=plan.pretension.mode)
    tracks = simulate_tracks(lanes, groups, plan.sample_hz)
    swings = [(g.pretension_mm, t) for g, t in zip(groups, tracks, strict=True) if g.kind != "idle"]
    peaks = [(p, float(np.abs(t.torsion).max())) for p, t in swings]
    quiet = Effects().without("sensor_noise", "stamp_jitter", "repeatability")
    recording = record_tracks(tracks, lanes, once, rig, effects=quiet, rng=np.random.default_rng(0))
    return np.array([max(peak for p, peak in peaks if p == mm) for mm in plan.pretension.pretension_mm]), recording


_REPEATED = ("sweep", "ring_down")


def simulate_tracks(
    lanes: Lanes, groups: Sequence[Group], sample_hz: float, steps: int | None = None, progress: Progress | None = None
) -> list[Track]:
    """Return the true motion of every group, sampled at `sample_hz`; see `sinew.solve.march`."""
    samples = [sum(g.sample_counts(sample_hz)) for g in groups]
    return integrate(*lanes, samples, 1 / sample_hz, steps=steps, progress=progress)


def simulate(
    plan: Plan | str | Path,
    rig: RigSpec | str | Path,
    *,
    seed: int = 0,
    effects: Effects | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Return the recording that the plan gives on the rig's physics twin.

    plan, rig: as such, or the path of their TOML file, or the name of a shipped one.
    seed: of scatter, noise and jitter; the same seed gives the same recording.
    progress: called with (done, total) simulated seconds.
    Every group starts from rest; the pause before it is not recorded.
    Raises SpecError for a plan with a [track]: what a drive that listens does is no plan's; see `sinew track`; and for
    one that bends or sways the head.

    >>> import sinew as sn
    >>> sweep = sn.Sweep(frequency_hz=(3.0,), settle_s=1.0, periods=3, repeats=1)
    >>> plan = sn.Plan(name="one", sample_hz=200.0, pretension=sn.Pretension(pretension_mm=(4.0,)), sweep=sweep)
    >>> sn.simulate(plan, "paper", seed=1).sizes["segment"]
    3
    """
    plan = load_plan(plan) if isinstance(plan, (str, Path)) else plan
    rig = load_rig(rig) if isinstance(rig, (str, Path)) else rig
    if not (isinstance(plan, Plan) and isinstance(rig, RigSpec)):
        raise SpecError(
            f"found a {type(plan).__name__} and a {type(rig).__name__}, expected a Plan and a RigSpec, in this order, "
            "or the names or paths of their files"
        )
    if plan.track is not None:
        raise SpecError(
            f"plan {plan.name} has a [track]: what a drive that listens does is not known before; "
            "run it by `sinew track --emulate`"
        )
    require_straight(plan, "the twin")
    effects = effects or Effects()
    scatter, noise = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
    groups = plan.groups()
    lanes = lane_parameters(groups, rig, mode=plan.pretension.mode, effects=effects, rng=scatter)
    tracks = simulate_tracks(lanes, groups, plan.sample_hz, progress=progress)
    recording = record_tracks(tracks, lanes, plan, rig, effects=effects, rng=noise)
    return recording.assign_attrs(seed=seed)


def record_tracks(
    tracks: Sequence[Track],
    lanes: Lanes,
    plan: Plan,
    rig: RigSpec,
    *,
    effects: Effects,
    rng: np.random.Generator,
) -> xr.Dataset:
    """Return the recording of a plan's true motion: what the sensors of the rig would have said of it.

    tracks, lanes: of the plan's groups, in their order. rng: of noise, bias and jitter.
    """
    groups = plan.groups()
    samples = _read(tracks, groups, lanes[0], plan, rig, effects, rng)
    segments, sizes = _segments(groups, plan.sample_hz)
    off = [name for name in Effects.names() if not getattr(effects, name)]
    attrs = provenance("twin", rig=dump_rig(rig), plan=dump_plan(plan), effects_off=" ".join(off))
    return build_recording(samples, segments, sizes, attrs)


def _segments(groups: Sequence[Group], sample_hz: float) -> tuple[list[Segment], list[int]]:
    segments, sizes = [], []
    for group in groups:
        settle, record = group.sample_counts(sample_hz)
        if settle:
            segments.append(group.segment("settle"))
            sizes.append(settle)
        segments.append(group.segment(group.kind))
        sizes.append(record)
    return segments, sizes


def _read(
    tracks: Sequence[Track],
    groups: Sequence[Group],
    p: Parameters,
    plan: Plan,
    rig: RigSpec,
    effects: Effects,
    rng: np.random.Generator,
) -> dict[str, NDArray[Any]]:
    """Return every channel of the recording over all groups, one after the other."""
    counts = np.array([track.torsion.size for track in tracks])
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    joined = Track(*(np.concatenate([getattr(t, name) for t in tracks], axis=-1) for name in Track._fields))
    repeated: dict[str, Any] = {name: jnp.asarray(np.repeat(getattr(p, name), counts)) for name in _READ}
    each = p._replace(**repeated)
    own_time = (np.arange(counts.sum()) - np.repeat(starts, counts)) / plan.sample_hz
    command = np.where(own_time < each.stop_s, each.amplitude * np.sin(each.omega * own_time), 0.0)

    drive, bus, tendons = rig.drive, rig.bus, rig.tendons
    late = bus.drive_delay.value if effects.sensor_filter else 0.0
    lever = joined.lever - late * joined.lever_rate
    current = np.asarray(motor_current(jnp.asarray(joined.duty), jnp.asarray(joined.lever_rate), each))
    tension = np.asarray(tendon_tension(jnp.asarray(joined.stretch), each)).T
    taken_up = _take_up(joined.stretch, tension, starts, counts, groups, rig) / tendons.pulley_radius.value
    pull = tendons.current(tension)
    supply = np.full(command.size, drive.supply_voltage.value)
    turn = 2 * np.pi
    channels: dict[str, NDArray[Any]] = {
        "time_s": stamp(counts, plan.sample_hz, bus, effects, rng),
        "drive_command_rad": command.astype(np.float32),
        "drive_rad": read_rounded(lever, turn / drive.counts_per_turn.value, effects).astype(np.float32),
        "drive_current_a": read_rounded(current, drive.current_lsb.value, effects).astype(np.float32),
        "drive_pwm": read_rounded(joined.duty, drive.duty_lsb.value, effects).astype(np.float32),
        "tendon_rad": read_rounded(taken_up, turn / tendons.counts_per_turn.value, effects).astype(np.float32),
        "tendon_current_a": read_rounded(pull, tendons.current_lsb.value, effects).astype(np.float32),
        "tendon_pwm": read_rounded(
            _tendon_duty(pull, taken_up, starts, plan.sample_hz, rig), drive.duty_lsb.value, effects
        ).astype(np.float32),
        "supply_v": read_rounded(supply, VOLTAGE_LSB, effects).astype(np.float32),
        "gyro_rad_s": read_gyro(
            joined.gyro, joined.gyro_rate, joined.torsion_rate, starts, plan.sample_hz, rig.imu, effects, rng
        ),
        "acceleration_m_s2": read_accelerometer(
            joined.torsion_rate, joined.torsion_acceleration, rig.imu, effects, rng
        ),
    }
    noise = rng if effects.sensor_noise else None
    return channels | {s.channel: s.told(tension, noise).astype(np.float32) for s in rig.sensors}


def _tendon_duty(
    current: NDArray[np.float64], angle: NDArray[np.float64], starts: NDArray[np.intp], sample_hz: float, rig: RigSpec
) -> NDArray[np.float64]:
    """Return the duty of the tendon motors, (sample, tendon), for their current [A] and angle [rad] of that shape.

    (R i + k_e ω)/V: what holds the current against winding and back-EMF. R and k_e of the model's data sheet: nominal
    voltage over stall current, and over no-load speed.
    """
    servo = SERVOS[rig.wiring.tendon_model]
    supply = rig.drive.supply_voltage.value
    duty = (servo.resistance / supply) * current
    turned = angle[2:] - angle[:-2]
    inside = np.ones(angle.shape[0], dtype=bool)  # a group's first and last sample have no neighbour on one side
    inside[starts] = inside[starts - 1] = False
    duty[1:-1] += (servo.nominal_voltage / servo.no_load_speed / supply * 0.5 * sample_hz) * turned * inside[1:-1, None]
    return np.asarray(np.clip(duty, -1.0, 1.0))


def _take_up(
    stretch: NDArray[np.float64],
    tension: NDArray[np.float64],
    starts: NDArray[np.intp],
    counts: NDArray[np.intp],
    groups: Sequence[Group],
    rig: RigSpec,
) -> NDArray[np.float64]:
    """Return how much cable the motors have taken up since first contact [m], shape (sample, tendon).

    A group starts at rest with its pretension taken up, less what the servo gives way under the added tension;
    then the motor follows length and tension: Δw = -Δℓ + ΔT/k_cable.
    """
    cable, servo = rig.tendons.cable_stiffness.value, rig.tendons.servo_stiffness.value
    contact = rig.tendons.first_contact_tension.value
    pretension = np.repeat([g.pretension_mm * 1e-3 for g in groups], counts)[:, None]
    rest = np.repeat(starts, counts)
    moved = -(stretch.T - stretch.T[rest]) + (tension - tension[rest]) / cable
    return np.asarray(pretension - (tension[rest] - contact) / servo + moved)
