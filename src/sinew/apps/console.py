"""The voice of the commands: results on stdout, progress and remarks on stderr, files whole or not at all."""

import functools
import inspect
import json
import math
import os
import shlex
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer
from typer.core import TyperCommand

from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.result import Table
from sinew.measure.units import number_list as listed
from sinew.measure.units import one_number

if TYPE_CHECKING:
    import xarray as xr

    from sinew.measure.recording import ReadKind
    from sinew.measure.tasks import Spread

Progress = Callable[[float, float], None]

_PIPE_WIDTH = 200


def print_json(document: Any) -> None:
    """Print one JSON document on stdout. NaN and infinity have no JSON form, so they must be null before."""
    sys.stdout.write(_json_text(document))


def write_json(document: Any, path: Path) -> None:
    """Write one JSON document, atomically. Raises FileError where the folder cannot be written."""
    from sinew.measure.validation import write_text

    write_text(path, _json_text(document))


def _json_text(document: Any) -> str:
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None) -> None:
    """Print a table on stdout; the first column is text, the others are right-aligned."""
    print_lines([Table(columns, rows, title)])


def print_lines(lines: Iterable[Table | str]) -> None:
    """Print tables and sentences on stdout."""
    from rich.console import Console  # no --help needs it

    console = Console() if sys.stdout.isatty() else Console(width=_PIPE_WIDTH)
    for one in lines:
        if isinstance(one, Table):
            one.put_on(console)
        else:
            print(one)


def print_result(document: object, lines: Iterable[Table | str], written: str = "", *, json: bool) -> None:
    """Print a result on stdout: its document alone, or what it tells and what was written."""
    if json:
        print_json(document)
    else:
        print_lines([*lines, written] if written else lines)


def remark(sentence: str) -> None:
    """Print a remark on stderr, where it does not disturb what a pipe reads."""
    sys.stderr.write(f"sinew: {' '.join(sentence.split())}\n")


@contextmanager
def progress_bar(task: str) -> Iterator[Progress]:
    """Give a callable that takes (done, total) and shows a bar on stderr; in a pipe it shows nothing."""
    if not sys.stderr.isatty():
        yield lambda _done, _total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        shown = bar.add_task(task, total=None)
        yield lambda done, total: bar.update(shown, completed=done, total=total)


def require_folder(folder: Path) -> Path:
    """Return a folder that can be written, without making it: a run that fails later leaves nothing behind.

    Raises FileError before long work starts, where the folder, or the nearest one above it, takes no file.
    """
    nearest = next(ancestor for ancestor in (folder.absolute(), *folder.absolute().parents) if ancestor.exists())
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise FileError(
            f"cannot write into {folder}: {error.strerror or error}; choose a folder that you may write with --out"
        ) from error
    return folder


PICTURES = (".png", ".pdf", ".svg")
"""How the name of a picture ends."""


def require_ending(path: Path, endings: Sequence[str], *, option: str = "--out") -> Path:
    """Return a path where a file can be written (`require_file`) whose name has one of some endings, else SpecError."""
    if path.suffix not in endings:
        expected = " or ".join(filter(None, (", ".join(endings[:-1]), endings[-1])))
        raise SpecError(f"{option} is {path}, expected a name that ends with {expected}")
    return require_file(path, option=option)


def require_file(path: Path, *, option: str = "--out", reads: str | None = None) -> Path:
    """Return a path where a file can be written, and where none is unless --force was given.

    option: what names it. reads: a file that the command reads. Raises FileError before long work starts.
    """
    if path.exists() and not path.is_dir() and not _may_replace.get():
        what = "is what the command reads" if reads and Path(reads).exists() and path.samefile(reads) else "exists"
        raise FileError(f"{path} {what}; give another name with {option}, or replace it with --force")
    return writable_file(path)


def writable_file(path: Path) -> Path:
    """Return a path where a file can be written, over one that is there. Raises FileError before long work starts."""
    if path.is_dir():
        raise FileError(f"cannot write {path}: it is a folder; name a file in it")
    require_folder(path.parent)
    return path


def require_own(folder: Path, name: str, own: Callable[[Path], bool]) -> Path:
    """Return a folder that can be written, whose file `name` is absent, or an earlier output of the same command.

    own: whether a file that is there is one. Raises FileError for any other file, unless --force was given.
    """
    if (file := folder / name).exists() and not own(file):
        require_file(file)
    return require_folder(folder)


# Arguments and options that several commands share, and what a number or a word on the command line may be.

HIGHEST_HZ = 1000.0
"""Highest frequency that anything may be asked at [Hz]: far above any joint, so that only a slip lies beyond."""

LARGEST_DEG = 180.0
"""Largest amplitude of an angle that may be asked for [deg]."""


def option(metavar: str, help_: str, *flags: str, **more: Any) -> Any:
    """Return an option of a command: what stands for its value, its line in `--help`, its flag unless by its name."""
    return typer.Option(*flags, metavar=metavar, help=help_, **more)


