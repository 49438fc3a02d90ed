"""A line that lies: no stale or impossible reading is believed, motors end safe, and every end has a sentence."""

from collections.abc import Mapping
from dataclasses import replace

import pytest
from campaigns.faults import rest_tensions, verdicts
from campaigns.scenario import LIE_KINDS, LieKind, Lies, draw_hostile
from campaigns.trial import judge

from sinew.hardware.believable import MotorBounds
from sinew.hardware.imu import ClockTrack


@pytest.fixture(scope="module")
def tension_n() -> Mapping[float, float]:
    return rest_tensions()


def run(
    kind: LieKind, share: float, tension_n: Mapping[float, float], start: float = 1.0, end: float = 2.4
) -> list[str]:
    """Return what may not happen of a run, in position mode, whose operator ends it on a hostile line."""
    scene = replace(draw_hostile(0, 0), mode="position", interrupt_s=end, lies=Lies(kind, share, start, 90.0, 1))
    verdict = judge(scene, tension_n)
    assert verdict.happened["struck"] > 0
    return verdict.violations


@pytest.mark.parametrize(("kind", "share"), [("late", 0.1), ("re-signed", 0.2)])
def test_a_hostile_line_costs_no_truth_no_safety_and_no_sentence(
    kind: LieKind, share: float, tension_n: Mapping[float, float]
) -> None:
    assert run(kind, share, tension_n) == []


@pytest.mark.slow
def test_the_first_runs_of_the_campaign_show_nothing_that_may_not_happen() -> None:
    found = list(verdicts(0, range(len(LIE_KINDS)), draw=draw_hostile))
    assert [violation for verdict in found for violation in verdict.violations] == []


# The rest: a campaign that could not fail would show nothing.


@pytest.mark.slow
def test_a_bench_that_believes_stale_answers_is_found_out(
    tension_n: Mapping[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ClockTrack, "is_fresh", lambda *_: True)
    assert any("wrong readings" in what for what in run("repeated", 0.1, tension_n, 9.0, 10.5))


@pytest.mark.slow
def test_a_bench_that_believes_anything_is_found_out(
    tension_n: Mapping[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(MotorBounds, "objection", lambda *_: "")
    assert any("impossible readings" in what for what in run("re-signed", 0.05, tension_n, 1.0, 2.4))


def test_a_run_is_drawn_anew_from_its_number_alone() -> None:
    again = [draw_hostile(3, number) for number in (7, 2, 7)]
    assert (again[0] == again[2], again[0] == again[1]) == (True, False)
