"""JAX as Sinew sets it up: its cache of compiled programs, what it logs, programs within programs."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from sinew.solve.programs import configure

pytestmark = pytest.mark.slow

configure()

CACHED = """
import jax, jax.numpy as jnp
from sinew.solve.programs import configure, program
hits = []
jax.monitoring.register_event_listener(lambda name, **_: hits.append(name) if name.endswith("cache_hits") else None)

@program()
def long(x):
    for _ in range(12):
        x = jnp.sin(jnp.sort(x) + jnp.cumsum(x))
    return x

configure()
long(jnp.arange(100.0))
print(len(hits))
"""


def hits_in_another_process(folder: Path) -> int:
    environment = {**os.environ, "SINEW_CACHE": str(folder)}
    done = subprocess.run([sys.executable, "-c", CACHED], env=environment, capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_a_program_is_compiled_once_for_all_processes(tmp_path: Path) -> None:
    assert hits_in_another_process(tmp_path) == 0
    assert hits_in_another_process(tmp_path) > 0


def test_where_no_folder_can_be_written_programs_are_compiled_each_time(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    assert [hits_in_another_process(tmp_path / "file") for _ in range(2)] == [0, 0]


def test_jax_logs_nothing_below_what_ends_the_process() -> None:
    assert jax.config.jax_logging_level == "CRITICAL"