def flag(name: str, help_: str) -> Any:
    """Return an option of a command that has no value."""
    return typer.Option(name, help=help_)


KINDS = "auto|ring-down|sweep|broadband|impact"
"""Kinds of a table, as `--help` lists them."""

RIG_HELP = "A rig: a TOML file, or the name of a shipped one."

PlanArgument = Annotated[str, typer.Argument(metavar="PLAN", help="A plan: a TOML file, or the name of a shipped one.")]
RigArgument = Annotated[str, typer.Argument(metavar="RIG", help=RIG_HELP)]
Rig = Annotated[str, option("RIG", RIG_HELP, "--rig")]
Without = Annotated[
    list[str] | None, option("EFFECT", "Switch an effect of the twin off; may be repeated.", "--without")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of scatter, noise and jitter.")]
Json = Annotated[bool, flag("--json", "Print one JSON document on stdout.")]
ColumnTime = Annotated[str | None, option("COL[:unit]", "Column of the time stamps.", "--time")]
ColumnResponse = Annotated[
    str | None,
    option("COL[:unit]", "Column of the response; several are averaged: COL,COL:unit.", "--response", "--output"),
]
ColumnDrive = Annotated[str | None, option("COL[:unit]", "Column of the drive.", "--drive", "--input")]
Start = Annotated[float | None, option("S", "Take samples from this time on [s].", "--start")]
Stop = Annotated[float | None, option("S", "Take samples up to this time [s].", "--stop")]
Gaps = Annotated[str, option("refuse|split|bridge", "What to do where samples are missing.", "--gaps")]
Run = Annotated[str | None, option("N|NAME", "Which run, of a file that holds several.", "--run")]
Columns = Annotated[
    str | None, option("NAME,NAME,...", "Names for all columns, in their order, instead of the file's.", "--columns")
]
Rate = Annotated[float | None, option("HZ", "Samples per second, where there is no time column.", "--rate")]
Settle = Annotated[
    float | None,
    option("S", "Sweep: how long each group settles before it is measured [s]; else its half.", "--settle"),
]

Scheduler = Annotated[
    str | None, option("ADDRESS", "A Dask scheduler whose workers do it, as tcp://host:8786.", "--scheduler")
]
Workers = Annotated[int, option("N", "Instead: so many processes of this computer.", "--workers", min=1)]
Keep = Annotated[Path | None, option("FILE", "Keeps results as they come, and goes on from them.", "--keep")]
Device = Annotated[str, option("cpu|gpu", "What computes; a GPU where JAX finds one.", "--device")]


def spread_of(scheduler: str | None, workers: int, keep: Path | None, device: str = "cpu") -> "Spread":
    """Return where the options say that tasks run. Raises SinewError where they cannot."""
    from sinew.measure.tasks import DEVICE, Spread

    if keep is not None:
        writable_file(keep)  # it goes on from what is there
    spread = Spread(scheduler, workers, keep, device)
    if scheduler is None and device != "cpu":
        os.environ[DEVICE] = device  # also of what is computed between tasks
    return spread


def read_csv(
    file: Path,
    kind: str,
    time: str | None,
    response: str | None,
    drive: str | None,
    start: float | None,
    stop: float | None,
    gaps: str,
    run: str | None,
    columns: str | None,
    rate: float | None,
) -> "xr.Dataset":
    """Return somebody's file as a recording, with the words of the command line checked. Raises SinewError."""
    from sinew.measure.read import read  # pandas and xarray: not for --help
    from sinew.measure.recording import IMPORT_SEGMENTS

    check_choice("--kind", kind, IMPORT_SEGMENTS)
    return read(
        file,
        time=time,
        response=response,
        drive=drive,
        kind=cast("ReadKind", kind),
        start_s=start,
        stop_s=stop,
        gaps=checked_gaps(gaps),
        run=run,
        columns=columns,
        rate_hz=rate,
    )


def checked_gaps(gaps: str) -> Literal["refuse", "split", "bridge"]:
    """Return the word of --gaps. Raises SpecError where it is none."""
    check_choice("--gaps", gaps, ("refuse", "split", "bridge"))
    return cast(Literal["refuse", "split", "bridge"], gaps)


def check_choice(option: str, found: str, expected: Iterable[str]) -> None:
    """Do nothing where a word is in a list; else raise SpecError, which shows the list."""
    if found not in expected:
        raise SpecError(f"{option} is {found!r}, expected one of {', '.join(expected)}")


_may_replace: ContextVar[bool] = ContextVar("may_replace", default=False)
"""Whether the command that runs was given --force."""

_WRITES = {"out", "truth"}
"""Parameters of commands that name what is written."""


def with_force(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command that has the option --force as well, where it writes files; see `require_file`."""
    given = inspect.signature(command)
    if _WRITES.isdisjoint(given.parameters):
        return command

    @functools.wraps(command)
    def forced(*args: Any, force: bool = False, **kwargs: Any) -> Any:
        before = _may_replace.set(force)
        try:
            return command(*args, **kwargs)
        finally:
            _may_replace.reset(before)

    force_option = Annotated[bool, flag("--force", "Replace files that this command did not write.")]
    own = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in given.parameters.values()]
    option = inspect.Parameter("force", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=force_option)
    forced.__signature__ = given.replace(parameters=[*own[:-1], option, own[-1]])  # type: ignore[attr-defined]
    forced.__annotations__ = command.__annotations__ | {"force": force_option}
    return forced


_OF_THIS_CALL = {"json", "force", "scheduler", "workers", "keep", "device"}
"""Parameters of commands that say where and how something is done, not what."""


def given_options(context: typer.Context) -> dict[str, str]:
    """Return what the command line holds: options as they are written, by the parameter that each gives."""
    given = [one for one in context.command.params if one.name and _is_given(context, one.name)]
    return {
        str(one.name): getattr(one, "metavar", one.name) if one.opts == [one.name] else one.opts[0] for one in given
    }


def command_line(context: typer.Context) -> str:
    """Return the command line that asks for the same again, its options in the order of `--help`."""
    words = ["sinew", str(context.command.name)]
    for one in context.command.params:
        if one.name is None or one.name in _OF_THIS_CALL or not _is_given(context, one.name):
            continue
        value = context.params[one.name]
        named = [] if one.param_type_name == "argument" else [one.opts[0]]
        if isinstance(value, bool):
            words += named if value else one.secondary_opts[:1]
            continue
        for each in value if isinstance(value, list | tuple) else [value]:
            words += [*named, f"{each:.12g}" if isinstance(each, float) else str(each)]
    return shlex.join(words)


def _is_given(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


_TABLES = {"{models}": "sinew.identify.oscillator.model:MODELS", "{keys}": "sinew.predict.oscillator:KEYS"}
"""Tables whose names an option lists in its help, by what stands for them there."""


class NumbersCommand(TyperCommand):
    """A command that refuses what no option can mean: an empty word, and a number that is none or has no end."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for index, word in enumerate(args):
            if word == "" or (word.startswith("--") and word.endswith("=")):
                before = args[index - 1] if word == "" and index else word.removesuffix("=")
                raise SpecError(f"found nothing after {before or 'sinew'}, expected a value; write one or leave it out")
        return list(super().parse_args(ctx, args))

    def format_options(self, ctx: Any, formatter: Any) -> None:
        for parameter in self.params:
            for stands, table in _TABLES.items():
                if stands in (help_ := getattr(parameter, "help", None) or ""):  # JAX: for the --help that needs it
                    parameter.help = help_.replace(stands, ", ".join(resolve_name(table)))  # type: ignore[attr-defined]
        super().format_options(ctx, formatter)

    def invoke(self, ctx: Any) -> Any:
        for parameter in self.params:
            value = ctx.params.get(parameter.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise SpecError(f"{parameter.opts[0]} is {value:g}, expected a finite number")
        return super().invoke(ctx)


class PortCommand(NumbersCommand):
    """A command of a bench: its ports, sockets and processes are those of Linux and macOS."""

    def invoke(self, ctx: Any) -> Any:
        try:
            import fcntl  # noqa: F401 - on every POSIX system, and on no other
        except ModuleNotFoundError as missing:
            raise SinewError(
                f"sinew {self.name} needs the ports of Linux or macOS, which Windows does not have; run it in WSL, "
                "and attach the USB adapter there (usbipd attach --wsl)"
            ) from missing
        return super().invoke(ctx)


def number_list(
    option: str,
    text: str,
    expected: str,
    *,
    between: str = ",",
    low: float = -math.inf,
    high: float = math.inf,
    above: bool = False,
) -> list[float]:
    """Return the numbers of an option that takes several.

    expected: what the words "expected ..." say. low, high: what each may be; above: low itself is not allowed.
    Raises SpecError where one is no number, not finite, or outside.
    """
    try:
        values = listed(text) if between == "," else [one_number(part) for part in text.split(between)]
    except ValueError as error:
        raise SpecError(f"{option} is {text!r}: {error} ({expected})") from error
    return [checked_number(option, value, expected, low=low, high=high, above=above, of="holds") for value in values]


def checked_number(
    option: str,
    value: float,
    expected: str,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    above: bool = False,
    of: str = "is",
) -> float:
    """Return a number unchanged. Raises SpecError where it is not finite or lies outside low to high."""
    if not math.isfinite(value) or not low <= value <= high or (above and value == low):
        raise SpecError(f"{option} {of} {value:g}, expected {expected}")
    return value


def checked_band(band_hz: Sequence[float]) -> tuple[float, float]:
    """Return --from-hz and --to-hz unchanged. Raises SpecError unless they are a band of positive frequencies."""
    low, high = band_hz
    if not 0 < low < high <= HIGHEST_HZ:
        raise SpecError(
            f"found a band from {low:g} to {high:g} Hz, expected 0 < --from-hz < --to-hz, up to {HIGHEST_HZ:g} Hz"
        )
    return low, high
