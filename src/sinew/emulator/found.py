"""The bench as a master finds it, slack tendons and a tilted head, all compiled that a first answer waits for."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sinew.emulator.faults import Faults, FaultSpec, FaultyRig
from sinew.emulator.plant import Plant, Unloaded
from sinew.emulator.rig import EmulatedRig
from sinew.emulator.unbuilt import Unbuilt
from sinew.measure.errors import PortError, SpecError
from sinew.plan.rig import RigSpec

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
