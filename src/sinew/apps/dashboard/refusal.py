"""This is where a command that is not carried out says why."""

from sinew.measure.errors import SinewError

__all__ = ["RefusedError"]


class RefusedError(SinewError):
    """A command is not carried out.

    status: of HTTP, 4xx: 403 not allowed, 409 not now, 422 not valid. knows_ticket: False where a page needs another.
    """

    def __init__(self, status: int, sentence: str, *, knows_ticket: bool = True) -> None:
        super().__init__(sentence)
        self.status, self.knows_ticket = status, knows_ticket
