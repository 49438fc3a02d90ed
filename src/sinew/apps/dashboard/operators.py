"""Viewers and operators of a bench: who operates, which commands were heard before, which folders are safe to read.

Each page that is loaded takes a ticket and numbers its commands. A number that is not greater than the last one is a
command that was heard already, sent again by whoever recorded it. One ticket at most operates; it does so until it
gives that up, its page is closed or falls silent, or another takes over, which is a command of its own and never
happens by the way.
"""

import os
import re
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from sinew.measure.errors import FileError, SinewError

# A command that is not carried out says why.


class RefusedError(SinewError):
    """A command is not carried out.

    status: of HTTP, 4xx: 403 not allowed, 409 not now, 422 not valid. more: what else is answered: ticket, False where
    a page needs another; number, the last one that was heard; exists, where there is one of that name.
    """

    def __init__(self, status: int, sentence: str, **more: int) -> None:
        super().__init__(sentence)
        self.status, self.more = status, more


_MOST_TICKETS = 1000
_PRESENT_S = 30.0

LEAVES_S = 10.0
"""A page that says it leaves operates so long yet [s]: from one page to the next a tab leaves and comes back."""

LAPSES_S = 150.0
"""A page that is not heard of for so long operates no more [s]; browsers let a hidden one speak once a minute."""


@dataclass
class Ticket:
    """A page that was loaded. id: known to that page only. name: known to all. number: of its last command."""

    id: str
    name: str
    number: int = 0
    seen: float = field(default=0.0, repr=False)
    left: float | None = field(default=None, repr=False)


class Operators:
    """Tickets and the operator among them. clock: monotonic [s]; wall: what the time is for people [s since 1970]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, wall: Callable[[], float] = time.time) -> None:
        self._clock, self._wall = clock, wall
        self._tickets: dict[str, Ticket] = {}
        self._given = 0
        self._operator: Ticket | None = None
        self._since = 0.0

    def give_ticket(self) -> Ticket:
        """Return a new ticket. The one that was silent longest makes room, though never the operator's."""
        if len(self._tickets) >= _MOST_TICKETS:
            others = [ticket for ticket in self._tickets.values() if ticket is not self._operator]
            del self._tickets[min(others, key=lambda ticket: ticket.seen).id]
        self._given += 1
        ticket = Ticket(secrets.token_urlsafe(16), f"page {self._given}", seen=self._clock())
        self._tickets[ticket.id] = ticket
        return ticket

    def admit(self, ticket_id: str, number: int) -> Ticket:
        """Return the ticket of a command, which is heard now. Raises RefusedError for one unknown or heard before."""
        ticket = self._tickets.get(ticket_id)
        if ticket is None:
            raise RefusedError(403, "found a ticket that was not given here; load the page again", ticket=False)
        if number <= ticket.number:
            raise RefusedError(
                409,
                f"found command {number} again, expected one after {ticket.number}; nothing was done",
                number=ticket.number,
            )
        self._drop_absent()
        ticket.number, ticket.seen, ticket.left = number, self._clock(), None
        return ticket

    def see(self, ticket_id: str | None) -> None:
        """Note that a page is still there."""
        if ticket_id is not None and (ticket := self._tickets.get(ticket_id)) is not None:
            self._drop_absent()
            ticket.seen, ticket.left = self._clock(), None

    def leave(self, ticket_id: str) -> None:
        """Note that a page is being closed, or left for another one of the same tab, which is heard of soon."""
        if (ticket := self._tickets.get(ticket_id)) is not None:
            ticket.left = self._clock()

    def _drop_absent(self) -> None:
        """Leave the bench without an operator where the operator's page is gone."""
        ticket, now = self._operator, self._clock()
        if ticket is None:
            return
        is_gone = ticket.left is not None and now - ticket.left > LEAVES_S
        if is_gone or now - ticket.seen > LAPSES_S:
            self._operator = None

    def take(self, ticket: Ticket) -> str:
        """Make a ticket the operator's, and return a sentence that says from whom."""
        self._drop_absent()
        before, self._operator = self._operator, ticket
        if before is ticket:
            return "this page is in control already"
        self._since = self._wall()
        return "this page is in control now" + ("; another page was before" if before else "")

    def give(self, ticket: Ticket) -> str:
        """Leave the bench without an operator. Raises RefusedError where somebody else operates."""
        self.require_operator(ticket)
        self._operator = None
        return "nobody is in control now"

    def require_operator(self, ticket: Ticket) -> None:
        """Raise RefusedError where a ticket is not the operator's."""
        self._drop_absent()
        if self._operator is None:
            raise RefusedError(403, "nobody is in control; take control first")
        if self._operator is not ticket:
            raise RefusedError(403, "another page is in control; take over first")

    def viewers(self) -> int:
        """Return how many pages were heard of within the last half minute."""
        return sum(self._clock() - ticket.seen < _PRESENT_S for ticket in self._tickets.values())

    def operator(self, asking: str | None) -> dict[str, object] | None:
        """Return who operates since when [s since 1970], and whether that is the ticket `asking`; None for nobody."""
        self._drop_absent()
        if self._operator is None:
            return None
        mine = asking is not None and secrets.compare_digest(self._operator.id.encode(), asking.encode())
        return {"name": self._operator.name, "since": self._since, "mine": mine}


# The folder of runs from outside: what a run may be called, what is ours, and reading that no link leads astray.
#
# A run's folder may have been copied or planted with links in it. Whoever looks at the pages would read through them
# what the server may read. So a folder that is a link, or has one among its files, is not read, and files are opened
# part by part without following any.

BENCH = ".bench"
"""Folder of what belongs to the bench and to no run."""

SIGNED_OUT = "signed-out"
"""Name of the file in it that lists the sessions that were ended."""

SHELVES = ("rigs", "plans")
"""Folders that hold the lab's own rigs and plans, and no run."""

CACHE = ".dashboard"
"""Folder in a run's own for what can be made anew."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")


def is_run_name(name: object) -> bool:
    """Return whether this is up to 80 letters, digits, '.', '_' or '-', the first a letter or a digit, and no shelf."""
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
    for place in (folder, folder / CACHE):
        with suppress(OSError), os.scandir(place) as entries:  # what is not there is for others to say
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
