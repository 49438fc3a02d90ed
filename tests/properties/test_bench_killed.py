"""Runs that are killed with SIGKILL at random moments, on an emulated bench in a process of its own.

A few kills here; SINEW_KILLS=50 makes the whole proof, as `python -m campaigns.kills` does.
"""

import math
import os

import pytest
from campaigns.kills import MOST_MISSING, MOST_STOPPED_MS, Kill, Series, run_series

pytestmark = [pytest.mark.slow, pytest.mark.realtime]
KILLS = int(os.environ.get("SINEW_KILLS", "8"))


@pytest.fixture(scope="module")
def series() -> list[Series]:
    return list(run_series(KILLS, seed=1))


@pytest.fixture(scope="module")
def kills(series: list[Series]) -> list[Kill]:
    return [kill for one in series for kill in one.kills]


def test_the_run_is_killed_as_often_as_asked_and_also_while_it_resumes(kills: list[Kill]) -> None:
    assert len(kills) == KILLS
    assert {kill.how.partition(" ")[2] for kill in kills} == {"", "--resume"}


def test_every_motor_under_a_watchdog_is_stopped_within_100_ms_of_the_last_instruction(kills: list[Kill]) -> None:
    stopped = [kill.heard_ms for kill in kills if not math.isnan(kill.heard_ms)]
    assert stopped
    assert max(stopped) <= MOST_STOPPED_MS


def test_no_motor_moves_that_has_torque_and_no_watchdog(series: list[Series]) -> None:
    assert [wrong for one in series for kill in one.kills for wrong in kill.wrong] == []


def test_half_a_second_of_samples_is_missing_at_most(kills: list[Kill]) -> None:
    assert max(kill.missing for kill in kills if kill.missing is not None) <= MOST_MISSING


def test_after_every_kill_the_journal_makes_a_valid_recording_of_its_finished_groups(kills: list[Kill]) -> None:
    assert all(kill.is_sound for kill in kills)


def test_resuming_completes_every_run(series: list[Series]) -> None:
    assert all(one.is_complete for one in series)


def test_what_is_measured_after_a_kill_is_measured_with_the_rigs_own_drive(series: list[Series]) -> None:
    # Registers read back at every start, and the lever's amplitude, are among what a series holds against a run.
    assert [wrong for one in series for wrong in one.wrong] == []


def test_a_fresh_run_on_motors_under_torque_is_refused_and_stop_lets_go(series: list[Series]) -> None:
    assert any(one.refused for one in series)
    assert [wrong for one in series for wrong in one.wrong] == []
