"""Modes of a joint in space: torsion, sway and what couples them, over pretension and bend.

Small motion about a rest pose, the lever locked to the head, frequencies with the silicone's storage at each mode's
own frequency. Guides hold in small swings and lose nothing; a stated swing of the head gives them the spring and the
loss of their fundamental at the torsion that the mode has in it. Stiffening of the tendons in that swing is not in it.

Shares of energy: with the potential energy ½ vᵀK v of a mode, a group g of coordinates has vᵀ_g (K v)_g of vᵀK v. As
K v = ω² M v, the share of the kinetic energy is the same; shares add up to one and may be a little below zero.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, minimize_scalar

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate, fixed, number
from sinew.measure.told import Table, Told
from sinew.mechanics.parameters import CURRENT, POSITION, TENDON_MODES
from sinew.mechanics.rod import STRAINS, TERMS
from sinew.mechanics.space import Space
from sinew.plan.plan import TendonMode
from sinew.plan.pose import swing_of_bend
from sinew.plan.rig import LIMIT_RESERVE_N, RigSpec, moments_of
from sinew.plan.toml import load_rig
from sinew.predict.band import draw_rigs, estimate_of_deviations
from sinew.predict.predicted import refuse_pretensions
from sinew.solve.programs import configure
from sinew.solve.spatial import Linear, Mode, Rest, bend, hold, linear_equations, modes
from sinew.twin.parameters import space_from_rig

SHARES = ("torsion", "in_plane", "across", "axial")
"""Groups of coordinates whose energies are told apart; in_plane: bend and shear in the plane of the bend."""

KINDS = {"torsion": "torsion", "in_plane": "sway in plane", "across": "sway across", "axial": "axial"}
"""What a mode is called by its largest share."""

BELOW_HZ = 40.0
SWING_DEG = 10.0
RATIOS = (1.0, 2.0)
"""Ratios of sway to torsion at which the two resonate with each other: equal, and sway at the double frequency, that
the square of the torsion excites."""

_MIXED = 0.9
_SCAN_MM = 2.0
_NEAR = 0.25
_OFF = 0.01
"""How far a ratio may be off where the search says that it is met; a jump is further."""

_LARGEST_BEND_DEG = 60.0
_NOTHING = 1e-9
"""Of the head's motion: what rounding makes of a direction in which it does not move."""

Progress = Callable[[float, float], None]


class FoundMode(NamedTuple):
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
    modes: tuple[FoundMode, ...]
    coordinates: Array
    why_not: str = ""

    def of(self, group: str) -> FoundMode | None:
        """Return the slowest mode whose largest share is that group's; None where there is none."""
        return next((one for one in self.modes if one.group == group), None)

    def torsion_hz(self, *, swung: bool = False) -> float:
        """Return the frequency of the torsional mode [Hz], NaN where there is none."""
        found = self.of("torsion")
        return math.nan if found is None else found.swung_hz if swung else found.frequency_hz

    def ratio(self, group: str, *, swung: bool = False) -> float:
        """Return the frequency of a sway over that of the torsion; NaN where either is missing."""
        sway = self.of(group)
        return math.nan if sway is None else sway.frequency_hz / self.torsion_hz(swung=swung)


class Condition(NamedTuple):
    """Where a sway has a ratio to the torsion. pretension_mm and frequency_hz of the torsion: of small swings;
    swung_mm: with the torsion's frequency in the swing. NaN where it is not met up to the rig's limit; ends: ratio at
    the least and at the largest pretension; steps: it jumps over the condition there, as a tendon goes slack."""

    ratio: float
    group: str
    bend_deg: float
    pretension_mm: Estimate
    frequency_hz: Estimate
    swung_mm: float
    ends: tuple[float, float]
    steps: bool

    @property
    def is_near(self) -> bool:
        """Return whether it is met, or as good as: a sway three times as fast says nothing of 1:1."""
        met = math.isfinite(self.pretension_mm.value)
        return met or min(abs(x / self.ratio - 1) for x in self.ends if math.isfinite(x)) < _NEAR


