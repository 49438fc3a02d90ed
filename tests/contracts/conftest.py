"""What several tests of commands need: a plan, a folder that is not there yet, a sweep."""

from pathlib import Path

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import WatchedPort, virtual_port
from tests.contracts.identify_sweep import write_sweep
from tests.contracts.virtual_run import RunHere


@pytest.fixture
def plan(tmp_path: Path) -> str:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return str(path)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "out"


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> WatchedPort:
    """Return the port of an emulated bench that stands in for every serial port."""
    return virtual_port(monkeypatch)


@pytest.fixture
def run_here(plan: str, out: Path, port: WatchedPort, capsys: pytest.CaptureFixture[str]) -> RunHere:
    """Return `sinew run` of the tiny plan on that port."""
    return RunHere(plan, out, port, capsys)


@pytest.fixture(scope="session")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a CSV file of a linear joint under a force sweep."""
    return write_sweep(tmp_path_factory.mktemp("sweep"))
