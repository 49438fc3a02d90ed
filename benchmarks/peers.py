"""Peers that cannot live in .venv: asked in a process of their own, in the interpreter that `make peers` makes."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PYTHON = ROOT / ".venv-peers" / "bin" / "python"

_RAISED = re.compile(r"[\w.]*(Error|Exception|Interrupt)\b")
"""How the line of a traceback begins that says what was raised; JAX writes more lines below it."""


class PeerSilentError(Exception):
    """A peer that told nothing; the text says why and what to do."""


def told_by(script: str, asked: dict[str, Any], timeout_s: float = 300) -> dict[str, Any]:
    """Return what a script of this folder tells as one JSON document on its last line, asked with another one.

    Raises PeerSilentError where there is no interpreter for peers, or the script fails.
    """
    if not PYTHON.exists():
        raise PeerSilentError(f"found no {PYTHON.relative_to(ROOT)}; make it with `make peers`")
    command = [str(PYTHON), str(ROOT / "benchmarks" / script), json.dumps(asked)]
    try:
        done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=timeout_s)
    except subprocess.CalledProcessError as error:
        lines = error.stderr.strip().splitlines()
        last = ([line for line in lines if _RAISED.match(line)] or lines)[-1:]
        raise PeerSilentError(f"it ended with status {error.returncode}: {' '.join(last)}; try `make peers`") from None
    except subprocess.TimeoutExpired:
        raise PeerSilentError(f"it told nothing for {timeout_s:g} s; run {script} alone") from None
    answer: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return answer
