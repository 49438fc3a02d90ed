"""Tendons that drive the head on the bench: what moves, what is refused, and the recording beside the twin."""

import math
import re
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.experiments.bent import run_bent, twin_of

from sinew.analysis.analysed import analyse_recording
from sinew.bench.group import Moving
from sinew.plan.plan import Group, Plan, Pose, Pretension, Sweep
from sinew.plan.toml import load_rig
from sinew.predict.preview import held_preview

RIG = load_rig("paper")
RADIUS = RIG.tendons.pulley_radius.value


def swaying(amplitude_mm: float, frequency_hz: float, drive: Any = "roll", bend_deg: float = 0.0) -> Plan:
    sweep = Sweep(
        frequency_hz=(frequency_hz,), drive=drive, amplitude_mm=amplitude_mm, settle_s=1.5, periods=5, repeats=1
    )
    pretension = Pretension(pretension_mm=(6.0,), rest_s=0.3)
    return Plan(name="sway", pose=Pose(bend_deg=bend_deg, azimuth_deg=90.0), pretension=pretension, sweep=sweep)


def moving(plan: Plan) -> Moving:
    (group,) = [group for group in plan.groups() if group.kind == "steady"]
    return Moving.of(group, 0.0, RADIUS, 4)


@pytest.mark.parametrize(("drive", "pattern"), [("roll", (1, 0, -1, 0)), ("pitch", (0, -1, 0, 1))])
def test_driven_tendons_pull_against_one_another_and_the_lever_stays(drive: str, pattern: tuple[int, ...]) -> None:
    told: list[tuple[float, ...]] = []

    def cycle(**asked: Any) -> None:
        assert set(asked) == {"pull"}  # the lever's default is its zero
        told.append(tuple(asked["pull"](0.25 / 3.0)))  # at a quarter of a period

    moving(swaying(0.8, 3.0, drive)).cycle(cast("Any", SimpleNamespace(cycle=cycle)))
    assert told == [pytest.approx([0.8e-3 / RADIUS * weight for weight in pattern], abs=1e-12)]


def test_a_lever_that_drives_leaves_the_tendons() -> None:
    group = Group("steady", 6.0, 3.0, 20.0, 0, 1.0, 1.0)
    driven = Moving.of(group, 0.0, RADIUS, 4)
    assert (driven.weights, driven.swing.amplitude) == ((), pytest.approx(math.radians(20.0)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plan", "says"),
    [
        (swaying(2.0, 3.0), r"2 mm of cable at 3 Hz are too fast for the motor of tendon \d: it follows 1\.\d mm"),
        (swaying(0.5, 9.1), r"leave tendon \d -\d+ N of 44 N, a bench drives taut ones"),
        (swaying(0.5, 9.1), r"pull tendon \d with \d+ N, the rig allows 200 N"),
        (swaying(5.0, 3.0), r"lean the head 12\.\d° out of its pose, the rig allows 10°"),
    ],
)
def test_tendons_that_the_motors_cannot_drive_so_are_refused_with_the_reason(plan: Plan, says: str) -> None:
    assert any(re.search(says, one) for one in held_preview(plan, RIG)[0].refusals)


@pytest.mark.slow
@pytest.mark.long
def test_a_head_that_the_tendons_drive_tilts_on_the_bench_as_on_the_twin() -> None:
    plan = swaying(0.8, 4.0, bend_deg=20.0)
    run = run_bent(plan, RIG)
    assert run.recording is not None, run.report.sentence
    results = [analyse_recording(one, RIG) for one in (run.recording, twin_of(plan, RIG).drop_vars("orientation"))]
    names = ("channel_amplitude_rad", "channel_gain")
    tilt, gain = ([float(np.ravel(one[name].values)[2]) for one in results] for name in names)
    assert tilt[0] == pytest.approx(tilt[1], rel=0.02)
    assert gain[0] == pytest.approx(gain[1], rel=0.03)  # against what the motors' angles say
    assert run.is_safe
