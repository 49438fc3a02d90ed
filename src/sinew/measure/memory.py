"""How much memory a file may ask for: what a process may take, decided before anything is read."""

import os
import resource


def most_bytes() -> int:
    """Return how many bytes of numbers this process may take from a file: half of this computer's memory.

    Of a process with a limit of its own (`RLIMIT_DATA`, as the dashboard's workers have) it is a quarter of that limit:
    what is read is copied for its hash, and again where it is analysed.
    """
    half = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    own, _ = resource.getrlimit(resource.RLIMIT_DATA)
    return half if own == resource.RLIM_INFINITY else min(half, own // 4)
