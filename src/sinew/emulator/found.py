"""The bench as a master finds it: slack tendons, a tilted head, and all compiled that a first answer waits for."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sinew.emulator.faults import Faults, FaultSpec, FaultyRig
from sinew.emulator.plant import Plant
from sinew.emulator.rig import EmulatedRig
from sinew.emulator.unloaded import Unloaded
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
) -> FaultyRig:
    """Return an emulated bench that is ready to answer. Raises SpecError for a fault of what the rig does not have.

    baud: what the devices are set to; else the rig's. unloaded: motors on the table, without the joint.
    """
    bench = Faults(faults, seed).attach(EmulatedRig(rig, _plant(rig, start, unloaded), seed=seed, baud=baud))
    bench.advance(_WARM_UP)
    bench.rig.motion()
    return bench


def _plant(rig: RigSpec, start: Start, unloaded: bool) -> Plant:
    if unloaded:
        return Unloaded(rig.tendons.count, rig)
    from sinew.emulator.joint_plant import JointPlant  # JAX: half a second
    from sinew.twin.cache import compute_inline

    compute_inline()
    return JointPlant(rig, slack_m=start.slack, rest_tilt=start.tilt)
