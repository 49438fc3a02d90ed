"""This is where it is said what the pages ask of whoever computes for them."""

from collections.abc import Awaitable
from typing import Any, Protocol

__all__ = ["Work"]


class Work(Protocol):
    """Runs what takes long, or needs JAX, in another process."""

    def warm_up(self) -> None:
        """Begin to compile what sliders need; returns at once."""
        ...

    def call(self, name: str, *arguments: Any, key: str | None = None) -> Awaitable[Any]:
        """Return what a function of `sinew.apps.dashboard.work` returns; with a key only the latest request runs."""
        ...
