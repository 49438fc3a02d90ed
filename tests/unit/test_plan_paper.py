"""The shipped rig and plan against the paper's text and the data sheets."""

import math
from itertools import pairwise

import pytest

from sinew.plan.toml import load_plan, load_rig

RIG = load_rig("paper")
PLAN = load_plan("paper")
STIFFNESS = RIG.silicone.torsional_rigidity.value / RIG.silicone.length.value
PER_TURN = 4096 / (2 * math.pi)  # counts of the encoder
SAID = {
    "inertia of head and lever (Eq. 4)": (RIG.inertia.head.value + RIG.inertia.lever.value, 12.74e-3, 1e-6),
    "stiffness of the bare silicone (Eq. 5)": (STIFFNESS, 3.052, 1e-3),
    "resonance of the bare silicone": (math.sqrt(STIFFNESS / 12.74e-3) / (2 * math.pi), 2.46, 0.01),
    "frequency at which 20 degrees take the no-load speed": (
        RIG.drive.no_load_speed.value / (2 * math.pi * math.radians(20)),
        2.20,
        0.005,
    ),
    "position gain, default register over the duty range": (
        RIG.drive.position_gain.value / (800 / 128 / 885 * PER_TURN),
        1.0,
        1e-4,
    ),
    "servo stiffness by the tendon motors' default gain": (
        RIG.tendons.servo_stiffness.value * RIG.tendons.pulley_radius.value**2 / (900 / 128 / 885 * 3.4 * PER_TURN),
        1.0,
        0.005,
    ),
    "delay of the gyroscope by data sheet": (RIG.imu.filter_delay, 5.9e-3, 1e-6),
    "count of the drive's current": (RIG.drive.current_lsb.value, 0.00269, 0.0),
    "count of the tendon motors' current": (RIG.tendons.current_lsb.value, 0.00269, 0.0),
    "radius of the head's guides": (RIG.tendons.head_radius.value, RIG.tendons.base_radius.value, 0.0),
}


@pytest.mark.parametrize(("found", "said", "within"), SAID.values(), ids=SAID.keys())
def test_a_number_of_the_rig_is_that_of_the_paper_or_the_data_sheet(found: float, said: float, within: float) -> None:
    assert found == pytest.approx(said, abs=within, rel=0)


def test_every_parameter_says_where_it_is_from() -> None:
    assert [name for name, parameter in RIG.parameters() if not parameter.note] == []


def test_the_plan_visits_0_to_12_mm_and_sweeps_most_densely_over_the_papers_resonances() -> None:
    sweep = PLAN.sweep
    assert sweep is not None
    assert PLAN.pretension.pretension_mm == tuple(range(13))
    assert (sweep.amplitude_deg, sweep.settle_s, sweep.periods, sweep.repeats) == (20, 3, 5, 3)
    assert len(sweep.frequency_hz) >= 28
    assert (sweep.frequency_hz[0], sweep.frequency_hz[-1]) == (1.5, 6.0)
    assert {round(b - a, 6) for a, b in pairwise(sweep.frequency_hz) if 2.7 <= a < 4.6} == {0.1}


def test_ring_downs_stop_the_drive_at_a_zero_crossing() -> None:
    turns = [g.settle_s * g.frequency_hz for g in PLAN.groups() if g.kind == "ring-down"]
    assert max(abs(turn - round(turn)) for turn in turns) < 1e-9
