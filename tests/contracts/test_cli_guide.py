"""`sinew doctor --guide` at an emulated bench out of its boxes: led to a rig file, broken off, and begun again."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from campaigns.doctor import make_scene, misunderstood, try_seed
from tests.contracts.commands import refused
from tests.contracts.emulated_bench import PATIENCE, SINEW, playing
from tests.patience import communicate

from sinew.plan.toml import load_rig

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals of Linux")


def test_a_step_that_there_is_not_is_refused_with_those_that_are(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "doctor", "--port", "bench", "--guide", "my.toml", "--step", "levers")
    assert "found --step levers, expected one of devices, settings, board, lever, tendons, constants, check" in said


def test_only_one_step_and_all_from_one_on_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "doctor", "--port", "bench", "--guide", "my.toml", "--step", "lever", "--from", "board")
    assert "found --step and --from, expected one of them" in said


def test_a_step_without_a_guide_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "doctor", "--port", "bench", "--step", "lever")
    assert "found --step or --from without --guide" in said


def test_a_guide_that_is_told_a_baud_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "doctor", "--port", "bench", "--guide", "my.toml", "--baud", "57600")
    assert "found --fix or --baud with --guide" in said


def test_a_port_that_is_not_there_is_refused_before_any_step(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "doctor", "--port", "no-bench", "--guide", "my.toml", "--yes")
    assert "cannot open no-bench" in said
    assert "`sinew emulate`" in said


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(4, marks=pytest.mark.long)])
def test_a_bench_that_is_built_wrongly_is_led_to_its_first_run(seed: int) -> None:
    verdict = try_seed(seed)
    assert verdict.wrong == []
    assert verdict.named


@pytest.mark.slow
def test_a_guide_that_is_broken_off_leaves_a_safe_bench_and_finds_all_the_second_time() -> None:
    verdict = try_seed(1, with_run=False)
    assert verdict.broke_off
    assert verdict.wrong == []


@pytest.mark.slow
@pytest.mark.realtime
def test_the_guide_speaks_for_itself_and_motors_are_safe_wherever_it_ends(tmp_path: Path) -> None:
    rig = tmp_path / "my-rig.toml"
    with playing(tmp_path, "--unbuilt", "all", "--seed", "7") as bench:
        lead = [SINEW, "doctor", "--port", bench.port, "--guide", str(rig)]
        short = subprocess.run(lead, input="\n\n\n", capture_output=True, text=True, timeout=PATIENCE, check=False)
        with subprocess.Popen([*lead, "--yes"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            while "lever: " not in process.stdout.readline():
                pass
            time.sleep(2.0)
            process.send_signal(signal.SIGINT)
            _, broken = communicate(process, PATIENCE)
        whole = subprocess.run(
            [*lead, "--yes", "--json", "--from", "lever"], capture_output=True, text=True, timeout=600, check=False
        )
        truth = bench.truth()
    document = json.loads(whole.stdout)
    wiring = load_rig(rig).wiring
    assert (short.returncode, process.returncode, whole.returncode) == (1, 1, 0)
    assert "the input ended; no motor has torque; nothing was written" in short.stderr
    assert "interrupted by Ctrl-C; no motor has torque" in broken
    assert (truth["in_safe_state"], [motor["torque"] for motor in truth["motors"]]) == (True, [False] * 5)
    assert (document["ok"], document["next"].split()[:3]) == (True, ["sinew", "run", "first"])
    assert wiring.drive_sign == truth["unbuilt"]["drive_sign"]
    assert len(wiring.measured) > 8


@pytest.mark.slow
def test_the_campaign_tells_a_rig_that_is_not_the_bench() -> None:
    scene = make_scene(0, ("pulls",), drawn=False)
    assert list(misunderstood(scene, scene.unbuilt.spec)) == []
    assert any("pulls" in wrong for wrong in misunderstood(scene, scene.spec))
