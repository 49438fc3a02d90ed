"""A bent plan run through the emulator's bytes in virtual time, beside the twin; and how bent runs meet faults."""

from typing import NamedTuple

import pytest
import xarray as xr
from tests.experiments.bent import BentRun, Row, off_by, run_bent, shortened, twin_of

from sinew.measure.errors import SpecError
from sinew.plan.plan import Plan, Pose
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_plan, load_rig
from sinew.predict.preview import held_preview

RIG = load_rig("paper")
PLAN = shortened(load_plan("bent"), (3.4, 4.2), 6.0)


class Beside(NamedTuple):
    run: BentRun
    twin: xr.Dataset
    off: Row


@pytest.fixture(scope="module")
def beside() -> Beside:
    run, twin = run_bent(PLAN, RIG), twin_of(PLAN, RIG)
    assert run.recording is not None, run.report.sentence
    return Beside(run, twin, off_by(run.recording, twin.drop_vars("orientation"), RIG))


@pytest.mark.slow
def test_the_bench_bends_the_joint_to_the_pose_swings_it_as_the_twin_does_and_leaves_it_safe(beside: Beside) -> None:
    (set_,) = beside.run.report.pretensions
    assert set_.tilt_deg < 0.05
    assert set_.reached_mm == pytest.approx(6.0, abs=0.05)
    assert beside.run.is_safe
    assert max(beside.off[:3]) < 0.02  # torsion, tilt and coupling of the twin
    assert beside.off.lag_deg < 1.0
    recording = beside.run.recording
    assert recording is not None
    assert set(recording["bend_deg"].values) == {20.0}
    assert set(recording["azimuth_deg"].values) == {90.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "says"),
    [  # in its swing, while it is levelled, while it is bent
        ("unplug@19", "port is gone"),
        ("imu-freeze@12", "IMU repeats one sample"),
        ("overload:motor=2@9.5", "tendon 2"),
    ],
)
def test_a_bent_run_that_meets_a_fault_ends_in_the_declared_state(fault: str, says: str) -> None:
    run = run_bent(PLAN, RIG, seed=1, fault=fault)
    assert not run.report.is_complete
    assert says in run.report.sentence
    assert run.is_safe


def posed(bend_deg: float, pretension_mm: float, **changes: object) -> Plan:
    pose = Pose(bend_deg=bend_deg, azimuth_deg=90.0)
    pretension = PLAN.pretension.model_copy(update={"pretension_mm": (pretension_mm,)})
    return PLAN.model_copy(update={"pose": pose, "pretension": pretension, **changes})


def limited(**limits: object) -> RigSpec:
    return RIG.model_copy(update={"limits": RIG.limits.model_copy(update=limits)})


@pytest.mark.parametrize(
    ("plan", "rig", "says"),
    [
        (posed(20.0, 2.0), RIG, "tendon 4 would be slack"),
        (posed(20.0, 6.0), limited(tension_n=60.0), "tendon 2 pulls 69 N, the rig allows 60 N"),
        (posed(20.0, 6.0), limited(tendon_travel_mm=(-20.0, 12.0)), "the rig allows -20 to 12 mm"),
        (posed(20.0, 6.0), limited(bend_deg=15.0), "the rig allows 15°"),
        (posed(89.0, 12.0), limited(bend_deg=90.0, tendon_travel_mm=(-60.0, 60.0)), "89° towards 90°"),
    ],
)
def test_a_pose_that_the_bench_cannot_hold_is_refused_with_its_reason(plan: Plan, rig: RigSpec, says: str) -> None:
    refusals = " ".join(held_preview(plan, rig)[0].refusals)
    assert says in refusals


def test_a_pose_on_a_rig_that_tells_no_masses_is_refused() -> None:
    with pytest.raises(SpecError, match=r"no \[space\]"):
        held_preview(PLAN, RIG.model_copy(update={"space": None}))
