"""An emulated bench in a process of its own, `sinew emulate`, and the port to it."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.patience import Patience, await_end, comes

SINEW = Path(sys.executable).with_name("sinew")
PATIENCE = 60.0  # s; how long a start may take on a busy computer


@contextmanager
def emulated(folder: Path, *options: str) -> Iterator[str]:
    """Give the path of the port while an emulator runs; it must end with status 0 and say nothing on stderr."""
    link = folder / "bench"
    command = [SINEW, "emulate", "--link", str(link), "--json", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            assert comes(process.stdout, PATIENCE), "the emulator does not get ready"
            assert said(process.stdout.readline())["link"] == str(link)
            yield str(link)
        finally:
            process.terminate()
            error = process.stderr.read()
            status = await_end(process, PATIENCE)
        assert (status, error) == (0, "")


def said(line: str) -> dict[str, Any]:
    """Return what the emulator said when it was ready."""
    return dict(json.loads(line))


def eventually(claim: Callable[[], bool], seconds: float = 10.0) -> bool:
    """Return whether a claim comes true."""
    patience = Patience(seconds)
    while not claim():
        if patience.is_over():
            return False
        time.sleep(0.01)
    return True
