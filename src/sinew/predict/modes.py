"""Modes of a joint in space: torsion, sway and what couples them, over pretension and bend.

Small motion about a rest pose, the lever locked to the head, frequencies with the silicone's storage at each mode's
own frequency. Guides hold in small swings and lose nothing; a stated swing of the head gives them the spring and the
loss of their fundamental at the torsion that the mode has in it. Stiffening of the tendons in that swing is not in it.

Shares of energy: with the potential energy ½ vᵀK v of a mode, a group g of coordinates has vᵀ_g (K v)_g of vᵀK v. As
K v = ω² M v, the share of the kinetic energy is the same; shares add up to one and may be a little below zero.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.result import Column, Field, Result, Rows, Table
from sinew.mechanics.parameters import CURRENT, POSITION, TENDON_MODES
from sinew.mechanics.rod import STRAINS, TERMS
from sinew.mechanics.space import Space
from sinew.plan.plan import TendonMode, swing_of_bend
from sinew.plan.rig import LIMIT_RESERVE_N, RigSpec, moments_of
from sinew.plan.toml import load_rig
from sinew.predict.band import draw_rigs, estimate_of_deviations
from sinew.predict.predicted import DrawsResult, refuse_pretensions
from sinew.solve.programs import configure
from sinew.solve.spatial import Linear, Mode, Rest, bend, hold, linear_equations, modes
from sinew.twin.parameters import space_from_rig

SHARES = ("torsion", "in_plane", "across", "axial")
"""Groups of coordinates whose energies are told apart; in_plane: bend and shear in the plane of the bend."""

KINDS = {"torsion": "torsion", "in_plane": "sway in plane", "across": "sway across", "axial": "axial"}
"""What a mode is called by its largest share."""

BELOW_HZ = 40.0
SWING_DEG = 10.0
_MIXED = 0.9
_SCAN_MM = 2.0
_LARGEST_BEND_DEG = 60.0
_NOTHING = 1e-9
"""Of the head's motion: what rounding makes of a direction in which it does not move."""

Progress = Callable[[float, float], None]


class SpaceMode(NamedTuple):
    """One mode. damping: Lehr's, for small swings. swung_hz, swung_damping: with guides that slip in the swing asked
    for. shares: of its energy, in the order of `SHARES`. torsion, tilt_in_plane, tilt_across: of the head, that
    across as `out_of_plane` reads it. shape: coordinates (18,) in which the largest rotation of the head is 1 rad."""

    frequency_hz: float
    damping: float
    swung_hz: float
    swung_damping: float
    shares: Array
    torsion: float
    tilt_in_plane: float
    tilt_across: float
    shape: Array

    @property
    def group(self) -> str:
        """Return the group with the largest share of its energy."""
        return SHARES[int(np.argmax(self.shares))]

    @property
    def kind(self) -> str:
        """Return what it is by its largest share, and that it is mixed where that is below nine tenths."""
        name = KINDS[self.group]
        return name if np.max(self.shares) >= _MIXED else f"{name}, mixed"

    @property
    def tilt_across_per_torsion(self) -> float:
        """Return how far the head tilts across the bend as it twists by one; NaN where it does not twist."""
        if abs(self.torsion) <= _NOTHING:
            return math.nan
        per = self.tilt_across / self.torsion
        return per if abs(per) > _NOTHING else 0.0


@dataclass(frozen=True)
class PoseModes:
    """The modes of one pose. why_not: why there are none; empty where there are. taut: whether all tendons are."""

    pretension_mm: float
    bend_deg: float
    tension_n: Array
    taut: bool
    modes: tuple[SpaceMode, ...]
    coordinates: Array
    why_not: str = ""

    def of(self, group: str) -> SpaceMode | None:
        """Return the slowest mode whose largest share is that group's; None where there is none."""
        return next((one for one in self.modes if one.group == group), None)

    def torsion_hz(self) -> float:
        """Return the frequency of the torsional mode [Hz], NaN where there is none."""
        found = self.of("torsion")
        return math.nan if found is None else found.frequency_hz


class ModesRequest(NamedTuple):
    """What is sought: pretensions [mm], bends and their azimuth [deg], mode of the motors, swing of the head [deg]."""

    pretension_mm: tuple[float, ...]
    bend_deg: tuple[float, ...]
    azimuth_deg: float = 0.0
    mode: TendonMode = "position"
    swing_deg: float = SWING_DEG


