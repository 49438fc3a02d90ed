"""`sinew doctor --guide` at an emulated bench out of its boxes: led to a rig file, broken off, and begun again."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.contracts.commands import refused
from tests.contracts.emulated_bench import PATIENCE, SINEW, playing
from tests.experiments.wrong_wirings import DOUBLE, NEW, USED, Scene, Wrong, broken_off, first_run, led, misunderstood
from tests.patience import communicate

from sinew.plan.toml import dump_rig, load_rig

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals of Linux")


def test_a_step_that_there_is_not_is_refused_with_those_that_are(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "doctor", "--port", "bench", "--guide", "my.toml", "--step", "levers")
    assert "found --step levers, expected one of devices, settings, board, lever, tendons, check" in said


def test_a_step_without_a_guide_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "doctor", "--port", "bench", "--step", "lever")
    assert "found --step or --from without --guide" in said


def test_a_port_that_is_not_there_is_refused_before_any_step(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "doctor", "--port", "no-bench", "--guide", "my.toml", "--yes")
    assert "cannot open no-bench" in said
    assert "`sinew emulate`" in said


@pytest.mark.slow
def test_a_bench_out_of_its_boxes_is_led_to_its_first_run() -> None:
    scene = Scene(NEW)
    wrong, rig = led(scene, scene.spec)
    named = {told.subject for told in scene.told if told.severity == "note"}
    assert wrong == []
    assert {"bus", "drive", "IMU", "tendon 1", "tendon 2"} <= named
    assert (first_run(scene, rig), scene.unsafe()) == ("", [])


@pytest.mark.slow
@pytest.mark.parametrize(("wrong", "step", "dies"), [(USED, "lever", False), (DOUBLE, "tendons", True)])
def test_a_guide_that_is_broken_off_leaves_a_safe_bench_and_finds_all_the_second_time(
    wrong: Wrong, step: str, dies: bool
) -> None:
    scene = Scene(wrong)
    unsafe, rig = broken_off(scene, step, 3.0, dies=dies)
    assert unsafe == []
    assert led(scene, rig)[0] == []


@pytest.mark.slow
@pytest.mark.realtime
def test_the_guide_speaks_for_itself_and_motors_are_safe_wherever_it_ends(tmp_path: Path) -> None:
    rig, there = tmp_path / "my-rig.toml", tmp_path / "there.toml"
    there.write_text(dump_rig(Scene(NEW).true))
    with playing(tmp_path, "--new", "--rig", str(there), "--seed", "7") as bench:
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
    assert wiring.drive_sign == -1
    assert len(wiring.measured) > 8


@pytest.mark.slow
def test_a_rig_that_is_not_the_benchs_is_told_from_it() -> None:
    scene = Scene(Wrong({"tendon_pull": (1, -1, 1, 1)}))
    assert list(misunderstood(scene, scene.true)) == []
    assert any("pulls" in wrong for wrong in misunderstood(scene, scene.spec))
