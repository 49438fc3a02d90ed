"""Reasons, by name, why a run did not start or did not reach its end.

SinewError
└── BenchError
    ├── StartError              nothing has moved: the bench, the plan or the disk is not as it must be
    └── StoppedError            motors were under power; the rig was brought to its safe state
        ├── LimitError          a measured value went beyond a limit of the rig
        └── LostError           a device fell silent, froze or does not do what it is told
            └── PauseError      motors were stopped by their watchdogs because the computer paused
"""

from sinew.measure.errors import SinewError


class BenchError(SinewError):
    """Base of what ends a run on a bench."""


class StartError(BenchError):
    """Nothing has moved: the bench, the plan or the disk is not as it must be."""


class StoppedError(BenchError):
    """Motors were under power; the rig was brought to its safe state."""


class LimitError(StoppedError):
    """A measured value went beyond a limit of the rig."""


class LostError(StoppedError):
    """A device fell silent, froze or does not do what it is told."""


class PauseError(LostError):
    """Motors were stopped by their watchdogs because the computer paused; a run may go on from its last whole group."""
