"""Programs that are kept: traced once, the same numbers, nothing of what is no longer so."""

import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sinew
from sinew.measure import kept
from sinew.plan.toml import load_rig
from sinew.solve import programs
from sinew.solve.programs import configure, program
from sinew.tune.pretension import _stiffness
from sinew.twin.parameters import from_rig

pytestmark = pytest.mark.slow

configure()
P = from_rig(load_rig("paper"))
GIVEN = (np.linspace(0.0, 2e-3, 5), jax.tree.map(lambda leaf: np.full(5, leaf), P))


def anew() -> Callable[..., Any]:
    """Return a program of the package as another process has it, which has not called it yet."""
    programs.forget()
    return program()(_stiffness.__wrapped__)


def asked() -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in anew()(*GIVEN)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SINEW_CACHE", str(tmp_path))
    return tmp_path / "programs"


@pytest.fixture
def traces(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of what is traced from now on."""
    told: list[str] = []
    trace = programs._traced

    def counting(key: str, function: Callable[..., Any], *given: Any) -> Any:
        told.append(function.__name__)
        return trace(key, function, *given)

    monkeypatch.setattr(programs, "_traced", counting)
    return told


def test_a_program_is_traced_once_and_gives_what_jax_gives(folder: Path, traces: list[str]) -> None:
    plain = jax.jit(_stiffness.__wrapped__)(*GIVEN)
    for _ in range(3):
        np.testing.assert_array_equal(asked(), [np.asarray(leaf) for leaf in plain])
    assert traces == ["_stiffness"]
    assert len(list(folder.iterdir())) == 1


def test_other_shapes_and_another_source_are_another_program(
    folder: Path, traces: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked()
    shorter = jax.tree.map(lambda leaf: leaf[:3], GIVEN)
    assert np.shape(anew()(*shorter)[0]) == (3,)
    monkeypatch.setattr(kept, "_of_this_source", lambda: "of tomorrow")
    asked()
    assert len(traces) == 3


@pytest.mark.parametrize("seed", range(2))
def test_what_was_damaged_is_traced_anew_and_mended(folder: Path, traces: list[str], seed: int) -> None:
    before = asked()
    (file,) = folder.iterdir()
    whole, rng = file.read_bytes(), random.Random(seed)
    at = rng.randrange(len(whole) // 4, 3 * len(whole) // 4)
    harm = {
        "other letter": whole[:at] + (b"A" if whole[at : at + 1] != b"A" else b"B") + whole[at + 1 :],
        "cut": whole[: rng.randrange(len(whole))],
        "other": bytes(rng.randrange(256) for _ in range(400)),
        "swapped": whole.replace(b'"found": ["', b'"found": ["AAAA' + b"B" * 4 * rng.randrange(1, 9)),
        "none": b"null",
    }
    for said in harm.values():
        file.write_bytes(said)
        for _ in range(2):
            np.testing.assert_array_equal(asked(), before)
    assert len(traces) == 1 + len(harm)


SOURCE = """
import sys, time
from pathlib import Path
import sinew
from sinew.measure.kept import keep, key_of, recall
when = sys.argv[1]
file = Path(sinew.__file__).with_name("solve") / "rest.py"
def change():
    time.sleep(0.05)
    file.write_bytes(file.read_bytes())
if when == "before":
    change()
before = recall("things", key_of("asked"))
if when == "after":
    change()
keep("things", key_of("asked"), 1 + (before or 0))
print(before)
"""


def test_who_may_have_read_another_source_reads_and_keeps_nothing(tmp_path: Path) -> None:
    shutil.copytree(Path(sinew.__file__).parent, tmp_path / "sinew", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "SINEW_CACHE": str(tmp_path / "cache")}

    def told(changed: str) -> str:
        command = [sys.executable, "-c", SOURCE, changed]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()

    assert [told("never"), told("never"), told("never")] == ["None", "1", "2"]
    assert [told("before"), told("never"), told("never")] == ["None", "None", "1"]  # the file has another time
    assert [told("after"), told("never"), told("never")] == ["2", "None", "1"]


def test_where_nothing_can_be_kept_it_is_computed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    file.write_text("no folder")
    monkeypatch.setenv("SINEW_CACHE", str(file))
    np.testing.assert_array_equal(asked(), [np.asarray(leaf) for leaf in jax.jit(_stiffness.__wrapped__)(*GIVEN)])


class Theirs:
    pass


def squared(x: jax.Array, law: object = None) -> jax.Array:
    return x * x


def test_no_program_of_other_people_is_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert program(static=("law",))(squared)(3.0) == 9.0
    monkeypatch.setattr(squared, "__module__", "sinew.tune.pretension")  # as if it stood there
    ours = program(static=("law",))(squared)
    programs.forget()
    assert ours(3.0, Theirs()) == ours(3.0, law=Theirs) == 9.0
    assert not folder.exists()
    assert ours(3.0, "a law") == ours(3.0) == 9.0
    assert len(list(folder.iterdir())) == 2


def test_a_program_within_another_is_part_of_it() -> None:
    whole = jax.jit(lambda shortening: _stiffness(shortening, GIVEN[1])[0])(GIVEN[0])
    np.testing.assert_allclose(whole, _stiffness(*GIVEN)[0], rtol=1e-12)
    slope = jax.jacfwd(lambda shortening: _stiffness(shortening, GIVEN[1])[0])(jnp.asarray(GIVEN[0]))
    step = 1e-7
    ends = [np.asarray(_stiffness(GIVEN[0] + sign * step, GIVEN[1])[0]) for sign in (-1, 1)]
    np.testing.assert_allclose(np.diag(slope), (ends[1] - ends[0]) / (2 * step), rtol=1e-5)


def test_what_encloses_a_number_is_refused() -> None:
    number = 3.0

    def scaled(x: jax.Array) -> jax.Array:
        return number * x

    with pytest.raises(TypeError, match="encloses something"):
        program()(scaled)


def test_what_is_handed_in_wrongly_is_refused(folder: Path) -> None:
    for wrong in ([*GIVEN, 7.0], [GIVEN[0]]):
        with pytest.raises(TypeError):
            anew()(*wrong)
    with pytest.raises(TypeError):
        anew()(*GIVEN, p=GIVEN[1])
    assert not folder.exists()


def test_an_error_of_the_function_reaches_who_calls_it(folder: Path) -> None:
    with pytest.raises(ValueError, match="inconsistent sizes"):
        anew()(np.zeros(4), GIVEN[1])
    assert not folder.exists()


_SLOW_TO_FOLD = """
import os, sys, tempfile
import jax, numpy as np
from sinew.solve.programs import configure

def logged(name, size):
    values = np.random.default_rng(0).random((size, size, size))
    def summed(x):
        return x + jax.lax.reduce_window(values, 0.0, jax.lax.add, (7, 7, 7), (1, 1, 1), "SAME").sum()
    with tempfile.TemporaryFile() as file:
        before = os.dup(2)
        os.dup2(file.fileno(), 2)
        jax.jit(summed).lower(1.0).compile()
        os.dup2(before, 2)
        file.seek(0)
        print(name, len(file.read()))

jax.config.update("jax_enable_x64", True)
logged("jax", SIZE)
configure()
logged("sinew", SIZE + 1)
"""


@pytest.mark.slow
def test_what_xla_logs_does_not_reach_the_screen() -> None:
    # Folding this constant takes XLA over a second, which it says at the level of an error.
    code = _SLOW_TO_FOLD.replace("SIZE", "16")
    surroundings = {name: value for name, value in os.environ.items() if name not in ("JAX_LOGGING_LEVEL", "XLA_FLAGS")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=surroundings)
    (_, by_jax), (_, by_sinew) = (line.split() for line in done.stdout.splitlines())
    assert int(by_jax) > 0
    assert int(by_sinew) == 0


def test_a_users_own_level_of_jaxs_log_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    before = jax.config.jax_logging_level
    monkeypatch.setenv("JAX_LOGGING_LEVEL", "ERROR")
    try:
        jax.config.update("jax_logging_level", "ERROR")
        programs._begun.__wrapped__()
        assert jax.config.jax_logging_level == "ERROR"
    finally:
        jax.config.update("jax_logging_level", before)


def test_jax_logs_nothing_below_what_ends_the_process() -> None:
    assert jax.config.jax_logging_level == "CRITICAL"
