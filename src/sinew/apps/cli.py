"""The command `sinew`: its parts put together, and an error as one line and an exit status.

Exit status: 0 on success, 1 where a bench run, stop or doctor did not end well, 2 on wrong input (one line on stderr),
130 when interrupted. Any other exception is a fault of Sinew's own and keeps its
traceback.
"""

import inspect
import io
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pkgutil import resolve_name
from typing import Annotated, Any, cast

import typer
from typer.core import TyperCommand, TyperGroup

from sinew import __version__
from sinew.apps import console
from sinew.measure.errors import SinewError, SpecError

COMMANDS: dict[str, tuple[str, ...]] = {
    "recordings.simulate:check": ("sinew check plans/paper.toml --rig rigs/paper.toml",),
    "recordings.simulate:simulate": (
        "sinew simulate short --rig paper --out run/recording.nc --without guide_friction",
    ),
    "recordings.convert:look": ("sinew look swing.csv",),
    "recordings.analyse:analyse": (
        "sinew analyse chirp.csv --kind broadband --time t_s --response phi:deg --drive u:N*m --out chirp",
        "sinew analyse decay.csv --kind ring-down --time t_s --response angle:deg --json",
    ),
    "recordings.runs:runs": (
        'sinew runs runs --search "aged f_r=3.2.. pretension=6"',
        "sinew runs runs --search pretension=6 --trend f_r --out ageing.svg",
    ),
    "recordings.identify:identify": (
        "sinew identify a.csv --time t_s --input u:N*m --output phi:deg --excitation torque --json",
    ),
    "joints.design:calibrate": ("sinew calibrate rigs/paper.toml monday.nc tuesday.nc --out rigs/mine.toml",),
    "joints.predict:predict": (
        "sinew predict fit/fit.json --torque 1,2,4:V --through 3.1:12+-0.2:deg@2",
        "sinew predict paper ring.toml --pretension-mm 0,6,12 --out out/compared",
        "sinew predict rigs/paper.toml --pretension-mm 0,6,12 --json",
    ),
    "joints.pose:model": (
        "sinew model paper --to matlab --pretension-mm 0,4,8 --out out/transfer.mat",
        "sinew model paper --pretension-mm 6 --bend-deg 10 --out bent.xml --json",
    ),
    "joints.pose:modes": (
        "sinew modes rigs/paper.toml --pretension-mm 0,6,12 --bend-deg 0,10,20 --out out/modes.html",
    ),
    "joints.design:joint": ("sinew joint --section circle --outer-mm 60 --out sixty.toml",),
    "joints.design:tune": ("sinew tune rigs/paper.toml --resonance-hz 3.2,3.6,4 --yaw-deg 7 --json",),
    "joints.pose:pose": (
        "sinew pose paper --map --pretension-mm 0,6,12 --step-deg 4 --out map.png",
        "sinew pose paper --pretension-mm 6 --bend-deg 20 --azimuth-deg 90 --out bent.png",
    ),
    "joints.design:design": (
        "sinew design --walk slow.npz --walk fast.npz --gait-only --json",
        "sinew design --stride-hz 0.7:1.1 --yaw-deg 7 --inertia-kg-m2 0.25 --out out/torso",
    ),
    "recordings.convert:import_": ("sinew import decay.csv --time t_s --response angle:deg --out decay.nc",),
    "recordings.convert:export": (
        "sinew export out/paper --to latex --part resonance --columns pretension_mm,resonance_hz --out resonance.tex",
        "sinew export runs/monday --to foxglove --ws-port 8765",
        "sinew export run/recording.nc --to mat --out run/recording.mat",
    ),
    "bench.emulate:emulate": ("sinew emulate --rig paper --link /tmp/bench --fault unplug@60 --seed 1",),
    "bench.doctor:doctor": (
        "sinew doctor --port /dev/ttyUSB0 --rig rigs/paper.toml --fix",
        "sinew doctor --port /dev/ttyUSB0 --guide my-rig.toml",
    ),
    "bench.run:run": ("sinew run short --rig paper --port /dev/ttyUSB0 --out out/bench",),
    "bench.track:track": ("sinew track paper --emulate --pretension-mm 0,4,8,12 --out out/backbone",),
    "bench.serve:serve": ("sinew serve --emulate --runs runs",),
    "bench.run:stop": ("sinew stop --port /dev/ttyUSB0 --state release",),
    "recordings.reproduce:report": (
        "sinew report run/recording.nc --answers --film sweep --pretension-mm 6",
        "sinew report paper --azimuth-deg 0 --out out/bent",
    ),
    "recordings.reproduce:reproduce": ("sinew reproduce --out out/paper --seed 1",),
}
"""The function of each command, below `sinew.apps`, with examples."""

