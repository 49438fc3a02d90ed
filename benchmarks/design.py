"""Time of the search for joints: a thousand candidates here, and on two workers of a local cluster.

The workers run on the same machine. All are warmed up first, so that no compiling is timed, here or there.
"""

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from sinew.measure.errors import how_to_install
from sinew.measure.tasks import Spread, run_tasks
from sinew.plan.toml import dump_rig, load_rig
from sinew.predict.joints.design import shear_modulus_of
from sinew.predict.joints.material import list_materials, load_material
from sinew.tune.candidate import SHAPES, DesignTarget
from sinew.tune.design import blocks_of, drafts_of, propose, search_block

STARTS, EXACT, WORKERS = 64, 8, 2
TARGET = DesignTarget((0.7, 1.1), 7.0, 0.25)

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


def main(_: Sequence[str] = ()) -> None:
    """Print the time of a thousand candidates, of an exact evaluation, and the speed-up by two workers."""
    rig = load_rig("paper")
    text = dump_rig(rig)
    silicones = {"base": shear_modulus_of(rig)}
    silicones |= {name: load_material(name).shear_modulus.value for name in list_materials()}
    blocks = blocks_of(text, TARGET, silicones, list(SHAPES), STARTS, 0)
    count = STARTS * len(blocks)
    print(f"a joint for 0.7-1.1 Hz, ±7°, 0.25 kg m²: {count} candidates in {len(blocks)} blocks")
    begin = time.perf_counter()
    search_block(blocks[0])
    print(f"  first block        {time.perf_counter() - begin:8.2f} s, with compiling or reading what was compiled")
    found, alone = _timed(search_block, blocks, None)
    fit = sum(int(one.feasible.sum()) for one in found)
    print(f"  one process        {alone:8.2f} s, {1000 * alone / count:.2f} s per thousand (wanted: at most 1.5); "
          f"{fit} keep every limit")  # fmt: skip
    drafts = drafts_of(found, text, TARGET, EXACT)
    propose(drafts[0])
    proposals, exact = _timed(propose, drafts, None)
    print(f"  exact evaluation   {exact:8.2f} s for {len(drafts)}, {exact / len(drafts):.2f} s each")
    try:
        from distributed import LocalCluster
    except ImportError:
        print(f"  two workers: skipped, dask.distributed is not installed; install it: {how_to_install('cluster')}")
        return
    with LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        address = cluster.scheduler_address
        _timed(search_block, blocks[: 2 * WORKERS], address)
        _timed(propose, drafts[: 2 * WORKERS], address)
        spread, together = _timed(search_block, blocks, address)
        again, exactly = _timed(propose, drafts, address)
    same = all((a.sizes == b.sizes).all() for a, b in zip(found, spread, strict=True))
    same &= [one.objectives for one in proposals if one] == [one.objectives for one in again if one]
    print(f"  two workers        {together:8.2f} s, {1000 * together / count:.2f} s per thousand, "
          f"{alone / together:.2f} times as fast")  # fmt: skip
    print(f"    exact evaluation {exactly:8.2f} s, {exact / exactly:.2f} times as fast; "
          f"{'the same numbers' if same else 'OTHER NUMBERS'}")  # fmt: skip


def _timed(
    function: Callable[[_Task], _Result], tasks: Sequence[_Task], scheduler: str | None
) -> tuple[list[_Result], float]:
    begin = time.perf_counter()
    return run_tasks(function, tasks, Spread(scheduler)), time.perf_counter() - begin


if __name__ == "__main__":
    main()