class Finder:
    """The modes of one rig at any pretension and bend, each found once; from the pose nearest to it.

    nearby: the finder of a rig whose poses are a start.
    """

    def __init__(self, rig: RigSpec, request: ModesRequest, nearby: "Finder | None" = None) -> None:
        configure()
        self.request, self.space = request, space_from_rig(rig)
        self.contact = rig.tendons.first_contact_tension.value
        self._nearby = nearby
        self._rests: dict[tuple[float, float], tuple[Space, Rest]] = {}
        self._found: dict[tuple[float, float], PoseModes] = {}
        self._linear: dict[tuple[float, float], tuple[Linear, Space]] = {}

    def rest(self, pretension_mm: float, bend_deg: float) -> tuple[Space, Rest]:
        """Return (parameters with motors that hold positions, rest pose)."""
        key = (float(pretension_mm), float(bend_deg))
        if key not in self._rests:
            angle = math.radians(bend_deg)
            tilt = angle * self.direction
            self._rests[key] = bend(self.space, self.contact, 1e-3 * pretension_mm, tilt, self._start(key))
        return self._rests[key]

    def _start(self, key: tuple[float, float]) -> Rest | None:
        known = self._rests if self._nearby is None else self._nearby._rests
        good = {at: one for at, (_, one) in known.items() if one.found}
        if not good:
            return None
        nearest = min(good, key=lambda at: abs(at[0] - key[0]) + abs(at[1] - key[1]))
        return good[nearest] if abs(nearest[1] - key[1]) < 5 or nearest[1] > 0 else None

    @property
    def direction(self) -> Array:
        """Return the axis about y and z of frame B of a bend towards the azimuth, (2,)."""
        return np.array(swing_of_bend(1.0, math.radians(self.request.azimuth_deg)))

    def linear(self, pretension_mm: float, bend_deg: float) -> tuple[Linear, Space]:
        """Return (linear equations, parameters in the mode asked for) at a pose. Raises SpecError without one."""
        key = (float(pretension_mm), float(bend_deg))
        if key not in self._linear:
            space, pose = self.rest(*key)
            if not pose.found:
                raise SpecError(
                    f"found no stable pose at {key[0]:g} mm and {key[1]:g}°, expected one; bend less, or change the "
                    "pretension"
                )
            mode = TENDON_MODES[self.request.mode]
            there = space if mode == POSITION else hold(space, pose, mode, 0 if mode == CURRENT else LIMIT_RESERVE_N)
            self._linear[key] = (linear_equations(pose.q, there), there)
        return self._linear[key]

    def at(self, pretension_mm: float, bend_deg: float) -> PoseModes:
        """Return the modes at a pose, or why there are none."""
        key = (float(pretension_mm), float(bend_deg))
        if key not in self._found:
            pose = self.rest(*key)[1]
            found: tuple[SpaceMode, ...] = ()
            why = ""
            try:
                linear, space = self.linear(*key)
                found = tuple(self._mode_of(one, linear, space, bend_deg) for one in modes(linear, space, BELOW_HZ))
            except SpecError as error:
                why = str(error)
            self._found[key] = PoseModes(*key, pose.at.tension, pose.taut, found, pose.q, why)
        return self._found[key]

    def _mode_of(self, mode: Mode, linear: Linear, space: Space, bend_deg: float) -> SpaceMode:
        omega = 2 * math.pi * mode.frequency_hz
        storage, _ = linear.stiffness(omega, space)
        shares = energy_shares(mode.shape, storage, self.direction)
        head = np.array([mode.torsion, *mode.tilt])
        size = float(np.linalg.norm(head))
        # The swing is of the head: its torsion is what the mode has of it.
        amplitude = math.radians(self.request.swing_deg) * abs(mode.torsion) / size
        spring, loss = space.rod.joint.guides.fundamental(float(linear.around.tension.sum()), np.asarray(amplitude))
        softer = omega**2 + (float(spring) - linear.guides) * mode.torsion**2
        damped = mode.damping * omega**2 + 0.5 * float(loss) * mode.torsion**2
        swung = math.sqrt(max(softer, 0.0))
        scaled = head * np.sign(head[np.argmax(np.abs(head))]) / size
        return SpaceMode(
            mode.frequency_hz,
            mode.damping,
            swung / (2 * math.pi),
            damped / swung**2 if swung > 0 else math.nan,
            shares,
            float(scaled[0]),
            float(scaled[1:] @ self.direction),
            float(scaled[1:] @ out_of_plane(self.direction, bend_deg)),
            mode.shape * np.sign(head[np.argmax(np.abs(head))]) / size,
        )


def across_of(direction: Array) -> Array:
    """Return the axis across that of a bend, about y and z of B, (2,): with x and the bend's axis a right-handed triad,
    so that it points away from where the head leans."""
    return np.array([-direction[1], direction[0]])


