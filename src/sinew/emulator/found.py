"""The bench as a master finds it, slack tendons and a tilted head, all compiled that a first answer waits for."""

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sinew.emulator.faults import Faults, FaultSpec, FaultyRig
from sinew.emulator.plant import Plant, Unloaded
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.registers import BAUD_RATES
from sinew.measure.errors import PortError, SpecError
from sinew.plan.rig import Axis, RigSpec, Wiring
from sinew.plan.servo import PULSE

# ---- a bench before it is set up: what is wired or set wrongly, drawn from a seed, and the hands that put it right
#
# What people call tendon 1 is what the motor's label says; which tendon its cable is on the mechanics know. So the
# mechanics stay as they are, and ids, bauds, senses and the sensor's mounting are drawn around them. The hands plug the
# motors in and out by what people call them, and turn the lever to its middle, as far as an eye can tell.


KINDS: Mapping[str, str] = {
    "new": "every motor with id 1 and 57600 baud, none plugged in",
    "ids": "ids in any order",
    "double": "two motors with one id",
    "baud": "some motors at other bauds",
    "tendons": "the motors of two tendons swapped",
    "pulls": "some pulleys wound the other way round",
    "lever": "the lever's motor the other way round",
    "zero": "the lever's middle elsewhere on its encoder",
    "board": "the board with the sensor turned",
}
"""What may be wrong, as a user writes it and as it is told."""

ALL = ("new", "tendons", "pulls", "lever", "zero", "board")
"""What the word `all` stands for: a rig out of its boxes, put together by somebody in a hurry."""

EYE = math.radians(0.5)
"""How well a hand turns the lever to its middle, standard deviation [rad]; assumed."""

_NEW_ID, _NEW_BAUD = 1, 57_600
_ZEROS = (1100, 2990)  # so that a window of 90° either way is within the encoder's turn
_AT_REST = math.radians(60)
_MOST_ID = 20


