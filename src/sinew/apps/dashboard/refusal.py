"""This is where a command that is not carried out says why."""

from sinew.measure.errors import SinewError

__all__ = ["RefusedError"]


class RefusedError(SinewError):
    """A command is not carried out.

    status: of HTTP, 4xx: 403 not allowed, 409 not now, 422 not valid. more: what else is answered: ticket, False where
    a page needs another; number, the last one that was heard.
    """

    def __init__(self, status: int, sentence: str, **more: int) -> None:
        super().__init__(sentence)
        self.status, self.more = status, more