class Veering(NamedTuple):
    """Closest approach of two neighbouring modes that exchange their shapes over pretension: where, how far apart, and
    how much of the torsion's energy the one that has less of it has there; both zero where they cross."""

    bend_deg: float
    kinds: tuple[str, str]
    pretension_mm: float
    frequency_hz: float
    gap_hz: float
    mixing: float


class Asked(NamedTuple):
    """What was asked: pretensions [mm], bends and their azimuth [deg], mode of the motors, swing of the head [deg]."""

    pretension_mm: tuple[float, ...]
    bend_deg: tuple[float, ...]
    azimuth_deg: float = 0.0
    mode: TendonMode = "position"
    swing_deg: float = SWING_DEG


class Finder:
    """The modes of one rig at any pretension and bend, each found once; from the pose nearest to it.

    nearby: the finder of a rig whose poses are a start.
    """

    def __init__(self, rig: RigSpec, asked: Asked, nearby: "Finder | None" = None) -> None:
        configure()
        self.asked, self.space = asked, space_from_rig(rig)
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
        return np.array(swing_of_bend(1.0, math.radians(self.asked.azimuth_deg)))

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
            mode = TENDON_MODES[self.asked.mode]
            there = space if mode == POSITION else hold(space, pose, mode, 0 if mode == CURRENT else LIMIT_RESERVE_N)
            self._linear[key] = (linear_equations(pose.q, there), there)
        return self._linear[key]

    def at(self, pretension_mm: float, bend_deg: float) -> PoseModes:
        """Return the modes at a pose, or why there are none."""
        key = (float(pretension_mm), float(bend_deg))
        if key not in self._found:
            pose = self.rest(*key)[1]
            found: tuple[FoundMode, ...] = ()
            why = ""
            try:
                linear, space = self.linear(*key)
                found = tuple(self._told(one, linear, space, bend_deg) for one in modes(linear, space, BELOW_HZ))
            except SpecError as error:
                why = str(error)
            self._found[key] = PoseModes(*key, pose.at.tension, pose.taut, found, pose.q, why)
        return self._found[key]

    def _told(self, mode: Mode, linear: Linear, space: Space, bend_deg: float) -> FoundMode:
        omega = 2 * math.pi * mode.frequency_hz
        storage, _ = linear.stiffness(omega, space)
        shares = energy_shares(mode.shape, storage, self.direction)
        head = np.array([mode.torsion, *mode.tilt])
        size = float(np.linalg.norm(head))
        # The swing is of the head: its torsion is what the mode has of it.
        amplitude = math.radians(self.asked.swing_deg) * abs(mode.torsion) / size
        spring, loss = space.rod.joint.guides.fundamental(float(linear.around.tension.sum()), np.asarray(amplitude))
        softer = omega**2 + (float(spring) - linear.guides) * mode.torsion**2
        damped = mode.damping * omega**2 + 0.5 * float(loss) * mode.torsion**2
        swung = math.sqrt(max(softer, 0.0))
        scaled = head * np.sign(head[np.argmax(np.abs(head))]) / size
        return FoundMode(
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
class Modes(Told):
    """The modes of a rig over pretension and bend.

    poses: those asked for. tracks: for each bend, poses over the rig's pretensions. conditions, veerings: see there.
    drawn: for each pose and each of its modes the intervals (frequency, damping, swung damping, ratio to torsion), from
    draws; empty without. names: parameters that were drawn; remarks: on them.
    """

    rig: RigSpec
    asked: Asked
    finder: Finder
    poses: tuple[PoseModes, ...]
    tracks: dict[float, tuple[PoseModes, ...]]
    conditions: tuple[Condition, ...]
    veerings: tuple[Veering, ...]
    draws: int = 0
    names: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    drawn: dict[tuple[float, float], list[dict[str, Estimate]]] = field(default_factory=dict)

    def estimates(self, pose: PoseModes, index: int) -> dict[str, Estimate]:
        """Return frequency, damping and ratio of a mode with their intervals."""
        known = self.drawn.get((pose.pretension_mm, pose.bend_deg))
        if known is not None:
            return known[index]
        return {name: _certain(value) for name, value in _numbers(pose, index).items()}

    def document(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        asked = self.asked
        return {
            "rig": self.rig.name,
            "mode": asked.mode,
            "azimuth_deg": asked.azimuth_deg,
            "swing_deg": asked.swing_deg,
            "poses": [self._pose(one) for one in self.poses],
            "tracks": [
                {
                    "bend_deg": bend_deg,
                    "pretension_mm": [one.pretension_mm for one in track],
                    "frequency_hz": [[mode.frequency_hz for mode in one.modes] for one in track],
                    "torsion_share": [[float(mode.shares[0]) for mode in one.modes] for one in track],
                }
                for bend_deg, track in self.tracks.items()
            ],
            "conditions": [
                {
                    "sway": KINDS[one.group],
                    "ratio": one.ratio,
                    "bend_deg": one.bend_deg,
                    "is_met": math.isfinite(one.pretension_mm.value) and not one.steps,
                    "jumps_over_it": one.steps,
                    "pretension_mm": one.pretension_mm.to_json(),
                    "torsion_frequency_hz": one.frequency_hz.to_json(),
                    "pretension_in_swing_mm": _finite(one.swung_mm),
                    "ratio_at_ends": [_finite(x) for x in one.ends],
                }
                for one in self.conditions
            ],
            "veering": [{**one._asdict(), "kinds": list(one.kinds)} for one in self.veerings],
            "assumptions": list(moments_of(self.rig).assumptions),
            "draws": {"count": self.draws, "parameters": list(self.names), "remarks": list(self.remarks)},
        }

    def _pose(self, pose: PoseModes) -> dict[str, Any]:
        rows = []
        for i, mode in enumerate(pose.modes):
            told = self.estimates(pose, i)
            rows.append(
                {
                    "kind": mode.kind,
                    "frequency_hz": told["frequency_hz"].to_json(),
                    "damping_ratio": told["damping_ratio"].to_json(),
                    "swing_frequency_hz": told["swing_frequency_hz"].to_json(),
                    "swing_damping_ratio": told["swing_damping_ratio"].to_json(),
                    "ratio_to_torsion": told["ratio_to_torsion"].to_json(),
                    "energy_shares": dict(zip(SHARES, map(float, mode.shares), strict=True)),
                    "head": {
                        "torsion": mode.torsion,
                        "tilt_in_plane": mode.tilt_in_plane,
                        "tilt_across": mode.tilt_across,
                    },
                    "tilt_across_per_torsion": told["tilt_across_per_torsion"].to_json(),
                }
            )
        return {
            "pretension_mm": pose.pretension_mm,
            "bend_deg": pose.bend_deg,
            "tension_n": pose.tension_n.tolist(),
            "taut": pose.taut,
            "why_not": pose.why_not,
            "modes": rows,
        }

    def told(self) -> list[Table | str]:
        """Return a row for each mode, what the head does in the torsional ones, what is met over pretension, and what
        the intervals rest on."""
        rows, twists = [], []
        for pose in self.poses:
            place = (f"{pose.pretension_mm:g}", f"{pose.bend_deg:g}" + ("" if pose.taut else " slack"))
            for i, mode in enumerate(pose.modes):
                told = self.estimates(pose, i)
                rows.append(
                    (
                        *place,
                        KINDS[mode.group],
                        told["frequency_hz"].shown_interval(),
                        number(told["ratio_to_torsion"].value, 3),
                        fixed(100 * told["damping_ratio"].value, 1),
                        fixed(100 * told["swing_damping_ratio"].value, 1),
                        " ".join(f"{100 * share:.0f}" for share in _shown_shares(mode.shares)),
                    )
                )
                if mode.group == "torsion":
                    per = told["tilt_across_per_torsion"]
                    even = 0.5 * math.sin(math.radians(pose.bend_deg))
                    shown = per.shown_interval() if per.high > per.low else number(per.value)
                    twists.append((*place, shown, fixed(even, 3)))
        swung = f"D/% at {self.asked.swing_deg:g}°"
        columns = ("p/mm", "bend/°", "mode", "f/Hz", "f/torsion", "D/%", swung, "energy/%")
        told_: list[Table | str] = [
            Table(columns, rows, "modes, the lever locked to the head; energy in torsion, in plane, across, axial")
        ]
        if any(self.asked.bend_deg):
            head = ("p/mm", "bend/°", "tilt across/torsion", "½ sin β")
            told_.append(Table(head, twists, "the head in torsional modes; ½ sin β: slowly, evenly twisted"))
        told_ += [
            f"- at {one.pretension_mm:g} mm and {one.bend_deg:g}° {one.why_not}" for one in self.poses if one.why_not
        ]
        told_ += [f"- {sentence_of(one, self.rig)}" for one in self.conditions if one.is_near]
        told_ += [f"- {_veering_sentence(one)}" for one in self.veerings]
        told_ += [f"- {one}" for one in (*moments_of(self.rig).assumptions, *self.remarks)]
        return told_


def _shown_shares(shares: Array) -> Array:
    """Return shares for a table, where a little less than nothing is nothing."""
    positive = np.maximum(shares, 0.0)
    return np.asarray(positive / positive.sum())


def sentence_of(one: Condition, rig: RigSpec) -> str:
    """Return where a condition is met, or between what the ratio stays."""
    sway = f"{KINDS[one.group]} at {one.bend_deg:g}°"
    if not math.isfinite(one.pretension_mm.value):
        low, high = rig.limits.pretension_mm
        drawn = one.pretension_mm
        where = f"; draws meet it at {number(drawn.low, 3)} to {number(drawn.high, 3)} mm (90 %)"
        return (
            f"{sway}: {one.ratio:g}:1 is not met from {low:g} to {high:g} mm, the ratio goes from "
            f"{number(one.ends[0], 3)} to {number(one.ends[1], 3)}{where if math.isfinite(drawn.low) else ''}"
        )
    if one.steps:
        return (
            f"{sway}: the ratio jumps over {one.ratio:g}:1 at {number(one.pretension_mm.value, 3, 'mm')}, "
            "where a tendon goes slack"
        )
    swung = f", in the swing at {one.swung_mm:.3g} mm" if math.isfinite(one.swung_mm) else ""
    return (
        f"{sway}: {one.ratio:g}:1 at {one.pretension_mm.shown_interval('mm')}, torsion at "
        f"{one.frequency_hz.shown_interval('Hz')}{swung}"
    )


def _veering_sentence(one: Veering) -> str:
    where = f"{one.pretension_mm:.3g} mm and {one.bend_deg:g}°, {one.frequency_hz:.4g} Hz"
    if one.gap_hz == 0:
        return f"{one.kinds[0]} and {one.kinds[1]} cross at {where}, and do not mix"
    return (
        f"{one.kinds[0]} and {one.kinds[1]} come within {one.gap_hz:.2g} Hz at {where}; the one with less of the "
        f"torsion has {100 * one.mixing:.2g} % of its energy in it"
    )


def _certain(value: float) -> Estimate:
    return Estimate(value, math.nan, math.nan, math.nan)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _numbers(pose: PoseModes, index: int) -> dict[str, float]:
    mode = pose.modes[index]
    torsion = pose.torsion_hz()
    return {
        "frequency_hz": mode.frequency_hz,
        "damping_ratio": mode.damping,
        "swing_frequency_hz": mode.swung_hz,
        "swing_damping_ratio": mode.swung_damping,
        "ratio_to_torsion": mode.frequency_hz / torsion,
        "tilt_across_per_torsion": mode.tilt_across_per_torsion,
    }


# Crossings and closest approaches over pretension.


def scan_of(rig: RigSpec) -> tuple[float, ...]:
    """Return the pretensions [mm] over which ratios are sought, to the rig's limit."""
    low, high = rig.limits.pretension_mm
    return tuple(np.linspace(low, high, max(3, round((high - low) / _SCAN_MM) + 1)).tolist())


def _crossing(track: Sequence[PoseModes], at: Callable[[float], float], wanted: float) -> tuple[float, bool]:
    """Return (pretension [mm] where a ratio is first met, whether it only jumps over it); NaN where neither.

    A tendon that goes slack makes the ratio jump: then there is no pretension at which it is met.
    """
    ratios = [at(one.pretension_mm) for one in track]
    jump = math.nan
    for i in range(len(track) - 1):
        a, b = ratios[i] - wanted, ratios[i + 1] - wanted
        if not (math.isfinite(a * b) and a * b <= 0):
            continue
        low, high = track[i].pretension_mm, track[i + 1].pretension_mm
        try:
            where = low if a == 0 else float(brentq(lambda p: at(p) - wanted, low, high, xtol=1e-3))
        except ValueError:  # modes that veer: between them neither is the torsion
            continue
        if abs(at(where) - wanted) < _OFF:
            return where, False
        slack = [one.tension_n > 0 for one in track[i : i + 2]]
        if math.isnan(jump) and np.any(slack[0] != slack[1]):
            jump = where
    return jump, math.isfinite(jump)


def _conditions(finder: Finder, tracks: dict[float, tuple[PoseModes, ...]]) -> tuple[Condition, ...]:
    found = []
    for bend_deg, track in tracks.items():
        for group in ("in_plane", "across"):
            for wanted in RATIOS:

                def ratio(p: float, bend_deg: float = bend_deg, group: str = group) -> float:
                    return finder.at(p, bend_deg).ratio(group)

                def swung(p: float, bend_deg: float = bend_deg, group: str = group) -> float:
                    return finder.at(p, bend_deg).ratio(group, swung=True)

                where, steps = _crossing(track, ratio, wanted)
                hz = finder.at(where, bend_deg).torsion_hz() if math.isfinite(where) else math.nan
                in_swing, jumps = _crossing(track, swung, wanted)
                span = ratio(track[0].pretension_mm), ratio(track[-1].pretension_mm)
                in_swing = math.nan if jumps else in_swing
                found.append(Condition(wanted, group, bend_deg, _certain(where), _certain(hz), in_swing, span, steps))
    return tuple(found)


_WHERE_MM = 1e-3
"""To which a closest approach is sought."""
_FAR = 2.0
"""How many half widths g/s off a closest approach two modes are held against each other: there they have turned into
one another by 90° - atan(1/2) = 63° where they veer, and by nothing where they only come near."""


def _veerings(finder: Finder, tracks: dict[float, tuple[PoseModes, ...]]) -> tuple[Veering, ...]:
    """Return where neighbouring modes of which one is the torsion exchange their shapes, veering or crossing.

    Two modes that couple have the gap √(g² + s²(p - p_0)²) over the pretension p: g is what is left at p_0, s the slope
    at which they would cross without coupling, g/s the half width in which they mix. They are said to exchange where
    the lower one before is more like the upper one behind than like the lower one; to cross where g is not resolved.
    """
    found = []
    for bend_deg, track in tracks.items():
        count = min(len(one.modes) for one in track)
        for i in range(count - 1):

            def gap(p: float, i: int = i, bend_deg: float = bend_deg) -> float:
                here = finder.at(p, bend_deg).modes
                return here[i + 1].frequency_hz - here[i].frequency_hz if len(here) > i + 1 else math.inf

            gaps = [gap(one.pretension_mm) for one in track]
            k = int(np.argmin(gaps))
            if k in (0, len(track) - 1):
                continue
            near = track[k - 1 : k + 2]
            if any(np.any((one.tension_n > 0) != (near[0].tension_n > 0)) for one in near):
                continue  # a tendon goes slack between them: a jump
            if not any(mode.group == "torsion" for one in near for mode in one.modes[i : i + 2]):
                continue
            bounds = (near[0].pretension_mm, near[-1].pretension_mm)
            where = float(minimize_scalar(gap, bounds=bounds, method="bounded", options={"xatol": _WHERE_MM}).x)
            least = gap(where)
            sides = [(gaps[j], track[j].pretension_mm - where) for j in (k - 1, k + 1)]
            slope = math.sqrt(max(float(np.mean([(g**2 - least**2) / off**2 for g, off in sides])), 0.0))
            half = least / slope if slope > 0 else math.inf
            before = next((one for one in reversed(track) if one.pretension_mm <= where - _FAR * half), track[0])
            behind = next((one for one in track if one.pretension_mm >= where + _FAR * half), track[-1])
            lower = before.modes[i]
            stays, exchanges = (_assurance(lower, behind.modes[j]) for j in (i, i + 1))
            if exchanges < stays:
                continue
            pair = finder.at(where, bend_deg).modes[i : i + 2]
            crosses = least <= 2 * slope * _WHERE_MM
            found.append(
                Veering(
                    bend_deg,
                    (lower.kind, before.modes[i + 1].kind),
                    where,
                    pair[0].frequency_hz,
                    0.0 if crosses else least,
                    0.0 if crosses else max(min(float(one.shares[0]) for one in pair), 0.0),
                )
            )
    return tuple(found)


def _assurance(one: FoundMode, other: FoundMode) -> float:
    """Return the modal assurance of two shapes: the squared cosine between them, 0 to 1."""
    cosine = one.shape @ other.shape / (np.linalg.norm(one.shape) * np.linalg.norm(other.shape))
    return float(cosine**2)


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


def _likeness(one: FoundMode, other: FoundMode) -> float:
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
    asked = Asked(
        tuple(float(x) for x in np.atleast_1d(pretension_mm)),
        tuple(float(x) for x in np.atleast_1d(bend_deg)),
        azimuth_deg,
        mode,
        swing_deg,
    )
    refuse_pretensions(made, asked.pretension_mm)
    for angle in asked.bend_deg:
        if not 0 <= angle <= _LARGEST_BEND_DEG:
            raise SpecError(f"a bend is {angle:g}°, expected 0 to {_LARGEST_BEND_DEG:g}°; turn it with the azimuth")
    if bands == 1:
        raise SpecError("found 1 draw, expected none or at least 2, for an interval")
    finder = Finder(made, asked)
    poses = tuple(finder.at(p, b) for b in asked.bend_deg for p in asked.pretension_mm)
    scan = scan_of(made)
    tracks = {b: tuple(finder.at(p, b) for p in scan) for b in asked.bend_deg}
    conditions, veerings = _conditions(finder, tracks), _veerings(finder, tracks)
    nominal = Modes(made, asked, finder, poses, tracks, conditions, veerings)
    return nominal if bands == 0 else _with_bands(nominal, bands, seed, progress)


def _with_bands(nominal: Modes, bands: int, seed: int, progress: Progress | None) -> Modes:
    rigs, names, remarks = draw_spatial(nominal.rig, bands, seed)
    places = [(one.pretension_mm, one.bend_deg) for one in nominal.poses]
    off: list[list[dict[str, list[float]]]] = [[{} for _ in pose.modes] for pose in nominal.poses]
    met: dict[int, list[tuple[float, float]]] = {i: [] for i in range(len(nominal.conditions))}
    straight = [i for i, one in enumerate(nominal.conditions) if one.bend_deg == 0]
    for done, rig in enumerate(rigs):
        finder = Finder(rig, nominal.asked, nominal.finder)
        for k, place in enumerate(places):
            pose, there = nominal.poses[k], finder.at(*place)
            for i, j in enumerate(_matched(pose, there)):
                if j is None:
                    continue
                here = _numbers(pose, i)
                for name, value in _numbers(there, j).items():
                    if math.isfinite(value) and math.isfinite(here[name]):
                        off[k][i].setdefault(name, []).append(value - here[name])
        for i in straight:
            met[i].append(_interpolated(finder, nominal, nominal.conditions[i]))
        if progress is not None:
            progress(done + 1, len(rigs))
    drawn = {
        place: [
            {
                name: _reaching(estimate_of_deviations(value, np.array(off[k][i].get(name, []))))
                for name, value in _numbers(nominal.poses[k], i).items()
            }
            for i in range(len(nominal.poses[k].modes))
        ]
        for k, place in enumerate(places)
    }
    told = list(remarks)
    conditions = list(nominal.conditions)
    for i in straight:
        one = conditions[i]
        where = np.array([x for x in met[i] if math.isfinite(x[0])]).reshape(-1, 2)
        if math.isnan(one.pretension_mm.value) and len(where) > 1:
            off_mm, off_hz = (estimate_of_deviations(0.0, where[:, k]) for k in (0, 1))
            nan = math.nan
            conditions[i] = one._replace(
                pretension_mm=Estimate(nan, off_mm.std, off_mm.low, off_mm.high),
                frequency_hz=Estimate(nan, off_hz.std, off_hz.low, off_hz.high),
            )
        elif len(where):
            conditions[i] = one._replace(
                pretension_mm=_reaching(
                    estimate_of_deviations(one.pretension_mm.value, where[:, 0] - one.pretension_mm.value)
                ),
                frequency_hz=_reaching(
                    estimate_of_deviations(one.frequency_hz.value, where[:, 1] - one.frequency_hz.value)
                ),
            )
        if len(met[i]) and (len(where) or math.isfinite(one.pretension_mm.value)):
            told.append(
                f"{KINDS[one.group]}, straight: {len(where)} of {len(met[i])} draws meet {one.ratio:g}:1 within the "
                "rig's pretensions; the interval is theirs"
            )
    return Modes(
        nominal.rig,
        nominal.asked,
        nominal.finder,
        nominal.poses,
        nominal.tracks,
        tuple(conditions),
        nominal.veerings,
        len(rigs),
        names,
        tuple(told),
        drawn,
    )


def _reaching(one: Estimate) -> Estimate:
    """Return an estimate whose interval reaches to its value at least, which a few draws may all miss on one side."""
    return Estimate(one.value, one.std, min(one.low, one.value), max(one.high, one.value))


_FEW = 5


def _interpolated(finder: Finder, nominal: Modes, condition: Condition) -> tuple[float, float]:
    """Return (pretension [mm], frequency of the torsion [Hz]) where a draw meets a condition, straight: through five
    pretensions; NaN where it does not."""
    scan = np.linspace(*nominal.rig.limits.pretension_mm, _FEW)
    poses = [finder.at(float(p), 0.0) for p in scan]
    ratio = np.array([one.ratio(condition.group) for one in poses])
    torsion = np.array([one.torsion_hz() for one in poses])
    good = np.isfinite(ratio) & np.isfinite(torsion)
    if good.sum() < 2:
        return math.nan, math.nan
    curve, hz = PchipInterpolator(scan[good], ratio[good]), PchipInterpolator(scan[good], torsion[good])
    roots = [x for x in curve.solve(condition.ratio, extrapolate=False) if math.isfinite(x)]
    return (float(roots[0]), float(hz(roots[0]))) if roots else (math.nan, math.nan)
