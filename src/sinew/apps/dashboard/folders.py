"""The folder of runs from outside: what a run may be called, what is ours, and reading that no link leads astray.

A run's folder may have been copied or planted with links in it. Whoever looks at the pages would read through them
what the server may read. So a folder that is a link, or has one among its files, is not read, and files are opened
part by part without following any.
"""

import os
import re
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from sinew.measure.errors import FileError, SinewError


class RefusedError(SinewError):
    """A command is not carried out.

    status: of HTTP, 4xx: 409 not now, 422 not valid. more: what else is answered: exists, where there is one of that
    name.
    """

    def __init__(self, status: int, sentence: str, **more: int) -> None:
        super().__init__(sentence)
        self.status, self.more = status, more


BENCH = ".bench"
"""Folder of what belongs to the bench and to no run."""

SHELVES = ("rigs", "plans")
"""Folders that hold the lab's own rigs and plans, and no run."""

RECORDING, RESULTS = "recording.nc", "results.nc"
CACHE = ".dashboard"
"""Folder in a run's own for what can be made anew."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")


def is_run_name(name: object) -> bool:
    """Return whether this is up to 80 letters, digits, '.', '_' or '-', a letter or digit first, and no library."""
    return isinstance(name, str) and _NAME.fullmatch(name) is not None and name.lower() not in SHELVES


def require_run_name(name: str) -> str:
    """Return a name that a run may have. Raises RefusedError for another."""
    if not is_run_name(name):
        raise RefusedError(
            422,
            f"found {name[:100]!r} for a run's name, expected up to 80 letters, digits, '.', '_' or '-', "
            "the first a letter or a digit",
        )
    return name


def unlinked(folder: Path) -> Path:
    """Return a run's folder, if neither it nor what lies in it is a link. Raises FileError for one that is."""
    found = folder.name if folder.is_symlink() else None
    for level in (folder, folder / CACHE):
        with suppress(OSError), os.scandir(level) as entries:  # what is not there is for others to say
            found = found or next((entry.name for entry in entries if entry.is_symlink()), None)
    if found is not None:
        raise FileError(f"{folder.name}: {found} is a link, which is not followed; put the file itself there")
    return folder


def open_inside(root: Path, path: Path) -> BinaryIO:
    """Return a file below a folder, opened for reading through no link, whatever is exchanged meanwhile.

    root: may be a link itself. Raises FileError where a part of the path is a link or leads out, or there is no file.
    """
    handle = os.open(root, os.O_RDONLY | os.O_DIRECTORY)
    try:
        parts = path.relative_to(root).parts
        if not parts or ".." in parts:
            raise FileError(f"{path} does not lie in {root}")
        for part in parts[:-1]:
            below = os.open(part, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=handle)
            os.close(handle)
            handle = below
        file = os.open(parts[-1], os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=handle)
    except (OSError, ValueError) as error:
        raise FileError(f"cannot read {path.name} of {path.parent.name}: it is absent, or a link") from error
    finally:
        os.close(handle)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise FileError(f"{path.name} of {path.parent.name} is no file")
    return os.fdopen(file, "rb")


@contextmanager
def held_inside(root: Path, path: Path) -> Iterator[Path]:
    """Give a name under which a file below a folder can be opened, the one that was found through no link.

    A FileError that tells that name tells the file's own instead.
    """
    with open_inside(root, path) as file:
        held = Path(f"/dev/fd/{file.fileno()}")
        try:
            yield held if held.exists() else path
        except FileError as error:
            raise FileError(str(error).replace(str(held), path.name)) from error


def name_in(text: str) -> str | None:
    """Return the name in the text of a rig or plan, without reading all of it: a dumped one begins with its name."""
    line = next((one for one in text.splitlines() if one.startswith("name")), "")
    try:
        return str(tomllib.loads(line)["name"])
    except (tomllib.TOMLDecodeError, KeyError):
        return None
