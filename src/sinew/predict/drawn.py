"""This is where the curves of drawn rigs are computed: many lanes at once, with few harmonics."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.predict.band import Band, band_of
from sinew.predict.branch import Branch, Prediction
from sinew.predict.draws import Draws
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.predict.prediction import Problem, Resolution, predict
from sinew.predict.waves import Size
from sinew.twin.effects import Effects

__all__ = ["COARSE", "bands_of", "drawn_branches", "joined"]

COARSE = RESOLUTION._replace(sizes=((Size(7, 64), Size(7, 64)),))
"""Waves of the draws: those that a curve is followed with, not refined."""

_DRAWN = COARSE._replace(stability=False)
_RIGS = 16

Make = Callable[[RigSpec], Problem]


def joined(problems: Sequence[Problem]) -> Problem:
    """Return the lanes of several problems of the same equations as one problem."""
    first = problems[0]

    def side_by_side(*leaves: Any) -> Any:
        return np.concatenate([np.asarray(leaf) for leaf in leaves])

    lane = jax.tree.map(side_by_side, *(one.lane for one in problems))
    return first._replace(lane=lane, rest=np.concatenate([one.rest for one in problems]))


def drawn_branches(
    rigs: Sequence[RigSpec],
    make: Make,
    band_hz: tuple[float, float],
    resolution: Resolution = _DRAWN,
    progress: Callable[[float, float], None] | None = None,
) -> list[tuple[Branch, ...]]:
    """Return the curves of every rig, one tuple each, without their multipliers.

    make: returns a rig's problem; the same lanes for each. progress: called with (done, total) rigs.
    """
    found: list[tuple[Branch, ...]] = []
    for begin in range(0, len(rigs), _RIGS):
        some = [make(rig) for rig in rigs[begin : begin + _RIGS]]
        branches = predict(joined(some), band_hz, resolution).branches
        width = len(branches) // len(some)
        found += [branches[i : i + width] for i in range(0, len(branches), width)]
        if progress is not None:
            progress(len(found), len(rigs))
    return found


def bands_of(
    prediction: Prediction,
    rig: RigSpec,
    draws: Draws,
    pretension_mm: Sequence[float],
    amplitude_deg: float,
    band_hz: tuple[float, float],
    *,
    mode: TendonMode = "position",
    effects: Effects | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[Band]:
    """Return the band of each curve of a prediction.

    prediction: of the rig itself, at these pretensions [mm], amplitude of the command [deg] and band of frequencies;
    draws: of that rig. progress: called with (done, total) rigs.
    """

    def make(one: RigSpec) -> Problem:
        return joint_problem(one, list(pretension_mm), amplitude_deg, band_hz, mode=mode, effects=effects)

    coarse, *drawn = drawn_branches([rig, *draws.rigs], make, band_hz, progress=progress)
    return [
        band_of(nominal, coarse[i], [branches[i] for branches in drawn])
        for i, nominal in enumerate(prediction.branches)
    ]
