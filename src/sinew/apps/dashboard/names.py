"""Names in the folder of runs: what a run may be called, and what is ours."""

import re

BENCH = ".bench"
"""Folder of what belongs to the bench and to no run."""

SIGNED_OUT = "signed-out"
"""Name of the file in it that lists the sessions that were ended."""

SHELVES = ("rigs", "plans")
"""Folders that hold the lab's own rigs and plans, and no run."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")


def is_run_name(name: object) -> bool:
    """Return whether this is up to 80 letters, digits, '.', '_' or '-', the first a letter or a digit, and no shelf."""
    return isinstance(name, str) and _NAME.fullmatch(name) is not None and name.lower() not in SHELVES
