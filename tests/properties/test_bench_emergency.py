"""An emergency stop at a drawn moment of a run: every motor is frozen within 200 ms, by the truth of the mechanics."""

from collections.abc import Mapping

import pytest
from campaigns.emergency import PHASES, Case, draw_case, play, tensions

from sinew.bench.stops import Frozen
from sinew.hardware.bus import Clock
from sinew.hardware.rig import Rig

CASES = [draw_case(7, number) for number in range(10)]


@pytest.fixture(scope="module")
def tension_n() -> Mapping[float, float]:
    return tensions()


@pytest.mark.parametrize(
    "case",
    [*CASES[:3], *(pytest.param(case, marks=pytest.mark.slow) for case in CASES[3:])],
    ids=lambda case: f"{case.phase}, {case.mode}, {case.safe_state}",
)
def test_all_motors_are_frozen_within_200_ms_and_no_tension_jumps(case: Case, tension_n: Mapping[float, float]) -> None:
    assert play(case, tension_n).wrong == ()


def test_these_moments_are_of_every_phase_and_both_states() -> None:
    assert {case.phase for case in CASES} == set(PHASES)
    assert {case.safe_state for case in CASES} == {"hold", "release"}


@pytest.mark.slow
def test_a_bench_that_takes_its_time_is_found_out(
    tension_n: Mapping[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    def dawdle(rig: Rig, clock: Clock) -> Frozen:
        end = clock.now() + 0.21
        while clock.now() < end:  # who speaks keeps the watchdogs from acting
            rig.read()
            clock.wait_until(clock.now() + 0.005)
        return Frozen()

    monkeypatch.setattr("sinew.bench.stops.freeze", dawdle)
    case = next(case for case in CASES if case.phase == "steady")
    assert "not frozen after 200 ms" in play(case, tension_n).wrong
