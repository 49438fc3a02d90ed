"""Rig, pretensions and campaigns on the twin for the tests of the open questions."""

import functools

import numpy as np
import xarray as xr

from sinew.plan.plan import Plan, Pretension, RingDown, Sweep
from sinew.plan.toml import load_rig
from sinew.twin.simulate import simulate

RIG = load_rig("paper")
PRETENSIONS = np.arange(0.0, 13.0)

SMALL = Plan(
    name="small",
    pretension=Pretension(pretension_mm=(3.0, 10.0)),
    sweep=Sweep(frequency_hz=(2.4, 2.8, 3.0, 3.2, 3.4, 3.7, 4.2, 5.0), amplitude_deg=20.0, repeats=3),
    ring_down=RingDown(frequency_hz=(2.9, 3.4), repeats=2),
)

DECAYS = Plan(
    name="decays",
    pretension=Pretension(pretension_mm=(0.0, 12.0)),
    ring_down=RingDown(frequency_hz=(3.0, 4.3), repeats=2),
)


@functools.cache
def whole_campaign() -> xr.Dataset:
    """Return the small campaign on the twin with all effects; not to be changed."""
    return simulate(SMALL, RIG, seed=22)
