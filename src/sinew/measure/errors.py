"""The error tree: names for bad input.

    SinewError                 anything a user can put right; the command line exits 2 with its sentence
    ├── FileError              a file cannot be read or written, or is not what it claims to be
    ├── SchemaError            a dataset breaks the recording or result schema
    ├── UnitError              a unit is unknown or of the wrong dimension
    ├── SpecError              a rig or plan is not valid, or asks for what the rig cannot give
    └── RecordingError         the samples cannot answer the question (gap, NaN, too short, growing, ...)
        └── TimeError          the time stamps are unusable (backwards, gap, not enough)

A sentence says what was found, what was expected and what to do. An outcome of good input (a drive
that saturates, a decay that is not exponential) is a field of a result and never an exception.
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


DISTRIBUTION = "sinew-lab"


def how_to_install(extra: str) -> str:
    """Return the words, after "install it: ", that say how the packages of an extra such as `dashboard` come in."""
    wheel = f"{DISTRIBUTION.replace('-', '_')}-{__version__}-py3-none-any.whl"
    return (
        f'in a clone `.venv/bin/python -m pip install -e ".[{extra}]"`, with a wheel `pip install "{wheel}[{extra}]"`'
    )
