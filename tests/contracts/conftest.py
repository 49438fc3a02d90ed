"""This is where the tests of `sinew run` in virtual time get their plan, and a folder that is not there yet."""

from pathlib import Path

import pytest
from tests.contracts.emulated_bench import TINY


@pytest.fixture
def plan(tmp_path: Path) -> str:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return str(path)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "out"
