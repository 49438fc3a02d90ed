"""This is where it is said what a run may be called: a name that is safe as a folder, in an address and on a page."""

import re

__all__ = ["is_run_name"]

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")


def is_run_name(name: object) -> bool:
    """Return whether this is up to 80 letters, digits, '.', '_' or '-', the first a letter or a digit."""
    return isinstance(name, str) and _NAME.fullmatch(name) is not None
