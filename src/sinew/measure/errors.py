"""The error tree: names for bad input, for what can go wrong at a bench, and for why a run did not reach its end.

    SinewError                 anything a user can put right; the command line exits 2 with its sentence
    ├── FileError              a file cannot be read or written, or is not what it claims to be
    ├── SchemaError            a dataset breaks the recording or result schema
    ├── UnitError              a unit is unknown or of the wrong dimension
    ├── SpecError              a rig or plan is not valid, or asks for what the rig cannot give
    ├── RecordingError         the samples cannot answer the question (gap, NaN, too short, growing, ...)
    │   └── TimeError          the time stamps are unusable (backwards, gap, not enough)
    ├── HardwareError          between Sinew and a bench
    │   ├── PacketError        a packet that cannot be sent
    │   ├── RegisterError      no such register, or a value that it cannot hold
    │   ├── PortError          the serial port cannot be opened, or is gone
    │   └── DeviceError        a device does not do what it must: silent, another model, a register that does not take
    └── BenchError             a run on a bench
        ├── StartError         nothing has moved: the bench, the plan or the disk is not as it must be
        └── StoppedError       motors were under power; the rig was brought to its safe state
            ├── LimitError     a measured value went beyond a limit of the rig
            └── LostError      a device fell silent, froze or does not do what it is told
                └── PauseError motors were stopped by their watchdogs because the computer paused

A sentence says what was found, what was expected and what to do. An outcome of good input (a drive
that saturates, a decay that is not exponential) is a field of a result and never an exception.
To the bus a device that is silent, refuses or raises its alert is no exception but an outcome, see
`sinew.hardware.bus`; a motor or sensor that is set up, though, must do as it is told, and raises DeviceError.
"""

from sinew import __version__


class SinewError(Exception):
    """Base of all errors that a user can put right."""


class FileError(SinewError):
    """A file cannot be read or written, or is not what it claims to be."""


class SchemaError(SinewError):
    """A dataset breaks the recording or result schema."""


class UnitError(SinewError):
    """A unit is unknown or of the wrong dimension."""


class SpecError(SinewError):
    """A rig or plan is not valid, or asks for what the rig cannot give."""


class RecordingError(SinewError):
    """The samples cannot answer the question that was asked."""


class TimeError(RecordingError):
    """The time stamps of a recording are unusable."""


class HardwareError(SinewError):
    """Base of what can go wrong between Sinew and a bench."""


class PacketError(HardwareError):
    """A packet that cannot be sent: an id, address or length the protocol does not have."""


class RegisterError(HardwareError):
    """No such register, or a value that it cannot hold."""


class PortError(HardwareError):
    """The serial port cannot be opened, or is gone."""


class DeviceError(HardwareError):
    """A device that does not do what it must: it is silent, of another model, or does not take a register's value."""


TROUBLES = (PacketError, RegisterError, DeviceError)
"""What can go wrong while the port is there, and the others can still be asked."""


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


DISTRIBUTION = "sinew-lab"


def how_to_install(extra: str) -> str:
    """Return the words, after "install it: ", that say how the packages of an extra such as `dashboard` come in."""
    wheel = f"{DISTRIBUTION.replace('-', '_')}-{__version__}-py3-none-any.whl"
    return (
        f'in a clone `.venv/bin/python -m pip install -e ".[{extra}]"`, with a wheel `pip install "{wheel}[{extra}]"`'
    )
