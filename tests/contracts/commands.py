"""What a command line answers: its document, or a refusal of status 2 in one line that says why."""

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from tests.tables import rows

from sinew.apps.cli import main


def command_lines(table: str) -> pytest.MarkDecorator:
    """Return the marker that runs a test with each line `WORDS => SENTENCE` of a table.

    Its `arguments` are the words as a shell splits them, its `sentence` is a part of the line that is expected.
    """
    cases = [
        pytest.param(tuple(shlex.split(words)), sentence, id=words or "nothing") for words, sentence in rows(table)
    ]
    return pytest.mark.parametrize(("arguments", "sentence"), cases)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Return the line that a refused command line leaves on stderr."""
    status = main([*map(str, arguments)])
    out, err = capsys.readouterr()
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("sinew: ")
    return err


def answered(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> dict[str, Any]:
    """Return the document of a command line that does well and says nothing on stderr."""
    document, err = answered_with_remarks(capsys, *arguments)
    assert err == ""
    return document


def answered_with_remarks(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[dict[str, Any], str]:
    """Return the document of a command line that does well, and what it says on stderr."""
    capsys.readouterr()
    status = main([*map(str, arguments), "--json"])
    out, err = capsys.readouterr()
    assert status == 0
    return dict(json.loads(out)), err