GROUPS = {
    "The paper": ("reproduce", "report"),
    "Bench": ("check", "emulate", "doctor", "run", "stop", "track", "serve"),
    "Recordings": (
        "look",
        "import",
        "analyse",
        "identify",
        "runs",
        "simulate",
        "export",
    ),
    "Joints": ("predict", "tune", "design", "joint", "pose", "modes", "model", "calibrate"),
}
"""Commands as `sinew --help` lists them."""


JOINED = {
    "answer": "report --answers",
    "compare": "predict RIG RIG...",
    "film": "report --film",
    "gait": "design --walk",
    "table": "export --to latex",
    "stream": "export --to foxglove",
    "current": "analyse --kind current",
    "workspace": "pose --map",
    "transfer": "model --to control",
}
"""What does today what a command of an earlier version did."""


class _Commands(Mapping[str, TyperCommand]):
    """The commands by name, each made, and its module loaded, when it is asked for: a call needs one of them."""

    def __init__(self) -> None:
        self.places = {location.rpartition(":")[2].rstrip("_"): location for location in COMMANDS}

    def __iter__(self) -> Iterator[str]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, name: str) -> TyperCommand:
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        epilog = "\n\n".join(f"Example: {one}" for one in COMMANDS[self.places[name]])
        needs_port = self.places[name].startswith("bench.")
        kind = console.PortCommand if needs_port else console.NumbersCommand
        function = self.function(name)
        if not needs_port or name == "emulate":  # what a bench gave is never replaced
            function = console.with_force(function)
        alone.command(name, cls=kind, epilog=epilog)(function)
        return cast(TyperCommand, typer.main.get_command(alone))

    def function(self, name: str) -> Any:
        """Return the function that a command calls."""
        return resolve_name(f"sinew.apps.{self.places[name]}")


class _Group(TyperGroup):
    """The group of `COMMANDS`."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands = _Commands()  # type: ignore[assignment]

    def list_commands(self, ctx: Any) -> list[str]:
        return list(self.commands)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and (today := JOINED.get(args[0])):
            raise SpecError(f"sinew {args[0]} is now sinew {today}; see sinew {today.split()[0]} --help")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        named = cast(_Commands, self.commands)
        width = formatter.width - 6 - max(map(len, named))
        for title, names in GROUPS.items():
            whole = [TyperCommand(name, help=inspect.getdoc(named.function(name))) for name in names]
            with formatter.section(title):
                formatter.write_dl([(str(one.name), one.get_short_help_str(width)) for one in whole])


app = typer.Typer(
    name="sinew",
    cls=_Group,
    help="Sinew: a resonance laboratory for tendon-driven continuum joints, in software.",
    epilog="Example: sinew reproduce --out out/paper",
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def _sinew(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False,
) -> None:
    if version:
        print(f"sinew {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line (`sys.argv` by default, of a process of its own) and return its exit status."""
    if arguments is None:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a second one mostly waits for the first
        if isinstance(sys.stdout, io.TextIOWrapper):  # a pipe on Windows has no Greek letters; JSON reads \\u03bb too
            sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = app(args=None if arguments is None else list(arguments), standalone_mode=False, prog_name="sinew")
        if sys.stdout is not None:
            sys.stdout.flush()
    except SinewError as error:
        return _refuse(str(error), 2)
    except typer.TyperException as error:
        return _refuse(getattr(error, "format_message", error.__str__)(), 2)
    except (KeyboardInterrupt, typer.Abort):
        return _refuse("interrupted; what was being written is not there, what was finished is", 130)
    except BrokenPipeError:
        # The reader of a pipe has left (`sinew ... | head`); without this Python complains again while it exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return status if isinstance(status, int) else 0


def _refuse(sentence: str, status: int) -> int:
    print(f"sinew: {' '.join(sentence.split())}", file=sys.stderr)
    return status