def out_of_plane(direction: Array, bend_deg: float) -> Array:
    """Return what makes of tilts about y and z of B how far the head's axis leans out of the plane of its bend, (2,).

    A swing by dα of that plane turns the head by β dα across it and leans its axis by sin β dα out of it, which is what
    recordings are read for (`measure.attitude.tilt_from`).
    """
    return across_of(direction) * float(np.sinc(bend_deg / 180))


def energy_shares(shape: Array, stiffness: Array, direction: Array) -> Array:
    """Return the shares of a mode's energy in the order of `SHARES`, (4,).

    shape (18,), stiffness (18, 18). direction: axis of the bend about y and z of B, (2,).
    """
    v, force = shape.reshape(len(STRAINS), TERMS), (stiffness @ shape).reshape(len(STRAINS), TERMS)
    along, across = direction, across_of(direction)

    def of(rows: Sequence[Array]) -> float:
        return sum(float((row @ v) @ (row @ force)) for row in rows)

    def row(first: int, pair: Array) -> Array:
        full = np.zeros(len(STRAINS))
        full[first : first + 2] = pair
        return full

    one = np.eye(len(STRAINS))
    shares = np.array(
        [
            of([one[0]]),
            # a bend about an axis goes with the shear across that axis
            of([row(1, along), row(4, across)]),
            of([row(1, across), row(4, along)]),
            of([one[3]]),
        ]
    )
    return np.asarray(shares / shares.sum())


@dataclass(frozen=True, repr=False)
class EnergyShares(Result):
    """Shares of a mode's energy, see `SHARES`."""

    torsion: Annotated[float, Field("torsion")]
    in_plane: Annotated[float, Field("in plane")]
    across: Annotated[float, Field("across")]
    axial: Annotated[float, Field("axial")]

    def cell(self) -> str:
        """Return them in percent, where a little less than nothing is nothing."""
        return " ".join(f"{100 * max(share, 0.0):.0f}" for share in vars(self).values())


@dataclass(frozen=True, repr=False)
class ModeRow(Result):
    """A mode with 90 % intervals, where something was drawn; swing: with guides that slip in the swing asked for.
    head: how it turns, its torsion and tilts, 1 in all."""

    pretension_mm: Annotated[float, Field("p")]
    bend_deg: Annotated[float, Field("bend")]
    kind: Annotated[str, Field("mode")]
    frequency_hz: Annotated[Estimate, Field("f", "interval")]
    ratio_to_torsion: Annotated[Estimate, Field("f/torsion")]
    damping_ratio: Annotated[Estimate, Field("D", unit="%")]
    swing_frequency_hz: Annotated[Estimate, Field("", "detail")]
    swing_damping_ratio: Annotated[Estimate, Field("D in the swing", unit="%")]
    tilt_across_per_torsion: Annotated[Estimate, Field("tilt across/torsion", "interval", unit="")]
    energy_shares: Annotated[EnergyShares, Field("energy/%", unit="")]
    head: Annotated[Mapping[str, float], Field("", "detail")]


_DRAWN = (
    "frequency_hz",
    "ratio_to_torsion",
    "damping_ratio",
    "swing_frequency_hz",
    "swing_damping_ratio",
    "tilt_across_per_torsion",
)
"""Numbers of a `ModeRow` that have intervals, in the order of `_numbers`."""


@dataclass(frozen=True, repr=False)
class PoseRow(Result):
    """The modes of one pose. why_not: why there are none."""

    pretension_mm: Annotated[float, Field("p")]
    bend_deg: Annotated[float, Field("bend")]
    tension_n: Column
    taut: Annotated[bool, Field("taut")]
    why_not: Annotated[str, Field("", "detail")]
    modes: Annotated[Rows[ModeRow], Field("", "detail")]


@dataclass(frozen=True, repr=False)
class Track(Result):
    """Modes of one bend over the rig's pretensions: frequencies and torsion's shares, a list for each pretension."""

    bend_deg: Annotated[float, Field("bend")]
    pretension_mm: Column
    frequency_hz: Annotated[tuple[tuple[float, ...], ...], Field("", "detail")]
    torsion_share: Annotated[tuple[tuple[float, ...], ...], Field("", "detail")]


