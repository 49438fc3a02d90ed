"""Whatever goes wrong on a bench: no wrong sample, always the safe state, always a sentence; and a campaign that could
say otherwise."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns.faults import OUTCOMES, rest_tensions, table, verdicts
from campaigns.scenario import NOMINAL_S, Scenario, draw_scenario
from campaigns.trial import MOTOR_S, Truth, judge, wrong_readings

from sinew.bench.stops import StopReport
from sinew.emulator.faults import DRAWN_KINDS, parse_fault
from sinew.hardware.imu import ClockTrack
from sinew.hardware.motor import Motor
from sinew.measure.tasks import Spread
from sinew.plan.toml import load_rig

SAMPLE = 60  # with fewer not every kind of fault is drawn
SEED = 2  # with it each kind is drawn alone at least once in the sample


@pytest.fixture(scope="module")
def tension_n() -> Mapping[float, float]:
    return rest_tensions()


def scenario(*faults: str, **changes: Any) -> Scenario:
    """Return a run in position mode, with these faults, that the operator ends early."""
    drawn = draw_scenario(0, 0).without_faults()
    plain = replace(drawn, plan="one pretension", mode="position", safe_state="release", interrupt_s=2.4)
    return replace(plain, faults=tuple(map(parse_fault, faults)), **changes)


@pytest.mark.parametrize(
    ("fault", "changes"),
    [
        ("unplug@2.1", {"safe_state": "hold"}),
        ("brown-out:to=4V@1.9-2.1", {}),
        ("flip:p=0.1@0.3", {"mode": "current", "safe_state": "hold"}),
        ("delay:p=0.05,by=30ms@0", {}),
        ("overload:motor=5@0.2", {"mode": "current"}),
        ("drop:p=0.2@2.35", {"safe_state": "hold", "mode": "position-with-current-limit"}),
    ],
)
def test_a_fault_costs_no_truth_no_safety_and_no_sentence(
    fault: str, changes: dict[str, Any], tension_n: Mapping[float, float]
) -> None:
    verdict = judge(scenario(fault, **changes), tension_n)
    assert verdict.violations == []


@pytest.mark.slow
def test_a_ring_down_with_holes_is_not_taken_for_whole_because_of_the_pause_before_it(
    tension_n: Mapping[float, float],
) -> None:
    holes = replace(draw_scenario(0, 296), faults=(parse_fault("duplicate:p=0.08624@11.206"),))
    assert judge(holes, tension_n).violations == []


@pytest.mark.slow
def test_without_a_fault_every_reading_is_found_to_be_true(tension_n: Mapping[float, float]) -> None:
    verdict = judge(scenario(interrupt_s=math.inf), tension_n)
    assert (verdict.outcome, verdict.violations, verdict.readings.checked > 50_000) == ("complete", [], True)


@pytest.mark.slow
def test_a_packet_in_a_thousand_may_be_lost_and_all_groups_are_recorded(tension_n: Mapping[float, float]) -> None:
    # Of seven packets a cycle: 0.7 % of the rows in the mean, where a group may lack 2 %.
    verdict = judge(scenario("drop:p=0.001", interrupt_s=math.inf), tension_n)
    assert (verdict.outcome, verdict.violations) == ("complete", [])


@pytest.mark.slow
def test_samples_that_average_over_a_freeze_of_the_sensor_are_not_believed(tension_n: Mapping[float, float]) -> None:
    verdict = judge(scenario("imu-freeze@10.5-10.53", interrupt_s=10.8), tension_n)
    assert (verdict.sentence, verdict.violations) == ("interrupted by the operator", [])


def first_of_each_kind(seed: int) -> list[int]:
    """Return the runs of a campaign in which a kind of fault, alone, is drawn for the first time."""
    alone = [(run, found[0].kind) for run in range(SAMPLE) if len(found := draw_scenario(seed, run).faults) == 1]
    first = {kind: run for run, kind in reversed(alone)}
    return sorted(first.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    "runs",
    [
        pytest.param(first_of_each_kind(SEED), id="the first of each kind"),
        pytest.param(list(range(SAMPLE)), id="sixty", marks=pytest.mark.long),
    ],
)
def test_no_fault_drawn_at_random_costs_truth_safety_or_a_sentence(runs: list[int]) -> None:
    found = list(verdicts(SEED, runs, Spread(workers=2)))
    rows = table(found)
    assert [violation for verdict in found for violation in verdict.violations] == []
    assert sum(rows["all"][outcome] for outcome in OUTCOMES) == len(runs)
    assert rows["all"]["raised"] == 0
    assert set(DRAWN_KINDS) <= set(rows)


# The rest: a campaign that could not fail would show nothing.


@pytest.mark.slow
def test_a_bench_that_takes_late_answers_for_fresh_ones_is_found_out(
    tension_n: Mapping[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    follow = ClockTrack.is_fresh
    monkeypatch.setattr(ClockTrack, "is_fresh", lambda *answer: follow(*answer) or True)
    verdict = judge(scenario("delay:p=0.01,by=6ms@12.6-13.8", interrupt_s=13.8), tension_n)
    assert any("wrong readings" in violation for violation in verdict.violations)


def test_a_bench_that_only_says_that_it_stopped_is_found_out(
    tension_n: Mapping[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sinew.bench.run.stop", lambda _rig, _clock, state, _, **__: StopReport(state))
    verdict = judge(scenario(), tension_n)
    assert any("the report says release" in violation for violation in verdict.violations)


def test_motors_left_alone_without_a_watchdog_are_found_out(
    tension_n: Mapping[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Motor, "arm_watchdog", lambda _motor, _seconds: None)
    verdict = judge(scenario("unplug@2"), tension_n)
    assert any("outside the safe state" in violation for violation in verdict.violations)


def test_an_error_without_a_name_is_found_out(
    tension_n: Mapping[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Motor, "set_counts", lambda _motor, _block: 1 / 0)
    verdict = judge(scenario(), tension_n)
    assert any("raised ZeroDivisionError" in violation for violation in verdict.violations)


@pytest.mark.parametrize(("late_s", "is_found"), [(0.0, False), (5e-3, True)])
def test_a_reading_that_is_one_cycle_old_at_speed_is_found_out(late_s: float, is_found: bool) -> None:
    spec = load_rig("paper")
    time = np.arange(0.0, 1.0, 1.25e-3)
    omega, amplitude = math.tau * 3.0, math.radians(15.0)
    rows = np.zeros((time.size, 9 + 2 * spec.tendons.count))
    rows[:, 0], rows[:, 1] = time, amplitude * np.sin(omega * time)
    rows[:, 2] = amplitude * omega * np.cos(omega * time)
    asked = np.array([0.5])  # where the lever passes its middle
    reading = amplitude * np.sin(omega * (asked - late_s))
    wrong = wrong_readings(Truth(rows, spec), {"drive_rad": reading}, asked, MOTOR_S, MOTOR_S)
    assert bool(wrong) == is_found


def test_a_run_is_drawn_anew_from_its_number_alone() -> None:
    again = [draw_scenario(3, number) for number in (7, 2, 7)]
    assert (again[0] == again[2], again[0] == again[1]) == (True, False)


def test_a_run_aimed_at_a_phase_has_its_fault_in_it() -> None:
    drawn = (draw_scenario(0, number) for number in range(200))
    aimed = next(one for one in drawn if one.phase == "stop")
    fault = aimed.aimed({"stop": (NOMINAL_S, NOMINAL_S + 1.0)}).faults[0]
    assert NOMINAL_S - 0.1 <= fault.start <= NOMINAL_S + 1.0
