"""Refusal of a command line: status 2, nothing on stdout, one line that says why."""

from pathlib import Path

import pytest

from sinew.apps.cli import main


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Return the line that a refused command line leaves on stderr."""
    status = main([*map(str, arguments)])
    out, err = capsys.readouterr()
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("sinew: ")
    return err