@dataclass(frozen=True, slots=True)
class Unbuilt:
    """What is wrong with a bench. Motors are meant in the order of the true tendons, the drive last.

    kinds: of `KINDS`. ids, bauds: of the motors. called: by tendon as people count them, from 0, the true tendon that
    its motor pulls. spec: the rig as it is wired in truth. lever: where it rests [rad]. plugged: whether the motors
    are. eye: seed of how exactly the hands see.
    """

    kinds: tuple[str, ...]
    ids: tuple[int, ...]
    bauds: tuple[int, ...]
    called: tuple[int, ...]
    spec: RigSpec
    lever: float
    plugged: bool
    eye: int

    def document(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        wiring = self.spec.wiring
        return {
            "kinds": list(self.kinds),
            "ids": list(self.ids),
            "bauds": list(self.bauds),
            "tendon_called": [tendon + 1 for tendon in self.called],
            "tendon_pull": list(wiring.tendon_pull),
            "drive_sign": wiring.drive_sign,
            "drive_zero_counts": wiring.drive_zero_counts,
            "imu_axes": list(wiring.imu_axes),
        }


def parse_kinds(text: str) -> tuple[str, ...]:
    """Return what a user wants wrong: words of `KINDS` with commas between, or `all`. Raises SpecError."""
    kinds = tuple(word for part in text.split(",") for word in (ALL if part == "all" else (part,)))
    for kind in kinds:
        if kind not in KINDS:
            raise SpecError(f"found {kind!r} to build wrongly, expected all, or some of {', '.join(KINDS)}")
    return tuple(dict.fromkeys(kinds))


def draw_unbuilt(spec: RigSpec, kinds: Collection[str], seed: int) -> Unbuilt:
    """Return a bench with something wrong, drawn from a seed; what is not named is as the rig has it.

    Raises SpecError for kinds that exclude each other.
    """
    if "new" in kinds and (also := [kind for kind in ("ids", "double", "baud") if kind in kinds]):
        raise SpecError(f"motors that are new have no {' and '.join(also)} of their own; leave one of the two out")
    chance, wiring = np.random.default_rng([seed, 2]), spec.wiring
    count = len(wiring.tendon_ids)
    called = _swapped(count, chance) if "tendons" in kinds else tuple(range(count))
    by_label = (*wiring.tendon_ids, wiring.drive_id)
    if "ids" in kinds:
        free = [number for number in range(_MOST_ID + 1) if number != wiring.imu_id]
        by_label = tuple(int(number) for number in chance.choice(free, count + 1, replace=False))
    place = {tendon: label for label, tendon in enumerate(called)}
    ids = [by_label[place[tendon]] for tendon in range(count)] + [by_label[count]]
    true = Wiring(
        **wiring.model_dump()
        | {
            "tendon_ids": tuple(ids[:count]),
            "drive_id": ids[count],
            "tendon_pull": _senses(wiring.tendon_pull, chance) if "pulls" in kinds else wiring.tendon_pull,
            "drive_sign": -wiring.drive_sign if "lever" in kinds else wiring.drive_sign,
            "drive_zero_counts": int(chance.integers(*_ZEROS)) if "zero" in kinds else wiring.drive_zero_counts,
            "imu_axes": _mounting(wiring.imu_axes, chance) if "board" in kinds else wiring.imu_axes,
        }
    )
    bauds = [wiring.baud] * (count + 1)
    if "baud" in kinds:
        others = [baud for baud in BAUD_RATES if baud != wiring.baud]
        for motor in chance.choice(count + 1, int(chance.integers(1, count + 2)), replace=False):
            bauds[motor] = int(chance.choice(others))
    if "double" in kinds:
        one, other = chance.choice(count + 1, 2, replace=False)
        ids[other], bauds[other] = ids[one], bauds[one]
    is_new = "new" in kinds
    if is_new:
        ids, bauds = [_NEW_ID] * (count + 1), [_NEW_BAUD] * (count + 1)
    return Unbuilt(
        kinds=tuple(kind for kind in KINDS if kind in kinds),
        ids=tuple(ids),
        bauds=tuple(bauds),
        called=called,
        spec=spec.model_copy(update={"wiring": true}),
        lever=float(chance.uniform(-_AT_REST, _AT_REST)) if "zero" in kinds or is_new else 0.0,
        plugged=not is_new,
        eye=seed,
    )


def _swapped(count: int, chance: np.random.Generator) -> tuple[int, ...]:
    one, other = (int(tendon) for tendon in chance.choice(count, 2, replace=False))
    order = list(range(count))
    order[one], order[other] = order[other], order[one]
    return tuple(order)


def _senses(pull: tuple[int, ...], chance: np.random.Generator) -> tuple[int, ...]:
    turned = chance.choice(len(pull), int(chance.integers(1, len(pull) + 1)), replace=False)
    return tuple(-sense if motor in turned else sense for motor, sense in enumerate(pull))


def _mounting(axes: tuple[Axis, ...], chance: np.random.Generator) -> tuple[str, ...]:
    """Return another way to mount the board: any of the other right-handed frames along its axes."""
    frames = []
    for letters in itertools.permutations("xyz"):
        for signs in itertools.product("+-", repeat=3):
            frame = tuple(sign + letter for sign, letter in zip(signs, letters, strict=True))
            even = letters in (("x", "y", "z"), ("y", "z", "x"), ("z", "x", "y"))
            if (signs.count("-") % 2 == 0) == even and frame != tuple(axes):
                frames.append(frame)
    return frames[int(chance.integers(len(frames)))]


class Hands:
    """Somebody at the bench who does what is asked: plugs motors in and out, turns the lever.

    rig: made for `unbuilt.spec`. Its motors get the ids and bauds that are wrong, and are unplugged where they are new.
    """

    def __init__(self, rig: EmulatedRig, unbuilt: Unbuilt) -> None:
        self._rig, self._unbuilt = rig, unbuilt
        self._eye = np.random.default_rng([unbuilt.eye, 3])
        for motor, device, baud in zip(rig.motors.values(), unbuilt.ids, unbuilt.bauds, strict=True):
            motor.registers["id"], motor.registers["baud_rate"] = device, BAUD_RATES.index(baud)
        rig.plug(range(len(unbuilt.ids)) if unbuilt.plugged else ())

    def do(self, act: str) -> None:
        """Do it: `plug tendon 2` or `plug drive`, alone of all motors; `plug all`; `turn lever`. Raises SpecError."""
        words, count = act.split(), len(self._unbuilt.called)
        labels = {f"tendon {label + 1}": tendon for label, tendon in enumerate(self._unbuilt.called)}
        labels["drive"] = count
        what = " ".join(words[1:])
        if words[:1] == ["plug"] and (what == "all" or what in labels):
            self._rig.plug(range(count + 1) if what == "all" else (labels[what],))
        elif act == "turn lever":
            middle = PULSE * round(float(self._eye.normal(0.0, EYE)) / PULSE)
            self._rig.mechanics.catch_up().place_lever(middle)
        else:
            raise SpecError(f"hands cannot {act!r}; expected plug {', plug '.join([*labels, 'all'])}, turn lever")


# ---- the bench as a master finds it


_WARM_UP = 0.02  # s of emulated time, before a master can open the port


class Start(NamedTuple):
    """How the bench is found. tilt: of the slack head plate about y and z [rad]; slack: of each tendon [m]."""

    tilt: tuple[float, float]
    slack: tuple[float, ...]


def drawn_start(
    rig: RigSpec, seed: int, tilt_deg: float | None = None, slack_mm: Sequence[float] | None = None
) -> Start:
    """Return how a bench is found for a seed; what is given, tilt [deg] and slack of each tendon [mm], is not drawn."""
    chance = np.random.default_rng([seed, 1])
    size = math.radians(chance.uniform(0.5, 1.5) if tilt_deg is None else tilt_deg)
    towards = chance.uniform(0, math.tau)
    drawn = chance.uniform(0.5e-3, 3e-3, rig.tendons.count)
    slack = drawn.tolist() if slack_mm is None else [1e-3 * millimetres for millimetres in slack_mm]
    return Start((size * math.cos(towards), size * math.sin(towards)), tuple(slack))


def found_bench(
    rig: RigSpec,
    start: Start,
    seed: int,
    faults: Sequence[FaultSpec] = (),
    *,
    baud: int | None = None,
    unloaded: bool = False,
    in_space: bool = False,
    unbuilt: Unbuilt | None = None,
    tells_supply: bool = False,
) -> FaultyRig:
    """Return an emulated bench that is ready to answer. Raises SpecError for a fault of what the rig does not have, or
    a joint in space without its masses.

    baud: what the devices are set to; else the rig's. unloaded: motors on the table, without the joint. in_space: a
    joint with a heavy head, which bends and sways; one that was cast bent is always that. unbuilt: what is wrong with
    it; `unbuilt.Hands` makes it so, and puts it right. tells_supply: as of `EmulatedRig`.
    """
    rig = rig if unbuilt is None else unbuilt.spec
    plant = _plant(rig, start, unloaded, in_space)
    if unbuilt is not None:
        plant.place_lever(unbuilt.lever)
    bench = Faults(faults, seed).attach(EmulatedRig(rig, plant, seed=seed, baud=baud, tells_supply=tells_supply))
    bench.advance(_WARM_UP)
    bench.rig.motion()
    return bench


def _plant(rig: RigSpec, start: Start, unloaded: bool, in_space: bool) -> Plant:
    if unloaded and in_space:
        raise SpecError("motors without a joint do not bend; leave out --unloaded or --in-space")
    if unloaded:
        return Unloaded(rig.tendons.count, rig)
    from sinew.emulator.joint_plant import JointPlant  # JAX: half a second

    bends = in_space or (rig.space is not None and rig.space.rest_bend_deg != 0)
    return JointPlant(rig, slack_m=start.slack, rest_tilt=start.tilt, in_space=bends)


class VirtualPort:
    """A bench in virtual time: Transport and Clock of the same time, and nothing sleeps.

    rig: the bench, with faults or without. host_cost: how long each call keeps the host busy [s], so that time passes
    for a master that never waits.
    """

    def __init__(self, rig: EmulatedRig | FaultyRig, host_cost: float = 50e-6) -> None:
        self.rig, self.host_cost = rig, host_cost
        self._now = rig.time

    def now(self) -> float:
        self._now = max(self._now, self.rig.time)
        return self._now

    def wait_until(self, time: float) -> None:
        self._now = max(self.now(), time)
        self.rig.advance(self._now)

    def write(self, data: bytes) -> None:
        self._work()
        self.rig.receive(data, self._now)

    def read(self, deadline: float) -> bytes:
        self._work()
        while True:
            data = self.rig.transmit(self._now)
            if data:
                return data
            event = self.rig.next_event()
            if event > deadline:
                self.wait_until(deadline)
                self._refuse_unplugged()
                return self.rig.transmit(self._now)
            self.wait_until(event)
            self._refuse_unplugged()

    def close(self) -> None:
        pass

    def _work(self) -> None:
        self._refuse_unplugged()
        self._now = self.now() + self.host_cost

    def _refuse_unplugged(self) -> None:
        if self.rig.unplugged:
            raise PortError("the port is gone; plug it in again")