@dataclass(frozen=True, repr=False)
class Modes(Result):
    """The modes of a rig over pretension and bend.

    spec: the rig. nominal: what the poses are of, in their order. scanned: by bend, over the rig's pretensions.
    """

    spec: RigSpec
    finder: Finder
    nominal: tuple[PoseModes, ...]
    scanned: dict[float, tuple[PoseModes, ...]]
    rig: Annotated[str, Field("", "detail")]
    mode: Annotated[str, Field("", "detail")]
    azimuth_deg: Annotated[float, Field("", "detail")]
    swing_deg: Annotated[float, Field("", "detail")]
    poses: Annotated[Rows[PoseRow], Field("", "detail")]
    tracks: Annotated[Rows[Track], Field("", "detail")]
    assumptions: Annotated[tuple[str, ...], Field("", "detail")]
    draws: Annotated[DrawsResult, Field("", "detail")]

    def blocks(self) -> list[Table | str]:
        """Return a row for each mode, why there are none, and what the intervals rest on."""
        groups = ", ".join(SHARES).replace("_", " ")
        title = f"modes, the lever locked to the head; energy in {groups}; swing {self.swing_deg:g}°"
        table = Rows(mode for pose in self.poses for mode in pose.modes).table(title)
        lines = [
            f"at {one.pretension_mm:g} mm and {one.bend_deg:g}° {one.why_not or 'a tendon is slack'}"
            for one in self.poses
            if one.why_not or not one.taut
        ]
        lines += [*self.assumptions, *self.draws.remarks]
        return [*([table] if table else []), *(f"- {one}" for one in lines)]


def _numbers(pose: PoseModes, index: int) -> Array:
    """Return the numbers of a mode that have intervals, in the order of `_DRAWN`."""
    mode = pose.modes[index]
    ratio = mode.frequency_hz / pose.torsion_hz()
    return np.array(
        [mode.frequency_hz, ratio, mode.damping, mode.swung_hz, mode.swung_damping, mode.tilt_across_per_torsion]
    )


def _pose_row(pose: PoseModes, off: Sequence[Sequence[Array]]) -> PoseRow:
    """Return the row of a pose. off: for each mode, by how much those of the draws are off, see `_DRAWN`."""
    rows = []
    for i, mode in enumerate(pose.modes):
        apart = np.array(off[i]).reshape(-1, len(_DRAWN))
        estimates: dict[str, Any] = {}
        for name, value, column in zip(_DRAWN, _numbers(pose, i).tolist(), apart.T, strict=True):
            one = estimate_of_deviations(value, column[np.isfinite(column)])
            # A few draws may all lie on one side of the value.
            estimates[name] = Estimate(value, one.std, min(one.low, value), max(one.high, value))
        head = {name: getattr(mode, name) for name in ("torsion", "tilt_in_plane", "tilt_across")}
        shares = EnergyShares(*map(float, mode.shares))
        key = (pose.pretension_mm, pose.bend_deg, mode.kind)
        rows.append(ModeRow(*key, **estimates, energy_shares=shares, head=head))
    return PoseRow(pose.pretension_mm, pose.bend_deg, pose.tension_n, pose.taut, pose.why_not, Rows(rows))


# What is assumed is drawn.


def draw_spatial(rig: RigSpec, count: int, seed: int) -> tuple[list[RigSpec], tuple[str, ...], tuple[str, ...]]:
    """Return (drawn rigs, names of the parameters that vary, sentences on them).

    Assumed masses, heights and moments, on which the torsion of a straight joint does not depend: as often below as
    above the value, evenly to the bound there. The head's moment across is at least half of that along the axis, as of
    any body; a head with less mass than its lever is drawn again.
    What a calibration told, as it told it; without one, silicone and tendons stay at their values, for drawn one by one
    they would contradict the torsion that they were calibrated to.
    """
    table = dict(rig.parameters())
    varied = [
        name
        for name, one in table.items()
        if one.origin == "assumed"
        and one.bounds[0] < one.bounds[1]
        and (name.startswith("space.") or name == "inertia.head_mass")
    ]
    remarks = [
        f"drawn to both sides of their values, evenly to their bounds, as no more is known: {', '.join(varied)}; a "
        "bench that weighs its head narrows the intervals"
    ]
    known = rig.calibration is not None or any(one.interval90 is not None for one in table.values())
    bases, names = [rig] * count, tuple(varied)
    if known:
        drawn = draw_rigs(rig, count, seed)
        bases, names = list(drawn.rigs), (*drawn.names, *varied)
        remarks += drawn.remarks
    else:
        remarks.append(
            f"the rig {rig.name} holds no intervals: silicone, tendons and guides are held at their values, as "
            "calibrated together to the torsion of the straight joint"
        )
    rng = np.random.default_rng((seed, 1))
    rigs = []
    for base in bases:
        now = {name: one.value for name, one in base.parameters()}
        for _ in range(1000):
            values = {}
            for name in varied:
                low, high = table[name].bounds
                if name == "space.head_across":
                    low = min(max(low, 0.5 * now["inertia.head"]), now[name])
                values[name] = float(
                    rng.uniform(low, now[name]) if rng.random() < 0.5 else rng.uniform(now[name], high)
                )
            if (now | values)["space.lever_mass"] < (now | values)["inertia.head_mass"]:
                break
        rigs.append(base.with_values(values))
    return rigs, names, tuple(remarks)


