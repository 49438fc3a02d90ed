"""This is where a joint is designed: search, exact evaluation, front, distinct proposals, confirmation on the twin."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig
from sinew.tune.confirmation import Confirmed, Request, confirm
from sinew.tune.design_target import DesignTarget
from sinew.tune.front import nondominated, spread_out
from sinew.tune.proposal import Draft, Proposal, propose
from sinew.tune.search import Found, blocks_of, search_block
from sinew.tune.tasks import run_tasks

__all__ = ["Designed", "Effort", "design_joints", "drafts_of", "select"]

Array = NDArray[np.float64]

_OTHER_LENGTH = 1.5


@dataclass(frozen=True)
class Effort:
    """How much is done. starts: of the search, in each block of a shape and a silicone. exact: candidates that are
    computed by harmonic balance. proposals: at most. seed: of starts and twin."""

    starts: int = 64
    exact: int = 24
    proposals: int = 4
    seed: int = 0


@dataclass(frozen=True)
class Designed:
    """What came of it. candidates, feasible: of the search, numbers. evaluated: exactly computed ones that have
    resonances. front: which of them are feasible and not dominated, (n,). chosen: indices of the proposals among them,
    confirmed: what the twin says of each. search_s, exact_s, confirm_s: wall time of the parts [s]."""

    candidates: int
    feasible: int
    evaluated: tuple[Proposal, ...]
    front: NDArray[np.bool_]
    chosen: tuple[int, ...]
    confirmed: tuple[tuple[Confirmed, ...], ...]
    search_s: float
    exact_s: float
    confirm_s: float


def design_joints(
    rig: RigSpec,
    target: DesignTarget,
    silicones: dict[str, float],
    shapes: Sequence[str],
    effort: Effort,
    *,
    scheduler: str | None = None,
    progress: Callable[[str, float, float], None] | None = None,
) -> Designed:
    """Return proposals for a target, from a base rig whose motors, guides, sensors and loss factor are kept.

    silicones: name and G [Pa]; a name that is no known material stands for the base's. scheduler: of a Dask cluster
    that does the work; the result is the same. progress: called with (part, done, total).
    """

    def told(part: str) -> Callable[[float, float], None]:
        return lambda done, total: None if progress is None else progress(part, done, total)

    text, begin = dump_rig(rig), time.perf_counter()
    blocks = blocks_of(text, target, silicones, list(shapes), effort.starts, effort.seed)
    found = run_tasks(search_block, blocks, scheduler, told("search"))
    searched = time.perf_counter()
    drafts = drafts_of(found, text, target, effort.exact)
    evaluated = [one for one in run_tasks(propose, drafts, scheduler, told("evaluate")) if one is not None]
    front, chosen = select(evaluated, effort.proposals)
    computed = time.perf_counter()
    requests = [Request(evaluated[i], effort.seed) for i in chosen]
    confirmed = run_tasks(confirm, requests, scheduler, told("confirm"))
    return Designed(
        candidates=sum(len(one.sizes) for one in found),
        feasible=int(sum(one.feasible.sum() for one in found)),
        evaluated=tuple(evaluated),
        front=front,
        chosen=tuple(chosen),
        confirmed=tuple(confirmed),
        search_s=searched - begin,
        exact_s=computed - searched,
        confirm_s=time.perf_counter() - computed,
    )


def drafts_of(found: Sequence[Found], text: str, target: DesignTarget, count: int) -> list[Draft]:
    """Return at most `count` candidates for exact evaluation: of each shape those that are not dominated by another of
    that shape, as far apart as may be."""
    shapes = list(dict.fromkeys(one.shape for one in found))
    drafts = []
    for shape in shapes:
        own = [one for one in found if one.shape == shape and one.feasible.any()]
        rows = [(one, i) for one in own for i in np.flatnonzero(one.feasible)]
        if not rows:
            continue
        objectives = np.array([one.objectives[i] for one, i in rows])
        best = np.flatnonzero(nondominated(objectives))
        for pick in spread_out(objectives[best], -(-count // len(shapes))):
            one, i = rows[best[pick]]
            pretension, lever = (tuple(row[i].tolist()) for row in (one.pretension, one.lever))
            drafts.append(Draft(text, target, shape, one.material, tuple(one.sizes[i].tolist()), pretension, lever))
    return drafts


def select(evaluated: Sequence[Proposal], count: int) -> tuple[NDArray[np.bool_], list[int]]:
    """Return (which are feasible and not dominated, indices of at most `count` distinct proposals).

    Distinct: another shape, another silicone, or a length that differs by half. The front's come first, then others
    that are feasible; in each those that are far apart in the objectives.
    """
    front = np.zeros(len(evaluated), dtype=bool)
    fit = [i for i, one in enumerate(evaluated) if not one.faults]
    if not fit:
        return front, []
    objectives = np.array([evaluated[i].objectives for i in fit])
    best = nondominated(objectives)
    front[np.array(fit)[best]] = True
    order = [fit[k] for k in np.flatnonzero(best)[spread_out(objectives[best], len(fit))]]
    order += [fit[k] for k in spread_out(objectives, len(fit)) if fit[k] not in order]
    chosen: list[int] = []
    for i in order:
        if len(chosen) < count and not any(_alike(evaluated[i], evaluated[j]) for j in chosen):
            chosen.append(i)
    return front, chosen


def _alike(a: Proposal, b: Proposal) -> bool:
    lengths = sorted((a.rig.silicone.length.value, b.rig.silicone.length.value))
    same = (a.draft.shape, a.draft.material) == (b.draft.shape, b.draft.material)
    return same and lengths[1] < _OTHER_LENGTH * lengths[0]
