"""A torso of 0.25 kg m² at 0.7 to 1.1 Hz, ±7°: distinct joints that the full twin confirms, here and on a cluster."""

import numpy as np
import pytest

from sinew.measure.tasks import Spread
from sinew.plan.check import check_plan
from sinew.plan.toml import load_rig
from sinew.predict.design import load_material, shear_modulus_of
from sinew.tune.candidate import DesignTarget
from sinew.tune.design import ENOUGH, Effort, design_joints, plan_of

RIG = load_rig("paper")
TARGET = DesignTarget((0.7, 1.1), 7.0, 0.25)
SILICONES = {"base": shear_modulus_of(RIG), "ecoflex-00-50": load_material("ecoflex-00-50").shear_modulus_pa.value}
SHAPES = ["circle", "annulus", "ellipse"]


@pytest.mark.slow
@pytest.mark.long
def test_three_distinct_joints_are_proposed_and_the_twin_confirms_each_at_both_ends() -> None:
    found = design_joints(RIG, TARGET, SILICONES, SHAPES, Effort(starts=16, exact=6, proposals=3, seed=1000))
    assert len({(one.shape, one.material) for one in found.proposals}) == 3
    for one in found.proposals:
        assert one.faults == ()
        assert [end.frequency_hz for end in one.ends] == pytest.approx([0.7, 1.1], rel=1e-3)
        assert [end.torsion_deg for end in one.ends] == pytest.approx([7.0, 7.0], rel=5e-3)
        # Resonance at 90° of lag: the spring's torque balances the inertia's, k = I Ω², whatever the joint is made of.
        assert one.rig.inertia.head.value == 0.25
        assert check_plan(plan_of(one), one.rig, [end.rest_tension_n for end in one.ends]).refusals == ()
        assert one.error is not None
        assert np.abs(one.error).max() < ENOUGH


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
def test_two_workers_of_a_cluster_give_the_front_that_one_process_gives() -> None:
    distributed = pytest.importorskip("distributed", reason="needs dask.distributed, the extra `cluster`")
    effort = Effort(starts=8, exact=4, proposals=2, seed=1000)
    silicones = {"base": SILICONES["base"]}
    alone = design_joints(RIG, TARGET, silicones, SHAPES[:2], effort)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        spread = design_joints(RIG, TARGET, silicones, SHAPES[:2], effort, spread=Spread(cluster.scheduler_address))
    assert [one.rig for one in spread.evaluated] == [one.rig for one in alone.evaluated]
    assert spread.evaluated == alone.evaluated  # their place on the front among it
    assert spread.proposals == alone.proposals
