"""A plan run on the twin, and the recording of it."""

from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.parameters import CURRENT, TENDON_MODES, Parameters
from sinew.plan.plan import Group, Plan, TendonMode
from sinew.plan.rig import LIMIT_RESERVE_N, Imu, RigSpec
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig
from sinew.solve.march import Progress, Track, integrate, lanes_together
from sinew.solve.programs import configure, program, use_all_cores
from sinew.solve.rest import set_pretension
from sinew.twin.parameters import Effects, from_rig
from sinew.twin.sensors import Moved, read_sensors
from sinew.twin.space import join_swings, space_lanes, swing_lanes

Lanes = tuple[Parameters, NDArray[np.float64]]


@program()
def _set_pretension(
    p: Parameters, pretension: jax.Array, contact: jax.Array, mode: jax.Array, reserve: jax.Array
) -> tuple[Parameters, jax.Array]:
    return jax.vmap(set_pretension, in_axes=(0, 0, None, None, None))(p, pretension, contact, mode, reserve)


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
    lanes, size = pretension.size, lanes_together(pretension.size)
    blocks = []
    for start in range(0, lanes, size):
        index = np.minimum(np.arange(start, start + size), lanes - 1)
        block = jax.tree.map(lambda leaf, index=index: np.asarray(leaf)[index], p)
        blocks.append(_set_pretension(block, pretension[index], contact, mode, LIMIT_RESERVE_N))
    held, shortening = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:lanes], *blocks)
    return held, shortening


def rest_tension(pretension_mm: Sequence[float], rig: RigSpec) -> NDArray[np.float64]:
    """Return the tension of each tendon at rest [N] at every pretension [mm], shape (pretension,)."""
    groups = [Group("idle", p, np.nan, np.nan, 0, 0.0, 1.0) for p in pretension_mm]
    p, _ = lane_parameters(groups, rig, mode="current")
    return np.asarray(p.held_tension)


def foresee(plan: Plan, rig: RigSpec) -> tuple[NDArray[np.float64], xr.Dataset]:
    """Return what a plan will bring about: the largest torsion [rad] at each of its pretensions, (pretension,), from
    rest, and the recording of one repeat of it without scatter and noise, with the delays and filters of the sensors.
    """
    parts = {name: part.model_copy(update={"repeats": 1}) for name in _REPEATED if (part := getattr(plan, name))}
    once = plan.model_copy(update=parts)
    groups = once.groups()
    moved, p = _move(once, groups, rig)
    quiet = Effects().without("sensor_noise", "stamp_jitter", "repeatability")
    return _peaks(moved, groups, plan), _record(moved, p, once, rig, quiet, np.random.default_rng(0))


_REPEATED = ("sweep", "ring_down", "impulse")


def _peaks(moved: Moved, groups: Sequence[Group], plan: Plan) -> NDArray[np.float64]:
    """Return the largest torsion [rad] at each pretension of a plan, of its groups that are driven."""
    torsions = np.split(moved.torsion, moved.starts[1:])
    rows = [
        (g.pretension_mm, float(np.abs(t).max())) for g, t in zip(groups, torsions, strict=True) if g.kind != "idle"
    ]
    return np.array([max(peak for p, peak in rows if p == mm) for mm in plan.pretension.pretension_mm])


def _move(
    plan: Plan,
    groups: Sequence[Group],
    rig: RigSpec,
    *,
    effects: Effects | None = None,
    rng: np.random.Generator | None = None,
    progress: Progress | None = None,
) -> tuple[Moved, Parameters]:
    """Return (true motion of groups of a plan, parameters of each), without scatter where there is no rng.

    A head that is upright and that the lever drives only turns and sinks, which is far less to compute.
    """
    mode, hz = plan.pretension.mode, plan.sample_hz
    use_all_cores()
    if plan.is_spatial:
        bent = space_lanes(groups, rig, mode=mode, effects=effects, rng=rng)
        swings = swing_lanes(bent, groups, hz, progress=progress)
        return join_swings(swings, bent, rig.imu), bent.space.joint
    lanes = lane_parameters(groups, rig, mode=mode, effects=effects, rng=rng)
    return _moved(simulate_tracks(lanes, groups, hz, progress=progress), groups, rig.imu), lanes[0]


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
    A plan whose head is bent, or moved by something else than the lever, runs on the joint in space; see
    `sinew.twin.space`.
    Raises SpecError for a plan with a [track]: what a drive that listens does is no plan's; see `sinew track`; and for
    a pose that the joint does not take.

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
    effects = effects or Effects()
    scatter, noise = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
    moved, p = _move(plan, plan.groups(), rig, effects=effects, rng=scatter, progress=progress)
    return _record(moved, p, plan, rig, effects, noise).assign_attrs(seed=seed)


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
    return _record(_moved(tracks, plan.groups(), rig.imu), lanes[0], plan, rig, effects, rng)


def _record(
    moved: Moved, p: Parameters, plan: Plan, rig: RigSpec, effects: Effects, rng: np.random.Generator
) -> xr.Dataset:
    samples = read_sensors(moved, p, plan.sample_hz, rig, effects, rng)
    segments, sizes = _segments(plan.groups(), plan.sample_hz)
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


def _moved(tracks: Sequence[Track], groups: Sequence[Group], imu: Imu) -> Moved:
    """Return the true motion of an upright head over all groups; its chip sits at (0, r, 0) in frame H.

    Specific force, upright: +g along x, -r φ̇² along y, r φ̈ along z.
    """

    def joined(name: str) -> Array:
        return np.concatenate([getattr(track, name) for track in tracks], axis=-1)

    rate, stretch, radius = joined("torsion_rate"), joined("stretch").T, imu.mount_radius.value
    pretension = np.array([g.pretension_mm * 1e-3 for g in groups])[:, None]
    force = np.empty((rate.size, 3))
    force[:, 0], force[:, 1] = STANDARD_GRAVITY, -radius * rate**2
    force[:, 2] = radius * joined("torsion_acceleration")
    return Moved(
        counts=np.array([track.torsion.size for track in tracks]),
        torsion=joined("torsion"),
        lever=joined("lever"),
        lever_rate=joined("lever_rate"),
        duty=joined("duty"),
        stretch=stretch,
        driven=np.broadcast_to(0.0, stretch.shape),
        at_rest=np.broadcast_to(pretension, (len(groups), stretch.shape[1])),
        gyro=_along(joined("gyro")),
        gyro_rate=_along(joined("gyro_rate")),
        spin=_along(rate),
        force=force,
        orientation=None,
    )


def _along(values: Array) -> Array:
    """Return vectors (sample, 3) along x; memory that holds their zeros is not touched."""
    vectors = np.zeros((3, values.size))
    vectors[0] = values
    return vectors.T
