"""This is where the newest samples are kept, in memory that never grows."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["Ring"]

Floats = NDArray[np.float64]


class Ring:
    """The newest columns of a table that goes on.

    rows: how many rows a column has. capacity: how many columns are kept. count: columns put so far; a column's number
    is its place in that count, and stays.
    """

    def __init__(self, rows: int, capacity: int) -> None:
        self._table = np.full((rows, capacity), np.nan)
        self.count = 0

    @property
    def oldest(self) -> int:
        """Number of the oldest column that is kept."""
        return max(0, self.count - self._table.shape[1])

    def put(self, columns: Floats) -> None:
        """Add columns (rows, n); the oldest make room."""
        capacity = self._table.shape[1]
        kept = columns[:, -capacity:]
        first = self.count + columns.shape[1] - kept.shape[1]
        self._table[:, np.arange(first, first + kept.shape[1]) % capacity] = kept
        self.count += columns.shape[1]

    def get(self, first: int, end: int) -> Floats:
        """Return the columns with numbers in [first, end), those that are still kept."""
        first, end = max(first, self.oldest), min(end, self.count)
        return self._table[:, np.arange(first, max(first, end)) % self._table.shape[1]]