def _matched(pose: PoseModes, other: PoseModes) -> list[int | None]:
    """Return for each mode of a pose the one of the same pose of another rig that is most like it; None where
    that has no modes."""
    found: list[int | None] = []
    for mode in pose.modes:
        alike = [_likeness(mode, one) for one in other.modes]
        found.append(int(np.argmax(alike)) if alike else None)
    return found


def _likeness(one: SpaceMode, other: SpaceMode) -> float:
    """Return how alike two modes are by their shares and the sequence of their shapes, 0 to 1."""
    a, b = one.shape / np.linalg.norm(one.shape), other.shape / np.linalg.norm(other.shape)
    return float(abs(a @ b) + one.shares @ other.shares)


def find_modes(
    rig: RigSpec | str | Path,
    pretension_mm: float | Sequence[float] = (0.0, 6.0, 12.0),
    *,
    bend_deg: float | Sequence[float] = (0.0, 10.0, 20.0, 30.0),
    azimuth_deg: float = 0.0,
    mode: TendonMode = "position",
    swing_deg: float = SWING_DEG,
    bands: int = 0,
    seed: int = 0,
    progress: Progress | None = None,
) -> Modes:
    """Return the modes of a rig's joint in space at pretensions and bends of the head.

    rig: as such, the path of its TOML file, or the name of a shipped one; it needs a [space]. pretension_mm, bend_deg:
    modes for each pair. azimuth_deg: direction of the bend, from y towards z. mode: of the tendon motors, which hold
    positions until the pose is reached. swing_deg: of the head, at which guides slip. bands: draws of what is assumed,
    for 90 % intervals; seed: of them. progress: called with (done, total) rigs.
    Raises SpecError where the rig does not allow what is asked.
    """
    made = rig if isinstance(rig, RigSpec) else load_rig(rig)
    request = ModesRequest(
        tuple(float(x) for x in np.atleast_1d(pretension_mm)),
        tuple(float(x) for x in np.atleast_1d(bend_deg)),
        azimuth_deg,
        mode,
        swing_deg,
    )
    refuse_pretensions(made, request.pretension_mm)
    for angle in request.bend_deg:
        if not 0 <= angle <= _LARGEST_BEND_DEG:
            raise SpecError(f"a bend is {angle:g}°, expected 0 to {_LARGEST_BEND_DEG:g}°; turn it with the azimuth")
    if bands == 1:
        raise SpecError("found 1 draw, expected none or at least 2, for an interval")
    finder = Finder(made, request)
    nominal = tuple(finder.at(p, b) for b in request.bend_deg for p in request.pretension_mm)
    low, high = made.limits.pretension_mm
    scan = np.linspace(low, high, max(3, round((high - low) / _SCAN_MM) + 1)).tolist()
    scanned = {b: tuple(finder.at(p, b) for p in scan) for b in request.bend_deg}
    rigs, names, remarks = draw_spatial(made, bands, seed) if bands else ([], (), ())
    off: list[list[list[Array]]] = [[[] for _ in pose.modes] for pose in nominal]
    for done, rig_drawn in enumerate(rigs):
        drawn = Finder(rig_drawn, request, finder)
        for pose, deviations in zip(nominal, off, strict=True):
            there = drawn.at(pose.pretension_mm, pose.bend_deg)
            for i, j in enumerate(_matched(pose, there)):
                if j is not None:
                    deviations[i].append(_numbers(there, j) - _numbers(pose, i))
        if progress is not None:
            progress(done + 1, len(rigs))
    tracks = [
        Track(
            bend,
            np.array(scan),
            tuple(tuple(mode.frequency_hz for mode in one.modes) for one in track),
            tuple(tuple(float(mode.shares[0]) for mode in one.modes) for one in track),
        )
        for bend, track in scanned.items()
    ]
    return Modes(
        made,
        finder,
        nominal,
        scanned,
        made.name,
        mode,
        azimuth_deg,
        swing_deg,
        Rows(_pose_row(pose, deviations) for pose, deviations in zip(nominal, off, strict=True)),
        Rows(tracks),
        tuple(moments_of(made).assumptions),
        DrawsResult(len(rigs), seed, names, remarks),
    )
