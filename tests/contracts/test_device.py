"""`--device gpu`: what is said where JAX finds none, and that a batch has the numbers of its members alone."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks import gpu

SENTENCE = 'found no GPU that JAX can use, only cpu; install a JAX for yours, as by `pip install "jax[cuda13]"`, or '
SENTENCE += "compute on the CPU (--device cpu)"


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "design --stride-hz 0.7:1.1 --yaw-deg 7 --out torso",
        "pose paper --map --pretension-mm 6 --step-deg 20 --out map.png",
        "calibrate paper --paper --posterior --out mine.toml",
    ],
)
def test_a_command_for_a_gpu_that_is_not_there_says_so_in_one_line(words: str, tmp_path: Path) -> None:
    code = "import sys; from sinew.apps.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, *shlex.split(words), "--device", "gpu"]
    environment = os.environ | {"JAX_PLATFORMS": "cpu"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"sinew: {SENTENCE}\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_benchmark_says_why_the_figure_of_a_gpu_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    assert gpu.asked("gpu", [4]) == SENTENCE


def test_the_benchmark_says_that_the_figure_of_a_gpu_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = {"seconds": 2.0, "cpu_s": 1.5, "kind": "float64", "values": [[1.0]]}
    told = {"cpu": {"64 designs": one}, "gpu": SENTENCE}
    monkeypatch.setattr(gpu, "asked", lambda device, _counts: told[device])
    (row,) = gpu.rows()
    assert (row.theirs, row.note) == (None, f"the GPU's figure is missing: {SENTENCE}")


@pytest.mark.slow
def test_rigs_of_a_posterior_have_in_a_batch_the_numbers_that_they_have_alone() -> None:
    from sinew.paper.numbers import observe, rig_with, scale_of
    from sinew.plan.toml import load_rig

    rig = load_rig("paper")
    scale = scale_of(rig)
    rigs = [rig_with(rig, scale.likely + share * scale.width) for share in (-0.2, 0.0, 0.2)]
    together = observe(rigs)
    assert np.ptp(together, axis=0).min() > 0
    np.testing.assert_allclose(together, [observe([one])[0] for one in rigs], rtol=1e-9)


@pytest.mark.slow
def test_designs_are_worth_in_a_batch_what_they_are_worth_alone() -> None:
    import jax

    from sinew.plan.toml import load_rig
    from sinew.predict.design import shear_modulus_of
    from sinew.solve.programs import configure
    from sinew.tune.candidate import DesignTarget, frame_of, judge

    configure()
    rig = load_rig("paper")
    frame, modulus = frame_of(rig, DesignTarget((0.7, 1.1), 7.0, 0.25), "circle"), shear_modulus_of(rig)
    places = np.random.default_rng(0).uniform(0.2, 0.8, (6, 5))
    together = jax.jit(jax.vmap(judge, in_axes=(0, None, None)))(places, modulus, frame)
    alone = jax.jit(judge)
    for place, *batched in zip(places, *together, strict=True):
        for one, other in zip(alone(place, modulus, frame), batched, strict=True):
            np.testing.assert_allclose(other, one, rtol=1e-9)
