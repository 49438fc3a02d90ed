"""`sinew run` after a pause of the computer: an emulated bench goes on by itself, a real one by --resume.

The bench is the emulator's in virtual time, and the whole command runs in this process.
"""

import json

import pytest
from tests.contracts.virtual_run import RunHere, torques

from sinew.hardware.imu import Imu

PULLING_S = 3.0


def pause(here: RunHere, *times: float, seconds: float = 0.121) -> None:
    """Have the computer pause at some times of the run [s]."""
    port = here.port
    port.agenda = [(port.now() + time, lambda: port.wait_until(port.now() + seconds)) for time in times]


@pytest.fixture
def real(run_here: RunHere, monkeypatch: pytest.MonkeyPatch) -> RunHere:
    """A run on a bench that is not known to be emulated, with a pause while it pulls its tendons."""
    monkeypatch.setattr(Imu, "is_emulated", lambda _: False)
    pause(run_here, PULLING_S)
    return run_here


def test_a_real_bench_stops_in_its_safe_state_and_says_how_to_go_on(real: RunHere) -> None:
    told = real("--json")
    document = json.loads(told.out)
    keys = ("complete", "ended_by_pause", "is_safe", "pauses")
    assert [told.status, *(document[key] for key in keys)] == [1, False, True, True, []]
    assert document["ended"].startswith("the computer paused for 1")
    assert told.err.endswith("--resume\n")
    assert not any(torques(real.port.rig))


def test_an_emulated_bench_goes_on_by_itself(run_here: RunHere) -> None:
    pause(run_here, PULLING_S)
    document = json.loads(run_here("--json").out)
    assert len(document["pauses"]) == 1
