"""Record and run for the tests of `sinew identify`: a linear joint under a force sweep."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.contracts.commands import refused
from tests.unit.identify_signals import chirp, motion, noisy, viscous

from sinew.apps.cli import main

TIME = np.arange(0, 16, 0.01)
PHASE = chirp(1, 6, 16)
COLUMNS = ("--time", "t", "--input", "u:V", "--output", "y:V", "--excitation", "force")
LINEAR = ("--model", "linear")
DOCUMENT = (
    "model",
    "parameters",
    "natural_frequency_hz",
    "damping_ratio",
    "rmse",
    "unit",
    "converged",
    "message",
    "unidentifiable",
    "mechanics",
    "compared",
)


def push(t):
    return 20 * np.sin(PHASE(t))


def write(path: Path, **columns: np.ndarray) -> Path:
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    return path


def write_sweep(folder: Path) -> Path:
    """Return the record of a linear joint of 3 Hz and D = 0.1 under a force sweep, in volts."""
    response = noisy(motion(viscous(0.1), push, TIME)[0], 0.002, 1)
    return write(folder / "sweep.csv", t=TIME, u=push(TIME), y=response)


def identified(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> dict[str, Any]:
    assert main(["identify", *map(str, arguments), "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def unidentified(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Return the line with which `sinew identify` refuses."""
    return refused(capsys, "identify", *arguments, "--json")
